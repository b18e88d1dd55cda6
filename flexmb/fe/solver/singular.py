"""Whether a stiffness matrix is singular, and which part of the model then moves freely.

In: a symmetric stiffness matrix and something that solves with it. Out: the softest motion and its
stiffness relative to the diagonal (inverse iteration on the matrix scaled to a unit diagonal, which
has no units), and an error that names the part that this motion moves. The quotient is formed with
the matrix itself, not with its factors: rounding leaves 1e-16 in it, while a cantilever of 2000
beam elements in a row still has 3e-14.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from flexmb.errors import ReductionError
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = [
    "SHIFT",
    "NotPositive",
    "SingularMatrix",
    "free_part",
    "require_stiff",
    "softest",
    "stiffness_scale",
]

SHIFT = 1e-10  # added to the unit diagonal to look for free motions of a matrix that has no factor
_SINGULAR = 2e-15  # softer than this relative to the diagonal is free
_MOVES = 1e-4  # share of the largest entry from which an unknown moves


class NotPositive(ArithmeticError):
    """A pivot is not positive; ``index`` is its row of the matrix."""

    def __init__(self, index: int) -> None:
        super().__init__(f"the pivot of row {index} is not positive")
        self.index = index


class SingularMatrix(ReductionError):
    """A part of the model is held by nothing; ``dofs`` are its unknowns (rows of the matrix)."""

    dofs: IntArray = np.zeros(0, dtype=int)


def stiffness_scale(K: csr_array) -> FloatArray:
    """(n,) factors that give the matrix a unit diagonal.

    Raises
    ------
    SingularMatrix
        An entry of the diagonal is not positive; ``dofs`` are these rows.
    """
    diagonal = K.diagonal()
    bad = np.flatnonzero(~(diagonal > 0))
    if len(bad):
        what = f"{len(bad)} degrees of freedom without stiffness, the first is number {bad[0]}"
        raise _error(f"the stiffness matrix has {what}", bad)
    return 1.0 / np.sqrt(diagonal)


def softest(
    K: csr_array, solve: Callable[[FloatArray], FloatArray], steps: int = 2
) -> tuple[float, FloatArray]:
    """The smallest stiffness relative to the diagonal, and its motion (n,), about.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.
    solve : callable
        Solution with K, or with K and a small shift.
    steps : int
        Inverse iterations.
    """
    scale = stiffness_scale(K)
    z = np.cos(np.arange(len(scale)))
    for _ in range(steps):
        z = solve(z / scale) / scale
        z /= np.abs(z).max()
    x = scale * z
    return float(x @ (K @ x) / (z @ z)), x


def require_stiff(
    K: csr_array, solve: Callable[[FloatArray], FloatArray], points: FloatArray | None = None
) -> None:
    """Refuse a matrix that leaves a motion free; ``points`` (n, 3) say where its unknowns are.

    Raises
    ------
    SingularMatrix
        Names the part that moves.
    """
    quotient, x = softest(K, solve)
    if not quotient > _SINGULAR:
        raise free_part(K, x, points)


def free_part(K: csr_array, motion: FloatArray, points: FloatArray | None = None) -> SingularMatrix:
    """The error that names what moves in a motion without stiffness.

    Parameters
    ----------
    K : (n, n) sparse
        Stiffness.
    motion : (n,) float
        A vector that K takes to zero, such as that of :func:`softest`.
    points : (n, 3) float, optional
        Position of each unknown [m].
    """
    size = np.abs(motion / stiffness_scale(K))
    dofs = np.flatnonzero(size > _MOVES * size.max())
    if points is None:
        part = f"{len(dofs)} of {len(size)} unknowns move, the first is number {dofs[0]}"
    else:
        nodes = np.unique(points[dofs], axis=0)
        low, high = (_place(end) for end in (nodes.min(axis=0), nodes.max(axis=0)))
        part = f"its {len(nodes)} nodes lie between {low} and {high} m"
    return _error(
        "the stiffness matrix with all interfaces held is singular: a part moves freely "
        f"({part}); hold it by an interface, connect it to the rest by more nodes, or make it less "
        "stiff beside what holds it: beyond 1e12 times numbers cannot tell",
        dofs,
    )


def _place(point: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"


def _error(text: str, dofs: IntArray) -> SingularMatrix:
    error = SingularMatrix(text)
    error.dofs = dofs
    return error
