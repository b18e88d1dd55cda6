"""Rank of a matrix, the one decision of the package, and what follows: null space and circuits.

In: a matrix whose rows and columns are weighted so that its entries compare. Out: its rank by
singular values, motions that no row hinders, and sets of dependent rows as circuits, that is left
null vectors on as few rows as can be: the reduced row echelon form of a null space, whose pivots
are selected by size, has one fundamental circuit in every row (Strang, Linear Algebra and Its
Applications, ch. 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.linalg  # its threads are limited with those of NumPy
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

Array = NDArray[np.float64]

MAX_COORDINATES = 600
"""Coordinates up to which a dense decomposition is affordable; larger models are taken as free,
which only costs digits of the reported reactions."""
RANK_TOLERANCE = 1e-8
"""Singular values below this share of the largest one are zero; round-off leaves 1e-13."""
_ZERO_COEFFICIENT = 1e-7  # share of the largest coefficient of a circuit that is round-off


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit dense linear algebra to one thread; also a decorator.

    With up to `MAX_COORDINATES` two threads take no less time, and where other processes run they
    wait for each other: a chain of 100 bars takes 0.4 s with one thread, 1 to 4 s with two.
    """
    with _pools().limit(limits=1, user_api="blas"):
        yield


@cache
def _pools() -> ThreadpoolController:
    # NumPy and SciPy have loaded theirs; a search for them takes longer than a small decomposition
    return ThreadpoolController()


def numerical_rank(singular_values: Array, largest: float | None = None) -> int:
    """How many singular values, largest first, are not zero against the largest one."""
    if not singular_values.size:
        return 0
    scale = singular_values[0] if largest is None else largest
    return int(np.sum(singular_values > RANK_TOLERANCE * scale))


@dataclass(frozen=True)
class Decomposition:
    """A = U S Vᵀ: U (rows, rows), S (min(rows, columns),), V (columns, columns)."""

    U: Array
    S: Array
    V: Array

    @classmethod
    def of(cls, A: Array) -> Decomposition:
        """Of a matrix A (rows, columns)."""
        U, S, Vt = np.linalg.svd(A)
        return cls(U, S, Vt.T)

    @cached_property
    def rank(self) -> int:
        """Number of independent rows."""
        return numerical_rank(self.S)

    @property
    def free(self) -> Array:
        """(columns, k) orthonormal motions that no row hinders."""
        return self.V[:, self.rank :]

    @property
    def condition(self) -> float:
        """Least singular value that is not zero, over the largest."""
        return float(self.S[self.rank - 1] / self.S[0]) if self.rank else 1.0

    @cached_property
    def circuits(self) -> Array:
        """(n, rows) sets of dependent rows."""
        return circuits(self.U[:, self.rank :].T)

    def unreachable(self, values: Array) -> Array:
        """The part of row values (rows,) that no motion can take away."""
        null = self.U[:, self.rank :]
        return np.asarray(null @ (null.T @ values))


def null_space(A: Array, largest: float | None = None) -> Array:
    """(columns, k) orthonormal motions that no row of A (rows, columns) hinders.

    Zero is what is small against `largest`, by default the largest singular value of A.
    """
    _, values, Vt = np.linalg.svd(A, full_matrices=len(A) < A.shape[1])
    return np.asarray(Vt[numerical_rank(values, largest) :].T)


def circuits(N: Array) -> Array:
    """A basis of the rows of N (k, n) with as many zeros as can be had, largest entry one."""
    if not N.size:
        return N
    _, _, order = scipy.linalg.qr(N, mode="economic", pivoting=True)
    basis = np.linalg.solve(N[:, order[: len(N)]], N)
    basis /= np.abs(basis).max(axis=1, keepdims=True)
    basis[np.abs(basis) < _ZERO_COEFFICIENT] = 0.0
    return np.asarray(basis)
