"""Degrees of freedom of a mesh, and summing element matrices into a sparse matrix.

Nodes have three displacements, six motions where beams or shells meet them. Independent degrees of
freedom come first, tied ones after them; at a node displacements x, y, z, then rotations x, y, z,
body axes. :class:`Accumulator` sums batches of element matrices. Numbers that come in threes are
summed as blocks of 3 x 3, which makes sorting nine times cheaper; batches are added up pairwise
like the digits of a binary counter, so that little more than the matrix itself is stored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array

from flexmb.flexbody.arrays import FloatArray, IntArray, skew


@dataclass(frozen=True, eq=False)
class Numbering:
    """Degree-of-freedom numbers by node.

    Parameters
    ----------
    table : (nodes, 6) int
        Number of each degree of freedom, -1 where there is none.
    n : int
        How many are independent: the numbers 0 to n - 1.
    n_all : int
        How many there are with those that follow others by ties: n to n_all - 1.
    """

    table: IntArray
    n: int
    n_all: int

    @property
    def nodes(self) -> IntArray:
        """Nodes that carry degrees of freedom, ascending."""
        return np.flatnonzero(self.table[:, 0] >= 0)

    @property
    def rotating(self) -> IntArray:
        """Nodes that carry rotations, ascending."""
        return np.flatnonzero(self.table[:, 3] >= 0)

    @property
    def tied(self) -> IntArray:
        """Nodes with a degree of freedom that follows others, ascending."""
        return np.flatnonzero((self.table >= self.n).any(axis=1))

    def of(self, nodes: IntArray, width: int) -> IntArray:
        """(ne, k * width) numbers of the first ``width`` motions of the nodes (ne, k)."""
        return self.table[nodes, :width].reshape(len(nodes), -1)


def number_nodes(
    count: int, moving: IntArray, rotating: IntArray, tied: NDArray[np.bool_] | None = None
) -> Numbering:
    """Number the degrees of freedom node by node.

    Parameters
    ----------
    count : int
        Nodes in the mesh.
    moving, rotating : (k,) int
        Nodes with displacements, and those that have rotations as well.
    tied : (count, 6) bool, optional
        Motions that follow others.
    """
    has = np.zeros((count, 6), dtype=bool)
    has[moving, :3] = True
    has[rotating] = True
    follows = np.zeros_like(has) if tied is None else has & tied
    table = np.full((count, 6), -1)
    free = has & ~follows
    n, n_all = int(free.sum()), int(has.sum())
    table[free] = np.arange(n)
    table[follows] = np.arange(n, n_all)
    return Numbering(table, n, n_all)


def rigid_vectors(numbering: Numbering, points: FloatArray, about: FloatArray) -> FloatArray:
    """(n_all, 6) the unit translations and the unit rotations about a point, body axes."""
    R = np.zeros((numbering.n_all, 6))
    nodes, rotating = numbering.nodes, numbering.rotating
    arms = -skew(points[nodes] - about)
    for c in range(3):
        R[numbering.table[nodes, c], c] = 1.0
        R[numbering.table[nodes, c], 3:] = arms[:, c]
        R[numbering.table[rotating, 3 + c], 3 + c] = 1.0
    return R


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
        width = 3 if self._n % 3 == 0 and _in_triples(numbers) else 1
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


def _merge(sums: list[tuple[int, bsr_array]]) -> None:
    """Replace the last two sums by theirs, which counts one digit higher."""
    _, newer = sums.pop()
    digit, older = sums.pop()
    sums.append((digit + 1, older + newer))


def _in_triples(numbers: IntArray) -> bool:
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
