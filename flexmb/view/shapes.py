"""Shapes of bodies, joints on curves and ground, as triangles for both renderers.

In: a :class:`Mechanism` and its size [m]. Out: :class:`Triangles`, outward oriented, in global
axes. Bodies without a shape are drawn as links between the markers that joints use; a cam is a
plate, an open curve a wire, a roller a disk, a flat a pad; a driven distance is a cylinder with its
rod, a massless link a rod, a spring a coil; ground is a pedestal under what turns on it and a rail
along what slides on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.model.joints.curve import curve_shape
from flexmb.model.joints.joint import JointSpec
from flexmb.model.lookup import joint_frames
from flexmb.model.reading import GROUND, split_reference
from flexmb.view.content import Camera, Mechanism, Triangles

Array = NDArray[np.float64]

_COILED = ("spring-damper", "line-force")
_AROUND = 48  # corners of a drawn circle
_CURVE_POINTS = 90
_COILS = 8  # of a drawn spring
_BARREL = 0.6  # share of a driven distance that the cylinder's barrel covers
# as shares of the mechanism's size
_LINK = 0.012  # radius of a link
_ROD, _WINDING = 0.006, 0.02  # radius of a line between two markers, of a spring's coils
_CAM, _WIRE, _FLAT = 0.06, 0.006, 0.16  # thickness, radius, edge
_RAIL, _RAIL_END = 0.005, 0.08  # radius, length beyond the travel
_BEHIND = 0.08  # distance of a pedestal behind its cam


def joined(parts: list[Triangles]) -> Triangles:
    """Several shapes as one."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=False)]
    return Triangles(np.vstack([part.points for part in parts]), np.vstack(faces))


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
    half = 0.5 * length * _unit(axis)
    return tube(-half, half, radius)


def plate(ring: ArrayLike, thickness: float) -> Triangles:
    """A plate across z with a closed contour `ring` (n, 3), star-shaped about its middle."""
    points = np.asarray(ring, dtype=float)
    after = np.roll(points, -1, axis=0)
    if np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]) < 0:
        points = points[::-1]
    up, middle = np.array([0.0, 0.0, 0.5 * thickness]), points.mean(axis=0)
    return _loft(np.stack([points + up, points - up]), middle + up, middle - up)


def sphere(radius: float, center: ArrayLike = (0, 0, 0)) -> Triangles:
    """A ball of `radius` at `center` (3,)."""
    polar = np.linspace(0, np.pi, _AROUND // 2 + 1)[1:-1, None, None]
    rings = np.sin(polar) * _circle(np.eye(3)[0], np.eye(3)[1]) + np.cos(polar) * np.eye(3)[2]
    unit = _loft(rings, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))
    return Triangles(radius * unit.points + np.asarray(center, dtype=float), unit.faces)


def tube(start: ArrayLike, stop: ArrayLike, radius: float) -> Triangles:
    """A closed cylinder from `start` (3,) to `stop` (3,)."""
    a, b = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    axis = _unit(b - a)
    e1 = _unit(np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis))
    ring = radius * _circle(e1, np.cross(axis, e1))
    return _loft(np.stack([b + ring, a + ring]), b, a)


def body_shape(mechanism: Mechanism, name: str, size: float) -> Triangles | None:
    """The body's own shape with links to joints outside it, or links alone; its curves."""
    spec = mechanism.model.bodies[name]
    shape = own_shape(mechanism, name)
    points = _distinct([mechanism.point(ref) for ref in mechanism.used_markers(name)], size)
    curves = curve_shapes(mechanism, name, size)
    if curves and shape is not None:
        return joined([*curves, shape])
    if curves and len(points) > 1:
        links = _links(points, mechanism.pose(name).A, size)
        return joined([*curves, links] if links else curves)
    if curves:
        return joined(curves)
    middle = mechanism.point(f"{name}.center")
    if shape is None:
        if len(points) < 2 and not spec.flexible:
            points = _distinct([*points, middle], size)
        return _links(points, mechanism.pose(name).A, size)
    reach = float(np.linalg.norm(shape.points - middle, axis=1).max())
    outside = [point for point in points if np.linalg.norm(point - middle) > reach]
    return joined([shape, *(tube(middle, point, _LINK * size) for point in outside)])


def own_shape(mechanism: Mechanism, name: str) -> Triangles | None:
    """The shape that the scene gives a body, at its centre."""
    spec = getattr(mechanism.model.bodies[name], "shape", None)
    kind = getattr(spec, "type", None)
    if spec is None or kind not in ("box", "cylinder", "sphere"):
        return None
    if kind == "box":
        shape = box(spec.size)
    elif kind == "cylinder":
        shape = cylinder(spec.radius, spec.length, np.eye(3)["xyz".index(spec.axis)])
    else:
        shape = sphere(spec.radius)
    return shape.moved(mechanism.point(f"{name}.center"), mechanism.pose(name).A)


def curve_shapes(mechanism: Mechanism, body: str, size: float) -> list[Triangles]:
    """What joints on curves give a body to show: its curves, rollers and flats."""
    shapes = []
    for name, joint in mechanism.model.joints.items():
        if not joint.curves:
            continue
        frames = joint_frames(mechanism.model, name, mechanism.flexbodies)
        for side, (reference, marker) in enumerate(zip(joint.between, frames, strict=True)):
            if split_reference(reference)[0] != body:
                continue
            shape = _side_shape(mechanism, joint, side, size)
            if shape is not None:
                A = mechanism.pose(body).A @ marker.R
                shapes.append(shape.moved(mechanism.point(reference), A))
    return shapes


def joint_points(mechanism: Mechanism) -> Array:
    """Where balls (j, 3) show joints: a marker of each, both of what slides between bodies."""
    points = []
    for spec in mechanism.model.joints.values():
        slides = spec.type in ("prismatic", "cylindrical")
        references = spec.between[: 2 if slides else 1]
        if spec.curves:
            references = follower_markers(spec)
        points += [mechanism.point(r) for r in references if not (slides and is_ground(r))]
    return np.array(points).reshape(-1, 3)


def follower_markers(joint: JointSpec) -> tuple[str, ...]:
    """The markers of a joint on a curve where a ball shows it: none where more is drawn."""
    points = ("pin-in-slot", "point-on-curve", "cam-knife")
    return joint.between[1:] if joint.type in points else ()


def ground_shapes(mechanism: Mechanism, size: float, camera: Camera) -> list[Triangles]:
    """The shapes of ground, its curves among them."""
    shapes = curve_shapes(mechanism, GROUND, size)
    for name, spec in mechanism.model.joints.items():
        grounded = [ref for ref in spec.between if is_ground(ref)]
        if not grounded or spec.curves:
            continue
        point = mechanism.point(grounded[0])
        moving = [ref for ref in spec.between if not is_ground(ref)]
        if spec.type in ("prismatic", "cylindrical"):  # a rail over all the way of what slides
            axis = mechanism.axes[name]
            low, high = mechanism.travel((moving or grounded)[0], axis)
            start, over = point - (point @ axis) * axis, _RAIL_END * size
            ends = start + (low - over) * axis, start + (high + over) * axis
            shapes.append(tube(*ends, _RAIL * size))
        else:
            if moving and curve_shapes(mechanism, split_reference(moving[0])[0], size):
                point = point - _BEHIND * size * np.array(camera.direction)
            shapes.append(_pedestal(point, size, camera))
    return shapes


def line_shapes(mechanism: Mechanism, size: float) -> list[Triangles]:
    """What lies between two markers and is no body: cylinders, massless links, springs."""
    model, shapes = mechanism.model, []
    for parts in (model.joints, model.forces, model.drivers):
        for spec in parts.values():
            kind = getattr(spec, "type", "cylinder")
            between = getattr(spec, "between", None)
            if between is None or kind not in ("cylinder", "distance", *_COILED):
                continue
            a, b = (mechanism.point(reference) for reference in between)
            if kind in _COILED:
                shapes.append(_coil(a, b, size))
            else:
                shapes.append(tube(a, b, _ROD * size))
            if kind == "cylinder":
                shapes.append(tube(a, a + _BARREL * (b - a), 2.5 * _ROD * size))
    return shapes


def is_ground(reference: str) -> bool:
    """Whether a marker is on ground."""
    return split_reference(reference)[0] == GROUND


def _side_shape(mechanism: Mechanism, joint: JointSpec, side: int, size: float) -> Triangles | None:
    """The shape of one side of a joint on curves in the axes of its marker."""
    thick = _CAM * size
    if side < len(joint.curves):
        shape = curve_shape(mechanism.model, joint.curves[side])
        points = shape.points[:: max(1, len(shape.samples) // _CURVE_POINTS)]
        if shape.closed:
            return plate(points[:-1], thick)
        ends = zip(points[:-1], points[1:], strict=True)
        return joined([tube(a, b, _WIRE * size) for a, b in ends])
    if joint.radius is not None:
        return cylinder(joint.radius, 1.2 * thick)
    if joint.type == "cam-flat":
        return box((_FLAT * size, _FLAT * size, 0.1 * thick))
    return None


def _links(points: list[Array], A: Array, size: float) -> Triangles | None:
    """Tubes between all of up to four points, else from each to the next; a box at one."""
    if len(points) < 2:
        return box(np.full(3, 6 * _LINK * size)).moved(points[0], A) if points else None
    pairs = [(i, i + 1) for i in range(len(points) - 1)]
    if len(points) <= 4:
        pairs = [(i, j) for i in range(len(points)) for j in range(i + 1, len(points))]
    ends = [sphere(_LINK * size, point) for point in points]
    return joined([*(tube(points[i], points[j], _LINK * size) for i, j in pairs), *ends])


def _pedestal(point: Array, size: float, camera: Camera) -> Triangles:
    """A post and a plate under a point."""
    up = np.array(camera.up)
    across = np.cross(up, camera.direction)
    across /= np.linalg.norm(across)
    axes = np.stack([across, up, np.cross(across, up)], axis=1)
    post = box(np.array([0.03, 0.07, 0.03]) * size).moved([0, -0.035 * size, 0], np.eye(3))
    foot = box(np.array([0.14, 0.012, 0.09]) * size).moved([0, -0.076 * size, 0], np.eye(3))
    return joined([post, foot]).moved(point, axes)


def _coil(a: Array, b: Array, size: float) -> Triangles:
    """A helix of thin tubes from point to point, straight at its ends."""
    axis = _unit(b - a)
    e1 = _unit(np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis))
    turns = np.linspace(0, 2 * np.pi * _COILS, 12 * _COILS + 1)[:, None]
    ring = _WINDING * size * (np.cos(turns) * e1 + np.sin(turns) * np.cross(axis, e1))
    wound = a + np.linspace(0.12, 0.88, len(turns))[:, None] * (b - a)
    points = [a, wound[0], *(wound + ring), wound[-1], b]
    pairs = zip(points[:-1], points[1:], strict=True)
    return joined([tube(p, q, 0.5 * _ROD * size) for p, q in pairs])


def _distinct(points: list[Array], size: float) -> list[Array]:
    distinct: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 1e-6 * size for other in distinct):
            distinct.append(point)
    return distinct


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


def _circle(e1: Array, e2: Array) -> Array:
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    return np.asarray(np.outer(np.cos(angle), e1) + np.outer(np.sin(angle), e2))


def _unit(vector: ArrayLike) -> Array:
    values = np.asarray(vector, dtype=float)
    length = float(np.linalg.norm(values))
    return np.asarray(values / length) if length > 0 else np.array([0.0, 0.0, 1.0])
