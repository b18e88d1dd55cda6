"""What is wrong or suspicious about a mesh, in sentences.

:func:`mesh_report` returns :class:`Finding` objects: notes, warnings, and errors for a mesh that no
body can be made of. The quality of an element is its scaled Jacobian: at each corner the volume
(area) spanned by its edges over the product of their lengths, scaled to 1 for the regular element;
the smallest value of its corners. Source: Knupp et al., The Verdict Library Reference Manual,
Sandia 2007.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexmb.fe.elements.element_blocks import FAMILIES, Block
from flexmb.fe.elements.shell_fields import WARP_WARNING, warp
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.units import say_length

CORNERS: dict[str, tuple[str, float]] = {
    "triangle": ("12 20 01", 2 / math.sqrt(3)),
    "quad": ("13 20 31 02", 1.0),
    "tetra": ("123 203 013 021", math.sqrt(2)),
    "wedge": ("123 204 015 540 351 432", 2 / math.sqrt(3)),
    "hexahedron": ("134 205 316 027 750 461 572 643", 1.0),
}
"""Neighbours of each corner, in a right-handed order, and the scale of the regular element."""


def scaled_jacobian(kind: str, x: FloatArray) -> FloatArray | None:
    """(ne,) quality of elements with node coordinates x (ne, k, 3); None for other kinds.

    Numbering may be left- or right-handed, and a normal may point to either side; a negative value
    means that the element is folded.
    """
    shape = CORNERS.get(kind.rstrip("0123456789"))
    if shape is None:
        return None
    corners, scale = shape
    normal = None
    ratios = []
    for corner, neighbours in enumerate(corners.split()):
        edges = x[:, [int(k) for k in neighbours]] - x[:, [corner]]
        lengths = np.prod(np.linalg.norm(edges, axis=2), axis=1)
        if edges.shape[1] == 3:
            spanned = np.einsum("ec,ec->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
        else:
            areas = np.cross(edges[:, 0], edges[:, 1])
            normal = areas if normal is None else normal
            sign = np.where(np.einsum("ec,ec->e", areas, normal) < 0, -1.0, 1.0)
            spanned = sign * np.linalg.norm(areas, axis=1)
        ratios.append(spanned / np.where(lengths > 0, lengths, np.inf))
    quality = scale * np.array(ratios)
    return np.min(quality * np.where(quality.sum(axis=0) < 0, -1.0, 1.0), axis=0)


# scaled Jacobian below which an element is reported as a sliver; the regular element has 1
SLIVER = 0.05
_COINCIDENT = 1e-6  # nodes closer than this fraction of the extent of the mesh are coincident
# a node lies on an edge if its distance is below this fraction of the edge's length
_ON_EDGE = 1e-4
# plausible extent of a part [m]: one of 450 mm that is read as metres is outside
_EXTENT = (1e-4, 100.0)

Cells = tuple[str, IntArray]


class Finding(NamedTuple):
    """One sentence, and how bad it is: ``"note"``, ``"warning"`` or ``"error"``."""

    level: str
    sentence: str


def mesh_report(
    mesh: Mesh,
    blocks: Sequence[Block] | None = None,
    linked: Sequence[IntArray] = (),
    unit: str = "m",
    scale: float = 1.0,
) -> list[Finding]:
    """All findings about a mesh.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    blocks : sequence of Block, optional
        The elements of the body; without them its elements of the highest dimension.
    linked : sequence of (k,) int
        Nodes that are joined by other means: ties, interfaces.
    unit : str
        Unit in which places are stated; empty if it is not known.
    scale : float
        That unit in the unit of the coordinates.
    """
    if blocks is None:
        cells = _highest(mesh)
        shells = [(kind, nodes) for kind, nodes in cells if dimension(kind) == 2]
    else:
        cells = [(block.kind, block.nodes) for block in blocks]
        shells = [(b.kind, b.nodes) for b in blocks if b.family.dimension == 2]
    place = _Places(mesh, unit, scale)
    return [
        *([Finding("note", mesh.note)] if mesh.note else []),
        *_numbers(mesh),
        *_orphans(mesh, cells, linked),
        *_repeated(cells, place),
        *_inverted(cells, place),
        *_slivers(cells, place),
        *_warped(shells, place),
        *_coincident(mesh, cells, linked, place),
        *_hanging(mesh, cells, linked, place),
        *_apart(cells, linked, place, "warning" if blocks is None else "error"),
    ]


def size_sentence(points: FloatArray, unit: float = 1.0) -> str:
    """A sentence if the extent of these points [m] hints at a wrong unit of length; else empty.

    `unit` [m] is the mesh's unit of length: in a mesh in micrometres small parts are no hint.
    """
    extent = float(np.ptp(points, axis=0).max())
    if _EXTENT[0] * min(1.0, unit / 1e-3) <= extent <= _EXTENT[1]:
        return ""
    return f"the mesh extends over {say_length(extent)}: is its unit system the right one?"


def parts(count: int, groups: Sequence[IntArray]) -> IntArray:
    """(count,) number of the part that each node belongs to; rows of ``groups`` join nodes."""
    lists = [np.atleast_2d(group) for group in groups if np.size(group)] or [np.zeros((1, 1), int)]
    first = [np.repeat(rows[:, 0], rows.shape[1]) for rows in lists]
    ends = (np.concatenate([*first, []]).astype(int), np.concatenate([r.ravel() for r in lists]))
    graph = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


class _Places:
    """Writes the positions of nodes and elements as text."""

    def __init__(self, mesh: Mesh, unit: str, scale: float) -> None:
        self.points, self._unit, self._scale, self._mesh = mesh.points, unit, scale, mesh

    def node(self, number: int) -> str:
        return f"{self._mesh.node_text(number)} at {self._text(self.points[number])}"

    def element(self, nodes: IntArray) -> str:
        return f"at {self._text(self.points[nodes].mean(axis=0))}"

    def _text(self, point: FloatArray) -> str:
        text = ", ".join(f"{value:.4g}" for value in point / self._scale + 0.0)
        return f"({text}) {self._unit}".rstrip()


def _highest(mesh: Mesh) -> list[Cells]:
    kinds = mesh.kinds(3) or mesh.kinds(2) or mesh.kinds(1)
    return [(kind, mesh.blocks[kind]) for kind in kinds]


def _numbers(mesh: Mesh) -> Iterator[Finding]:
    if mesh.numbers is not None and (mesh.numbers != np.arange(len(mesh.numbers))).any():
        first, last = mesh.numbers[0], mesh.numbers[-1]
        what = f"nodes are counted from 0: number {first} of the mesh file is node 0 here, number "
        yield Finding("note", f"{what}{last} is node {len(mesh.numbers) - 1}")


def _used(cells: Sequence[Cells]) -> IntArray:
    return np.unique(np.concatenate([np.zeros(0, int), *(nodes.ravel() for _, nodes in cells)]))


def _orphans(mesh: Mesh, cells: Sequence[Cells], linked: Sequence[IntArray]) -> Iterator[Finding]:
    joined = [_used(cells), *(np.ravel(nodes) for nodes in linked)]
    missing = len(mesh.points) - len(np.unique(np.concatenate(joined)))
    if missing:
        what = "1 node belongs to no element of the body and is left out"
        if missing > 1:
            what = f"{missing} nodes belong to no element of the body and are left out"
        yield Finding("note", what)


def _repeated(cells: Sequence[Cells], place: _Places) -> Iterator[Finding]:
    for kind in dict.fromkeys(kind for kind, _ in cells):
        nodes = np.concatenate([rows for name, rows in cells if name == kind])
        keys = np.stack([nodes.min(axis=1), nodes.max(axis=1), nodes.sum(axis=1)], axis=1)
        _, like, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        some = np.sort(nodes[count[like.ravel()] > 1], axis=1)
        again, count = np.unique(some, axis=0, return_counts=True)
        if (count > 1).any():
            what = f'{(count > 1).sum()} of {len(nodes)} elements of kind "{kind}" are there more '
            what += f"than once, the first {place.element(again[count > 1][0])}: their stiffness "
            yield Finding("warning", f"{what}and mass count as often")


def _inverted(cells: Sequence[Cells], place: _Places) -> Iterator[Finding]:
    for kind, nodes in cells:
        family = FAMILIES.get(kind)
        bad = [] if family is None else family.defects(place.points[nodes])
        if len(bad):
            what = f'{len(bad)} of {len(nodes)} elements of kind "{kind}" are flat, folded or '
            what += f"turned inside out, the first {place.element(nodes[bad[0]])}"
            yield Finding("error", what)


def _slivers(cells: Sequence[Cells], place: _Places) -> Iterator[Finding]:
    for kind, nodes in cells:
        quality = scaled_jacobian(kind, place.points[nodes])
        if quality is None or not (quality < SLIVER).any():
            continue
        worst = int(np.argmin(quality))
        what = f'{(quality < SLIVER).sum()} of {len(nodes)} elements of kind "{kind}" are '
        what += f"slivers: quality (scaled Jacobian at the corners) below {SLIVER:g}, the least "
        yield Finding("warning", f"{what}{quality[worst]:.2g} {place.element(nodes[worst])}")


def _warped(shells: Sequence[Cells], place: _Places) -> Iterator[Finding]:
    for kind, nodes in shells:
        if not kind.startswith("quad"):
            continue
        out = warp(place.points[nodes[:, :4]])
        count, worst = int((out > WARP_WARNING).sum()), int(np.argmax(out))
        if count:
            what = f'{count} of {len(nodes)} elements of kind "{kind}" are warped: their corners '
            what += f"are off a plane by more than {WARP_WARNING:g} of their size, at most by "
            what += f"{out[worst]:.2g} {place.element(nodes[worst])}; mesh the twist finer"
            yield Finding("warning", what)


def _coincident(
    mesh: Mesh, cells: Sequence[Cells], linked: Sequence[IntArray], place: _Places
) -> Iterator[Finding]:
    used = _used(cells)
    if len(used) < 2:
        return
    near = _COINCIDENT * np.ptp(mesh.points[used], axis=0).max()
    for axis in np.sqrt([[0.2, 0.3, 0.5], [0.3, 0.5, 0.2], [0.5, 0.2, 0.3]]):
        used = used[np.argsort(mesh.points[used] @ axis)]
        gaps = np.diff(mesh.points[used] @ axis, prepend=-np.inf, append=np.inf)
        # nodes with a neighbour along one axis; sorting leaves few candidates
        used = used[np.minimum(gaps[1:], gaps[:-1]) <= 1.01 * near]
    if len(used) < 2:
        return
    tree = scipy.spatial.cKDTree(mesh.points[used])
    pairs = used[tree.query_pairs(near, output_type="ndarray")].reshape(-1, 2)
    if linked and len(pairs):
        joined = parts(len(mesh.points), linked)
        pairs = pairs[joined[pairs[:, 0]] != joined[pairs[:, 1]]]
    if len(pairs):
        a, b = min(map(sorted, pairs.tolist()))
        verb = "pair of nodes coincides" if len(pairs) == 1 else "pairs of nodes coincide"
        what = f"{len(pairs)} {verb}, the first {place.node(a)} with node {b}: what touches there "
        yield Finding("warning", f"{what}is not joined; merge the nodes if it should be")


def _hanging(
    mesh: Mesh, cells: Sequence[Cells], linked: Sequence[IntArray], place: _Places
) -> Iterator[Finding]:
    """Nodes on edges of elements that do not have these nodes: the mesh can open there."""
    used, ends = _used(cells), [np.zeros((0, 2), int)]
    for kind, nodes in cells:
        edges = FAMILIES[kind].edges if kind in FAMILIES else ()
        for number, (a, b) in enumerate(edges, 1):
            middle = max(map(max, edges)) + number
            path = (a, middle, b) if middle < nodes.shape[1] else (a, b)
            ends += [nodes[:, pair] for pair in pairwise(path)]
    low, high = np.sort(np.concatenate(ends), axis=1).T
    a, b = divmod(np.unique((low * len(mesh.points) + high)[low < high]), len(mesh.points))
    if len(used) < 3 or not len(a):
        return
    x = mesh.points
    _, near = scipy.spatial.cKDTree(x[used]).query((x[a] + x[b]) / 2, k=2)
    along, part_of = x[b] - x[a], parts(len(x), linked)
    square = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    hanging = set[int]()
    for node in used[near].T:
        share = np.sum((x[node] - x[a]) * along, axis=1) / square
        off = np.sum((x[node] - x[a] - share[:, None] * along) ** 2, axis=1)
        on = (abs(share - 0.5) < 0.49) & (off < _ON_EDGE**2 * square)
        on &= (part_of[node] != part_of[a]) & (part_of[node] != part_of[b])
        hanging |= set(node[on].tolist())
    if hanging:
        what = f"hanging nodes, on edges of elements that do not have them: {len(hanging)}, the "
        what += f"first {place.node(min(hanging))}; the body can open there: make the parts conform"
        yield Finding("warning", what)


def _apart(
    cells: Sequence[Cells], linked: Sequence[IntArray], place: _Places, level: str
) -> Iterator[Finding]:
    used = _used(cells)
    if not len(used):
        return
    part_of = parts(len(place.points), [*(nodes for _, nodes in cells), *linked])[used]
    names, first, count = np.unique(part_of, return_index=True, return_counts=True)
    if len(names) > 1:
        least = int(np.argmin(count))
        what = f"the mesh falls into {len(names)} parts that share no nodes and no interface; the "
        what += f"smallest has {count[least]} nodes, one of them {place.node(used[first[least]])}: "
        what += "merge coincident nodes, or make the parts conform"
        yield Finding(level, what)
