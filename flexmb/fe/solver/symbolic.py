"""What a multifrontal factorisation will look like, before any number is computed.

In: the graph of a matrix and its dissection. Out: :class:`Fronts`: for every front the degrees of
freedom it eliminates and those it updates, and what all of it takes in entries, operations and
memory. Source: Duff, Reid (1983), ACM Trans. Math. Softw. 9(3), 302-325; Liu (1992), SIAM Review
34(1), 82-109.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.fe.solver.dissection import Dissection
from flexmb.fe.solver.graph import Graph
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Fronts", "fronts", "ranges"]


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
        """(s,) eliminated and (s,) updated rows of each front."""
        own = np.diff(self.first).astype(float)
        return own, np.array([len(border) for border in self.borders], dtype=float)

    @property
    def nnz(self) -> int:
        """Entries of the triangular factor."""
        own, border = self.sizes
        return int(np.sum(own * (own + 1) / 2 + own * border))

    @property
    def flops(self) -> FloatArray:
        """(s,) multiplications and additions of each front."""
        own, border = self.sizes
        return own**3 / 3 + own**2 * border + own * border**2

    @property
    def memory(self) -> float:
        """Largest number of bytes that factors and waiting updates take at one time."""
        own, border = self.sizes
        kept = waiting = most = 0.0
        updates = border**2
        for k, parent_of in enumerate(self.children):
            kept += own[k] * (own[k] + border[k])
            most = max(most, kept + waiting + updates[k])
            waiting += updates[k] - updates[parent_of].sum()
        return 8.0 * most

    @property
    def children(self) -> list[list[int]]:
        """Fronts whose updates each front takes."""
        found: list[list[int]] = [[] for _ in self.parents]
        for child, parent in enumerate(self.parents):
            if parent >= 0:
                found[parent].append(child)
        return found


def fronts(graph: Graph, dissection: Dissection) -> Fronts:
    """Follow the elimination set by set."""
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
    """From vertices to the degrees of freedom they hold."""
    weights = graph.weights[order]
    begin = np.concatenate([[0], np.cumsum(weights)])
    rows = ranges(graph.first[order], weights)
    expanded = [ranges(begin[b], weights[b]) for b in borders]
    return Fronts(rows, begin[first], expanded, parents)


def ranges(start: IntArray, count: IntArray) -> IntArray:
    """start[0], start[0] + 1, ... (count[0] of them), start[1], ..."""
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.repeat(start - ends + count, count) + np.arange(total)
