"""Order of elimination by nested dissection of the graph of a matrix.

Degrees of freedom of one node are one vertex of :class:`Graph`; without positions, neighbouring
rows of the matrix with the same pattern are. A set of vertices is cut by a plane; the vertices that
separate its two sides are eliminated after both. Among all planes normal to the coordinate axes and
the principal axes, the one with the smallest separator / (p (1 - p)) is taken, where p is the
fraction of the degrees of freedom on one side. The separator is a minimum vertex cover of the cut
edges (König's theorem). Without positions, distances in the graph from a few landmark vertices
serve as coordinates. Source: George (1973), SIAM J. Numer. Anal. 10(2), 345-363.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching, shortest_path

from flexmb.flexbody.arrays import FloatArray, IntArray

_LANDMARKS = 3


@dataclass(frozen=True, eq=False)
class Graph:
    """The graph of a sparse matrix: vertices, their neighbours and positions.

    Parameters
    ----------
    first : (v + 1,) int
        Vertex k holds the rows ``first[k]`` to ``first[k + 1] - 1`` of the matrix.
    neighbours : (v, v) sparse
        Pattern; every vertex is its own neighbour too.
    places : (v, d) float
        Coordinates.
    """

    first: IntArray
    neighbours: csr_array
    places: FloatArray

    @property
    def weights(self) -> IntArray:
        """(v,) degrees of freedom of each vertex."""
        return np.diff(self.first)


def matrix_graph(K: csr_array, points: FloatArray | None = None) -> Graph:
    """The graph of ``K`` (n, n), with ``points`` (n, 3) if known."""
    n = K.shape[0]
    same = _same_pattern(K) if points is None else (points[1:] == points[:-1]).all(axis=1)
    first = np.concatenate([[0], np.flatnonzero(~same) + 1, [n]])
    neighbours = _quotient(K, first)
    places = _distances(neighbours) if points is None else points[first[:-1]]
    return Graph(first, neighbours, places)


def _same_pattern(K: csr_array) -> np.ndarray:
    """(n - 1,) whether row i + 1 of the matrix has its entries in the same columns as row i."""
    key = np.random.default_rng(0).integers(1 << 62, size=K.shape[0])
    sums = np.concatenate([[0], np.cumsum(key[K.indices])])[K.indptr]
    total = np.diff(sums)
    return total[1:] == total[:-1]


def _quotient(K: csr_array, first: IntArray) -> csr_array:
    v = len(first) - 1
    vertex = np.repeat(np.arange(v, dtype=np.int32), np.diff(first))
    pattern = csr_array((np.ones(K.nnz, dtype=bool), vertex[K.indices], K.indptr), (len(vertex), v))
    gather = csr_array((np.ones(len(vertex), dtype=bool), np.arange(len(vertex)), first))
    graph = csr_array(gather @ pattern)
    graph.sort_indices()
    return graph


def _distances(neighbours: csr_array) -> FloatArray:
    """(v, 3) distances in the graph from landmarks, each as far as possible from the earlier
    ones."""
    v = neighbours.shape[0]
    places = np.zeros((v, _LANDMARKS))
    start = 0
    for k in range(_LANDMARKS):
        if k == 0:
            start = int(_steps(neighbours, start).argmax())
        places[:, k] = _steps(neighbours, start)
        start = int(places[:, : k + 1].min(axis=1).argmax())
    return places


def _steps(neighbours: csr_array, start: int) -> FloatArray:
    far = shortest_path(neighbours, unweighted=True, indices=start)
    return np.where(np.isfinite(far), far, far[np.isfinite(far)].max() + 1.0)


_LEAF = 240  # a set of fewer degrees of freedom is not cut further
_MIN_SHARE = 0.3  # wanted least fraction of a set's degrees of freedom on either side of a cut
_UNBALANCE_COST = 10.0  # factor on the cost of a cut with less than that on one side
# a set is not cut across an axis along which its extent is below this fraction of its largest
_SLIM_EXTENT = 0.2
_SAME_PLACE = 1e-9  # coordinates that differ by less than this fraction of the extent are equal


@dataclass(frozen=True, eq=False)
class Dissection:
    """Sets of vertices in the order of elimination, children before their parent.

    Parameters
    ----------
    order : (v,) int
        Vertices.
    first : (s + 1,) int
        Set k holds ``order[first[k]:first[k + 1]]``.
    """

    order: IntArray
    first: IntArray


def dissect(graph: Graph, leaf: int = _LEAF) -> Dissection:
    """Cut the graph into pieces of at most about ``leaf`` degrees of freedom."""
    weights = graph.weights.astype(float)
    sets: list[IntArray] = []  # a parent before its children; reversed at the end
    stack = [(np.arange(len(weights)), graph.neighbours)]
    while stack:
        piece, inner = stack.pop()
        parts = None
        if weights[piece].sum() > leaf:
            parts = _cut(inner, graph.places[piece], weights[piece])
        if parts is None:
            sets.append(piece)
            continue
        left, right, between = parts
        if len(between):
            sets.append(piece[between[_curve(graph.places[piece[between]])]])
        if weights[piece[left]].sum() > weights[piece[right]].sum():
            left, right = right, left
        # the side pushed last is cut first; after the reversal it is eliminated last
        for side in (right, left):
            stack.append((piece[side], inner[side][:, side]))
    sets.reverse()
    first = np.concatenate([[0], np.cumsum([len(part) for part in sets])])
    return Dissection(np.concatenate(sets) if sets else np.zeros(0, dtype=int), first)


def _cut(
    inner: csr_array, places: FloatArray, weights: FloatArray
) -> tuple[IntArray, IntArray, IntArray] | None:
    """Vertices on both sides of the best plane and of the separator; None if no plane cuts the
    set."""
    best, left = np.inf, None
    for x in _axes(places):
        cost, at = _position(inner, x, weights)
        if cost < best:
            best, left = cost, x <= at
    if left is None:
        return None
    between = _cover(inner, left)
    left[between] = False
    right = ~left
    right[between] = False
    if not left.any() or not right.any():
        return None
    return np.flatnonzero(left), np.flatnonzero(right), between


def _axes(places: FloatArray) -> list[FloatArray]:
    """Coordinates along the coordinate and principal axes, rounded so that layers of nodes
    coincide."""
    centred = places - places.mean(axis=0)
    turned = centred @ np.linalg.eigh(centred.T @ centred)[1]
    axes = []
    for x in (*centred.T, *turned.T):
        extent = np.ptp(x)
        if extent > _SLIM_EXTENT * np.ptp(places, axis=0).max():
            axes.append(np.round((x - x.min()) / (extent * _SAME_PLACE)))
    return axes


def _position(inner: csr_array, x: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """The cost of the best cut normal to one axis, and the coordinate x of the plane.

    For a plane at t, a vertex on the left has a neighbour on the right if x <= t < max(x of its
    neighbours). So the number of degrees of freedom next to the plane is a difference of two
    cumulative sums over the sorted coordinates, for all t at once.
    """
    near = x[inner.indices]
    above = np.maximum.reduceat(near, inner.indptr[:-1])
    below = np.minimum.reduceat(near, inner.indptr[:-1])
    at = np.unique(x)[:-1]
    if not len(at):
        return np.inf, 0.0
    total = weights.sum()
    here = _cumulated(x, weights, at)
    share = here / total
    smaller = np.minimum(
        here - _cumulated(above, weights, at), _cumulated(below, weights, at) - here
    )
    cost = (smaller + 1.0) / (share * (1 - share))
    cost[np.minimum(share, 1 - share) < _MIN_SHARE] *= _UNBALANCE_COST
    best = int(cost.argmin())
    return float(cost[best]), float(at[best])


def _cumulated(x: FloatArray, weights: FloatArray, at: FloatArray) -> FloatArray:
    """Sum of the weights of all vertices with x <= t, for each t of ``at``."""
    order = np.argsort(x, kind="stable")
    sums = np.concatenate([[0.0], np.cumsum(weights[order])])
    return sums[np.searchsorted(x[order], at, side="right")]


def _cover(inner: csr_array, left: np.ndarray) -> IntArray:
    """Minimum vertex cover of the edges between the left and the right side (König's theorem)."""
    rows = np.repeat(np.arange(len(left)), np.diff(inner.indptr))
    cut = left[rows] & ~left[inner.indices]
    a, i = np.unique(rows[cut], return_inverse=True)
    b, j = np.unique(inner.indices[cut], return_inverse=True)
    if not len(a):
        return np.zeros(0, dtype=int)
    edges = csr_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(len(a), len(b)))
    mate = maximum_bipartite_matching(edges, perm_type="column")
    reached = _alternating(i, j, mate, len(b))
    return np.concatenate([a[~reached[: len(a)]], b[reached[len(a) :]]])


def _alternating(i: IntArray, j: IntArray, mate: IntArray, columns: int) -> np.ndarray:
    """(rows + columns,) bool: vertices on alternating paths from unmatched rows, rows first."""
    rows = len(mate)
    matched, free = np.flatnonzero(mate >= 0), np.flatnonzero(mate < 0)
    source = rows + columns
    tail = np.concatenate([i, rows + mate[matched], np.full(len(free), source)])
    head = np.concatenate([rows + j, matched, free])
    graph = csr_array((np.ones(len(tail), dtype=np.int8), (tail, head)), (source + 1, source + 1))
    reached = np.zeros(source + 1, dtype=bool)
    reached[breadth_first_order(graph, source, return_predecessors=False)] = True
    return reached[:source]


def _curve(places: FloatArray) -> IntArray:
    """Order of places along a space-filling curve (Morton), which keeps neighbours together.

    A smaller front then touches few contiguous runs of rows of a larger one.
    """
    extent = np.ptp(places, axis=0).max()
    cells = ((places - places.min(axis=0)) / (extent or 1.0) * 1023).astype(np.int64)
    key = np.zeros(len(places), dtype=np.int64)
    for bit in range(10):
        for axis in range(places.shape[1]):
            key |= (cells[:, axis] >> bit & 1) << (bit * places.shape[1] + axis)
    return np.argsort(key, kind="stable")
