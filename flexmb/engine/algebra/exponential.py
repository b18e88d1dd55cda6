"""exp(h A) x of vibrations, by a Chebyshev series in the matrix.

Source: Tal-Ezer & Kosloff, J. Chem. Phys. 81 (1984) 3967.
"""

from __future__ import annotations

from flexmb.engine.algebra.vector import weighted_max
from flexmb.engine.jit import Integers, Matrices, Matrix, Vector, kernel, unit


@unit
def put_exponential(
    A: Matrices, load: Matrices, rates: Vector, is_plain: Integers, weights: Vector,
    coefficients: Matrix, x: Vector, work: Matrix, largest: float, row: int, series: int,
    terms: int, h: float, radius: float,
) -> float:  # fmt: skip
    """x = exp(h A) x in place for ẋ = A[row] x + (0, f), x = (η, η̇/ω, 1, 0); returns the growth.

    f goes from load[row, 0] by load[row, 1] in a step h; the last two of x belong to it. `is_plain`
    tells the η whose rate is `rates` times their η̇/ω. The coefficients are those of a `radius` that
    holds all frequencies times h. Growth is that of the largest term, by weights, over x; where it
    is above `largest`, x is not changed.
    """
    n = x.shape[0]
    before, now, total = work[0], work[1], work[2]
    size = weighted_max(x, weights)
    if size == 0.0:
        return 0.0
    _vibration_product(A, load, rates, is_plain, row, h, radius, x, now)
    c0, c1 = coefficients[series, 0], coefficients[series, 1]
    for i in range(n):
        before[i] = x[i]
        total[i] = c0 * x[i] + c1 * now[i]
    growth = 1.0
    after = work[3]
    for j in range(2, terms):
        _vibration_product(A, load, rates, is_plain, row, h, radius, now, after)
        c = coefficients[series, j]
        for i in range(n):
            term = 2.0 * after[i] + before[i]
            before[i] = now[i]
            now[i] = term
            total[i] += c * term
        grown = weighted_max(now, weights) / size
        if not grown < largest:  # or not a number
            return grown
        growth = max(growth, grown)
    for i in range(n):
        x[i] = total[i]
    return growth


@kernel
def _vibration_product(A, load, rates, is_plain, row, h, radius, x, out):
    """out = h A x / radius, with the loads."""
    n = x.shape[0] - 2
    u = n // 2
    f = h / radius
    for i in range(u):
        if is_plain[i]:
            out[i] = f * rates[i] * x[u + i]
        else:
            total = 0.0
            for j in range(n):
                total += A[row, i, j] * x[j]
            out[i] = f * total
    for i in range(u):
        total = load[row, 0, i] * x[n] + load[row, 1, i] * x[n + 1]
        for j in range(n):
            total += A[row, u + i, j] * x[j]
        out[u + i] = f * total
    out[n] = 0.0
    out[n + 1] = x[n] / radius
