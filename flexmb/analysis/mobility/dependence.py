"""Which constraint rows repeat others: rank, and the smallest sets of rows that are dependent.

In: a weighted Jacobian. Out: its rank, and its left null space as circuits, that is vectors on as
few rows as can be: the reduced row echelon form of a null space, whose pivots are chosen by size,
has one fundamental circuit in every row (Strang, Linear Algebra and Its Applications, ch. 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

__all__ = ["Dependence", "circuits", "dependence", "null_space", "together"]

Array = NDArray[np.float64]
RANK = 1e-8  # relative to the largest singular value; round-off leaves 1e-13
_NOTHING = 1e-7  # share of the largest coefficient of a circuit that is round-off


@dataclass(frozen=True)
class Dependence:
    """Rank of a matrix of rows, its circuits (n, rows), and how near it is to a lower rank.

    `almost` is the smallest singular value that is not zero over the largest; `free` (columns, k)
    are orthonormal motions that no row sees.
    """

    rank: int
    circuits: Array
    almost: float
    free: Array


def dependence(A: Array) -> Dependence:
    """Rank and circuits of the rows of A (rows, columns), and its null space."""
    if not A.size:
        return Dependence(0, np.eye(len(A)), 1.0, np.eye(A.shape[1]))
    U, size, Vt = np.linalg.svd(A)
    rank = int(np.sum(size > RANK * size[0])) if size[0] > 0 else 0
    almost = float(size[rank - 1] / size[0]) if rank else 1.0
    return Dependence(rank, circuits(U[:, rank:].T), almost, np.asarray(Vt[rank:].T))


def null_space(A: Array, size: float | None = None) -> Array:
    """(columns, k) orthonormal motions that no row of A (rows, columns) sees.

    Zero is what is small against `size`, by default the largest singular value of A.
    """
    if not A.size:
        return np.eye(A.shape[1])
    _, values, Vt = np.linalg.svd(A, full_matrices=len(A) < A.shape[1])
    largest = values[0] if size is None else size
    return np.asarray(Vt[int(np.sum(values > RANK * largest)) :].T)


def circuits(N: Array) -> Array:
    """A basis of the rows of N (k, n) with as many zeros as can be had, largest entry one."""
    if not N.size:
        return N
    _, _, order = qr(N, mode="economic", pivoting=True)
    pivots = order[: len(N)]
    found = np.linalg.solve(N[:, pivots], N)
    found /= np.abs(found).max(axis=1, keepdims=True)
    found[np.abs(found) < _NOTHING] = 0.0
    return np.asarray(found)


def together(sets: Sequence[frozenset[int]]) -> list[list[int]]:
    """Indices of sets that hang together because they share members, group by group."""
    groups: list[tuple[set[int], list[int]]] = []
    for k, members in enumerate(sets):
        touched = [group for group in groups if group[0] & members]
        merged = set(members).union(*(group[0] for group in touched))
        indices = sorted([k, *(i for group in touched for i in group[1])])
        groups = [group for group in groups if group not in touched] + [(merged, indices)]
    return [indices for _, indices in groups]
