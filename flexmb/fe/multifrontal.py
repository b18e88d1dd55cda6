"""Multifrontal Cholesky factorisation on dense BLAS and LAPACK.

The front of a set of rows is a dense matrix. It sums the entries of these rows and the updates of
its children, eliminates the rows (potrf, trsm) and passes an update (syrk) to its parent, so nearly
all work is done on full matrices. Only lower triangles are formed. :class:`Fronts` are known before
any number is computed, and with them the number of entries, the operations and the memory of the
factorisation. It is used besides SciPy's SuperLU because that has no symmetric mode: for a solid of
92 000 unknowns it takes several times the time and memory. Sources: Duff, Reid (1983), ACM Trans.
Math. Softw. 9(3), 302-325; Liu (1992), SIAM Review 34(1), 82-109.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_array
from threadpoolctl import ThreadpoolController

from flexmb.fe.dissection import Dissection, Graph
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress, silent


class NotPositive(ArithmeticError):
    """A pivot is not positive; ``index`` is its row of the matrix."""

    def __init__(self, index: int) -> None:
        super().__init__(f"the pivot of row {index} is not positive")
        self.index = index


@dataclass(frozen=True, eq=False)
class Fronts:
    """Dense fronts in the order of elimination, children before their parent.

    Parameters
    ----------
    order : (n,) int
        Rows of the matrix in the order of elimination.
    first : (s + 1,) int
        Front k eliminates the rows ``first[k]`` to ``first[k + 1] - 1`` of the new order.
    borders : list of (b,) int
        Rows of the new order, ascending, that front k updates.
    parents : (s,) int
        Front that takes this update; -1 if there is none.
    """

    order: IntArray
    first: IntArray
    borders: list[IntArray]
    parents: IntArray

    @property
    def sizes(self) -> tuple[FloatArray, FloatArray]:
        """(s,) number of rows that each front eliminates, and (s,) number that it updates."""
        own = np.diff(self.first).astype(float)
        return own, np.array([len(border) for border in self.borders], dtype=float)

    @property
    def nnz(self) -> int:
        """Entries of the triangular factor."""
        own, border = self.sizes
        return int(np.sum(own * (own + 1) / 2 + own * border))

    @property
    def flops(self) -> FloatArray:
        """(s,) multiplications and additions in each front."""
        own, border = self.sizes
        return own**3 / 3 + own**2 * border + own * border**2

    @property
    def memory(self) -> float:
        """Largest number of bytes that the factors and the stored updates take at any one time."""
        own, border = self.sizes
        factors = waiting = most = 0.0
        updates = border**2
        for k, parent_of in enumerate(self.children):
            factors += own[k] * (own[k] + border[k])
            most = max(most, factors + waiting + updates[k])
            waiting += updates[k] - updates[parent_of].sum()
        return 8.0 * most

    @property
    def children(self) -> list[list[int]]:
        """Fronts whose updates each front takes."""
        children: list[list[int]] = [[] for _ in self.parents]
        for child, parent in enumerate(self.parents):
            if parent >= 0:
                children[parent].append(child)
        return children


def fronts(graph: Graph, dissection: Dissection) -> Fronts:
    """Symbolic factorisation: the fronts of the sets of a dissection."""
    order, first = dissection.order, dissection.first
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    permuted = graph.neighbours[order]
    near, start = place[permuted.indices], permuted.indptr[first]
    borders: list[IntArray] = []
    parents = np.full(len(first) - 1, -1)
    waiting: list[list[IntArray]] = [[] for _ in parents]
    for k, end in enumerate(first[1:]):
        both = np.concatenate([near[start[k] : start[k + 1]], *waiting[k]])
        border = np.unique(both[both >= end])
        waiting[k] = []
        borders.append(border)
        if len(border):
            parents[k] = owner[border[0]]
            waiting[parents[k]].append(border)
    return _expanded(graph, order, first, borders, parents)


def _expanded(
    graph: Graph, order: IntArray, first: IntArray, borders: list[IntArray], parents: IntArray
) -> Fronts:
    """The fronts over degrees of freedom from those over vertices."""
    weights = graph.weights[order]
    begin = np.concatenate([[0], np.cumsum(weights)])
    rows = ranges(graph.first[order], weights)
    expanded = [ranges(begin[b], weights[b]) for b in borders]
    return Fronts(rows, begin[first], expanded, parents)


def ranges(start: IntArray, count: IntArray) -> IntArray:
    """The ranges start[k], ..., start[k] + count[k] - 1 one after the other."""
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.repeat(start - ends + count, count) + np.arange(total)


# operations of a front from which on several BLAS threads are faster than one
_PARALLEL_FLOPS = 1e9


class _Update(NamedTuple):
    rows: IntArray  # rows of the matrix, in the order of elimination
    values: FloatArray  # lower triangle of what is added to these rows and columns


@contextmanager
def blas_threads(count: int = 1) -> Iterator[tuple[int, ...]]:
    """Run with ``count`` BLAS threads; yields the numbers before the first of nested limits.

    On matrices of a few hundred rows OpenBLAS threads wait for each other longer than they work: on
    a busy machine with two cores a solution with twelve right sides took 24 times as long as with
    one thread, the reduction of a plate of 256 shells six times. So all of a reduction but the
    elimination of large fronts runs on one thread.
    """
    before = tuple(library.get_num_threads() for library in _blas_libraries())
    _nested.append(_nested[0] if _nested else before)
    set_threads((count,) * len(before))
    try:
        yield _nested[0]
    finally:
        set_threads(before)
        _nested.pop()


_nested: list[tuple[int, ...]] = []  # limits that are in force: the numbers before the first


class Multifrontal:
    """The factor L of P K P^T = L L^T.

    Parameters
    ----------
    K : (n, n) sparse
        Symmetric positive definite; both triangles are stored.
    fronts : Fronts
        Of its pattern.
    progress : Progress
        Called with the phase ``"factor"`` by the share of operations done.

    Raises
    ------
    NotPositive
        The matrix is not positive definite.
    """

    def __init__(self, K: csr_array, fronts: Fronts, progress: Progress = silent) -> None:
        self._fronts = fronts
        self.nnz = fronts.nnz
        self._diagonal: list[FloatArray] = []
        self._below: list[FloatArray] = []
        place = np.empty(len(fronts.order), dtype=np.int64)
        place[fronts.order] = np.arange(len(place))
        flops, done = fronts.flops, np.cumsum(fronts.flops)
        waiting: list[list[_Update]] = [[] for _ in fronts.borders]
        detail = f"{len(place)} unknowns, {self.nnz:.3g} entries"
        with blas_threads() as all_threads:
            for k, parent in enumerate(fronts.parents):
                set_threads(all_threads if flops[k] > _PARALLEL_FLOPS else (1,) * len(all_threads))
                update = self._eliminate(k, _rows(K, fronts, k, place), waiting[k])
                waiting[k] = []
                if parent >= 0:
                    waiting[parent].append(update)
                progress("factor", 0.99 * done[k] / done[-1], detail)

    def _eliminate(
        self, k: int, entries: tuple[IntArray, IntArray, FloatArray], updates: list[_Update]
    ) -> _Update:
        start, end = self._fronts.first[k : k + 2]
        border = self._fronts.borders[k]
        own, b = int(end - start), len(border)
        A = np.zeros((own, own), order="F")
        B = np.zeros((b, own), order="F")
        C = np.zeros((b, b), order="F")
        i, j, values = entries
        inside = i < end
        A[i[inside] - start, j[inside] - start] = values[inside]
        B[np.searchsorted(border, i[~inside]), j[~inside] - start] = values[~inside]
        while updates:
            _extend_add(A, B, C, start, border, updates.pop())
        A, info = dpotrf(A, lower=1, clean=0, overwrite_a=1)
        if info:
            raise NotPositive(int(self._fronts.order[start + info - 1]))
        if b:
            B = dtrsm(1.0, A, B, side=1, lower=1, trans_a=1, overwrite_b=1)
            C = dsyrk(-1.0, B, beta=1.0, c=C, lower=1, overwrite_c=1)
        self._diagonal.append(A)
        self._below.append(B)
        return _Update(border, C)

    @blas_threads()
    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        fronts = self._fronts
        x = b.reshape(len(b), -1)[fronts.order]
        for k, border in enumerate(fronts.borders):
            own = slice(*fronts.first[k : k + 2])
            x[own] = _solve_triangular(self._diagonal[k], x[own], 0)
            if len(border):
                x[border] -= self._below[k] @ x[own]
        for k in range(len(fronts.borders) - 1, -1, -1):
            own, border = slice(*fronts.first[k : k + 2]), fronts.borders[k]
            if len(border):
                x[own] -= self._below[k].T @ x[border]
            x[own] = _solve_triangular(self._diagonal[k], x[own], 1)
        solution = np.empty_like(x)
        solution[fronts.order] = x
        return solution.reshape(b.shape)


def _solve_triangular(L: FloatArray, b: FloatArray, transposed: int) -> FloatArray:
    """L^-1 b or L^-T b; for one column without the packing of L that `dtrsm` begins with."""
    if b.shape[1] == 1:
        return np.asarray(dtrsv(L, b[:, 0], lower=1, trans=transposed))[:, None]
    return np.asarray(dtrsm(1.0, L, b.T, side=1, lower=1, trans_a=1 - transposed).T)


def _rows(
    K: csr_array, fronts: Fronts, k: int, place: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Entries on and below the diagonal in the columns that front k eliminates: row, column, value.

    They are taken from the rows of K, which is symmetric.
    """
    start, end = fronts.first[k : k + 2]
    rows = fronts.order[start:end]
    count = K.indptr[rows + 1] - K.indptr[rows]
    at = ranges(K.indptr[rows], count)
    i, j = place[K.indices[at]], np.repeat(np.arange(start, end), count)
    lower = i >= j
    return i[lower], j[lower], K.data[at[lower]]


def _extend_add(
    A: FloatArray, B: FloatArray, C: FloatArray, start: int, border: IntArray, update: _Update
) -> None:
    """Add the update of a child to the front [A; B C], by blocks of consecutive rows."""
    own = len(A)
    rows, values = update
    at = np.where(rows < start + own, rows - start, own + np.searchsorted(border, rows))
    breaks = np.flatnonzero((np.diff(at) != 1) | (at[1:] == own)) + 1
    begin = np.concatenate([[0], breaks])
    length = np.diff(np.concatenate([begin, [len(at)]]))
    runs = list(zip(begin.tolist(), at[begin].tolist(), length.tolist(), strict=True))
    for c, (from_c, to_c, wide) in enumerate(runs):
        for from_r, to_r, high in runs[c:]:
            part = values[from_r : from_r + high, from_c : from_c + wide]
            if to_r < own:
                A[to_r : to_r + high, to_c : to_c + wide] += part
            elif to_c < own:
                B[to_r - own : to_r - own + high, to_c : to_c + wide] += part
            else:
                to = to_r - own, to_c - own
                C[to[0] : to[0] + high, to[1] : to[1] + wide] += part


@cache
def _blas_libraries() -> tuple[Any, ...]:
    """NumPy's and SciPy's BLAS libraries; both are loaded by now."""
    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


def set_threads(counts: tuple[int, ...]) -> None:
    """Threads of each library, as :func:`blas_threads` gives them."""
    for library, count in zip(_blas_libraries(), counts, strict=True):
        library.set_num_threads(count)
