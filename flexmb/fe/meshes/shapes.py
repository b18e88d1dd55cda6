"""Meshes of simple shapes, so that a simple body needs no file.

In: sizes [m], divisions, a kind of elements. Out: a :class:`Mesh` with named groups. Beams, tubes,
boxes and plates begin at x = 0 and extend along x, their sections centred on the x axis; disks lie
in the xy plane around the origin. Edges of round shapes lie on the circle, nodes in their middle
too. Numbers of elements that are not given follow :mod:`flexmb.fe.meshes.divisions`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.meshes import divisions as rule
from flexmb.fe.meshes.lattice import KINDS, fill
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.tables import is_number
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["beam", "box", "from_lattice", "plate", "refuse", "tube"]

Divisions = int | Sequence[int] | None
Facets = tuple[str, IntArray]


def beam(
    length: float | None = None,
    points: Sequence[Sequence[float]] | None = None,
    divisions: Divisions = None,
) -> Mesh:
    """Line elements along x, or along a polyline.

    Groups ``start`` and ``end`` (nodes); of a polyline also ``leg1``, ``leg2``, ... (elements) and
    ``corner1``, ... (nodes).

    Parameters
    ----------
    length : float
        From the origin along x [m].
    points : (k, 3) float
        Two or more points instead [m].
    divisions : int or list of int
        Elements of each leg; ten by default.

    Raises
    ------
    MeshError
        Both or none of length and points, a leg without length, or wrong divisions.
    """
    ends = _polyline(length, points)
    legs = [f"leg {k + 1}" for k in range(len(ends) - 1)]
    refuse(rule.division_problems(divisions, legs))
    counts = rule.chosen(divisions, [10] * len(legs))
    t = [np.arange(n) / n for n in counts]
    parts = [a + s[:, None] * (b - a) for s, a, b in zip(t, ends[:-1], ends[1:], strict=True)]
    nodes = np.concatenate([*parts, ends[-1:]])
    n = len(nodes) - 1
    at = np.cumsum([0, *counts])
    sets = {"start": np.array([0]), "end": np.array([n])}
    sets |= {f"corner{k}": at[k : k + 1] for k in range(1, len(legs))}
    rows = [np.arange(a, b) for a, b in zip(at[:-1], at[1:], strict=True)]
    several = len(legs) > 1
    groups = {f"leg{k + 1}": {"line": row} for k, row in enumerate(rows) if several}
    lines = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    return Mesh(nodes, {"line": lines}, sets, groups, source="beam")


def _polyline(length: Any, points: Any) -> FloatArray:
    if (length is None) == (points is None):
        told = "neither" if length is None else "both"
        refuse([Problem("mesh", f'give either "length" or "points" of a beam, given {told}')])
    refuse(rule.length_problems(length=length))
    if points is None:
        return np.array([[0.0, 0.0, 0.0], [float(length), 0.0, 0.0]])
    rows = list(points) if isinstance(points, Sequence | np.ndarray) else []
    good = [len(row) == 3 and all(is_number(c) for c in row) for row in rows if np.ndim(row) == 1]
    if len(good) != len(rows) or len(rows) < 2 or not all(good):
        what = f"must be two or more points of three numbers, given {points!r}"
        refuse([Problem("mesh.points", what)])
    ends = np.array(rows, dtype=float)
    short = np.flatnonzero(np.linalg.norm(np.diff(ends, axis=0), axis=1) == 0)
    refuse([Problem("mesh.points", f"points {k + 1} and {k + 2} coincide") for k in short])
    return ends


def plate(
    length: float,
    width: float,
    divisions: Divisions = None,
    elements: str | None = None,
    skew: float = 0.0,
) -> Mesh:
    """Surface elements in the xy plane, normal z: x from 0, y from -width/2 at no skew.

    Groups ``surface`` (elements), the edges ``x0``, ``x1``, ``y0``, ``y1`` (lines), all ``edges``
    together, ``corners`` and each corner, ``x0y0`` to ``x1y1`` (nodes).

    Parameters
    ----------
    length, width : float
        Lengths of the edges along x, and along y or inclined to it [m].
    divisions : int or (2,) int
        Elements along the two.
    elements : str
        ``"quad"`` (default) or ``"triangle"``.
    skew : float
        Angle from the y axis to the inclined edges, towards x [rad].

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    problems = rule.length_problems(length=length, width=width)
    problems += rule.kind_problems(elements, 2) + rule.division_problems(divisions, ("x", "y"))
    if not (is_number(skew) and abs(skew) < math.pi / 2):
        problems.append(Problem("mesh.skew", f"must be below a right angle, given {skew!r} rad"))
    refuse(problems)
    kind = elements or KINDS[2][0]
    n = rule.chosen(divisions, rule.even(kind, (length, width)))
    lattice = fill(kind, n)
    u, v, _ = lattice.coordinates(n).T
    across = (v - 0.5) * width
    points = np.stack(
        [u * length + across * math.sin(skew), across * math.cos(skew), 0 * u], axis=1
    )
    groups = {f"{'xy'[d]}{e}": [facets] for (d, e), facets in lattice.sides.items()}
    mesh = from_lattice("plate", kind, points, lattice.cells, groups, surface=True)
    edge = mesh.node_sets
    corners = {f"x{i}y{j}": np.intersect1d(edge[f"x{i}"], edge[f"y{j}"]) for i, j in _PAIRS}
    sets = {"corners": np.concatenate(list(corners.values())), **corners}
    sets["edges"] = np.unique(np.concatenate([edge[name] for name in groups]))
    return Mesh(mesh.points, mesh.blocks, sets, mesh.element_sets, source=mesh.source)


_PAIRS = ((0, 0), (0, 1), (1, 0), (1, 1))


def box(size: Sequence[float], divisions: Divisions = None, elements: str | None = None) -> Mesh:
    """Solid elements in a box, x from 0, centred in y and z.

    Groups: its faces ``x0``, ``x1``, ``y0``, ``y1``, ``z0``, ``z1`` (surfaces).

    Parameters
    ----------
    size : (3,) float
        Along x, y, z [m].
    divisions : int or (3,) int
        Elements along x, y, z.
    elements : str
        ``"hexahedron20"`` (default), ``"hexahedron27"``, ``"hexahedron"``, ``"tetra10"``,
        ``"tetra"`` or ``"wedge15"`` (prisms along z).

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    problems = rule.kind_problems(elements, 3) + rule.division_problems(divisions, tuple("xyz"))
    listed = isinstance(size, Sequence | np.ndarray) and not isinstance(size, str)
    if not listed or len(size) != 3 or not all(is_number(s) and s > 0 for s in size):
        problems.append(Problem("mesh.size", f"must be three positive lengths, given {size!r}"))
    refuse(problems)
    kind = elements or KINDS[3][0]
    n = rule.chosen(divisions, rule.even(kind, size))
    lattice = fill(kind, n)
    points = (lattice.coordinates(n) - [0.0, 0.5, 0.5]) * np.array(size)
    groups = {f"{'xyz'[d]}{e}": [facets] for (d, e), facets in lattice.sides.items()}
    return from_lattice("box", kind, points, lattice.cells, groups)


def tube(
    length: float,
    radius: float,
    inner: float | None = None,
    divisions: Divisions = None,
    elements: str | None = None,
) -> Mesh:
    """A hollow cylinder along x, of solid elements, or of surface elements with normals outwards.

    Groups ``start`` and ``end`` (at x = 0 and the other end), of solids also ``inner`` and
    ``outer`` (surfaces), of shells ``surface``.

    Parameters
    ----------
    length : float
        Along x, from 0 [m].
    radius : float
        Outer radius of a solid, radius of the surface of a shell [m].
    inner : float
        Inner radius of a solid [m]; none makes it a shell.
    divisions : int or list of int
        Elements through the wall (solids only), around, and along.
    elements : str
        Kind of solid or surface elements; ``"hexahedron20"`` or ``"quad"`` by default.

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    solid = inner is not None
    words = ("through the wall", "around", "along")[0 if solid else 1 :]
    problems = rule.length_problems(length=length, radius=radius, inner=inner)
    problems += rule.kind_problems(elements, 3 if solid else 2)
    problems += rule.division_problems(divisions, words) or few_around(divisions, int(solid))
    if not problems and inner is not None and inner >= radius:
        what = f"must be less than the outer radius {radius:g} m, given {inner:g}"
        problems.append(Problem("mesh.inner", what))
    refuse(problems)
    kind = elements or KINDS[3 if solid else 2][0]
    turns = rule.around(kind) if divisions is None else rule.chosen(divisions, words)[-2]
    usual = (rule.across(kind), turns, rule.beside(length, radius, turns))[0 if solid else 1 :]
    n = rule.chosen(divisions, usual)
    lattice = fill(kind, n, closed=int(solid))
    place = lattice.coordinates(n).T
    wall, angle, along = place if solid else (np.ones(len(place[0])), place[0], place[1])
    r = radius if inner is None else inner + wall * (radius - inner)
    angle = 2 * math.pi * angle
    points = np.stack([along * length, r * np.cos(angle), r * np.sin(angle)], axis=1)
    names = {(0, 0): "inner", (0, 1): "outer"} if solid else {}
    names |= {(len(n) - 1, 0): "start", (len(n) - 1, 1): "end"}
    groups = {name: [lattice.sides[side]] for side, name in names.items()}
    return from_lattice("tube", kind, points, lattice.cells, groups, surface=not solid)


def few_around(divisions: Any, direction: int) -> list[Problem]:
    """The problem of less than three elements around a circle."""
    if divisions is None or rule.chosen(divisions, (0,) * 3)[direction] >= 3:
        return []
    return [Problem("mesh.divisions", f"must be three or more around, given {divisions!r}")]


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
            found = sets.setdefault(name, {}).setdefault(facet, [])
            found.append(np.arange(first, first + len(rows)))
    return Mesh(
        points[used],
        {name: np.concatenate(parts) for name, parts in blocks.items()},
        {},
        {n: {k: np.concatenate(v) for k, v in found.items()} for n, found in sets.items()},
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
