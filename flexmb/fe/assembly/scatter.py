"""Summing element matrices into a sparse matrix, a batch at a time.

In: batches of (ne, d, d) element matrices and their (ne, d) global numbers. Out: an (n, n) CSR
matrix. Numbers that come in threes (the displacements or rotations of a node) are summed as blocks
of 3 x 3, which makes sorting nine times cheaper. Batches are added up pairwise like the digits of a
binary counter, so that little more than the matrix itself is held.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bsr_array, csr_array

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Accumulator", "scatter"]

_BATCH = 8_000_000  # entries of element matrices that are sorted at once: 130 MB


class Accumulator:
    """A matrix that grows by batches of element matrices.

    Parameters
    ----------
    n : int
        Rows and columns.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._sums: dict[int, list[tuple[int, bsr_array]]] = {1: [], 3: []}

    def add(self, elements: FloatArray, numbers: IntArray) -> None:
        """Add matrices (ne, d, d) at their numbers (ne, d); rows and columns at -1 are left out."""
        d = numbers.shape[1]
        width = 3 if self._n % 3 == 0 and _in_threes(numbers) else 1
        step = max(1, _BATCH // (d * d))
        for start in range(0, len(numbers), step):
            part = slice(start, start + step)
            self._push(width, _sum(elements[part], numbers[part], self._n, width))

    def matrix(self) -> csr_array:
        """The sum so far."""
        total = csr_array((self._n, self._n))
        for sums in self._sums.values():
            while len(sums) > 1:
                _merge(sums)
            if sums:
                total = total + sums[0][1].tocsr() if total.nnz else sums[0][1].tocsr()
        total.sort_indices()
        return total

    def _push(self, width: int, batch: bsr_array) -> None:
        sums = self._sums[width]
        sums.append((0, batch))
        while len(sums) > 1 and sums[-1][0] >= sums[-2][0]:
            _merge(sums)


def scatter(elements: FloatArray, numbers: IntArray, n: int) -> csr_array:
    """Sum element matrices (ne, d, d) at their global numbers (ne, d)."""
    total = Accumulator(n)
    total.add(elements, numbers)
    return total.matrix()


def _merge(sums: list[tuple[int, bsr_array]]) -> None:
    """Replace the last two sums by theirs, which counts one digit higher."""
    _, newer = sums.pop()
    digit, older = sums.pop()
    sums.append((digit + 1, older + newer))


def _in_threes(numbers: IntArray) -> bool:
    """Whether all numbers are 3 k, 3 k + 1, 3 k + 2 in turn, or three times -1."""
    if numbers.shape[1] % 3:
        return False
    threes = numbers.reshape(-1, 3)
    first = threes[:, :1]
    whole = (threes == first + np.arange(3)).all(axis=1) & (first[:, 0] % 3 == 0)
    return bool((whole | (threes == -1).all(axis=1)).all())


def _sum(elements: FloatArray, numbers: IntArray, n: int, width: int) -> bsr_array:
    """The sum of a batch, in blocks of ``width``.

    Sorting is stable, so that what is added at (i, j) and at (j, i) is added in the same order: a
    sum of symmetric matrices is symmetric to the last bit.
    """
    blocks = numbers[:, ::width].astype(np.int64) // width
    ne, k = blocks.shape
    rows, columns = np.repeat(blocks, k, axis=1).ravel(), np.tile(blocks, (1, k)).ravel()
    values = elements.reshape(ne, k, width, k, width).transpose(0, 1, 3, 2, 4)
    values = values.reshape(ne * k * k, width, width)
    size = n // width
    key = rows * size + columns
    order = np.argsort(key, kind="stable")
    if numbers.min(initial=0) < 0:
        order = order[(rows[order] >= 0) & (columns[order] >= 0)]
    key = key[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    data = np.add.reduceat(values[order], first, axis=0) if len(first) else values[:0]
    key = key[first]
    indptr = np.searchsorted(key, np.arange(size + 1) * size).astype(np.int32)
    return bsr_array((data, (key % size).astype(np.int32), indptr), shape=(n, n))
