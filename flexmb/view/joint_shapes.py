"""The shapes of joints and drivers: one for each type, as textbooks draw them.

A hinge is a pin with two washers, a spherical joint a ball in its socket, a fixed one a block; what
slides has a rail over all its way and a sleeve, a universal joint is a cross, a massless link a rod
with the joint of each end. Bodies, curves and their
followers stand in :mod:`flexmb.view.body_shapes`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmb.model.forces.force_characteristic import TranslationalStopSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.reading import GROUND, split_reference
from flexmb.view.mechanism import Mechanism, inverse
from flexmb.view.part import DRIVE, HOUSING, PIN, Part, between, on_marker
from flexmb.view.shapes import (
    Triangles,
    arrow,
    axes_along,
    box,
    cylinder,
    extrusion,
    frame_of,
    joined,
    revolved,
    ring,
    sphere,
    tube,
    turn_arrow,
    wire,
)

Array = NDArray[np.float64]

_LINKS = (
    "distance", "revolute-spherical", "prismatic-spherical", "cylindrical-spherical",
    "revolute-revolute", "revolute-cylindrical", "revolute-universal", "spherical-universal",
)  # fmt: skip
_SLIDING = ("prismatic", "cylindrical", "screw", "in-line")
_SAMPLES = 40  # times at which the way of what slides is looked up


def joint_parts(mechanism: Mechanism, r: float, half: dict[str, float]) -> Iterator[Part]:
    """All joints that are no curves: `r` [m] is the radius of a pin, `half` its half lengths."""
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
            if first is not None:
                yield Part(name, first, HOUSING, I, "joint")
            if second is not None:
                yield Part(name, second, PIN, J, "joint")


def joint_sides(mechanism: Mechanism, name: str) -> Iterator[tuple[str, Array]]:
    """Markers I and J of a joint with its axes (3, 3) relative to them."""
    return zip(mechanism.model.joints[name].between, mechanism.joint_axes[name], strict=True)


def slide_range(mechanism: Mechanism, name: str, spec: JointSpec) -> tuple[float, float]:
    """Least and greatest place of marker J along the axis of I over the run, and its stops [m]."""
    times = mechanism.result.time
    axis = mechanism.joint_axes[name][0][:, 2]
    strokes = [
        bound
        for stop in mechanism.model.forces.values()
        if isinstance(stop, TranslationalStopSpec) and stop.joint == name
        for bound in stop.bounds
        if np.isfinite(bound)
    ]
    for t in times[np.unique(np.linspace(0, len(times) - 1, _SAMPLES).astype(int))]:
        moment = mechanism.at(float(t))
        offset = inverse(moment.marker_frame(spec.between[0])) @ moment.marker_frame(
            spec.between[1]
        )
        strokes.append(float(offset[:3, 3] @ axis))
    return min(strokes), max(strokes)


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
        return box((9 * r, 9 * r, 0.25 * r)).moved((0, 0, -0.4 * r)), cylinder(1.4 * r, 0.7 * r)
    if kind == "in-plane":
        return box((9 * r, 9 * r, 0.25 * r)), sphere(1.1 * r)
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
    """Arrows that show what drivers move, lifted off their joints; a cylinder drives a distance."""
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
            reference = spec.ends[0] if split_reference(spec.ends[0])[0] != GROUND else spec.ends[1]
            along = np.eye(3)["xyz".find(motion.coordinate)]
            if motion.coordinate == "angle":
                along = np.array(spec.axis) if spec.axis is not None else np.eye(3)[2]
            axes = inverse(mechanism.marker_frame(reference))[:3, :3] @ axes_along(along)
        if motion.coordinate in ("angle", "second_angle"):
            turned = turn_arrow(3.0 * r, 0.55 * r)
            yield reference, axes, turned.moved((0, 0, lift.get(spec.joint or "", 0.0)))
        else:
            yield reference, axes, arrow(7.0 * r, 0.35 * r).moved((1.9 * r, 0, 0))
