"""Degrees of freedom of a mesh: three displacements a node, six where beams or shells meet it.

In: for each node, whether it moves, turns, and which of its motions follow others. Out: a table of
degree-of-freedom numbers with -1 for those that do not exist; the independent ones come first, the
tied ones after them. Order at a node: x, y, z displacement, then rotation about x, y, z, all in
body axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Numbering", "number_nodes", "rigid_vectors", "skew"]


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


def skew(s: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices with skew(s) @ u = s x u."""
    out = np.zeros((*s.shape, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., c, b] = s[..., a]
        out[..., b, c] = -s[..., a]
    return out
