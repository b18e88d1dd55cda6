"""Degrees of freedom of a mesh: three displacements a node, six where a beam ends.

In: for each node, whether solids and beams touch it. Out: a table of degree-of-freedom numbers
with -1 for those that do not exist. Order at a node: x, y, z displacement, then rotation about x,
y, z, all in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
        How many there are.
    """

    table: IntArray
    n: int

    @property
    def nodes(self) -> IntArray:
        """Nodes that carry degrees of freedom, ascending."""
        return np.flatnonzero(self.table[:, 0] >= 0)

    @property
    def rotating(self) -> IntArray:
        """Nodes that carry rotations, ascending."""
        return np.flatnonzero(self.table[:, 3] >= 0)


def number_nodes(count: int, moving: IntArray, rotating: IntArray) -> Numbering:
    """Number the degrees of freedom node by node.

    Parameters
    ----------
    count : int
        Nodes in the mesh.
    moving, rotating : (k,) int
        Nodes with displacements, and those that have rotations as well.
    """
    has = np.zeros((count, 6), dtype=bool)
    has[moving, :3] = True
    has[rotating] = True
    table = np.full((count, 6), -1)
    table[has] = np.arange(has.sum())
    return Numbering(table, int(has.sum()))


def rigid_vectors(numbering: Numbering, points: FloatArray, about: FloatArray) -> FloatArray:
    """(n, 6) the three unit translations and the three unit rotations about a point, body axes."""
    R = np.zeros((numbering.n, 6))
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
