"""Uniform refinement of a mesh: every edge is halved; groups and node numbers are kept.

A line becomes two elements of the same kind, a triangle or quadrilateral four, a solid eight;
tetrahedra are divided after Bey (1995), Computing 55, across the shortest diagonal. New nodes are
placed by the shape functions of their element, so they lie on its curved edges. A point of an
element is identified by the weights of its corners, so that neighbours that share an edge or face
find the same points, whatever their kinds. A group of nodes without elements gains the new nodes
between its own on an edge or a face.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

_MAX_NODES = 2_000_000
_PARTS = 64  # corner weights are stored as whole numbers of this fraction of one
_CORNERS = {
    "line": "0 1",
    "triangle": "00 10 01",
    "quad": "00 10 11 01",
    "tetra": "000 100 010 001",
    "wedge": "000 100 010 001 101 011",
    "hexahedron": "000 100 110 010 001 101 111 011",
}
_EDGES = {
    "line": "01",
    "triangle": "01 12 20",
    "quad": "01 12 23 30",
    "tetra": "01 12 20 03 13 23",
    "wedge": "01 12 20 34 45 53 03 14 25",
    "hexahedron": "01 12 23 30 45 56 67 74 04 15 26 37",
}
_CENTRES = {"quad9": "0123", "hexahedron27": "0374 1265 0154 3267 0123 4567 01234567"}
_TRIANGLES = "0 01 02|01 1 12|02 12 2|01 12 02"
_TETRAHEDRA = (
    "0 01 02 03|01 1 12 13|02 12 2 23|03 13 23 3|01 02 03 13|01 12 02 13|02 03 13 23|02 13 12 23"
)


# permutation of the nodes of a tetrahedron that rotates it about its corner 3
_TURN = [1, 2, 0, 3, 5, 6, 4, 8, 9, 7]


class _Division(NamedTuple):
    """How the elements of a kind are divided; points by the weights of the parent's corners."""

    weights: IntArray  # (points, corners) in parts: the parent's own nodes first
    shapes: FloatArray  # (points, nodes) shape functions of the parent
    children: IntArray  # (children, nodes) their nodes among the points


def refine_mesh(mesh: Mesh, times: int = 1) -> Mesh:
    """A mesh whose elements are halved in every direction, so many times.

    Raises
    ------
    MeshError
        Elements that cannot be divided, or more than two million nodes.
    """
    kinds = [kind for kind, cells in mesh.blocks.items() if len(cells) and dimension(kind) > 0]
    other = [kind for kind in kinds if kind.rstrip("0123456789") not in _CORNERS]
    if other and times:
        raise MeshError(f"{mesh.source}: elements of kind {other[0]} cannot be refined")
    counts = {kind: len(mesh.blocks[kind]) for kind in kinds} if times else {}
    growth = sum(n * len(_division(kind).children) ** times for kind, n in counts.items())
    if growth > _MAX_NODES:
        what = f"refining it makes {growth:.3g} elements, more than {_MAX_NODES:.0e}"
        raise MeshError(f"{mesh.source}: {what}")
    for _ in range(times):
        mesh = _halve(mesh, kinds)
    return mesh


def _halve(mesh: Mesh, kinds: list[str]) -> Mesh:
    divisions = {kind: _division(kind) for kind in kinds}
    cells = {kind: _turn(kind, mesh.blocks[kind], mesh.points) for kind in kinds}
    keys = [_keys(cells[kind], divisions[kind].weights) for kind in kinds]
    places = [
        np.einsum("pk,ekc->epc", divisions[kind].shapes, mesh.points[cells[kind]]) for kind in kinds
    ]
    own = _own_keys(len(mesh.points), [*cells.values()], keys)
    rows = np.concatenate([own, *(key.reshape(-1, key.shape[-1]) for key in keys)])
    _, first, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    numbers = number[same.ravel()]
    points = np.concatenate([mesh.points, *(place.reshape(-1, 3) for place in places)])
    blocks = {kind: cells for kind, cells in mesh.blocks.items() if kind not in kinds}
    at = len(own)
    for kind, key in zip(kinds, keys, strict=True):
        here = numbers[at : at + key.shape[0] * key.shape[1]].reshape(key.shape[:2])
        at += here.size
        children = divisions[kind].children
        blocks[kind] = here[:, children].reshape(-1, children.shape[1])
    return Mesh(
        points[first[order]], blocks, _grown_sets(mesh, rows[first[order]]),
        {name: {kind: _children_rows(kind, row, divisions) for kind, row in groups.items()}
         for name, groups in mesh.element_sets.items()},
        source=mesh.source, note=mesh.note, numbers=mesh.numbers,
    )  # fmt: skip


def _turn(kind: str, cells: IntArray, points: FloatArray) -> IntArray:
    """Tetrahedra numbered so that the diagonal 02-13 of the middles of their edges is shortest."""
    if kind.rstrip("0123456789") != "tetra":
        return cells
    x = points[cells[:, :4]]
    a, b, c, d = (x[:, k] for k in range(4))
    lengths = [a + c - b - d, b + a - c - d, c + b - a - d]  # twice each of the three diagonals
    shortest = np.argmin([np.linalg.norm(one, axis=1) for one in lengths], axis=0)
    turns = np.array([[0, 1, 2, 3, 4, 5, 6, 7, 8, 9], _TURN, [_TURN[k] for k in _TURN]])
    return np.take_along_axis(cells, turns[shortest][:, : cells.shape[1]], axis=1)


def _children_rows(kind: str, rows: IntArray, divisions: dict[str, _Division]) -> IntArray:
    if kind not in divisions:
        return rows
    count = len(divisions[kind].children)
    return (np.asarray(rows)[:, None] * count + np.arange(count)).ravel()


def _grown_sets(mesh: Mesh, keys: IntArray) -> dict[str, IntArray]:
    """Groups of nodes other than those of their elements, with the new nodes between theirs."""
    corners = keys // (_PARTS + 1)
    sets = {}
    for name, nodes in mesh.node_sets.items():
        elements = mesh.element_sets.get(name)
        if elements is not None and np.array_equal(nodes, mesh.touched_nodes(elements)):
            continue
        inside = np.zeros(len(mesh.points) + 1, dtype=bool)
        # the last entry stands for the corners that a point does not have
        inside[nodes] = inside[-1] = True
        between = np.flatnonzero(inside[corners].all(axis=1))
        sets[name] = np.union1d(nodes, between[between >= len(mesh.points)])
    return sets


def _keys(cells: IntArray, weights: IntArray) -> IntArray:
    """(n, points, 8) keys of points: the corners with weight, ascending, and these weights; -1 if
    none."""
    corners = cells[:, None, : weights.shape[1]]
    keys = np.full((len(cells), len(weights), 8), -1)
    keys[:, :, : weights.shape[1]] = np.where(weights > 0, corners * (_PARTS + 1) + weights, -1)
    keys.sort(axis=2)
    return keys[:, :, ::-1]


def _own_keys(count: int, cells: list[IntArray], keys: list[IntArray]) -> IntArray:
    """(n, 8) keys of the existing nodes, as points of their elements."""
    own = np.full((count, 8), -1)
    own[:, 0] = np.arange(count) * (_PARTS + 1) + _PARTS
    for block, key in zip(cells, keys, strict=True):
        own[block] = key[:, : block.shape[1]]
    return own


@cache
def _division(kind: str) -> _Division:
    shape = kind.rstrip("0123456789")
    corners = np.array([[float(x) for x in word] for word in _CORNERS[shape].split()])
    nodes = _nodes(kind, corners)
    children = np.array([_nodes(kind, child) for child in _children(shape, corners)])
    points, where = list(nodes), np.zeros(children.shape[:2], dtype=int)
    for child, row in zip(children, where, strict=True):
        for j, place in enumerate(child):
            match = [i for i, point in enumerate(points) if np.allclose(point, place)]
            row[j] = match[0] if match else len(points)
            points += [] if match else [place]
    places = np.array(points)
    linear = _monomials(shape, corners)
    weights = np.rint(_PARTS * _monomials(shape, places) @ np.linalg.inv(linear)).astype(int)
    shapes = _monomials(kind, places) @ np.linalg.inv(_monomials(kind, nodes))
    return _Division(weights, shapes, where)


def _nodes(kind: str, corners: FloatArray) -> FloatArray:
    """The nodes of an element: corners, middles of edges, of faces, centre."""
    shape = kind.rstrip("0123456789")
    words = [] if kind == shape else _EDGES[shape].split()
    words += _CENTRES.get(kind, "").split()
    return np.array([*corners, *(corners[[int(k) for k in word]].mean(axis=0) for word in words)])


def _children(shape: str, corners: FloatArray) -> list[FloatArray]:
    if shape in ("line", "quad", "hexahedron"):
        return [0.5 * (corners + start) for start in corners]
    table = _TETRAHEDRA if shape == "tetra" else _TRIANGLES
    base = corners[:3] if shape == "wedge" else corners
    parts = [
        np.array([base[[int(k) for k in word]].mean(axis=0) for word in child.split()])
        for child in table.split("|")
    ]
    if shape != "wedge":
        return parts
    up = np.array([0.0, 0.0, 0.5])
    return [np.vstack([part, part + up]) + k * up for k in (0, 1) for part in parts]


def _monomials(kind: str, x: FloatArray) -> FloatArray:
    """(n, nodes) monomials of the shape functions of a kind at points x (n, dim)."""
    shape = kind.rstrip("0123456789")
    dim, most = x.shape[1], 1 if kind == shape else 2
    powers = []
    for power in product(range(most + 1), repeat=dim):
        squares = sum(p == 2 for p in power)
        flat = sum(power[:2])
        if shape in ("triangle", "tetra"):
            fits = sum(power) <= most
        elif shape == "wedge":
            fits = flat <= (1 if power[2] == 2 else most)
        else:
            fits = squares <= 1 or kind in ("quad9", "hexahedron27")
        if fits:
            powers.append(power)
    return np.stack([np.prod(x ** np.array(power), axis=1) for power in powers], axis=1)
