"""A finite-element mesh with named groups, and integrals over its facets and lines.

Kinds are meshio's names (``"tetra10"``, ``"line"``) with VTK's node order; there is one block per
kind. Node numbers are the file's order, from 0. A group is a set of elements (by kind) and the
nodes they touch.

Curved facets are integrated with their own shape functions; basis and quadrature are scikit-fem's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from skfem import (
    ElementLineP1,
    ElementLineP2,
    ElementQuad1,
    ElementQuad2,
    ElementQuadS2,
    ElementTriP1,
    ElementTriP2,
)
from skfem.element import Element
from skfem.quadrature import get_quadrature

from flexmb.errors import MeshError, Problem, nearest
from flexmb.flexbody.arrays import FloatArray, IntArray

DIMENSION = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "polygon": 2} | {
    name: 3 for name in ("tetra", "pyramid", "wedge", "hexahedron", "polyhedron")
}


def dimension(kind: str) -> int:
    """Dimension of an element kind: 0 point, 1 line, 2 surface, 3 volume; -1 unknown."""
    return DIMENSION.get(kind.rstrip("0123456789").removeprefix("VTK_LAGRANGE_").lower(), -1)


_LARGEST = 1e100  # largest magnitude of a coordinate; its third power (a volume) is still finite


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
        Groups of nodes; every element group has one too: that of the file, such as a face whose
        elements are the solids behind it, or the nodes that it touches.
    element_sets : mapping of str to mapping of str to (k,) int
        Groups of elements: rows of the block of each kind.
    source : str
        Where it was read from, for messages.
    note : str
        What the file has besides a mesh, as text for messages.
    numbers : (n,) int, optional
        Numbers of the nodes in the file, if it has some.

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
    note: str = ""
    numbers: IntArray | None = None

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise MeshError(f"{self.source}: the mesh has no points in space")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            what = f"{self.node_text(int(bad[0]))} has a coordinate that is not a number"
            what += f" ({len(bad)} such nodes)" if len(bad) > 1 else ""
            raise MeshError(f"{self.source}: {what}")
        largest = float(np.abs(points).max())
        if largest > _LARGEST:
            node = int(np.abs(points).max(axis=1).argmax())
            what = f"{self.node_text(node)} has the coordinate {largest:g}: volumes overflow from"
            raise MeshError(f"{self.source}: {what} {_LARGEST:g} on")
        for kind, cells in self.blocks.items():
            if cells.size and (cells.min() < 0 or cells.max() >= len(points)):
                raise MeshError(
                    f"{self.source}: elements of kind {kind} name nodes that are absent"
                )
        object.__setattr__(self, "points", points)
        element_nodes = {name: self.touched_nodes(rows) for name, rows in self.element_sets.items()}
        node_sets = {name: np.unique(nodes) for name, nodes in self.node_sets.items()}
        object.__setattr__(self, "node_sets", element_nodes | node_sets)

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

    def node_text(self, node: int) -> str:
        """A node in a message: as it is counted here, and its number in the file."""
        own = self.numbers is not None and node < len(self.numbers)
        return f"node {node}" + (f" (number {self.numbers[node]} of the file)" if own else "")  # type: ignore[index]

    def _require(self, name: str, where: str) -> None:
        if name in self.node_sets:
            return
        names = tuple(self.node_sets)
        has = "" if names else " (it has no groups at all; nodes are named by number or place)"
        what = f'{self.source} has no group "{name}"{has}'
        raise MeshError.from_problems([Problem(where, what, names, nearest(name, names))])

    def touched_nodes(self, rows: Mapping[str, IntArray]) -> IntArray:
        """Nodes of the elements in these rows of each block."""
        nodes = [self.blocks[kind][row].ravel() for kind, row in rows.items()]
        return np.unique(np.concatenate(nodes)) if nodes else np.zeros(0, dtype=int)


FACETS: dict[str, tuple[Element, int]] = {  # basis and quadrature order; node order agrees
    "triangle": (ElementTriP1(), 2),
    "triangle6": (ElementTriP2(), 6),
    "quad": (ElementQuad1(), 3),
    "quad8": (ElementQuadS2(), 7),
    "quad9": (ElementQuad2(), 7),
    "line": (ElementLineP1(), 2),
    "line3": (ElementLineP2(), 6),
}
"""Kinds of facets and lines that can be integrated."""


class FacetRule(NamedTuple):
    """Values at the quadrature points of nf cells."""

    N: FloatArray  # (k, q) shape functions
    size: FloatArray  # (nf, q) area or length, weights included
    normal: FloatArray  # (nf, q, 3) unit normal by the order of the nodes; along a line its tangent


def facet_rule(kind: str, x: FloatArray) -> FacetRule:
    """Quadrature of cells with node coordinates x (nf, k, 3)."""
    element, order = FACETS[kind]
    points, weights = get_quadrature(element.refdom, order)
    shapes = [element.lbasis(points, k) for k in range(x.shape[1])]
    N = np.array([shape[0] for shape in shapes])
    dN = np.array([np.reshape(shape[1], (len(points), -1)) for shape in shapes])
    tangents = np.einsum("fkc,kdq->fqdc", x, dN)
    if len(points) == 2:
        direction = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    else:
        direction = tangents[:, :, 0]
    size = np.linalg.norm(direction, axis=2)
    normal = direction / np.where(size > 0, size, 1.0)[:, :, None]
    return FacetRule(N, size * weights, normal)


def group_centroid(mesh: Mesh, group: str, nodes: IntArray) -> FloatArray:
    """(3,) area centroid of the group's facets, else the length centroid of its lines, else the
    mean of ``nodes``."""
    facets = [(kind, cells) for kind, cells in group_facets(mesh, group, nodes) if len(cells)]
    if facets:
        moments = [facet_moments(kind, mesh.points[cells]) for kind, cells in facets]
        size = sum(part[0] for part in moments)
        return np.asarray(sum(part[1] for part in moments)) / size
    return mesh.points[nodes].mean(axis=0)


def facet_moments(kind: str, x: FloatArray) -> tuple[float, FloatArray]:
    """Area (or length) and its first moment (3,) of facets with node coordinates (nf, k, 3)."""
    rule = facet_rule(kind, x)
    return float(rule.size.sum()), np.einsum("fq,kq,fkc->c", rule.size, rule.N, x)


Facets = list[tuple[str, IntArray]]  # kind, and nodes of its cells


def group_facets(mesh: Mesh, group: str, nodes: IntArray) -> Facets:
    """Surfaces of a group, else its lines, whose nodes are all among ``nodes``."""
    for dim in (2, 1):
        facets = [
            (kind, cells[np.isin(cells, nodes).all(axis=1)])
            for kind, rows in mesh.group_elements(group).items()
            if dimension(kind) == dim and kind in FACETS
            for cells in [mesh.blocks[kind][rows]]
        ]
        if any(len(cells) for _, cells in facets):
            return facets
    return []


def facet_samples(points: FloatArray, facets: Facets, nodes: IntArray) -> csr_array:
    """(p, k) B: square root of the area at each quadrature point times the shape functions there.

    B^T B = int N^T N dA for fields over the facets, given by their values at ``nodes`` (ascending).
    """
    rows, columns, values, start = [], [], [], 0
    for kind, cells in facets:
        rule = facet_rule(kind, points[cells])
        entries = np.sqrt(rule.size)[:, :, None] * rule.N.T
        at = np.arange(start, start + rule.size.size).reshape(rule.size.shape)
        rows.append(np.broadcast_to(at[:, :, None], entries.shape).ravel())
        places = np.searchsorted(nodes, cells)[:, None]
        columns.append(np.broadcast_to(places, entries.shape).ravel())
        values.append(entries.ravel())
        start += rule.size.size
    parts = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csr_array(coo_array(parts, shape=(start, len(nodes))))
