"""Coefficients of Radau IIA with three stages, and the linear systems of its stages.

Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, §IV.5 and §IV.8.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra import ldl
from flexmb.engine.algebra.vector import copy, scaled_size, weighted_size
from flexmb.engine.iteration_matrix import factorise_pair, keep_diagonal, put_matrix, put_rows
from flexmb.engine.jit import Matrix, Vector, kernel, unit
from flexmb.engine.method import FINE
from flexmb.engine.state import Run

STAGES = 3
_ALMOST_ZERO = 1e-300


class Radau(NamedTuple):
    """Coefficients: A, A⁻¹ = V diag(γ, μ, μ̄) V⁻¹, and those of the error estimate."""

    A: Matrix  # (3, 3)
    inverse: Matrix  # (3, 3)
    c: Vector  # (3,)
    gamma: float
    filter: float  # 1/γ²
    mu_real: float
    mu_imag: float
    to: Matrix  # (3, 3) rows of V⁻¹: of γ; real and imaginary part of that of μ
    back: Matrix  # (3, 3) columns of V: of γ; of μ twice the real, less twice the imaginary part
    error: Vector  # (3,) weights of the increments of the stages
    bend: Vector  # (2,) of what the inner stages are off the cubic of the dense output
    jerk: Vector  # (3,) of the velocities of the stages: h² of their second rate
    works: Matrix  # (4, 4) of s, s², s³, s⁴ in the work: of the powers at 0, c₁, c₂, 1


def radau_coefficients() -> Radau:
    """Those of order 5."""
    s = 6.0**0.5
    A = np.array(
        [
            [(88 - 7 * s) / 360, (296 - 169 * s) / 1800, (-2 + 3 * s) / 225],
            [(296 + 169 * s) / 1800, (88 + 7 * s) / 360, (-2 - 3 * s) / 225],
            [(16 - s) / 36, (16 + s) / 36, 1 / 9],
        ]
    )
    inverse = np.linalg.inv(A)
    values, vectors = np.linalg.eig(inverse)
    order = [int(np.argmin(abs(values.imag))), int(np.argmax(values.imag))]
    rows = np.linalg.inv(vectors)
    gamma, mu = float(values[order[0]].real), complex(values[order[1]])
    # V is known but for a factor of each column, a complex one for γ too
    factor = 1.0 / rows[order[0], np.argmax(abs(rows[order[0]]))]
    first, of_first = (rows[order[0]] * factor).real, (vectors[:, order[0]] / factor).real
    second, of_second = rows[order[1]], vectors[:, order[1]]
    return Radau(
        A, inverse, A.sum(axis=1), gamma, 1.0 / gamma**2, mu.real, mu.imag,
        np.array([first, second.real, second.imag]),
        np.array([of_first, 2.0 * of_second.real, -2.0 * of_second.imag]),
        np.array([-13.0 - 7.0 * s, -13.0 + 7.0 * s, -1.0]) / (3.0 * gamma),
        _bend(A), 2.0 * np.linalg.inv(np.vander(A.sum(axis=1), increasing=True))[2],
        np.linalg.inv(np.vander([0.0, *A.sum(axis=1)], increasing=True))
        / np.arange(1.0, 5.0)[:, None],
    )  # fmt: skip


def _bend(A: Matrix) -> Vector:
    """Weights of what both inner stages are off the cubic of the dense output.

    The motion leaves the cubic by c² (1 − c)²/24 h⁴ u⁗. At the stages of smooth parts h⁴ u⁗ is seen
    less by their own error, Σ aᵢⱼ cⱼ³/6 − cᵢ⁴/24; stages that constraints determine have none. The
    weights tell it from both.
    """
    c = A.sum(axis=1)
    off = (c**2 * (1.0 - c) ** 2 / 24.0)[:2]
    own = (A @ c**3 / 6.0 - c**4 / 24.0)[:2]
    return np.linalg.solve([off, off + own], [1.0 / 24.0, 1.0 / 24.0])


@unit
def factorise_stages(run: Run, radau: Radau, h: float) -> int:
    """Assemble and factor S(h/γ) and S(h/μ) at the stage evaluated last."""
    fac, col, kkt, at = run.work.factor, run.work.collocation, run.system.kkt, run.trial_point
    pair, real, memory = col.pair, col.real, run.state.memory[0]
    n = radau.mu_real**2 + radau.mu_imag**2
    x, y = radau.mu_real * h / n, -radau.mu_imag * h / n
    fac.symmetric[0] = int(memory["symmetric"])
    pair.symmetric[0] = fac.symmetric[0]
    for i in range(pair.low.shape[0]):
        pair.low[i] = pair.up[i] = 0.0
    put_matrix(run, at, _ALMOST_ZERO, 0.0)  # the mass of motion, not that of single solves
    _add_matrix(pair, fac, -1j)
    put_matrix(run, at, y, 2.0 * x * y)
    _add_matrix(pair, fac, 1j)
    put_matrix(run, at, x, x * x - y * y)
    _add_matrix(pair, fac, 1.0 + 0j)
    c = h / radau.gamma
    put_matrix(run, at, c, c * c)
    _add_matrix(pair, fac, -1.0 + 0j)
    keep_diagonal(kkt.panels, fac.low, fac.diagonal)
    put_rows(run, at, c, c * c)
    _add_matrix(pair, fac, 1.0 + 0j)  # the rows alone
    run.state.count[0]["regularised_pivots"] += factorise_pair(run, pair)
    copy(fac.low, real.low)
    copy(fac.up, real.up)
    copy(fac.d, real.d)
    copy(fac.eps, real.eps)
    real.symmetric[0] = fac.symmetric[0]
    run.state.count[0]["factorisations"] += 2
    memory["factor_age"], memory["contraction"], memory["factor_step"] = 0.0, 1.0, h
    return FINE


@kernel
def _add_matrix(pair, fac, f):
    """pair += f times the assembled matrix."""
    for i in range(pair.low.shape[0]):
        pair.low[i] += f * fac.low[i]
        pair.up[i] += f * fac.up[i]


@kernel
def correct_stages(run, radau, h, floor):
    """Newton correction of all stages, into their motions and multipliers; its two sizes.

    Over motion and speed counts what is above the floor.
    """
    st, col, kkt, weights = run.state, run.work.collocation, run.system.kkt, run.system.weights
    place, nv = kkt.place, st.v.shape[0]
    real, pair, to, back = col.real, col.pair, radau.to, radau.back
    x, z, eps = real.sol, pair.sol, real.eps
    c = h / radau.gamma
    m = h / complex(radau.mu_real, radau.mu_imag)
    for k in range(nv):
        r, p, q = _transformed(to, col.res, k)
        x[place[k]] = -c * c * r
        z[place[k]] = -m * m * complex(p, q)
    for k in range(st.lam.shape[0]):
        # Regularised towards those that the points before share the least among redundant rows;
        # towards zero each step would yield to its reactions.
        i = place[nv + k]
        r, p, q = _transformed(to, col.gap, k)
        lr, lp, lq = _transformed(to, col.lam, k)
        nr, np_, nq = _transformed(to, col.next_lam, k)
        x[i] = eps[i] * c * c * (lr - nr) - r
        z[i] = eps[i] * m * m * complex(lp - np_, lq - nq) - complex(p, q)
    ldl.solve(kkt, real, x)
    ldl.solve_complex(kkt, pair)
    for k in range(nv):
        r, y = x[place[k]], z[place[k]]
        for i in range(STAGES):
            d = back[0, i] * r + back[1, i] * y.real + back[2, i] * y.imag
            col.u[i, k] += d
            col.change[i, k] = d
    for k in range(st.lam.shape[0]):
        i = place[nv + k]
        r, y = x[i] / (c * c), z[i] / (m * m)
        for n in range(STAGES):
            col.lam[n, k] += back[0, n] * r + back[1, n] * y.real + back[2, n] * y.imag
    size, moved = 0.0, 0.0
    for i in range(STAGES):
        moved = max(moved, weighted_size(col.change[i], weights))
        if run.settings.step == 0.0:
            size = max(size, scaled_size(col.change[i], weights, st.motion, floor))
            size = max(size, scaled_size(col.change[i], weights, st.speed, floor) / h)
    if run.settings.step > 0.0:
        size = moved
    return size, moved


@kernel
def _transformed(to, rows, k):
    """Column k of three stages by the eigenvectors: of γ, real and imaginary part of that of μ."""
    a, b, c = rows[0, k], rows[1, k], rows[2, k]
    return (
        to[0, 0] * a + to[0, 1] * b + to[0, 2] * c,
        to[1, 0] * a + to[1, 1] * b + to[1, 2] * c,
        to[2, 0] * a + to[2, 1] * b + to[2, 2] * c,
    )
