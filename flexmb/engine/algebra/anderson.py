"""Anderson acceleration of a fixed-point iteration x ← x + f(x).

The next iterate is x + f − Σ γ_j (Δx_j + Δf_j), with γ minimising |f − Σ γ_j Δf_j| over differences
of the last iterates. For a linear f it is equivalent to the generalised minimal residual method, so
it converges where the plain iteration diverges.

Source: Walker & Ni, SIAM J. Numer. Anal. 49 (2011) 1715.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import copy
from flexmb.engine.jit import Integers, Matrix, Vector, kernel

DEPTH = 8
"""Largest number of differences of iterates."""
# A difference Δf of unit length depends on the later ones if what is left of it after
# orthogonalisation is shorter than this; it is then not used.
_DEPENDENT = 1e-12


class Iterates(NamedTuple):
    """Scaled iterates of n unknowns, and the QR decomposition of their differences."""

    now: Vector  # (n,) present iterate x; `accelerate` overwrites it
    step: Vector  # (n,) f(x); `accelerate` replaces it by the accelerated step
    last: Vector  # (n,) previous iterate
    last_step: Vector  # (n,) f of it
    moves: Matrix  # (DEPTH, n) differences Δx + Δf, over |Δf|
    changes: Matrix  # (DEPTH, n) differences Δf, over |Δf|
    base: Matrix  # (DEPTH, n) Q: orthonormal basis of the changes, the last one first
    shares: Matrix  # (DEPTH, DEPTH) R of changes = Q R
    least: Vector  # (DEPTH,) coefficients γ of least squares
    count: Integers  # (1,) iterates so far


def new_iterates(n: int) -> Iterates:
    """Room for iterates of n unknowns."""
    vectors = (np.zeros(n) for _ in range(4))
    tables = (np.zeros((DEPTH, n)) for _ in range(3))
    square, least = np.zeros((DEPTH, DEPTH)), np.zeros(DEPTH)
    return Iterates(*vectors, *tables, square, least, np.zeros(1, np.int64))


@kernel
def accelerate(of, grows):
    """Store the present iterate; if the plain iteration diverges (`grows`), accelerate its step."""
    n, k, m = of.now.shape[0], of.count[0], min(of.count[0], of.moves.shape[0])
    if k > 0:
        slot, square = (k - 1) % of.moves.shape[0], 0.0
        for i in range(n):
            of.changes[slot, i] = of.step[i] - of.last_step[i]
            of.moves[slot, i] = of.now[i] - of.last[i] + of.changes[slot, i]
            square += of.changes[slot, i] ** 2
        for i in range(n):
            of.changes[slot, i] /= math.sqrt(square) if square > 0.0 else 1.0
            of.moves[slot, i] /= math.sqrt(square) if square > 0.0 else 1.0
    copy(of.now, of.last)
    copy(of.step, of.last_step)
    of.count[0] = k + 1
    if not grows:
        return
    _solve_least_squares(of, m)
    for j in range(m):
        for i in range(n):
            of.step[i] -= of.least[j] * of.moves[j, i]


@kernel
def _solve_least_squares(of, m):
    """Least-squares coefficients of f by m changes: Gram–Schmidt, twice for accuracy."""
    depth, last = of.moves.shape[0], of.count[0] - 2
    base, shares, left = of.base, of.shares, of.now
    copy(of.last_step, left)
    for j in range(m):
        copy(of.changes[(last - j) % depth], base[j])
        for i in range(j + 1):
            shares[i, j] = 0.0
        for _ in range(2):
            for i in range(j):
                part = _dot(base[i], base[j])
                shares[i, j] += part
                _subtract(part, base[i], base[j])
        length = math.sqrt(_dot(base[j], base[j]))
        for i in range(base.shape[1]):
            base[j, i] = base[j, i] / length if length > _DEPENDENT else 0.0
        shares[j, j] = length if length > _DEPENDENT else 0.0
        of.least[(last - j) % depth] = _dot(base[j], left)
        _subtract(of.least[(last - j) % depth], base[j], left)
    for j in range(m - 1, -1, -1):
        k = (last - j) % depth
        for i in range(j + 1, m):
            of.least[k] -= shares[j, i] * of.least[(last - i) % depth]
        of.least[k] = of.least[k] / shares[j, j] if shares[j, j] > 0.0 else 0.0


@kernel
def _dot(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel
def _subtract(f, a, b):
    """b −= f a."""
    for i in range(a.shape[0]):
        b[i] -= f * a[i]
