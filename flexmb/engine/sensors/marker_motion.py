"""Motion of markers: components of positions, velocities and accelerations, and orientation angles.

A measure is d·u. d is axis a of a marker I or a global axis. u is the position, velocity,
acceleration, angular velocity or angular acceleration of J, or ω_I × ω_J. An observer who turns
with I subtracts this last term from the difference of the angular accelerations.

Orientation is given by three angles, in any sequence, from the axes of one marker to those of
another: R = R_Iᵀ R_J = R_i(α) R_j(β) R_k(γ), each rotation about an axis of the frame that the
previous ones have turned. With s = ±1 for the parity of (i, j, third axis): sequences of three
different axes (Cardan, Bryan) have sin β = s R_ik and are singular at ±90°; those of two axes
(Euler, k = i) have cos β = R_ii and are singular at 0 and 180°. Of the two solutions (α, β, γ) and
(α + π, π − β or −β, γ + π), the one nearer to the previous angles is taken, so that they are
continuous, also if the motion leads through a singular orientation. There γ is kept, and α is the
rest of the rotation (Shuster, A Survey of Attitude Representations, J. Astronaut. Sci. 41 (1993)
439, sec. 6).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from flexmb.engine.algebra.vector import cross, put_part, wrapped
from flexmb.engine.bodies.wrench import marker_acceleration
from flexmb.engine.jit import Integers, kernel, unit
from flexmb.engine.joints import DOT2
from flexmb.engine.joints.row import dot_columns, put_pair
from flexmb.engine.kind import GLOBAL_AXES, ChannelKind, Kind, Measure, SensorKind, Term
from flexmb.engine.method import REPEAT, SUCCESS
from flexmb.engine.sensors.joint_coordinate import ROW_MEASURES
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import Sensors

if TYPE_CHECKING:
    from flexmb.engine.sensors.sensor import Channels
    from flexmb.model.sensor import MarkerSensorSpec, OrientationSensorSpec


@kernel
def _component_along(run, term, x, y, z):
    """Component of (x, y, z) along the axis of a term."""
    a = term["a"]
    if term["I"] < 0:
        return x if a == 0 else y if a == 1 else z
    R = run.work.now.marker[term["I"]]["R"]
    return R[0, a] * x + R[1, a] * y + R[2, a] * z


@kernel
def _put_gradients(run, term, level, place, u):
    """Gradients of d·u: with the rotation of I if d is an axis of I; with the motion of J.

    The latter is g[level, place : place + 3]: 6 for translation, 9 for rotation of J.
    """
    g, a = run.work.feedback.g, term["a"]
    x, y, z = 1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2)
    if term["I"] >= 0:
        R = run.work.now.marker[term["I"]]["R"]
        x, y, z = R[0, a], R[1, a], R[2, a]
        put_part(g[0], 3, cross((x, y, z), u))
    put_part(g[level], place, (x, y, z))


@unit
def position(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·x."""
    term = sensors.terms[t]
    x = run.work.now.marker[term["J"]]["x"]
    return _component_along(run, term, x[0], x[1], x[2])  # type: ignore[no-any-return]


@unit
def position_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradient of d·x."""
    term = sensors.terms[t]
    _put_gradients(run, term, 0, 6, run.work.now.marker[term["J"]]["x"])
    return 0.0


@unit
def velocity(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·v."""
    term = sensors.terms[t]
    v = run.work.now.marker[term["J"]]["vx"]
    return _component_along(run, term, v[0], v[1], v[2])  # type: ignore[no-any-return]


@unit
def velocity_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·v; that with respect to velocities is also that of d·v̇ to accelerations."""
    term = sensors.terms[t]
    _put_gradients(run, term, 1, 6, run.work.now.marker[term["J"]]["vx"])
    return 0.0


@unit
def angular_velocity(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·ω."""
    term = sensors.terms[t]
    om = run.work.now.marker[term["J"]]["om"]
    return _component_along(run, term, om[0], om[1], om[2])  # type: ignore[no-any-return]


@unit
def angular_velocity_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·ω; that with respect to velocities is also that of d·ω̇ to accelerations."""
    term = sensors.terms[t]
    _put_gradients(run, term, 1, 9, run.work.now.marker[term["J"]]["om"])
    return 0.0


@unit
def acceleration(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·v̇."""
    term = sensors.terms[t]
    x, y, z = marker_acceleration(run, at, term["J"], 0)
    return _component_along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def angular_acceleration(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·ω̇."""
    term = sensors.terms[t]
    x, y, z = marker_acceleration(run, at, term["J"], 3)
    return _component_along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def turning_of_axes(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·(ω_I × ω_J)."""
    term, markers = sensors.terms[t], run.work.now.marker
    p, q = markers[term["I"]]["om"], markers[term["J"]]["om"]
    x, y, z = cross(p, q)
    return _component_along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def turning_of_axes_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·(ω_I × ω_J)."""
    term, markers, g = sensors.terms[t], run.work.now.marker, run.work.feedback.g
    mi, a = markers[term["I"]], term["a"]
    R, p, q = mi["R"], mi["om"], markers[term["J"]]["om"]
    dx, dy, dz = R[0, a], R[1, a], R[2, a]
    put_part(g[1], 3, cross(q, (dx, dy, dz)))
    put_part(g[1], 9, cross((dx, dy, dz), p))
    x, y, z = cross(p, q)
    put_part(g[0], 3, cross((dx, dy, dz), (x, y, z)))
    return 0.0


POSITION = Measure(position, position_gradient, 0)
VELOCITY = Measure(velocity, velocity_gradient, 1)
ACCELERATION = Measure(acceleration, velocity_gradient, 2)
ANGULAR_VELOCITY = Measure(angular_velocity, angular_velocity_gradient, 1)
ANGULAR_ACCELERATION = Measure(angular_acceleration, angular_velocity_gradient, 2)
TURNING_OF_AXES = Measure(turning_of_axes, turning_of_axes_gradient, 1)
_MOTIONS = {
    "position": POSITION,
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "angular_velocity": ANGULAR_VELOCITY,
    "angular_acceleration": ANGULAR_ACCELERATION,
}
_POINT_MOTIONS = (POSITION, VELOCITY, ACCELERATION)


def add_marker_motion(channels: Channels, spec: MarkerSensorSpec) -> None:
    """Add three channels of a marker's motion: absolute, relative, or seen by a moving observer."""
    lowering, motion = channels.lowering, _MOTIONS[spec.type]
    j = lowering.marker(spec.of)
    for a in range(3):
        if spec.seen_from is not None:
            channels.add_sum(_observed(motion, lowering.marker(spec.seen_from), j, a))
            continue
        axes = GLOBAL_AXES if spec.axes == "global" else lowering.marker(spec.axes)
        terms = [Term(motion, -1, axes, j, a)]
        is_shifted = motion is POSITION and lowering.markers.origin.any()  # the origin of the axes
        if spec.relative_to is not None or is_shifted:
            other = lowering.marker(spec.relative_to or "ground")
            terms.append(Term(motion, -1, axes, other, a, factor=-1.0))
        channels.add_sum(terms)


def _observed(motion: Measure, observer: int, j: int, a: int) -> list[Term]:
    """Terms of component a of a motion of j as seen by an observer who moves with a marker."""
    if motion in _POINT_MOTIONS:
        return [Term(ROW_MEASURES[_POINT_MOTIONS.index(motion)], DOT2, observer, j, a, a)]
    terms = [Term(motion, -1, observer, j, a), Term(motion, -1, observer, observer, a, factor=-1.0)]
    if motion is ANGULAR_ACCELERATION:
        terms.append(Term(TURNING_OF_AXES, -1, observer, j, a, factor=-1.0))
    return terms


MARKER_MOTIONS = SensorKind(
    tuple(_MOTIONS), add_marker_motion, measures=(*_MOTIONS.values(), TURNING_OF_AXES)
)


# Row of FeedbackWork.g that holds the three angles.
_ANGLES = 3
# |sin β| (Euler) or |cos β| (Cardan) below which the orientation counts as singular: α and γ would
# be round-off there.
_SINGULAR = 1e-8
# Largest displacement of the tip of axis k, seen from I, over the sum of its distances from axis i
# before and after. α then changes by at most 2 arcsin 0.35 = 41°, so its branch is certain.
_MAX_RELATIVE_MOTION = 0.35


@kernel
def _sequence(code):
    """Axes i, j, k of the sequence 9 i + 3 j + k, the axis other than i and j, and the parity s."""
    i, j, k = code // 9, (code // 3) % 3, code % 3
    return i, j, k, 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0


@kernel
def _orientation_angles(code, Ri, Rj, before, b1, b2):
    """α, β, γ nearest to the previous ones; if these are NaN, with β within 0..180° or ±90°."""
    i, j, k, m, s = _sequence(code)
    y = dot_columns(Ri, i, Rj, j)
    if i == k:
        x = dot_columns(Ri, i, Rj, m)
        across = math.hypot(x, y)
        first = math.atan2(dot_columns(Ri, j, Rj, i), -s * dot_columns(Ri, m, Rj, i))
        second = math.atan2(across, dot_columns(Ri, i, Rj, i))
        third = math.atan2(y, s * x)
    else:
        x = dot_columns(Ri, i, Rj, i)
        across = math.hypot(x, y)
        first = math.atan2(-s * dot_columns(Ri, j, Rj, k), dot_columns(Ri, k, Rj, k))
        second = math.atan2(s * dot_columns(Ri, i, Rj, k), across)
        third = math.atan2(-s * y, x)
    if across < _SINGULAR:
        third = 0.0 if math.isnan(b2) else b2
        first = _first_angle_if_singular(i, j, k, m, s, third, Ri, Rj)
    if math.isnan(before):
        return first, second, third
    other = -second if i == k else math.pi - second
    p, q, r = first + math.pi, other, third + math.pi
    near = abs(wrapped(first - before)) + abs(wrapped(second - b1)) + abs(wrapped(third - b2))
    far = abs(wrapped(p - before)) + abs(wrapped(q - b1)) + abs(wrapped(r - b2))
    if far < near and across >= _SINGULAR:
        first, second, third = p, q, r
    return before + wrapped(first - before), b1 + wrapped(second - b1), b2 + wrapped(third - b2)


@kernel
def _first_angle_if_singular(i, j, k, m, s, third, Ri, Rj):
    """α at a singular orientation for a given γ: column j of R R_k(−γ) is that of R_i(α)."""
    c, d = math.cos(third), s * math.sin(third)
    p, f = (m, -d) if i == k else (i, d)
    up = c * dot_columns(Ri, m, Rj, j) + f * dot_columns(Ri, m, Rj, p)
    on = c * dot_columns(Ri, j, Rj, j) + f * dot_columns(Ri, j, Rj, p)
    return math.atan2(s * up, on)


@kernel
def _angle_gradient(code, number, Ri, Rj, first):
    """d with (rate of angle `number`) = d·(ω_J − ω_I), global axes; `first` is α.

    ω = α̇ n₁ + β̇ n₂ + γ̇ n₃ with the present axes of rotation n; d is the dual vector of its axis.
    """
    i, j, k, m, s = _sequence(code)
    c, d = math.cos(first), s * math.sin(first)
    x = c * Ri[0, j] + d * Ri[0, m]
    y = c * Ri[1, j] + d * Ri[1, m]
    z = c * Ri[2, j] + d * Ri[2, m]
    px, py, pz = cross((x, y, z), (Rj[0, k], Rj[1, k], Rj[2, k]))
    volume = Ri[0, i] * px + Ri[1, i] * py + Ri[2, i] * pz
    if number == 1:
        px, py, pz = cross((Rj[0, k], Rj[1, k], Rj[2, k]), (Ri[0, i], Ri[1, i], Ri[2, i]))
    elif number == 2:
        px, py, pz = cross((Ri[0, i], Ri[1, i], Ri[2, i]), (x, y, z))
    return px / volume, py / volume, pz / volume


class TurningAngles(NamedTuple):
    """Channels of orientation angles: the first of each three; the other two follow it."""

    channels: Integers


@unit
def put_angles(run: Run, t: int, c: int) -> int:
    """Put the three angles of term t, nearest to channels c to c + 2, into FeedbackWork.g."""
    term, markers, near = run.system.sensors.terms[t], run.work.now.marker, run.work.feedback.near
    Ri, Rj = markers[term["I"]]["R"], markers[term["J"]]["R"]
    x, y, z = _orientation_angles(term["a"], Ri, Rj, near[c], near[c + 1], near[c + 2])
    put_part(run.work.feedback.g[_ANGLES], 0, (x, y, z))
    return SUCCESS


@unit
def turning_angle(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Value of term t, one of three orientation angles, nearest to its previous value."""
    term = sensors.terms[t]
    put_angles(run, t, term["channel"] - term["b"])
    return run.work.feedback.g[_ANGLES, term["b"]]  # type: ignore[no-any-return]


@unit
def turning_angle_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradient of one orientation angle with respect to the rotations of both markers."""
    term, markers, g = sensors.terms[t], run.work.now.marker, run.work.feedback.g
    put_angles(run, t, term["channel"] - term["b"])
    Ri, Rj = markers[term["I"]]["R"], markers[term["J"]]["R"]
    x, y, z = _angle_gradient(term["a"], term["b"], Ri, Rj, g[_ANGLES, 0])
    put_pair(g[0], 3, (x, y, z))
    return 0.0


@unit
def turning_channel(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Value of channel c, which has one term: an orientation angle."""
    return turning_angle(run, sensors, at, sensors.channels[c]["first"])


@unit
def continue_turning_angles(run: Run, of: TurningAngles, at: Point) -> int:
    """Update FeedbackWork.near of orientation angles to the present position."""
    near, g, listed = run.work.feedback.near, run.work.feedback.g, of.channels
    for n in range(listed.shape[0]):
        c = listed[n]
        put_angles(run, run.system.sensors.channels[c]["first"], c)
        near[c], near[c + 1], near[c + 2] = g[_ANGLES, 0], g[_ANGLES, 1], g[_ANGLES, 2]
    return SUCCESS


@kernel
def _excludes_singularity(code, Ri, Rj, first, second):
    """Whether no singular orientation can lie between angles α, β and the present orientation.

    The tip of axis k of J must be near to where it is at α and β (`_MAX_RELATIVE_MOTION`).
    """
    i, j, k, m, s = _sequence(code)
    along, across = s * math.sin(second), math.cos(second)
    y, z = -s * across * math.sin(first), across * math.cos(first)
    if i == k:
        along, across = across, s * along
        y, z = across * math.sin(first), -s * across * math.cos(first)
    p, q = dot_columns(Ri, i, Rj, k), dot_columns(Ri, j, Rj, k)
    r = dot_columns(Ri, m, Rj, k)
    way = math.sqrt((p - along) ** 2 + (q - y) ** 2 + (r - z) ** 2)
    return not way > max(_MAX_RELATIVE_MOTION * (abs(across) + math.hypot(q, r)), 4.0 * _SINGULAR)


@unit
def follow_turning_angles(run: Run, of: TurningAngles, at: Point) -> int:
    """Update Trial.angles to the present position; REPEAT if a singular one may lie between."""
    angles, near, listed = run.work.trial.angles, run.work.feedback.near, of.channels
    sensors, markers, status = run.system.sensors, run.work.now.marker, SUCCESS
    for n in range(listed.shape[0]):
        c = listed[n]
        term = sensors.terms[sensors.channels[c]["first"]]
        Ri, Rj = markers[term["I"]]["R"], markers[term["J"]]["R"]
        if not _excludes_singularity(term["a"], Ri, Rj, angles[c], angles[c + 1]):
            status = REPEAT
        for a in range(3):
            near[c + a] = angles[c + a]
    if status == SUCCESS:
        continue_turning_angles(run, of, at)
        for n in range(listed.shape[0]):
            for c in range(listed[n], listed[n] + 3):
                angles[c] = near[c]
    return status


TURNING_ANGLES = Kind(
    "turning_angles",
    TurningAngles,
    {"angles": continue_turning_angles, "angle_path": follow_turning_angles},
)
TURNING_ANGLE = Measure(turning_angle, turning_angle_gradient, 0)
TURNING_CHANNEL = ChannelKind(turning_channel, "terms", counts_turns=True)


def add_orientation(channels: Channels, spec: OrientationSensorSpec) -> None:
    """Add three channels: the angles that turn the axes of one marker into those of another."""
    lowering = channels.lowering
    i, j = lowering.marker(spec.relative_to or "ground"), lowering.marker(spec.of)
    first, second, third = ("xyz".index(axis) for axis in spec.sequence)
    for number in range(3):
        term = Term(TURNING_ANGLE, -1, i, j, 9 * first + 3 * second + third, number)
        channels.add_angle(TURNING_CHANNEL, term, number)


ORIENTATIONS = SensorKind(
    ("orientation",), add_orientation, measures=(TURNING_ANGLE,), channels=(TURNING_CHANNEL,)
)
