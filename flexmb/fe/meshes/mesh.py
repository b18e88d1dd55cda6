"""A finite-element mesh with named groups, independent of any file format.

In: points, element blocks by kind, groups. Out: an immutable :class:`Mesh`. Kinds are meshio's
names (``"tetra10"``, ``"line"``) with VTK's node order; there is one block per kind. Node numbers
are the file's order, from 0. A group is a set of elements (by kind) and the nodes they touch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from flexmb.errors import MeshError, Problem, nearest
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["DIMENSION", "Mesh", "dimension"]

DIMENSION = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "polygon": 2} | {
    name: 3 for name in ("tetra", "pyramid", "wedge", "hexahedron", "polyhedron")
}


def dimension(kind: str) -> int:
    """Dimension of an element kind: 0 point, 1 line, 2 surface, 3 volume; -1 unknown."""
    return DIMENSION.get(kind.rstrip("0123456789").removeprefix("VTK_LAGRANGE_").lower(), -1)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Points, elements and groups.

    Parameters
    ----------
    points : (n, 3) float
        In whatever unit the file has.
    blocks : mapping of str to (ne, k) int
        Connectivity by element kind.
    node_sets : mapping of str to (k,) int
        Groups of nodes; every element group has one too.
    element_sets : mapping of str to mapping of str to (k,) int
        Groups of elements: rows of the block of each kind.
    source : str
        Where it was read from, for messages.

    Raises
    ------
    MeshError
        No points, coordinates that are not numbers, or elements that name missing nodes.
    """

    points: FloatArray
    blocks: Mapping[str, IntArray]
    node_sets: Mapping[str, IntArray] = field(default_factory=dict)
    element_sets: Mapping[str, Mapping[str, IntArray]] = field(default_factory=dict)
    source: str = "mesh"

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise MeshError(f"{self.source}: the mesh has no points in space")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            what = f"node {bad[0]} has a coordinate that is not a number ({len(bad)} such nodes)"
            raise MeshError(f"{self.source}: {what}")
        for kind, cells in self.blocks.items():
            if cells.size and (cells.min() < 0 or cells.max() >= len(points)):
                raise MeshError(
                    f"{self.source}: elements of kind {kind} name nodes that are absent"
                )
        object.__setattr__(self, "points", points)
        element_nodes = {name: self._touched(rows) for name, rows in self.element_sets.items()}
        given = {name: np.unique(nodes) for name, nodes in self.node_sets.items()}
        object.__setattr__(self, "node_sets", given | element_nodes)

    def scaled(self, factor: float) -> Mesh:
        """The same mesh with all coordinates multiplied by ``factor``."""
        return replace(self, points=self.points * factor)

    def kinds(self, dim: int) -> tuple[str, ...]:
        """Element kinds of that dimension that have elements."""
        return tuple(k for k, cells in self.blocks.items() if len(cells) and dimension(k) == dim)

    def group_nodes(self, name: str, where: str = "group") -> IntArray:
        """Nodes of a group.

        Raises
        ------
        MeshError
            No such group; lists those there are, nearest first.
        """
        self._require(name, where)
        return self.node_sets[name]

    def group_elements(self, name: str, where: str = "group") -> Mapping[str, IntArray]:
        """Rows of each block in a group; empty for a group of nodes.

        Raises
        ------
        MeshError
            No such group; lists those there are, nearest first.
        """
        self._require(name, where)
        return self.element_sets.get(name, {})

    def _require(self, name: str, where: str) -> None:
        if name in self.node_sets:
            return
        names = tuple(self.node_sets)
        has = "" if names else " (it has no groups at all)"
        what = f'{self.source} has no group "{name}"{has}'
        raise MeshError.from_problems([Problem(where, what, names, nearest(name, names))])

    def _touched(self, rows: Mapping[str, IntArray]) -> IntArray:
        nodes = [self.blocks[kind][row].ravel() for kind, row in rows.items()]
        return np.unique(np.concatenate(nodes)) if nodes else np.zeros(0, dtype=int)
