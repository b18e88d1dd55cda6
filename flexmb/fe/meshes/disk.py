"""Disks: full or with a hole, of surface elements, or of solid ones where a thickness is given.

In: radii and thickness [m], divisions, a kind of elements. Out: a :class:`Mesh` around the origin,
normal z. A full disk is a square core with rings around it, without elements that come to a point;
a disk with a hole is rings alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from flexmb.errors import Problem
from flexmb.fe.meshes import divisions as rule
from flexmb.fe.meshes.lattice import KINDS, Lattice, fill
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.shapes import Divisions, few_around, from_lattice, refuse
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["disk"]

_CORE = 0.55  # radius of the core's corners over that of the disk
_ROUND = 0.5  # 0: the core is a square, 1: a circle


def disk(
    radius: float,
    inner: float = 0.0,
    thickness: float | None = None,
    divisions: Divisions = None,
    elements: str | None = None,
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

    Raises
    ------
    MeshError
        Sizes or numbers that cannot be.
    """
    solid = thickness is not None
    words = ("along the radius", "around", "through the thickness")[: 3 if solid else 2]
    problems = rule.length_problems(radius=radius, thickness=thickness)
    problems += rule.length_problems(inner=inner or None)
    problems += rule.kind_problems(elements, 3 if solid else 2)
    problems += rule.division_problems(divisions, words) or few_around(divisions, 1)
    full = inner == 0
    if not problems and inner >= radius:
        what = f"must be less than the radius {radius:g} m, given {inner:g}"
        problems.append(Problem("mesh.inner", what))
    turns = 0 if problems or divisions is None else rule.chosen(divisions, words)[1]
    step = 8 if str(elements).startswith("tetra") else 4  # tetrahedra of core and rings conform
    if full and turns % step:
        what = f"must be a multiple of {step} around a full disk, given {turns}"
        problems.append(Problem("mesh.divisions", what))
    refuse(problems)
    kind = elements or KINDS[3 if solid else 2][0]
    turns = turns or rule.around(kind)
    width = radius - (_CORE * radius if full else inner)
    n = rule.chosen(
        divisions, (rule.beside(width, radius, turns), turns, rule.across(kind))[: len(words)]
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
    place = _CORE * radius * ((1 - _ROUND) * flat + _ROUND * bent)
    return np.column_stack([place, _height(z, thickness)])


def _first_ring(rings: Lattice) -> IntArray:
    """(n,) for each lattice point of the rings the one at its angle and height on the core."""
    _, t, z = np.indices(rings.counts).reshape(3, -1)
    return t * rings.counts[2] + z


def _joined(core: Lattice, rings: Lattice, side: int) -> IntArray:
    """(n,) number of each lattice point of the rings, those on the core having the core's."""
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
