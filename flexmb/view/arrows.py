"""Arrows of forces and torques: loads, reactions, and what sensors record of contacts.

The reactions of joints, drivers, couplers and forces on joints are part of every result. Those of
other forces, such as contacts and bushings, are there if a sensor of type reaction records them; a
contact's arrow begins where its sides touch. One round scale for all forces and one for all torques
holds for the whole run and is given in the caption.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import floor, log10
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import Array
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.forces.contact import ContactSpec, PlaneSide, SphereSide, nodes_of
from flexmb.model.forces.load import LoadSpec
from flexmb.model.markers import MarkerSpec, place
from flexmb.model.plane import in_plane_triad
from flexmb.model.reading import split_reference
from flexmb.model.sensor import ReactionSensorSpec
from flexmb.results.channels import marker_pairs
from flexmb.view.content import Scale, Solid
from flexmb.view.mechanism import Display, Mechanism, applied, transform
from flexmb.view.shapes import arrow, axes_along, turn_arrow

_FORCE, _TORQUE = "#b91c1c", "#7c3aed"
_MAX_ARROW = 0.2  # length of an arrow over the size of the mechanism
_MIN_ARROW = 1e-3  # arrows below this fraction of the largest are left out
_SAMPLES = 16  # times at which the largest arrow is searched


@dataclass(frozen=True)
class Vector:
    """A force [N] or torque [N m] (3,) in global axes, and the marker on which it acts.

    It begins at `offset` (3,) from the marker, in the marker's axes.
    """

    name: str
    marker: str
    value: Array
    torque: bool
    offset: Array | None = None


def vectors(mechanism: Mechanism, which: str) -> Iterator[Vector]:
    """Loads, reactions of joints and drivers, or both, at the mechanism's time."""
    if which in ("loads", "all"):
        yield from _loads(mechanism)
    if which in ("reactions", "all"):
        yield from _reactions(mechanism)
        for _, sensor, one in _force_sensors(mechanism):
            yield _sensor_vector(mechanism, sensor, one)


def _loads(mechanism: Mechanism) -> Iterator[Vector]:
    result, t = mechanism.result, mechanism.time
    seconds = t * result.units.scale("s")
    for name, spec in mechanism.model.forces.items():
        if not isinstance(spec, LoadSpec):
            continue
        values = []
        for function in spec.value:
            variables = {
                channel: (_at(result, channel, t), 0.0, 0.0)
                for channel in function.expression.channels
            }
            values.append(function.expression.value(seconds, variables or None)[0])
        A = np.eye(3)
        if spec.axes != "global":
            A = mechanism.marker_frame(spec.at if spec.axes == "body" else spec.axes)[:3, :3]
        yield Vector(name, spec.at, A @ np.array(values), spec.type == "torque")


def _at(result: Any, channel: str, time: float) -> float:
    """A channel's value at a time, SI."""
    unit = result._channel(channel).unit
    return float(np.interp(time, result.time, result[channel])) * (
        result.units.scale(unit) if unit else 1.0
    )


def _reactions(mechanism: Mechanism) -> Iterator[Vector]:
    result, time = mechanism.result, mechanism.result.time
    for pair in marker_pairs(result.layout, result.model):
        reaction, name = result.reaction(pair.path), pair.name
        A = mechanism.marker_frame(reaction.on)[:3, :3] @ _reaction_axes(mechanism, pair.path)
        for values, unit, torque in ((reaction.force, "N", False), (reaction.moment, "N m", True)):
            local = [np.interp(mechanism.time, time, values[:, k]) for k in range(3)]
            yield Vector(name, reaction.on, A @ np.array(local) * result.units.scale(unit), torque)


def _force_sensors(mechanism: Mechanism) -> Iterator[tuple[str, str, ReactionSensorSpec]]:
    """Forces of which no result has the reaction by itself, and the sensors that record them; of
    several sensors of the same the first."""
    seen = set()
    for name, sensor in mechanism.model.sensors.items():
        if not isinstance(sensor, ReactionSensorSpec) or sensor.force is None:
            continue
        spec = mechanism.model.forces[sensor.force]
        key = sensor.force, sensor.on, sensor.quantity
        if getattr(spec, "between", None) is not None and key not in seen:
            seen.add(key)
            yield sensor.force, name, sensor


def _contacts_without_sensor(mechanism: Mechanism) -> list[str]:
    """Contacts whose force no sensor records."""
    seen = {force for force, _, sensor in _force_sensors(mechanism) if sensor.quantity == "force"}
    contacts = {n for n, s in mechanism.model.forces.items() if isinstance(s, ContactSpec)}
    return sorted(contacts - seen)


def _sensor_vector(mechanism: Mechanism, name: str, sensor: ReactionSensorSpec) -> Vector:
    """What a sensor records of a force, at its marker, of a contact where its sides touch."""
    result, t = mechanism.result, mechanism.time
    spec: Any = mechanism.model.forces[str(sensor.force)]
    marker = spec.between["IJ".index(sensor.on)]
    value = np.array([_at(result, f"{name}.{axis}", t) for axis in "xyz"])
    if sensor.axes == "joint":
        value = _frame_of_side(mechanism, spec, "IJ".index(sensor.on))[:3, :3] @ value
    elif sensor.axes != "global":
        value = mechanism.marker_frame(sensor.axes)[:3, :3] @ value
    offset, torque = None, sensor.quantity == "moment"
    if isinstance(spec, ContactSpec) and not torque:
        frame = mechanism.marker_frame(marker)
        offset = frame[:3, :3].T @ (_contact_place(mechanism, spec) - frame[:3, 3])
    return Vector(str(sensor.force), marker, value, torque, offset)


def _frame_of_side(mechanism: Mechanism, spec: Any, k: int) -> Array:
    """The transform (4, 4) of a force's marker I or J; z is along its axis, if it has one."""
    side = spec.shapes[k] if isinstance(spec, ContactSpec) else spec
    pair = (spec.between[k],) * 2 if isinstance(spec, ContactSpec) else spec.between
    frame = mechanism.marker_frame(spec.between[k])
    if getattr(side, "axis", None) is not None:
        ends = lookup.frames(mechanism.model, pair, side.axis, mechanism.flexbodies)
        turn = mechanism.marker(spec.between[k]).R.T @ ends[0 if pair[0] == pair[1] else k].R
        frame[:3, :3] = frame[:3, :3] @ turn
    return frame


def _contact_place(mechanism: Mechanism, spec: ContactSpec) -> Array:
    """Where the sides of a contact touch or are nearest (3,), global axes; of several points the
    mean, with the weights of their forces."""
    k = spec.round_side
    mine, other = spec.shapes[k], spec.shapes[1 - k]
    frame = _frame_of_side(mechanism, spec, 1 - k)
    points = _points(mechanism, spec.between[k], mine)
    u = (points - frame[:3, 3]) @ frame[:3, :3]  # in the axes of the other side
    if isinstance(other, PlaneSide):
        away, depth = np.tile([0.0, 0.0, 1.0], (len(u), 1)), -u[:, 2]
    else:
        away = u.copy()
        if not isinstance(other, SphereSide):
            away[:, 2] = 0.0
        distance = np.linalg.norm(away, axis=1)
        away /= np.maximum(distance, 1e-300)[:, None]
        depth = other.radius - distance
        if getattr(other, "side", "outside") == "inside":
            away, depth = -away, -depth
    if isinstance(mine, SphereSide):
        return np.asarray(points[0] - mine.radius * frame[:3, :3] @ away[0])
    weights = np.maximum(depth, 0.0) ** spec.exponent
    if not weights.any():
        weights = np.asarray(depth == depth.max(), dtype=float)
    return np.asarray(weights @ points / weights.sum())


def _points(mechanism: Mechanism, reference: str, side: Any) -> Array:
    """The centre of a sphere, or contact points (n, 3), global axes."""
    if isinstance(side, SphereSide):
        return mechanism.point(reference)[None]
    body = split_reference(reference)[0]
    if side.points is not None:
        return applied(mechanism.frame(body), np.array(side.points))
    flexbody, eta = mechanism.flexbodies[body], mechanism.pose(body).eta
    own = []
    for node in nodes_of(flexbody, side):
        marker = place(body, MarkerSpec(node=int(node)), flexbody)
        moved = 0.0 if marker.Phi_t is None else marker.Phi_t @ eta
        own.append(marker.position + moved)
    return applied(mechanism.frame(body), np.array(own))


def _reaction_axes(mechanism: Mechanism, path: str) -> Array:
    """The axes (3, 3) of a reaction at marker J of a joint, a driver, a coupler or a force on a
    joint, in the marker's."""
    model, names = mechanism.model, path.split(".")
    joint = names[-1]
    if names[0] == "forces":  # a spring, stop or friction of a joint
        joint = str(vars(model.forces[joint])["joint"])
    if names[0] == "drivers":
        driver = model.drivers[joint]
        if driver.joint is None:
            J = lookup.frames(model, driver.ends, driver.axis, mechanism.flexbodies)[1]
            planar = model.plane if driver.axis is None else None
            turn = np.eye(3) if planar is None else in_plane_triad(planar)
            return np.asarray(mechanism.marker(driver.ends[1]).R.T @ J.R @ turn)
        joint = driver.joint
    axes, spec = mechanism.joint_axes[joint][1], model.joints[joint]
    if model.plane is None or spec.type not in (
        "prismatic",
        "in-line",
        "in-plane",
        "prismatic-spherical",
    ):
        return axes
    z = mechanism.marker_frame(spec.between[1])[:3, :3].T @ np.array(PLANES[model.plane])
    return np.column_stack([axes[:, 2], np.cross(z, axes[:, 2]), z])


@dataclass(frozen=True)
class ArrowScale:
    """Lengths of arrows: metres per newton and per newton metre, and as a text."""

    force: float
    torque: float
    caption: str


def arrow_scale(mechanism: Mechanism, which: str, size: float) -> ArrowScale:
    """A round scale with which the largest arrow of the run has a suitable length."""
    time = mechanism.result.time
    rows = np.unique(np.linspace(0, len(time) - 1, _SAMPLES).astype(int))
    moments = [mechanism, *(mechanism.at(float(time[row])) for row in rows)]
    largest = [0.0, 0.0]
    for moment in moments:
        for vector in vectors(moment, which):
            k = int(vector.torque)
            largest[k] = max(largest[k], float(np.linalg.norm(vector.value)))
    if which != "loads":
        for _, name, sensor in _force_sensors(mechanism):  # blows are short: all rows
            k, unit = int(sensor.quantity == "moment"), mechanism.result._channel(f"{name}.x").unit
            values = [mechanism.result[f"{name}.{axis}"] for axis in "xyz"]
            top = float(np.linalg.norm(values, axis=0).max())
            largest[k] = max(largest[k], top * mechanism.result.units.scale(unit))
    if largest[1] < _MIN_ARROW**2 * size * largest[0]:
        largest[1] = 0.0  # torques that are round-off
    units, length = mechanism.result.units, _MAX_ARROW * size
    scales, words = [0.0, 0.0], []
    for k, (noun, unit) in enumerate((("force", "N"), ("torque", "N m"))):
        if largest[k] > 0:
            shown = Scale.fitting(largest[k], units, unit)
            step = _round_up(shown.top)
            scales[k] = length / (step / shown.factor)
            words.append(f"{noun} {step:g} {shown.unit}")
    drawn = Scale.fitting(length, units)
    caption = (
        f"arrows {drawn.top:.3g} {drawn.unit} long: {', '.join(words)}" if words else "no forces"
    )
    if which != "loads" and (silent := _contacts_without_sensor(mechanism)):
        caption += f"; none of {', '.join(silent)}, which no sensor of type reaction records"
    return ArrowScale(scales[0], scales[1], caption)


def arrow_solids(
    display: Display, which: str, scale: ArrowScale, size: float, r: float
) -> Iterator[Solid]:
    """Arrows at the markers on which forces act; torques are curved arrows about their axes."""
    for vector in vectors(display.mechanism, which):
        value = float(np.linalg.norm(vector.value))
        length = value * (scale.torque if vector.torque else scale.force)
        if length < 10 * _MIN_ARROW * size:
            continue
        frame, offset = display.marker(vector.marker), vector.offset
        begin = frame[:3, 3] if offset is None else frame[:3, :3] @ offset + frame[:3, 3]
        at = transform(axes_along(vector.value), begin)
        if vector.torque:
            shape = turn_arrow(max(0.5 * length, 1.5 * r), 0.35 * r)
            yield Solid(vector.name, shape, _TORQUE, 1.0, at, "arrow")
        else:
            yield Solid(vector.name, arrow(length, 0.4 * r), _FORCE, 1.0, at, "arrow")


def _round_up(value: float) -> float:
    power = 10.0 ** floor(log10(value))
    return next(
        step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9)
    )
