"""A finite-element mesh with named groups: reading it with meshio, integrals over facets and lines.

Kinds are meshio's names (``"tetra10"``, ``"line"``) with VTK's node order; there is one block per
kind. Node numbers are the file's order, from 0. A group is a set of elements (by kind) and the
nodes they touch. meshio prints, may end the process on a file it cannot read, keeps bookkeeping
among the groups and leaves gmsh's two formats different: :func:`read_mesh` catches or normalises
all of that. Groups without a name are called ``"dim:tag"``.

Curved facets are integrated with their own shape functions; basis and quadrature are scikit-fem's.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

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
from flexmb.fe.meshes.abaqus_deck import ABAQUS, read_abaqus
from flexmb.fe.meshes.damaged_file import damage
from flexmb.fe.meshes.gmsh_file import read_gmsh
from flexmb.fe.meshes.med_file import read_med
from flexmb.fe.meshes.nastran_deck import NASTRAN, read_nastran
from flexmb.fe.meshes.vtk_cells import cells_left_out, rename_cells, teach_meshio
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.untrusted import check_reading, hdf5_beside, serve_reading

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


Groups = dict[str, dict[str, list[IntArray]]]

# kinds whose dimension meshio 5.3.5 does not know, so that it fails on them
_FORGOTTEN = ("wedge15", "pyramid13", "hexahedron24")


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a mesh in any format that meshio knows by its suffix.

    Parameters
    ----------
    path : path
        The file; coordinates are kept in its own unit.

    Raises
    ------
    MeshError
        No such file, or one that cannot be read.
    """
    source = Path(path)
    if not source.is_file():
        raise MeshError(f"{source}: there is no such mesh file")
    if not source.stat().st_size:
        raise MeshError(f"{source}: the mesh file is empty; export it again")
    problem = check_reading(source, "flexmb.fe.meshes.mesh")
    if problem is not None:
        raise MeshError(f"{source}: the mesh file {problem}")
    return _read(source)


def _read(source: Path) -> Mesh:
    raw = _read_quietly(source)
    try:
        points = np.asarray(raw.points, dtype=float)
        if points.ndim == 2 and points.shape[1] < 3:
            points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
        blocks, became = _merge_blocks(raw)
        groups = _named_groups(raw, became)
        node_sets = {name: np.asarray(nodes, int) for name, nodes in raw.point_sets.items()}
    except MeshError as error:
        raise MeshError(f"{source}: the mesh file is damaged: {error}") from None
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        raise MeshError(f"{source}: {damage(source, error)}") from error
    own = (getattr(raw, "note", ""), getattr(raw, "numbers", None))
    return Mesh(points, blocks, node_sets, groups, source.name, *own)


def _read_raw(source: Path) -> Any:
    import meshio

    own, suffix = None, source.suffix.lower()
    if suffix in ABAQUS:
        own = read_abaqus(source)
    elif suffix in NASTRAN:
        own = read_nastran(source)
    elif suffix == ".med":
        own = read_med(source)
    elif suffix == ".msh":
        own = read_gmsh(source)
    return meshio.read(source) if own is None else own


def _read_quietly(source: Path) -> Any:
    import meshio

    for kind in _FORGOTTEN:
        meshio._mesh.topological_dimension.setdefault(kind, 3)
    teach_meshio()
    noise = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(noise),
            contextlib.redirect_stderr(noise),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            raw = _read_raw(source)
        try:
            rename_cells(raw)
            note = cells_left_out(noise.getvalue())
        except MeshError as error:
            raise MeshError(f"{source}: {error}") from None
        raw.note = getattr(raw, "note", "") or note
        return raw
    except MeshError:
        raise
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001  its parsers let through what there is
        reason = error
    if source.suffix.lower() not in meshio.extension_to_filetypes:
        raise MeshError(
            f'{source}: no mesh format has the suffix "{source.suffix}"; allowed: .msh (Gmsh), '
            ".inp (Abaqus), .bdf, .nas, .fem (Nastran), .vtu, .vtk, .med, .xdmf and others of "
            "meshio; a geometry such as .step or .iges is to be meshed at first"
        )
    raise MeshError(f"{source}: {damage(source, reason)}") from reason


def _merge_blocks(raw: Any) -> tuple[dict[str, IntArray], list[IntArray]]:
    """One block per kind; and for each raw block the row of each of its elements in the merged
    block."""
    from meshio._common import num_nodes_per_cell

    kinds = list(dict.fromkeys(block.type for block in raw.cells))
    blocks: dict[str, IntArray] = {}
    became: list[IntArray] = [np.zeros(0, dtype=int)] * len(raw.cells)
    for kind in kinds:
        numbers = [k for k, block in enumerate(raw.cells) if block.type == kind]
        cells = np.concatenate([np.asarray(raw.cells[k].data, dtype=int) for k in numbers])
        if cells.shape[1] != num_nodes_per_cell.get(kind, cells.shape[1]):
            raise MeshError(f"elements of kind {kind} with {cells.shape[1]} nodes")
        blocks[kind], rows = _without_repeats(cells)
        ends = np.cumsum([len(raw.cells[k].data) for k in numbers])
        for number, part in zip(numbers, np.split(rows, ends[:-1]), strict=True):
            became[number] = part
    return blocks, became


def _without_repeats(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The distinct elements, in order of first occurrence, and the row of each given one among
    them."""
    _, first, same = np.unique(
        np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return cells[first[order]], rank[same.ravel()]


# data of a file that hold numbers of groups: gmsh's, Nastran's properties, references or materials
# of others
_TAGS = (
    "gmsh:physical", "nastran:ref", "medit:ref", "tetgen:ref", "ugrid:ref", "avsucd:material",
    "netgen:index", "su2:tag",
)  # fmt: skip


def _named_groups(raw: Any, became: list[IntArray]) -> dict[str, dict[str, IntArray]]:
    groups: Groups = {}
    for name, per_block in raw.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        for number, rows in enumerate(per_block):
            if rows is not None and len(rows):
                _add_rows(
                    groups, name, raw.cells[number].type, became[number][np.asarray(rows, int)]
                )
    by_name = set(groups)
    names = _names_of_tags(raw.field_data)
    tagged = next((raw.cell_data[key] for key in _TAGS if key in raw.cell_data), ())
    for number, tags in enumerate(tagged):
        kind = raw.cells[number].type
        for tag in np.unique(tags[tags != 0]):
            key = (dimension(kind), int(tag))
            name = names.get(key, f"{key[0]}:{key[1]}")
            if name not in by_name:
                _add_rows(groups, name, kind, became[number][np.asarray(tags) == tag])
    return {
        name: {kind: np.unique(np.concatenate(rows)) for kind, rows in kinds.items()}
        for name, kinds in groups.items()
    }


def _names_of_tags(field_data: Mapping[str, Any]) -> dict[tuple[int, int], str]:
    """gmsh's names of physical groups by (dimension, tag)."""
    return {
        (int(entry[1]), int(entry[0])): name
        for name, entry in field_data.items()
        if np.shape(entry) == (2,)
    }


def _add_rows(groups: Groups, name: str, kind: str, rows: IntArray) -> None:
    groups.setdefault(name, {}).setdefault(kind, []).append(rows)


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


def _read_apart(source: Path) -> None:
    # the reading in the main process raises the error again
    with hdf5_beside(), contextlib.suppress(MeshError):
        _read(source)


if __name__ == "__main__":
    serve_reading(_read_apart)
