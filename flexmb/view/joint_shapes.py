"""The shapes of joints, gears and drivers: one for each type, as textbooks draw them.

A hinge is a pin with two washers, a spherical joint a ball in a socket, a fixed joint a block.
Sliding joints have a rail along the whole stroke and a sleeve, a universal joint is a cross, a
massless link a rod with the joint of each end. Gears and racks have teeth that mesh as they are
placed. Bodies, curves and their followers are in :mod:`flexmb.view.body_shapes`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexmb.flexbody.arrays import Array
from flexmb.model.forces.force_characteristic import TranslationalStopSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.gear import GearSpec, RackSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.reading import GROUND as GROUND_NAME
from flexmb.model.reading import split_reference
from flexmb.view.content import DRIVE, GROUND, HOUSING, PIN, Part, between, on_body, on_marker
from flexmb.view.mechanism import Mechanism, inverse
from flexmb.view.shapes import (
    Triangles,
    arrow,
    axes_along,
    box,
    cylinder,
    extrusion,
    frame_of,
    joined,
    rack,
    revolved,
    ring,
    sphere,
    toothed_wheel,
    tube,
    turn_arrow,
    unit,
    wire,
)

_LINKS = (
    "distance", "revolute-spherical", "prismatic-spherical", "cylindrical-spherical",
    "revolute-revolute", "revolute-cylindrical", "revolute-universal", "spherical-universal",
)  # fmt: skip
_SLIDING = ("prismatic", "cylindrical", "screw", "in-line")
_SAMPLES = 40  # times at which the range of a sliding joint is determined


_Wheel = tuple[str, Array, Array]  # body, centre (3,) and axis (3,) at this time
_Phases = dict[tuple[str, int, int], float]
_TEETH = 28  # teeth of the smaller wheel if no numbers are given
_WIDTH = 0.3  # width of a wheel over the smaller radius
_PARALLEL = 1e-6  # sine of the angle below which axes are parallel


def joint_parts(mechanism: Mechanism, r: float, half: dict[str, float]) -> Iterator[Part]:
    """All joints except those on curves: `r` [m] is the radius of a pin, `half` its half
    lengths."""
    for name, spec in mechanism.model.joints.items():
        if spec.curves:
            continue
        I, J = (on_marker(*pair) for pair in joint_sides(mechanism, name))  # noqa: E741
        h = half.get(name, 1.8 * r)
        if spec.type in _LINKS:
            ends = spec.type.split("-") if "-" in spec.type else ("spherical", "spherical")
            yield Part(
                name, tube((0, 0, 0), (0, 0, 1), 0.4 * r), HOUSING, between(*spec.between), "joint"
            )
            for place, kind in zip((I, J), ends, strict=True):
                yield Part(name, _end(kind, 0.8 * r), PIN, place, "joint")
        elif spec.type in _SLIDING:
            low, high = slide_range(mechanism, name, spec)
            rail, sleeve = _slide(spec.type, r, low, high, spec.pitch)
            yield Part(name, rail, HOUSING, I, "joint")
            yield Part(name, sleeve, PIN, J, "joint")
        else:
            first, second = _pair(spec.type, r, h)
            if spec.type in ("planar", "in-plane"):
                first = _plate(mechanism, name, spec, r)
            if first is not None:
                yield Part(name, first, HOUSING, I, "joint")
            if second is not None:
                yield Part(name, second, PIN, J, "joint")


def joint_sides(mechanism: Mechanism, name: str) -> Iterator[tuple[str, Array]]:
    """Markers I and J of a joint, with the joint's axes (3, 3) relative to each."""
    return zip(mechanism.model.joints[name].between, mechanism.joint_axes[name], strict=True)


def slide_range(mechanism: Mechanism, name: str, spec: JointSpec) -> tuple[float, float]:
    """Smallest and largest position of marker J along the axis of I over the run, with stops
    [m]."""
    strokes = [
        bound
        for stop in mechanism.model.forces.values()
        if isinstance(stop, TranslationalStopSpec) and stop.joint == name
        for bound in stop.bounds
        if np.isfinite(bound)
    ]
    strokes += _places(mechanism, name, spec)[:, 2].tolist()
    return min(strokes), max(strokes)


def _places(mechanism: Mechanism, name: str, spec: JointSpec) -> Array:
    """Positions (n, 3) of marker J in the axes of I at some times of the run [m]."""
    times, axes, places = mechanism.result.time, mechanism.joint_axes[name][0], []
    for t in times[np.unique(np.linspace(0, len(times) - 1, _SAMPLES).astype(int))]:
        moment = mechanism.at(float(t))
        I, J = (moment.marker_frame(reference) for reference in spec.between)  # noqa: E741
        places.append((inverse(I) @ J)[:3, 3] @ axes)
    return np.array(places)


def _plate(mechanism: Mechanism, name: str, spec: JointSpec, r: float) -> Triangles:
    """The plane of I, over the area in which marker J moves during the run."""
    places = _places(mechanism, name, spec)[:, :2]
    low, high = places.min(axis=0) - 4.5 * r, places.max(axis=0) + 4.5 * r
    below = -0.4 * r if spec.type == "planar" else 0.0
    return box((*(high - low), 0.25 * r)).moved((*(0.5 * (low + high)), below))


def _slide(
    kind: str, r: float, low: float, high: float, pitch: float | None
) -> tuple[Triangles, Triangles]:
    """Rail and sleeve."""
    low, high = low - 3.0 * r, high + 3.0 * r
    middle, length = 0.5 * (low + high), high - low
    if kind == "prismatic":
        rail = box((1.1 * r, 1.1 * r, length)).moved((0, 0, middle))
        return rail, frame_of(2.6 * r, 1.3 * r, 3.6 * r)
    rod = tube((0, 0, low), (0, 0, high), (0.45 if kind == "in-line" else 0.6) * r)
    if kind == "in-line":
        return rod, sphere(1.2 * r)
    if kind == "screw":
        lead = np.sign(pitch or 1.0) * min(max(abs(pitch or r), 0.6 * r), 2.0 * r)
        turns = length / abs(lead)
        angle = np.linspace(0, 2 * np.pi * turns, int(16 * turns) + 2)
        x, y = 0.65 * r * np.cos(angle), 0.65 * r * np.sin(angle) * np.sign(lead)
        thread = np.column_stack([x, y, np.linspace(low, high, len(angle))])
        corners = np.arange(6) * np.pi / 3
        nut = extrusion(1.7 * r * np.column_stack([np.cos(corners), np.sin(corners)]), 2.0 * r)
        return joined([rod, wire(thread, 0.2 * r, 6)]), nut
    return rod, ring(1.4 * r, 0.7 * r, 3.6 * r)


def _pair(kind: str, r: float, h: float) -> tuple[Triangles | None, Triangles | None]:
    """The shapes of a joint in the axes of I and of J."""
    if kind == "revolute":
        washers = [cylinder(1.7 * r, 0.45 * r).moved((0, 0, z)) for z in (-h, h)]
        return joined(washers), cylinder(r, 2 * h + 1.1 * r)
    if kind == "spherical":
        polar = np.radians(np.linspace(180, 75, 12))
        bowl = np.column_stack([np.sin(polar), np.cos(polar)])
        return revolved(np.vstack([1.6 * r * bowl, 1.35 * r * bowl[::-1]])), sphere(1.3 * r)
    if kind == "fixed":
        return box((2.6 * r, 2.6 * r, 2.6 * r)), None
    if kind == "universal":
        bar = cylinder(0.45 * r, 4.0 * r)
        knobs = [cylinder(0.8 * r, 0.5 * r).moved((0, 0, z)) for z in (-2 * r, 2 * r)]
        return joined([bar, *knobs]), joined([bar, *knobs, sphere(0.9 * r)])
    if kind == "constant-velocity":
        bell = revolved([[0, -1.6 * r], [1.5 * r, -1.6 * r], [1.5 * r, 0.3 * r], [0, 0.3 * r]])
        return bell, joined([sphere(1.1 * r), cylinder(0.6 * r, 2.4 * r).moved((0, 0, 1.2 * r))])
    if kind == "planar":
        return None, cylinder(1.4 * r, 0.7 * r)
    if kind == "in-plane":
        return None, sphere(1.1 * r)
    if kind == "parallel":  # two rods, the second a pair: the sign of a drawing
        pair = [cylinder(0.3 * r, 5 * r).moved((x * r, 0, 0)) for x in (-0.8, 0.8)]
        return cylinder(0.5 * r, 5 * r), joined(pair)
    if kind == "perpendicular":  # two rods, the second on a set square
        return cylinder(0.5 * r, 5 * r), joined(
            [
                cylinder(0.5 * r, 5 * r),
                box((1.8 * r, 0.3 * r, 1.8 * r)).moved((0.9 * r, 0, 0.9 * r)),
            ]
        )
    arms = [box(2.4 * r * np.where(np.eye(3)[k] > 0, 1.0, 0.18)) for k in range(3)]
    return joined(arms), joined(arms)  # orientation


def _end(kind: str, r: float) -> Triangles:
    """The joint at one end of a massless link."""
    if kind == "revolute":
        return cylinder(1.1 * r, 3.6 * r)
    if kind == "prismatic":
        return frame_of(2.6 * r, 1.2 * r, 3.6 * r)
    if kind == "cylindrical":
        return ring(1.4 * r, 0.7 * r, 3.6 * r)
    if kind == "universal":
        return joined([cylinder(0.5 * r, 3.6 * r, np.eye(3)[k]) for k in range(3)])
    return sphere(1.3 * r)


def driver_parts(mechanism: Mechanism, r: float, lift: dict[str, float]) -> Iterator[Part]:
    """Arrows that show what drivers move, beside their joints; a driven distance is a cylinder."""
    for name, spec in mechanism.model.drivers.items():
        if spec.between is not None:
            barrel = joined(
                [tube((0, 0, 0), (0, 0, 0.6), 1.3 * r), tube((0, 0, 0.58), (0, 0, 0.6), 1.5 * r)]
            )
            rod = tube((0, 0, 0.6), (0, 0, 1), 0.55 * r)
            yield Part(name, barrel, DRIVE, between(*spec.between), "joint")
            yield Part(name, rod, HOUSING, between(*spec.between), "joint")
            for reference in spec.between:
                yield Part(name, sphere(0.9 * r), PIN, on_marker(reference), "joint")
            continue
        for reference, axes, shape in _drive_arrows(mechanism, spec, r, lift):
            yield Part(name, shape, DRIVE, on_marker(reference, axes), "joint")


def _drive_arrows(
    mechanism: Mechanism, spec: DriverSpec, r: float, lift: dict[str, float]
) -> Iterator[tuple[str, Array, Triangles]]:
    for motion in spec.motions(mechanism.model.plane):
        second = motion.coordinate == "second_angle"
        if spec.joint is not None:
            joint = mechanism.model.joints[spec.joint]
            side = int(second)
            reference, axes = joint.between[side], mechanism.joint_axes[spec.joint][side]
        else:
            reference = (
                spec.ends[0] if split_reference(spec.ends[0])[0] != GROUND_NAME else spec.ends[1]
            )
            along = np.eye(3)["xyz".find(motion.coordinate)]
            if motion.coordinate == "angle":
                along = np.array(spec.axis) if spec.axis is not None else np.eye(3)[2]
            axes = inverse(mechanism.marker_frame(reference))[:3, :3] @ axes_along(along)
        if motion.coordinate in ("angle", "second_angle"):
            turned = turn_arrow(3.0 * r, 0.55 * r)
            yield reference, axes, turned.moved((0, 0, lift.get(spec.joint or "", 0.0)))
        else:
            yield reference, axes, arrow(7.0 * r, 0.35 * r).moved((1.9 * r, 0, 0))


def gear_parts(mechanism: Mechanism, colors: dict[str, str]) -> Iterator[Part]:
    """Toothed wheels and racks, in the axes of their bodies."""
    phases: _Phases = {}
    for spec in mechanism.model.couplers.values():
        if not isinstance(spec, GearSpec | RackSpec):
            continue
        ends = [_wheel(mechanism, joint, spec.joints) for joint in spec.joints]
        if ends[0] is None or ends[1] is None:
            continue
        if isinstance(spec, RackSpec):
            shapes = _rack(mechanism, spec, ends[0], ends[1])
        elif np.linalg.norm(np.cross(ends[0][2], ends[1][2])) < _PARALLEL:
            shapes = _spur_gears(spec, ends[0], ends[1], phases)
        else:
            shapes = _bevel_gears(spec, ends[0], ends[1])
        for body, shape in shapes:
            local = inverse(mechanism.frame(body))
            yield Part(
                body,
                shape.moved(local[:3, 3], local[:3, :3]),
                colors.get(body, GROUND),
                on_body(body),
                "body",
            )


def _wheel(mechanism: Mechanism, joint: str, joints: tuple[str, str]) -> _Wheel | None:
    """The wheel at a joint: body on the side away from the common carrier, centre and axis."""
    model = mechanism.model
    bodies = [{split_reference(end)[0] for end in model.joints[name].between} for name in joints]
    for reference, axes in zip(
        model.joints[joint].between, mechanism.joint_axes[joint], strict=True
    ):
        body = split_reference(reference)[0]
        if body not in bodies[0] & bodies[1]:
            frame = mechanism.marker_frame(reference)
            return body, frame[:3, 3], frame[:3, :3] @ axes[:, 2]
    return None


def _spur_gears(
    spec: GearSpec, first: _Wheel, second: _Wheel, phases: _Phases
) -> Iterator[tuple[str, Triangles]]:
    (_, x, u), (_, y, v) = first, second
    h = (y - x) - ((y - x) @ u) * u
    distance = float(np.linalg.norm(h))
    inside = spec.internal or (spec.ratio is not None and spec.ratio * (u @ v) > 0)
    n = spec.teeth or (spec.radii if spec.radii is not None else (abs(spec.ratio or 1.0), 1.0))
    apart = abs(n[0] - n[1]) if inside else n[0] + n[1]
    if spec.radii is not None:
        radii = spec.radii
    elif distance > 0 and apart > 0:
        radii = n[0] * distance / apart, n[1] * distance / apart
    else:
        return
    teeth = [max(round(count), 8) for count in spec.teeth or _counts(radii)]
    axes = axes_along(u)
    # direction from the first to the second
    towards = float(np.arctan2(h @ axes[:, 1], h @ axes[:, 0]))
    larger = int(radii[1] > radii[0])
    meets = [towards, towards + np.pi]
    if inside:
        meets = [towards + (np.pi if larger else 0.0)] * 2
    middle = float((y - x) @ u), 0.0  # both are in the plane of the second
    share = None
    for k, (body, centre, _) in enumerate((first, second)):
        key = body, round(1e6 * radii[k]), round(1e6 * float(y @ u))
        pitch = 2 * np.pi / teeth[k]
        drawn = key in phases
        if not drawn:
            wanted = 0.0 if share is None else (share + 0.5 if inside else 0.5 - share)
            phases[key] = meets[k] - wanted * pitch
        share = (meets[k] - phases[key]) / pitch
        if drawn:
            continue
        c, s = np.cos(phases[key]), np.sin(phases[key])
        turn = axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        shape = toothed_wheel(radii[k], teeth[k], _WIDTH * min(radii), bool(inside) and k == larger)
        yield body, shape.moved(centre + middle[k] * u, turn)


def _counts(radii: tuple[float, float]) -> tuple[float, float]:
    return radii[0] * _TEETH / min(radii), radii[1] * _TEETH / min(radii)


def _bevel_gears(spec: GearSpec, first: _Wheel, second: _Wheel) -> Iterator[tuple[str, Triangles]]:
    """Wheels whose axes intersect: they taper towards the intersection."""
    (_, x, u), (_, y, v) = first, second
    s, t = np.linalg.lstsq(np.column_stack([u, -v]), y - x, rcond=None)[0]
    apex = x + s * u
    outward = [-np.sign(s) * u if abs(s) > 0 else u, -np.sign(t) * v if abs(t) > 0 else v]
    n = spec.teeth or spec.radii or (abs(spec.ratio or 1.0), 1.0)
    angle = float(np.arccos(np.clip(outward[0] @ outward[1], -1, 1)))
    cone = float(np.arctan2(np.sin(angle), n[1] / n[0] + np.cos(angle)))
    if spec.radii is not None:
        radii = spec.radii
    else:
        radius = (
            abs(s) * np.tan(cone) if abs(s) > 0 else abs(t) * np.tan(angle - cone) * n[0] / n[1]
        )
        radii = float(radius), float(radius * n[1] / n[0])
    if min(radii) <= 0:
        return
    teeth = [max(round(count), 8) for count in spec.teeth or _counts(radii)]
    width = _WIDTH * min(radii)
    for k, (body, _, _) in enumerate((first, second)):
        height = radii[k] / np.tan(cone if k == 0 else angle - cone)
        axes = axes_along(outward[k])
        h = outward[1 - k] @ axes
        phase = float(np.arctan2(h[1], h[0])) + (np.pi / teeth[1] if k else 0.0)
        c, sine = np.cos(phase), np.sin(phase)
        shape = toothed_wheel(radii[k], teeth[k], width)
        taper = 1.0 + (shape.points[:, 2:] - width / 2) / height * [1.0, 1.0, 0.0]
        points = shape.points * np.where([True, True, False], taper, 1.0)
        shape = Triangles(points + [0, 0, -width / 2], shape.faces)
        turn = axes @ np.array([[c, -sine, 0], [sine, c, 0], [0, 0, 1.0]])
        yield body, shape.moved(apex + height * outward[k], turn)


def _rack(
    mechanism: Mechanism, spec: RackSpec, pinion: _Wheel, bar: _Wheel
) -> Iterator[tuple[str, Triangles]]:
    (body, x, u), (other, y, d) = pinion, bar
    module, width = 2 * spec.radius / _TEETH, 1.5 * _WIDTH * spec.radius
    h = y - x
    n = unit(h - (h @ u) * u - (h @ d) * d)
    joint = mechanism.model.joints[spec.joints[1]]
    low, high = slide_range(mechanism, spec.joints[1], joint)
    pitch = np.pi * module
    # odd, so that a tooth is in the middle
    count = int((high - low + 2.5 * spec.radius) / pitch) | 1
    I, J = (mechanism.point(reference) for reference in joint.between)  # noqa: E741
    ahead = abs(float((J - I) @ d)) - 0.5 * (abs(low) + abs(high))
    contact = x + spec.radius * n + (h @ u) * u + pitch * round(ahead / pitch) * d
    shape = rack(count, module, width, 4 * module)
    yield other, shape.moved(contact, np.column_stack([d, -n, np.cross(d, -n)]))
    axes = np.column_stack([n, np.cross(u, n), u])
    c, s = np.cos(np.pi / _TEETH), np.sin(np.pi / _TEETH)  # a gap faces that tooth
    turn = axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    yield body, toothed_wheel(spec.radius, _TEETH, width).moved(x + (h @ u) * u, turn)
