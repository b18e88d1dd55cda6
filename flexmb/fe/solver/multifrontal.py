"""Multifrontal Cholesky factorisation on dense BLAS and LAPACK.

In: a sparse symmetric positive definite matrix and its fronts. Out: :class:`Multifrontal`, which
solves for one or many right sides. Each front adds up the entries of the rows it eliminates and
the updates of its children, eliminates (potrf, trsm) and leaves an update (syrk) to its parent:
nearly all work is on full matrices. Only lower triangles are formed; what stands above a diagonal
is never read. Source: Duff, Reid (1983), ACM Trans. Math. Softw. 9(3), 302-325.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_array

from flexmb.fe.solver.singular import NotPositive
from flexmb.fe.solver.symbolic import Fronts, ranges
from flexmb.fe.solver.threads import blas_threads, set_threads
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.progress import Progress, silent

__all__ = ["Multifrontal"]

_LARGE = 1e9  # operations of a front from which several threads are worth their waiting


class _Update(NamedTuple):
    rows: IntArray  # rows of the matrix, in the order of elimination
    values: FloatArray  # lower triangle of what is added there


class Multifrontal:
    """The factor L of P K P^T = L L^T.

    Parameters
    ----------
    K : (n, n) sparse
        Symmetric positive definite; both triangles are stored.
    fronts : Fronts
        Of its pattern.
    progress : Progress
        Told the phase ``"factor"`` by the share of operations done.

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
                set_threads(all_threads if flops[k] > _LARGE else (1,) * len(all_threads))
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

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution for ``b`` of shape (n,) or (n, k)."""
        with blas_threads():
            return self._solve(b)

    def _solve(self, b: FloatArray) -> FloatArray:
        fronts = self._fronts
        x = b.reshape(len(b), -1)[fronts.order]
        for k, border in enumerate(fronts.borders):
            own = slice(*fronts.first[k : k + 2])
            x[own] = dtrsm(1.0, self._diagonal[k], x[own].T, side=1, lower=1, trans_a=1).T
            if len(border):
                x[border] -= self._below[k] @ x[own]
        for k in range(len(fronts.borders) - 1, -1, -1):
            own, border = slice(*fronts.first[k : k + 2]), fronts.borders[k]
            if len(border):
                x[own] -= self._below[k].T @ x[border]
            x[own] = dtrsm(1.0, self._diagonal[k], x[own].T, side=1, lower=1).T
        solution = np.empty_like(x)
        solution[fronts.order] = x
        return solution.reshape(b.shape)


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
    """Add the update of a child to the front [A; B C], block by block of rows that follow on."""
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
