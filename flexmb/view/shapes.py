"""Primitive shapes as triangles, each about its own axes, for all renderers.

Out: :class:`Triangles`, closed and oriented outwards, in the axes in which they are made; round
shapes are along z. Sizes are in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexmb.flexbody.arrays import Array, IntArray

_AROUND = 48  # number of corners of a drawn circle
_SHARP_DEGREES = 35.0  # edges with a larger angle are drawn as lines


@dataclass(frozen=True, eq=False)
class Triangles:
    """Points (n, 3) [m] and triangles (t, 3) as rows of indices into them."""

    points: Array
    faces: IntArray

    def moved(self, r: ArrayLike, A: ArrayLike | None = None) -> Triangles:
        """Rotated by A (3, 3), then translated by r (3,)."""
        turned = self.points if A is None else self.points @ np.asarray(A, dtype=float).T
        return Triangles(turned + np.asarray(r, dtype=float), self.faces)

    def along(self, axis: ArrayLike, r: ArrayLike = (0, 0, 0)) -> Triangles:
        """With the z axis rotated to a direction (3,), then translated by r (3,)."""
        return self.moved(r, axes_along(axis))


def joined(parts: list[Triangles]) -> Triangles:
    """Several shapes as one."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=False)]
    return Triangles(np.vstack([part.points for part in parts]), np.vstack(faces))


def axes_along(axis: ArrayLike) -> Array:
    """Right-handed axes (3, 3), as columns, with z along a direction (3,)."""
    z = unit(axis)
    x = unit(np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z))
    return np.column_stack([x, np.cross(z, x), z])


def unit(vector: ArrayLike) -> Array:
    """The unit vector of a direction (3,); z if its length is zero."""
    values = np.asarray(vector, dtype=float)
    length = float(np.linalg.norm(values))
    return np.asarray(values / length) if length > 0 else np.array([0.0, 0.0, 1.0])


def box(size: ArrayLike) -> Triangles:
    """A box of edge lengths `size` (3,) about the origin, edges along the axes."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    points = 0.5 * corners * np.asarray(size, dtype=float)
    return Triangles(points, np.array(faces, dtype=np.int64))


def cylinder(radius: float, length: float, axis: ArrayLike = (0, 0, 1)) -> Triangles:
    """A closed cylinder about the origin along `axis` (3,)."""
    half = 0.5 * length * unit(axis)
    return tube(-half, half, radius)


def sphere(radius: float, center: ArrayLike = (0, 0, 0)) -> Triangles:
    """A ball of `radius` at `center` (3,)."""
    polar = np.linspace(np.pi, 0, _AROUND // 2 + 1)[1:-1]
    ball = revolved(np.column_stack([np.sin(polar), np.cos(polar)]))
    return Triangles(radius * ball.points + np.asarray(center, dtype=float), ball.faces)


def tube(start: ArrayLike, stop: ArrayLike, radius: float, end: float | None = None) -> Triangles:
    """A closed cylinder from `start` (3,) to `stop` (3,); a cone towards another radius `end`."""
    a, b = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    axes = axes_along(b - a)
    ring = _circle() @ axes[:, :2].T
    top = radius if end is None else end
    return _loft(np.stack([b + top * ring, a + radius * ring]), b, a)


def revolved(profile: ArrayLike) -> Triangles:
    """The solid of revolution about z of a profile (k, 2) of radius and height, from below
    upwards."""
    rows = np.asarray(profile, dtype=float)[::-1]
    circle = np.column_stack([_circle(), np.zeros(_AROUND)])
    rings = rows[:, 0, None, None] * circle + rows[:, 1, None, None] * np.eye(3)[2]
    ends = (np.array([0.0, 0.0, rows[k, 1]]) for k in (0, -1))
    return _loft(rings, next(ends), next(ends))


def ring(outer: float, inner: float, length: float) -> Triangles:
    """A hollow cylinder along z."""
    half = 0.5 * length
    corners = ((outer, half), (inner, half), (inner, -half), (outer, -half))
    rings = np.stack([np.column_stack([r * _circle(), np.full(_AROUND, z)]) for r, z in corners])
    return _closed_loft(rings)


def frame_of(width: float, hole: float, length: float) -> Triangles:
    """A hollow square bar along z."""
    half, wall = 0.5 * length, 0.5 * (width - hole)
    middle = 0.5 * (width + hole) / 2
    sides = [box((wall, width, 2 * half)).moved((s * middle, 0, 0)) for s in (-1, 1)]
    return joined(
        [*sides, *(box((hole, wall, 2 * half)).moved((0, s * middle, 0)) for s in (-1, 1))]
    )


def torus(radius: float, thickness: float, turn: float = 2 * np.pi) -> Triangles:
    """A ring of round wire about z, or an arc of it starting at the x axis."""
    angle = np.linspace(0.0, turn, max(int(_AROUND * turn / (2 * np.pi)), 3) + 1)
    return wire(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) * radius, thickness / 2)


def wire(path: ArrayLike, radius: float, corners: int = 10) -> Triangles:
    """A round wire along points (k, 3)."""
    points = np.asarray(path, dtype=float)
    tangents = np.gradient(points, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-300)
    x = axes_along(tangents[0])[:, 0]
    rings, angle = [], 2 * np.pi * np.arange(corners) / corners
    for point, t in zip(points, tangents, strict=True):
        x = unit(x - (x @ t) * t)
        y = np.cross(t, x)
        rings.append(point + radius * (np.outer(np.cos(angle), x) + np.outer(np.sin(angle), y)))
    return _loft(np.stack(rings[::-1]), points[-1], points[0])


def coil(turns: float, radius: float, thickness: float, length: float) -> Triangles:
    """A helical spring from z = 0 to 1 with straight ends, to be stretched to about `length`."""
    flat = 0.5 * thickness / length
    angle = np.linspace(0, 2 * np.pi * turns, 24 * round(turns) + 1)
    wound = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.linspace(0.1, 0.9, len(angle))]
    )
    ends = [((0, 0, 0.0), (0, 0, 0.1)), ((0, 0, 0.9), (0, 0, 1.0))]
    spokes = [box((radius, thickness, 2 * flat)).moved((0.5 * radius, 0, z)) for z in (0.1, 0.9)]
    return joined(
        [_flat_wire(wound, thickness, flat), *spokes, *(tube(a, b, thickness / 2) for a, b in ends)]
    )


def _flat_wire(path: Array, thickness: float, half_height: float) -> Triangles:
    """A helix of wire whose section keeps its shape however z is stretched."""
    outward = path * [1, 1, 0]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    half, flat = 0.5 * thickness, np.array([0, 0, half_height])
    rings = np.stack(
        [path + half * outward + flat, path - half * outward + flat,
         path - half * outward - flat, path + half * outward - flat], axis=1
    )  # fmt: skip
    return _loft(rings[::-1], path[-1], path[0])


def spiral(inner: float, outer: float, turns: float, thickness: float) -> Triangles:
    """A flat spiral spring about z."""
    angle = np.linspace(0, 2 * np.pi * turns, int(20 * turns) + 1)
    radius = np.linspace(inner, outer, len(angle))
    path = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    return wire(path, thickness / 2)


def extrusion(outline: ArrayLike, thickness: float) -> Triangles:
    """A plate normal to z with a closed contour (n, 2 or 3) that does not intersect itself.

    It is triangulated by ear clipping (Meisters, Amer. Math. Monthly 82, 1975).
    """
    points = np.asarray(outline, dtype=float)[:, :2]
    if _area(points) < 0:
        points = points[::-1]
    n, caps = len(points), _ears(points)
    flat = np.vstack([np.column_stack([points, np.full(n, z)]) for z in (0.5, -0.5)])
    flat[:, 2] *= thickness
    first = np.arange(n)
    second = np.roll(first, -1)
    sides = [[first, first + n, second + n], [first, second + n, second]]
    faces = [caps, caps[:, ::-1] + n, *(np.column_stack(side) for side in sides)]
    return Triangles(flat, np.vstack(faces))


def toothed_wheel(radius: float, teeth: int, width: float, internal: bool = False) -> Triangles:
    """A gear with a pitch radius: trapezoidal teeth, one module above the pitch circle, 1.2
    below."""
    module = 2 * radius / teeth
    steps, tips = np.array([-0.28, -0.13, 0.13, 0.28]), np.array([-1.2, 1.0, 1.0, -1.2])
    angle = (2 * np.pi / teeth * (np.arange(teeth)[:, None] + steps)).ravel()
    r = np.tile(radius + module * (-tips if internal else tips), teeth)
    contour = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    if not internal:
        return extrusion(contour, width)
    outside = (radius + 3.5 * module) * np.column_stack([np.cos(angle), np.sin(angle)])
    rings = np.stack(
        [np.column_stack([points, np.full(len(angle), z * width)])
         for points, z in ((outside, 0.5), (contour, 0.5), (contour, -0.5), (outside, -0.5))]
    )  # fmt: skip
    return _closed_loft(rings)


def rack(count: int, module: float, width: float, height: float) -> Triangles:
    """A bar along x with `count` teeth that point to y, with the pitch line at y = 0, centred in
    z."""
    pitch = np.pi * module
    x = pitch * (np.arange(count)[:, None] - 0.5 * (count - 1) + [-0.28, -0.13, 0.13, 0.28])
    y = np.tile([-1.2, 1.0, 1.0, -1.2], count) * module
    half = 0.5 * pitch * count
    ends = [[half, -1.2 * module], [half, -height], [-half, -height], [-half, -1.2 * module]]
    return extrusion(np.vstack([np.column_stack([x.ravel(), y]), ends]), width)


def arrow(length: float, radius: float) -> Triangles:
    """An arrow from the origin along z; the head does not grow with the length."""
    head = min(6.0 * radius, 0.6 * length)
    shaft = tube((0, 0, 0), (0, 0, length - head), radius)
    return joined([shaft, tube((0, 0, length - head), (0, 0, length), 2.6 * radius, 0.0)])


def turn_arrow(radius: float, thickness: float, turn: float = 1.5 * np.pi) -> Triangles:
    """A curved arrow about z, starting at the x axis."""
    end = radius * np.array([np.cos(turn), np.sin(turn), 0.0])
    ahead = np.array([-np.sin(turn), np.cos(turn), 0.0])
    head = tube(end, end + 3.2 * thickness * ahead, 1.5 * thickness, 0.0)
    return joined([torus(radius, thickness, turn), head])


def sharp_edges(points: Array, faces: IntArray) -> IntArray:
    """Point pairs (e, 2) of the sharp edges of a surface, and of its border."""
    if not len(faces):
        return np.zeros((0, 2), dtype=np.int64)
    _, weld = np.unique(
        np.round(points / (np.abs(points).max() + 1e-300), 9), axis=0, return_inverse=True
    )
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    key = np.sort(weld.ravel()[pairs], axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    pairs, owner, key = pairs[order], owner[order], key[order]
    same = (key[1:] == key[:-1]).all(axis=1)
    twin = np.flatnonzero(same)
    normals = face_normals(points, faces)
    cosine = np.einsum("ti,ti->t", normals[owner[twin]], normals[owner[twin + 1]])
    alone = np.ones(len(pairs), dtype=bool)
    alone[twin] = alone[twin + 1] = False
    alone &= key[:, 0] != key[:, 1]
    return np.vstack([pairs[twin[cosine < np.cos(np.radians(_SHARP_DEGREES))]], pairs[alone]])


def face_normals(points: Array, faces: IntArray) -> Array:
    """Unit normals (t, 3) of triangles."""
    a, b, c = points[faces.T]
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def spread_points(points: Array, faces: IntArray, count: int, random: np.random.Generator) -> Array:
    """`count` random points (count, 3) on a surface, uniform over its area."""
    a, b, c = points[faces.T]
    areas = triangle_areas(points, faces)
    rows = random.choice(len(faces), count, p=areas / areas.sum())
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return np.asarray(a[rows] + u * (b - a)[rows] + v * (c - a)[rows])


def triangle_areas(points: Array, faces: IntArray) -> Array:
    """Areas (t,) of triangles."""
    a, b, c = points[faces.T]
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def _area(points: Array) -> float:
    after = np.roll(points, -1, axis=0)
    return 0.5 * float(np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]))


def _ears(points: Array) -> IntArray:
    """Triangles (n - 2, 3) of a counter-clockwise polygon (n, 2)."""
    left, faces = list(range(len(points))), []

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    while len(left) > 3:
        ring_ = points[left]
        before, after = np.roll(ring_, 1, axis=0), np.roll(ring_, -1, axis=0)
        convex = np.flatnonzero(cross(ring_ - before, after - ring_) > 0)
        for k in convex[np.argsort(np.linalg.norm(after - before, axis=1)[convex])]:
            a, b, c = before[k], ring_[k], after[k]
            inside = (cross(b - a, ring_ - a) > 0) & (cross(c - b, ring_ - b) > 0)
            inside &= cross(a - c, ring_ - c) > 0
            if not inside.any():
                break
        else:  # round-off has left no proper ear: any corner is taken
            k = 0
        faces.append([left[k - 1], left[k], left[(k + 1) % len(left)]])
        del left[k]
    return np.array([*faces, left], dtype=np.int64)


def _loft(rings: Array, top: Array, bottom: Array) -> Triangles:
    """A closed surface through rings (k, n, 3), counter-clockwise seen from the top."""
    k, n = rings.shape[:2]
    first = np.arange(n)
    second, last = np.roll(first, -1), (k - 1) * n
    faces = [np.stack([np.full(n, k * n), first, second], axis=1)]
    for upper in range(0, last, n):
        lower = upper + n
        faces.append(np.stack([upper + first, lower + first, lower + second], axis=1))
        faces.append(np.stack([upper + first, lower + second, upper + second], axis=1))
    faces.append(np.stack([np.full(n, k * n + 1), last + second, last + first], axis=1))
    return Triangles(np.vstack([*rings, top, bottom]), np.vstack(faces))


def _closed_loft(rings: Array) -> Triangles:
    """The surface through rings (k, n, 3) from each to the next and from the last to the first."""
    k, n = rings.shape[:2]
    first = np.arange(n)
    second, faces = np.roll(first, -1), []
    for row in range(k):
        a, b = n * row, n * ((row + 1) % k)
        faces += [np.stack([a + first, a + second, b + first], axis=1)]
        faces += [np.stack([a + second, b + second, b + first], axis=1)]
    return Triangles(rings.reshape(-1, 3), np.vstack(faces))


def _circle() -> Array:
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    return np.column_stack([np.cos(angle), np.sin(angle)])
