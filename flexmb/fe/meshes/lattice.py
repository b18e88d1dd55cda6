"""Elements between the points of a lattice: what all structured meshes are made of.

Lattice points lie at the corners, at the middles of edges and faces, and at the centres of the
cells. Tetrahedra, wedges and triangles divide each cell, in mirror images from cell to cell, so
that an even number of cells gives a symmetric mesh; six tetrahedra per cell after Kuhn (1960), IBM
J. Res. Dev. 4. Default divisions: ten second-order elements, or twenty first-order ones, along the
longest extent; along the others as many as give edges of equal length, at least two (four
first-order ones in solids); round shapes have 16 or 32 elements around.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from math import pi, prod
from numbers import Integral
from typing import Any, get_args

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.meshes.mesh import Mesh
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.options import is_number, option_types, read_options

KINDS = {
    2: ("quad", "triangle"),
    3: ("hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15"),
}
"""Kinds of elements by dimension, the usual one first."""

_EDGES = {
    "hexahedron": "01 12 23 30 45 56 67 74 04 15 26 37",
    "tetra": "01 12 20 03 13 23",
    "wedge": "01 12 20 34 45 53 03 14 25",
}
# faces of a hexahedron; hexahedron27 has nodes at their centres
_FACES = "0374 1265 0154 3267 0123 4567"
_MIRRORED = {  # order of nodes that makes a mirrored element right-handed again
    "triangle": [0, 2, 1],
    "tetra": [0, 2, 1, 3],
    "wedge": [0, 2, 1, 3, 5, 4],
}
_FACETS = {2: "line", 3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_SQUARE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
_SPLIT = (_SQUARE[:3], (_SQUARE[0], _SQUARE[2], _SQUARE[3]))

Side = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Lattice:
    """Elements between lattice points.

    Parameters
    ----------
    counts : (3,) int
        Lattice points along each direction.
    cells : (ne, k) int
        Elements, by lattice points.
    sides : mapping of (direction, 0 or 1) to (kind, cells)
        Outer facets of each side, turned outwards.
    """

    counts: IntArray
    cells: IntArray
    sides: Mapping[Side, tuple[str, IntArray]]

    def coordinates(self, divisions: Sequence[int]) -> FloatArray:
        """(n, 3) position of every lattice point, 0 to 1 along each direction."""
        grid = np.indices(self.counts).reshape(3, -1).T
        full = [2 * n for n in divisions] + [1] * (3 - len(divisions))
        return grid / np.array(full)


def fill(kind: str, divisions: Sequence[int], closed: int = -1) -> Lattice:
    """Fill a box of cells with elements.

    Parameters
    ----------
    kind : str
        One of ``KINDS``; those of dimension 2 need two divisions.
    divisions : two or three int
        Number of cells along each direction.
    closed : int
        Direction in which the last cell adjoins the first (a ring); none by default.
    """
    cells = np.indices(divisions).reshape(len(divisions), -1).T
    cells = np.pad(cells, ((0, 0), (0, 3 - len(divisions))))
    counts = np.array([2 * n + 1 for n in divisions] + [1] * (3 - len(divisions)))
    if closed >= 0:
        counts[closed] -= 1
    ends = np.array([*divisions, *[1] * (3 - len(divisions))]) - 1
    open_sides = [(d, e) for d in range(len(divisions)) if d != closed for e in (0, 1)]
    elements: list[IntArray] = []
    facets: dict[Side, list[IntArray]] = {side: [] for side in open_sides}
    for parity, tables in _tables(kind).items():
        selected = cells if parity is None else cells[(cells % 2 == parity).all(axis=1)]
        for table in tables:
            elements.append(_numbers(selected, table, counts))
            for axis, end in open_sides:
                nodes = _facet(table, axis, end, len(divisions))
                if len(nodes):
                    outer = selected[selected[:, axis] == ends[axis] * end]
                    facets[axis, end].append(_numbers(outer, table[nodes], counts))
    sides = {side: np.concatenate(cells_of) for side, cells_of in facets.items()}
    named = {side: (_FACETS[cells_of.shape[1]], cells_of) for side, cells_of in sides.items()}
    return Lattice(counts, np.concatenate(elements), named)


def _numbers(cells: IntArray, table: IntArray, counts: IntArray) -> IntArray:
    """(nc, k) lattice points of the nodes ``table`` (k, 3), in half cells from the corner of each
    cell."""
    points = (2 * cells[:, None] + table) % counts  # in a closed direction the numbers wrap around
    return (points[..., 0] * counts[1] + points[..., 1]) * counts[2] + points[..., 2]


def _tables(kind: str) -> dict[tuple[int, ...] | None, list[IntArray]]:
    """Nodes (k, 3), in half cells, of the elements of one cell, by the parity of its position."""
    shape = kind.rstrip("0123456789")
    elements = _corners(shape)
    if shape in ("hexahedron", "quad"):
        return {None: [_nodes(shape, corners, kind) for corners in elements]}
    tables: dict[tuple[int, ...] | None, list[IntArray]] = {}
    for parity in product((0, 1), repeat=3):
        mirrored = [np.where(parity, 1 - corners, corners) for corners in elements]
        if sum(parity) % 2:
            mirrored = [corners[_MIRRORED[shape]] for corners in mirrored]
        tables[parity] = [_nodes(shape, corners, kind) for corners in mirrored]
    if shape != "tetra":  # prisms and triangles are the same in every layer
        return {(a, b, c): tables[a, b, 0] for a, b, c in product((0, 1), repeat=3)}
    return tables


def _corners(shape: str) -> list[IntArray]:
    """Corners (k, 3) of the elements of one cell, 0 or 1 along each direction."""
    if shape == "quad":
        return [np.array(_SQUARE)]
    if shape == "triangle":
        return [np.array(part) for part in _SPLIT]
    up = np.array([0, 0, 1])
    if shape == "hexahedron":
        return [np.vstack([_SQUARE, np.array(_SQUARE) + up])]
    if shape == "wedge":
        return [np.vstack([part, np.array(part) + up]) for part in _SPLIT]
    tetrahedra = []
    for order in permutations(range(3)):
        path = np.vstack([np.zeros(3, int), np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0)])
        right = np.linalg.det(path[1:]) > 0
        tetrahedra.append(path if right else path[_MIRRORED["tetra"]])
    return tetrahedra


def _nodes(shape: str, corners: IntArray, kind: str) -> IntArray:
    """All nodes of an element, in half cells: corners, middles of edges, of faces, centre."""
    parts = [2 * corners]
    if kind != shape:
        parts.append(
            np.array([corners[int(a)] + corners[int(b)] for a, b in _EDGES[shape].split()])
        )
    if kind == "hexahedron27":
        faces = [corners[[int(k) for k in face]].sum(axis=0) // 2 for face in _FACES.split()]
        parts += [np.array(faces), np.ones((1, 3), int)]
    return np.concatenate(parts)


def _facet(table: IntArray, axis: int, end: int, dim: int) -> list[int]:
    """Nodes of an element on a side of its cell, in VTK's order and turned outwards; empty if
    none."""
    on = [k for k in range(len(table)) if table[k, axis] == 2 * end]
    corners = [k for k in on if not (table[k] % 2).any()]
    if len(corners) < dim:
        return []
    u, v = ((axis + 1) % 3, (axis + 2) % 3) if end else ((axis + 2) % 3, (axis + 1) % 3)
    flat = table[corners] - table[corners].mean(axis=0)
    corners = [corners[k] for k in np.argsort(np.arctan2(flat[:, v], flat[:, u]), kind="stable")]
    around = zip(corners, corners[1:] + corners[:1], strict=True)
    wanted = [(table[a] + table[b]) / 2 for a, b in around] + [table[corners].mean(axis=0)]
    middles = [k for place in wanted for k in on if k not in corners and (table[k] == place).all()]
    return corners + list(dict.fromkeys(middles))


# default number of elements along the longest extent; key: second order
_ALONG_LONGEST = {True: 10, False: 20}
_AROUND = {True: 16, False: 32}
_THROUGH_WALL = {True: 1, False: 2}  # default number of elements through a wall
_MAX_ALONG_TUBE = 40  # largest default number of elements along a tube
_MAX_NODES = 10_000_000  # largest number of nodes; more is a typing error


def _second_order(kind: str) -> bool:
    return kind not in ("line", "quad", "triangle", "hexahedron", "tetra")


def even_divisions(kind: str, extents: Sequence[float]) -> tuple[int, ...]:
    """The default divisions of a box of these extents."""
    fine = _second_order(kind)
    edge = max(extents) / _ALONG_LONGEST[fine]
    least = 4 if not fine and len(extents) == 3 else 2
    return tuple(max(least, round(extent / edge)) for extent in extents)


def divisions_around(kind: str) -> int:
    """The default number of elements around a circle."""
    return _AROUND[_second_order(kind)]


def divisions_across(kind: str) -> int:
    """The default number of elements through a wall."""
    return _THROUGH_WALL[_second_order(kind)]


def divisions_along(extent: float, radius: float, turns: int) -> int:
    """The default number along an extent if ``turns`` elements lie on a circle: edges of equal
    length."""
    return min(_MAX_ALONG_TUBE, max(2, round(extent * turns / (2 * pi * radius))))


def division_counts(divisions: Any, usual: Sequence[int], refine: int = 0) -> tuple[int, ...]:
    """The given divisions, or the default ones; a single number counts for all directions.

    They are doubled `refine` times.
    """
    counts = usual if divisions is None else divisions
    numbers = [counts] * len(usual) if is_number(counts) else counts
    doubled = tuple(int(n) * 2**refine for n in numbers)
    if refine:
        refuse(division_problems(doubled, usual))
    return doubled


def division_problems(divisions: Any, words: Sequence[Any]) -> list[Problem]:
    """What is wrong with divisions along the directions ``words``; nothing with None."""
    if divisions is None:
        return []
    numbers = [divisions] * len(words) if is_number(divisions) else divisions
    listed = isinstance(numbers, list | tuple) and len(numbers) == len(words)
    if not listed or not all(
        isinstance(n, Integral) and not isinstance(n, bool) and n >= 1 for n in numbers
    ):
        what = f"must be whole numbers from 1 on, {', '.join(words)}; given {divisions!r}"
        return [Problem("mesh.divisions", what)]
    nodes = prod(2.0 * n + 1.0 for n in numbers)
    if nodes > _MAX_NODES:
        what = (
            f"would make up to {nodes:.3g} nodes, more than {_MAX_NODES:.0e}; given {divisions!r}"
        )
        return [Problem("mesh.divisions", what)]
    return []


def check_shape(options: type, **values: Any) -> list[Problem]:
    """Problems with the sizes and the kind of elements of a shape; sizes that are None are
    skipped."""
    (shape,) = get_args(option_types(options)["type"][0])
    words = {name: value for name, value in values.items() if value is not None}
    try:
        read_options(options, {"type": shape, **words}, "mesh", MeshError)
    except MeshError as error:
        return list(error.problems)
    return []


Facets = tuple[str, IntArray]


def few_around(divisions: Any, words: Sequence[str]) -> list[Problem]:
    """The problem of fewer than three elements around a circle, one of the directions ``words``."""
    if divisions is None or division_counts(divisions, (0,) * 3)[words.index("around")] >= 3:
        return []
    what = f"must be three or more around, given {divisions!r}; they are {', '.join(words)}"
    return [Problem("mesh.divisions", what)]


def from_lattice(
    source: str,
    kind: str,
    points: FloatArray,
    cells: IntArray,
    groups: Mapping[str, Sequence[Facets]],
    surface: bool = False,
) -> Mesh:
    """The mesh of elements on a lattice, without the points that none of them uses.

    Parameters
    ----------
    source, kind : str
        Name of the mesh, and of the kind of its elements.
    points : (n, 3) float
        Places of all lattice points [m].
    cells : (ne, k) int
        Elements.
    groups : mapping of str to list of (kind, cells)
        Facets of each group.
    surface : bool
        Whether the elements themselves make a group ``surface``.
    """
    used = np.unique(cells)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    blocks: dict[str, list[IntArray]] = {kind: [number[cells]]}
    sets: dict[str, dict[str, list[IntArray]]] = {}
    if surface:
        sets["surface"] = {kind: [np.arange(len(cells))]}
    for name, facets in groups.items():
        for facet, rows in facets:
            parts = blocks.setdefault(facet, [])
            first = sum(len(part) for part in parts)
            parts.append(number[rows])
            rows_of = sets.setdefault(name, {}).setdefault(facet, [])
            rows_of.append(np.arange(first, first + len(rows)))
    return Mesh(
        points[used],
        {name: np.concatenate(parts) for name, parts in blocks.items()},
        {},
        {n: {k: np.concatenate(v) for k, v in rows_of.items()} for n, rows_of in sets.items()},
        source=source,
    )


def refuse(problems: Sequence[Problem]) -> None:
    """Raise what is wrong, if anything is.

    Raises
    ------
    MeshError
        With all the problems.
    """
    if problems:
        raise MeshError.from_problems(problems)
