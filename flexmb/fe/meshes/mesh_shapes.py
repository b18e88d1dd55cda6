"""Meshes of simple shapes, so that a simple body needs no file.

Sizes are in metres. Beams, tubes, boxes and plates begin at x = 0 and extend along x, their
sections centred on the x axis; disks lie in the xy plane around the origin. Edges of round shapes
lie on the circle, nodes in their middle too. A full disk is a square core with rings around it,
without elements that come to a point; a disk with a hole is rings alone. :func:`mesh_from` makes
the mesh of a table ``{type = "box", size = [1, 0.1, 0.1]}``, of a file, or takes a Mesh.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.meshes.lattice import (
    KINDS,
    Lattice,
    check_shape,
    division_counts,
    division_problems,
    divisions_across,
    divisions_along,
    divisions_around,
    even_divisions,
    few_around,
    fill,
    from_lattice,
    refuse,
)
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.mesh_file import read_mesh
from flexmb.fe.meshes.mesh_refinement import refine_mesh
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.mesh_options import MESHES, BeamMesh, BoxMesh, DiskMesh, PlateMesh, TubeMesh
from flexmb.flexbody.options import is_number, key_problems, kind_of, read_options, rooted
from flexmb.units import say_length

Divisions = int | Sequence[int] | None


def beam(
    length: float | None = None,
    points: Sequence[Sequence[float]] | None = None,
    divisions: Divisions = None,
) -> Mesh:
    """Line elements along x, or along a polyline.

    Groups ``start`` and ``end`` (nodes), ``leg1``, ``leg2``, ... (elements); of a polyline also
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
    refuse(division_problems(divisions, legs))
    counts = division_counts(divisions, [10] * len(legs))
    t = [np.arange(n) / n for n in counts]
    parts = [a + s[:, None] * (b - a) for s, a, b in zip(t, ends[:-1], ends[1:], strict=True)]
    nodes = np.concatenate([*parts, ends[-1:]])
    n = len(nodes) - 1
    at = np.cumsum([0, *counts])
    sets = {"start": np.array([0]), "end": np.array([n])}
    sets |= {f"corner{k}": at[k : k + 1] for k in range(1, len(legs))}
    rows = [np.arange(a, b) for a, b in zip(at[:-1], at[1:], strict=True)]
    groups = {f"leg{k + 1}": {"line": row} for k, row in enumerate(rows)}
    lines = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    return Mesh(nodes, {"line": lines}, sets, groups, source="beam")


def _polyline(length: Any, points: Any) -> FloatArray:
    refuse(check_shape(BeamMesh, length=length, points=points))
    if points is None:
        return np.array([[0.0, 0.0, 0.0], [float(length), 0.0, 0.0]])
    rows = [] if isinstance(points, str) else list(points)
    if len(rows) < 2:
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
    problems = check_shape(PlateMesh, length=length, width=width, elements=elements, skew=skew)
    problems += division_problems(divisions, ("x", "y"))
    if is_number(skew) and not abs(skew) < math.pi / 2:
        problems.append(Problem("mesh.skew", f"must be below a right angle, given {skew!r} rad"))
    refuse(problems)
    kind = elements or KINDS[2][0]
    n = division_counts(divisions, even_divisions(kind, (length, width)))
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


def _kind_problems(kind: str | None, dim: int) -> list[Problem]:
    """Solid elements where the shape is a surface, or the other way."""
    if kind is None or kind in KINDS[dim] or kind not in (*KINDS[2], *KINDS[3]):
        return []
    what = f"{'surfaces' if dim == 2 else 'solids'} do not have elements of kind {kind!r}"
    return [Problem("mesh.elements", what, KINDS[dim])]


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
    problems = check_shape(BoxMesh, size=size, elements=elements)
    problems += division_problems(divisions, tuple("xyz"))
    refuse(problems)
    kind = elements or KINDS[3][0]
    n = division_counts(divisions, even_divisions(kind, size))
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
    refine: int = 0,
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
    refine : int
        How many times the divisions are doubled.

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    solid = inner is not None
    words = ("through the wall", "around", "along")[0 if solid else 1 :]
    problems = check_shape(TubeMesh, length=length, radius=radius, inner=inner, elements=elements)
    problems += _kind_problems(elements, 3 if solid else 2)
    problems += division_problems(divisions, words) or few_around(divisions, words)
    if not problems and inner is not None and inner >= radius:
        what = f"must be less than the outer radius {say_length(radius)}, given {say_length(inner)}"
        problems.append(Problem("mesh.inner", what))
    refuse(problems)
    kind = elements or KINDS[3 if solid else 2][0]
    turns = divisions_around(kind) if divisions is None else division_counts(divisions, words)[-2]
    usual = (divisions_across(kind), turns, divisions_along(length, radius, turns))[
        0 if solid else 1 :
    ]
    n = division_counts(divisions, usual, refine)
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


_CORE = 0.55  # radius of the core's corners over that of the disk
_CORE_ROUNDNESS = 0.5  # 0: the core is a square, 1: a circle


def disk(
    radius: float,
    inner: float = 0.0,
    thickness: float | None = None,
    divisions: Divisions = None,
    elements: str | None = None,
    refine: int = 0,
) -> Mesh:
    """A disk in the xy plane around the origin, full or with a hole.

    Groups ``outer`` and ``inner`` (the hole), of solids also ``bottom`` and ``top`` (at
    z = -thickness/2 and thickness/2), of shells ``surface``.

    Parameters
    ----------
    radius, inner : float
        Outer radius and that of the hole [m]; none by default.
    thickness : float
        Of a solid [m]; none makes it a shell.
    divisions : int or list of int
        Elements along the radius (of a full disk: outside of its core), around, and through the
        thickness (solids only). Around a full disk a multiple of 4, with tetrahedra of 8.
    elements : str
        Kind of solid or surface elements; ``"hexahedron20"`` or ``"quad"`` by default.
    refine : int
        How many times the divisions are doubled.

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    solid = thickness is not None
    words = ("along the radius", "around", "through the thickness")[: 3 if solid else 2]
    problems = check_shape(
        DiskMesh, radius=radius, inner=inner, thickness=thickness, elements=elements
    )
    problems += _kind_problems(elements, 3 if solid else 2)
    problems += division_problems(divisions, words) or few_around(divisions, words)
    full = inner == 0
    if not problems and inner >= radius:
        what = f"must be less than the radius {say_length(radius)}, given {say_length(inner)}"
        problems.append(Problem("mesh.inner", what))
    turns = 0 if problems or divisions is None else division_counts(divisions, words)[1]
    # with tetrahedra, core and rings then match
    step = 8 if str(elements).startswith("tetra") else 4
    if full and turns % step:
        what = f"must be a multiple of {step} around a full disk, given {turns}"
        problems.append(Problem("mesh.divisions", what))
    refuse(problems)
    kind = elements or KINDS[3 if solid else 2][0]
    turns = turns or divisions_around(kind)
    width = radius - (_CORE * radius if full else inner)
    n = division_counts(
        divisions,
        (divisions_along(width, radius, turns), turns, divisions_across(kind))[: len(words)],
        refine,
    )
    return _full(kind, radius, thickness, n) if full else _ring(kind, (inner, radius), thickness, n)


def _ring(kind: str, radii: tuple[float, float], thickness: float | None, n: Sequence[int]) -> Mesh:
    lattice = fill(kind, n, closed=1)
    s, t, z = lattice.coordinates(n).T
    r, angle = radii[0] + s * (radii[1] - radii[0]), 2 * math.pi * t
    points = np.stack([r * np.cos(angle), r * np.sin(angle), _height(z, thickness)], axis=1)
    groups = {"inner": [lattice.sides[0, 0]], **_outer_groups(thickness, [lattice])}
    return from_lattice("disk", kind, points, lattice.cells, groups, surface=thickness is None)


def _full(kind: str, radius: float, thickness: float | None, n: Sequence[int]) -> Mesh:
    side = n[1] // 4
    square = (side, side, *n[2:])
    core, rings = fill(kind, square), fill(kind, n, closed=1)
    inside = _core_points(core, square, radius, thickness)
    same = _joined(core, rings, side)
    s, t, z = rings.coordinates(n).T
    angle = 2 * math.pi * t - 0.75 * math.pi
    outer = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), _height(z, thickness)], axis=1
    )
    start = inside[same[_first_ring(rings)]]
    points = np.vstack([inside, outer + (1 - s[:, None]) * (start - outer)])
    moved = Lattice(
        rings.counts,
        same[rings.cells],
        {key: (facet, same[cells]) for key, (facet, cells) in rings.sides.items()},
    )
    groups = _outer_groups(thickness, [moved, core])
    cells = np.concatenate([core.cells, moved.cells])
    return from_lattice("disk", kind, points, cells, groups, surface=thickness is None)


def _core_points(
    core: Lattice, square: Sequence[int], radius: float, thickness: float | None
) -> FloatArray:
    u, v, z = core.coordinates(square).T
    u, v = 2 * u - 1, 2 * v - 1
    flat = np.stack([u, v], axis=1) / math.sqrt(2)
    bent = np.stack([u * np.sqrt(1 - v**2 / 2), v * np.sqrt(1 - u**2 / 2)], axis=1)
    place = _CORE * radius * ((1 - _CORE_ROUNDNESS) * flat + _CORE_ROUNDNESS * bent)
    return np.column_stack([place, _height(z, thickness)])


def _first_ring(rings: Lattice) -> IntArray:
    """(n,) for each lattice point of the rings, the core's one at its angle and height."""
    _, t, z = np.indices(rings.counts).reshape(3, -1)
    return t * rings.counts[2] + z


def _joined(core: Lattice, rings: Lattice, side: int) -> IntArray:
    """(n,) number of each lattice point of the rings; those on the core have the core's numbers."""
    m = 2 * side
    steps = np.arange(m)
    i = np.concatenate([steps, np.full(m, m), m - steps, np.zeros(m, int)])
    j = np.concatenate([np.zeros(m, int), steps, np.full(m, m), m - steps])
    s, t, z = np.indices(rings.counts).reshape(3, -1)
    on_core = (i[t] * core.counts[1] + j[t]) * core.counts[2] + z
    own = int(np.prod(core.counts)) + np.arange(len(s))
    return np.where(s == 0, on_core, own)


def _height(z: FloatArray, thickness: float | None) -> FloatArray:
    return 0 * z if thickness is None else (z - 0.5) * thickness


def _outer_groups(
    thickness: float | None, lattices: Sequence[Lattice]
) -> Mapping[str, Sequence[tuple[str, IntArray]]]:
    groups = {"outer": [lattices[0].sides[0, 1]]}
    if thickness is not None:
        groups["bottom"] = [lattice.sides[2, 0] for lattice in lattices]
        groups["top"] = [lattice.sides[2, 1] for lattice in lattices]
    return groups


MeshLike = str | os.PathLike[str] | Mapping[str, Any] | Mesh

SHAPES: dict[str, Callable[..., Mesh]] = {
    "beam": beam,
    "plate": plate,
    "box": box,
    "tube": tube,
    "disk": disk,
}
"""What makes the mesh of each type."""


_ROUND_SHAPES = ("tube", "disk")


def mesh_from(mesh: MeshLike, where: str = "mesh", refine: int = 0) -> Mesh:
    """The mesh itself, that of a file, or that of the table of a simple shape.

    It is refined ``refine`` times: tubes and disks, whose nodes lie on the circle, by doubling
    their divisions; other meshes by halving all elements in every direction, where nodes keep their
    numbers.

    Raises
    ------
    MeshError
        A file that cannot be read, or what is wrong with the table, all at once.
    """
    if not isinstance(mesh, Mapping):
        return refine_mesh(mesh if isinstance(mesh, Mesh) else read_mesh(mesh), refine)
    kind = kind_of("shape of a mesh", tuple(SHAPES), mesh, where, MeshError)
    if key_problems(MESHES[kind], mesh, where):
        read_options(MESHES[kind], mesh, where, MeshError)
    try:
        words = {name: value for name, value in mesh.items() if name != "type"}
        if kind in _ROUND_SHAPES:
            return SHAPES[kind](**words, refine=refine)
        return refine_mesh(SHAPES[kind](**words), refine)
    except MeshError as error:
        raise MeshError.from_problems(rooted(where, error.problems)) from None
