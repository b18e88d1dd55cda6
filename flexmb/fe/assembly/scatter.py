"""Summing element matrices into a sparse matrix, batch by batch.

In: (ne, d, d) element matrices and their (ne, d) global numbers. Out: an (n, n) CSR matrix.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Accumulator"]


class Accumulator:
    """An (n, n) matrix that element matrices are added to."""

    def __init__(self, n: int) -> None:
        self._sum = csr_array((n, n))

    def add(self, elements: FloatArray, numbers: IntArray) -> None:
        """Add element matrices (ne, d, d) at their global numbers (ne, d)."""
        n, d = self._sum.shape[0], numbers.shape[1]
        small = numbers.astype(np.int32)
        rows = np.repeat(small, d, axis=1).ravel()
        columns = np.tile(small, (1, d)).ravel()
        self._sum = self._sum + coo_array((elements.ravel(), (rows, columns)), shape=(n, n)).tocsr()

    def matrix(self) -> csr_array:
        """The sum so far."""
        return self._sum
