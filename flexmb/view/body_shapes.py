"""The shapes of rigid bodies and of ground; plates and shells with their thickness.

A body without a shape is drawn as rods between the markers that joints and forces use and a lump at
its centre of mass; one with a shape has rods to joints outside of it. A cam is a plate, an open
curve a wire, a roller a disk, a flat follower a pad. Ground is a bearing bracket behind rotating
parts and a hatched wall at clamped ones. The surface of a flexible body contains only the
mid-surface of its shells: each of their triangles is drawn at both faces, and the rim is closed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.parts import Surface
from flexmb.model.body import RigidBodySpec
from flexmb.model.joints.curve import curve_shape
from flexmb.model.joints.joint import JointSpec
from flexmb.model.lookup import joint_frames
from flexmb.model.reading import GROUND as GROUND_NAME
from flexmb.model.reading import split_reference
from flexmb.view.camera import Camera
from flexmb.view.content import GROUND, Deformed, Part, at_rest, on_body
from flexmb.view.mechanism import Mechanism, applied
from flexmb.view.shapes import (
    Triangles,
    axes_along,
    box,
    cylinder,
    extrusion,
    face_normals,
    joined,
    sphere,
    tube,
    unit,
    wire,
)

_CURVE_POINTS = 90
_GRID = 0.1  # spacing of the grid, as a fraction of what is seen
_TURNING = ("revolute", "cylindrical", "screw")  # joints whose axis a bracket holds
_HATCH = 6  # strokes of a hatched wall
# as fractions of the mechanism's size
_LINK = 0.012  # radius of a rod
_LUMP = 0.022  # radius of the lump at a centre of mass
_LARGEST_LUMP = 0.1  # largest edge of a box with the body's inertia; beyond it a ball is drawn
_CAM, _WIRE, _FLAT = 0.06, 0.006, 0.16  # thickness of a cam, radius of a wire, edge of a flat pad


def body_parts(mechanism: Mechanism, name: str, size: float, color: str) -> Iterator[Part]:
    """The parts of a body, except its flexible surface."""
    shape = body_shape(mechanism, name, size)
    if shape is not None:
        yield Part(name, shape, color, on_body(name))


def body_shape(mechanism: Mechanism, name: str, size: float) -> Triangles | None:
    """The body's own shape with rods to joints outside of it, or rods and a lump; and its
    curves."""
    shape = own_shape(mechanism, name)
    points = [mechanism.marker(reference).position for reference in mechanism.used_markers(name)]
    points = _distinct(points, size)
    curves = curve_shapes(mechanism, name, size)
    center = _center(mechanism, name)
    if shape is not None:
        reach = float(np.linalg.norm(shape.points - center, axis=1).max())
        outside = [point for point in points if np.linalg.norm(point - center) > reach]
        return joined([*curves, shape, *(tube(center, point, _LINK * size) for point in outside)])
    if curves and len(points) < 2:
        return joined(curves)
    flexible = mechanism.model.bodies[name].flexible and bool(len(mechanism.pose(name).eta))
    lump = [] if flexible else [_lump(mechanism, name, size)]
    if not points and not lump:
        return None
    return joined([*curves, *_links(points, center, size, bool(lump)), *lump])


def own_shape(mechanism: Mechanism, name: str) -> Triangles | None:
    """The shape that the scene gives a body, in body axes; None without one."""
    spec = getattr(mechanism.model.bodies[name], "shape", None)
    if spec is None:
        return None
    center = _center(mechanism, name)
    if spec.type == "box":
        return box(spec.size).moved(center)
    if spec.type == "cylinder":
        return cylinder(spec.radius, spec.length, np.eye(3)["xyz".index(spec.axis)]).moved(center)
    if spec.type == "sphere":
        return sphere(spec.radius, center)
    if spec.type == "mesh":
        return Triangles(*spec.surface)
    if spec.type == "extrusion":
        turn = np.roll(np.eye(3), "zxy".index(spec.axis), axis=0)
        return extrusion(spec.outline, spec.thickness).moved((0, 0, 0), turn)
    return None


def curve_shapes(mechanism: Mechanism, body: str, size: float) -> list[Triangles]:
    """Shapes of joints on curves at a body, in body axes: its curves, rollers and flat
    followers."""
    shapes = []
    for name, joint in mechanism.model.joints.items():
        if not joint.curves:
            continue
        frames = joint_frames(mechanism.model, name, mechanism.flexbodies)
        for side, (reference, marker) in enumerate(zip(joint.between, frames, strict=True)):
            if split_reference(reference)[0] == body:
                shape = _side_shape(mechanism, joint, side, size)
                if shape is not None:
                    shapes.append(shape.moved(marker.position, marker.R))
    return shapes


def ground_parts(mechanism: Mechanism, size: float, r: float, camera: Camera) -> Iterator[Part]:
    """Curves on ground, and brackets or walls at the markers of ground that joints use."""
    curves = curve_shapes(mechanism, GROUND_NAME, size)
    if curves:
        yield Part(GROUND_NAME, joined(curves), GROUND, at_rest, "ground")
    model, done = mechanism.model, list[Array]()
    forces: dict[str, Any] = {**model.forces}
    holders = [(n, s.between, s.type) for n, s in model.joints.items() if not s.curves]
    holders += [(n, s.between, "distance") for n, s in model.drivers.items() if s.between]
    holders += [(n, s.between, s.type) for n, s in forces.items()
                if getattr(s, "between", None) and s.type != "contact"]  # fmt: skip
    for name, ends, kind in holders:
        for side, reference in enumerate(ends):
            if split_reference(reference)[0] != GROUND_NAME or kind in (
                "prismatic",
                "planar",
                "in-plane",
            ):
                continue
            point = mechanism.point(reference)
            if any(np.linalg.norm(point - other) < 0.5 * r for other in done):
                continue
            done.append(point)
            axis = _bracket_axis(mechanism, name, reference, ends, side, kind)
            shape = _support(point, axis, kind, r, camera)
            yield Part(GROUND_NAME, shape, GROUND, at_rest, "ground")


def _bracket_axis(
    mechanism: Mechanism, name: str, reference: str, ends: tuple[str, str], side: int, kind: str
) -> Array:
    """The axis (3,) of a hinge on ground, or the line of what is connected there."""
    if name in mechanism.joint_axes and kind in _TURNING:
        axes = mechanism.marker_frame(reference)[:3, :3] @ mechanism.joint_axes[name][side]
        return np.asarray(axes[:, 2])
    other = ends[1 - side]
    line = mechanism.point(other) - mechanism.point(reference)
    if np.linalg.norm(line) < 1e-9:
        body = split_reference(other)[0]
        center = applied(mechanism.frame(body), _center(mechanism, body)[None])[0]
        line = center - mechanism.point(reference)
    return unit(line)


def _support(point: Array, axis: Array, kind: str, r: float, camera: Camera) -> Triangles:
    """A bracket on a hatched base, pointing away from the eye; for a clamp a hatched wall behind
    it."""
    up, towards = np.array(camera.up), np.array(camera.direction)
    if kind in _TURNING:
        facing = float(axis @ towards)
        if abs(facing) > 0.5:  # seen along the axis: a triangle behind the pin
            axis = axis if facing > 0 else -axis
            down = -unit(up - (up @ axis) * axis)
            axes = np.column_stack([np.cross(-down, axis), -down, axis])
            outline = r * np.array(
                [[-2.2, -3.4], [2.2, -3.4], [1.15, 0.3], [0.6, 1.0], [-0.6, 1.0], [-1.15, 0.3]]
            )
            plate = extrusion(outline, 0.5 * r)
            return joined([plate, _hatched(r).moved((0, -3.4 * r, 0))]).moved(
                point - 2.4 * r * axis, axes
            )
        axis = axis if axis @ up >= 0 else -axis
    elif kind in ("fixed", "bushing", "beam"):
        return _hatched(1.5 * r).moved(point - 1.3 * r * axis, _wall_axes(axis, towards))
    else:
        axis = np.sign(axis @ up) * up if abs(axis @ up) > 0.3 else axis
    post = tube((0, 0, -3.0 * r), (0, 0, -1.2 * r), 1.3 * r, 0.9 * r).along(axis, point)
    return joined([post, _hatched(r).moved(point - 3.0 * r * axis, _wall_axes(axis, towards))])


def _wall_axes(normal: Array, towards: Array) -> Array:
    """Axes whose y is the normal and whose x is horizontal in the picture."""
    across = np.cross(normal, towards)
    x = unit(across) if np.linalg.norm(across) > 1e-3 else axes_along(normal)[:, 0]
    return np.column_stack([x, normal, np.cross(x, normal)])


def _hatched(r: float) -> Triangles:
    """A wall normal to y, hatched below."""
    wall = box((6.4 * r, 0.35 * r, 2.2 * r)).moved((0, -0.17 * r, 0))
    x = np.linspace(-2.4, 3.0, _HATCH) * r
    strokes = [tube((a, -0.2 * r, 1.0 * r), (a - 0.9 * r, -1.2 * r, 1.0 * r), 0.12 * r) for a in x]
    return joined([wall, *strokes])


def _center(mechanism: Mechanism, name: str) -> Array:
    """The centre of mass in body axes (3,)."""
    if name in mechanism.flexbodies:
        return mechanism.flexbodies[name].center
    spec = mechanism.model.bodies[name]
    return np.array(spec.center) if isinstance(spec, RigidBodySpec) else np.zeros(3)


def _lump(mechanism: Mechanism, name: str, size: float) -> Triangles:
    """The box with the body's inertia at its centre of mass if it is large enough to see, else a
    ball."""
    center, spec = _center(mechanism, name), mechanism.model.bodies[name]
    if isinstance(spec, RigidBodySpec):
        properties = spec.mass_properties
        moments, axes = np.linalg.eigh(properties.inertia)
        squares = 6.0 / properties.mass * (moments.sum() - 2 * moments)
        edges = np.sqrt(np.maximum(squares, 0.0))
        if 2 * _LUMP * size < edges.max() <= _LARGEST_LUMP * size:
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            return box(np.maximum(edges, 0.01 * size)).moved(center, axes)
    return sphere(_LUMP * size, center)


def _side_shape(mechanism: Mechanism, joint: JointSpec, side: int, size: float) -> Triangles | None:
    """The shape of one side of a joint on curves in the axes of its marker."""
    thick = _CAM * size
    if side < len(joint.curves):
        shape = curve_shape(mechanism.model, joint.curves[side])
        points = shape.points[:: max(1, len(shape.samples) // _CURVE_POINTS)]
        if shape.closed and shape.in_plane and joint.type not in ("pin-in-slot", "point-on-curve"):
            return extrusion(points[:-1], thick)
        return wire(points, _WIRE * size)
    if joint.radius is not None:
        return cylinder(joint.radius, 1.2 * thick)
    if joint.type == "cam-flat":
        return box((_FLAT * size, _FLAT * size, 0.1 * thick)).moved((0, 0, -0.05 * thick))
    if joint.type == "cam-knife":
        return cylinder(0.004 * size, 1.2 * thick)
    if joint.type == "pin-in-slot":
        return cylinder(0.016 * size, 0.05 * size)
    return sphere(0.018 * size)


def _links(points: list[Array], center: Array, size: float, lump: bool) -> list[Triangles]:
    """Rods between all of up to three points, else from their centre to each; and one to the
    lump."""
    r, n = _LINK * size, len(points)
    middle = np.mean(points, axis=0) if points else center
    pairs = [(points[i], points[j]) for i in range(n) for j in range(i + 1, n)]
    if n > 3:
        pairs = [(middle, point) for point in points]
    if lump and n:
        feet = [_foot(center, a, b) for a, b in pairs] or points
        foot = min(feet, key=lambda point: float(np.linalg.norm(center - point)))
        if np.linalg.norm(center - foot) > r:
            pairs.append((center, foot))
    return [*(tube(a, b, r) for a, b in pairs), *(sphere(1.25 * r, point) for point in points)]


def _foot(point: Array, a: Array, b: Array) -> Array:
    """The point on the line between two points that is nearest to another point."""
    line = b - a
    share = float(np.clip((point - a) @ line / max(float(line @ line), 1e-300), 0.0, 1.0))
    return np.asarray(a + share * line)


def _distinct(points: list[Array], size: float) -> list[Array]:
    distinct: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 1e-6 * size for other in distinct):
            distinct.append(point)
    return distinct


def ground_grid(corners: Array, up: Array) -> Part:
    """A square grid below points (n, 3), with lines along the global axes if up is one of them."""
    across = unit(np.cross(up, np.eye(3)[np.argmin(abs(up))]))
    ahead = np.cross(across, up)
    low, high = (corners @ up).min(), corners @ np.column_stack([across, ahead])
    middle, span = 0.5 * (high.min(axis=0) + high.max(axis=0)), np.ptp(high, axis=0)
    step = _round_step(_GRID * float(max(span.max(), np.ptp(corners @ up))))
    cells = np.ceil(0.5 * span / step + 1).astype(int)
    first = np.round(middle / step) * step
    lines: list[Array] = []
    for k, (a, b) in enumerate(((across, ahead), (ahead, across))):
        reach = cells[1 - k] * step
        for i in range(-cells[k], cells[k] + 1):
            start = first[0] * across + first[1] * ahead + i * step * a + low * up
            lines += [start - reach * b, start + reach * b]
    ends = np.arange(len(lines)).reshape(-1, 2)
    shape = Triangles(np.array(lines), ends[:, [0, 1, 1]])  # lines are triangles without area
    return Part("grid", shape, "#d5d8de", at_rest, "grid")


def _round_step(length: float) -> float:
    power = 10.0 ** math.floor(math.log10(max(length, 1e-300)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= length * (1 + 1e-9))


@dataclass(frozen=True, eq=False)
class Plates:
    """Conversion of a mid-surface to a thick surface: each new point is an old one moved along the
    normal.

    Parameters
    ----------
    middle : (t, 3) int
        Triangles of the shells.
    faces : (f, 3) int
        Triangles of the new surface.
    source : (k,) int
        Index of the old point of each new one.
    offset : (k,) float
        Displacement of each new point along the normal there [m].
    """

    middle: IntArray
    faces: IntArray
    source: IntArray
    offset: Array

    def thick(self, points: Array) -> Array:
        """The new points (k, 3) of old ones (n, 3)."""
        corners, n = self.middle.ravel(), len(points)
        each = np.repeat(face_normals(points, self.middle), 3, axis=0)
        normals: Array = np.column_stack([np.bincount(corners, each[:, k], n) for k in range(3)])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.maximum(length, 1e-300)
        return np.asarray(points[self.source] + self.offset[:, None] * normals[self.source])

    def drawn(self, body: Deformed) -> Deformed:
        """A body drawn with the thickness of its shells."""
        return replace(
            body,
            points=self.thick(body.points),
            undeformed=self.thick(body.undeformed),
            faces=self.faces,
            displacement=body.displacement[self.source],
            values=None if body.values is None else body.values[self.source],
        )


def plates_of(body: FlexBody) -> Plates | None:
    """The plates of a body; None if it has none, or if their thickness is not known."""
    surface, sections = body.surface, json.loads(body.provenance.get("sections") or "{}")
    shells = {
        name: one for name, one in sections.items() if isinstance(one, dict) and "layers" in one
    }
    if surface is None or not len(surface.faces) or not shells:
        return None
    sides = np.full((len(surface.points), 2), np.nan)
    for name, section in shells.items():
        half = 0.5 * sum(float(layer["thickness"]) for layer in section["layers"])
        middle = section.get("offset") or 0.0
        middle = float(middle) if isinstance(middle, int | float) else 0.0
        sides[_points_of(body, surface, name)] = middle + half, middle - half
    own = np.isfinite(sides[:, 0])
    shell = own[surface.faces].all(axis=1)
    if not shell.any():
        return None
    n, triangles = len(surface.points), surface.faces[shell]
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys, where, count = np.unique(
        np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True
    )
    a, b = pairs[where[count == 1]].T
    rim = [
        np.column_stack([a + n, a + 2 * n, b + 2 * n]),
        np.column_stack([a + n, b + 2 * n, b + n]),
    ]
    faces = np.vstack([surface.faces[~shell], triangles + n, triangles[:, ::-1] + 2 * n, *rim])
    source = np.tile(np.arange(n), 3)
    offset = np.concatenate(
        [np.zeros(n), np.where(own, sides[:, 0], 0.0), np.where(own, sides[:, 1], 0.0)]
    )
    used, faces = np.unique(faces, return_inverse=True)
    return Plates(triangles, faces.reshape(-1, 3), source[used], offset[used])


def _points_of(body: FlexBody, surface: Surface, group: str) -> Any:
    """Points of the surface that are nodes of a group; corners of beams do not count."""
    ids = surface.node_ids
    beyond = np.flatnonzero(np.diff(ids) <= 0)
    nodes = np.arange(len(ids)) <= (beyond[0] if len(beyond) else len(ids))
    groups = {} if body.nodes is None else body.nodes.groups
    return nodes & np.isin(ids, groups[group]) if group in groups else nodes
