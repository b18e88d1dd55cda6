"""The graph of a sparse matrix: degrees of freedom of one place as one vertex.

In: a sparse symmetric matrix and, if known, the position of each degree of freedom. Out:
:class:`Graph`. Degrees of freedom that follow each other at one place (or, without positions, with
the same pattern of entries) are one vertex, which makes everything about the order of elimination
cheaper by an order of magnitude. Without positions, distances in the graph from a few far-apart
vertices stand in for coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Graph", "matrix_graph"]

_LANDMARKS = 3


@dataclass(frozen=True, eq=False)
class Graph:
    """Vertices of a matrix, their neighbours and places.

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
    """(n - 1,) whether a row of the matrix has entries where the one before has."""
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
    """(v, 3) steps from landmarks, each as far as can be from those before, as coordinates."""
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
