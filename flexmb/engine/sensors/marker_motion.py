"""Motion of markers: components of positions, velocities and accelerations.

A measure is d·u, d axis a of a marker I or a global one, u the position, the velocity or
acceleration, the angular velocity or acceleration of J, or what the turning axes of I take from the
latter for an observer on I, ω_I × ω_J.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kind import GLOBAL_AXES, Measure, SensorKind, Term
from flexmb.engine.row_kinds import DOT2
from flexmb.engine.sensors.joint_coordinate import ROW_MEASURES, marker_acceleration
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import Sensors

if TYPE_CHECKING:
    from flexmb.engine.sensors.sensor import Channels
    from flexmb.model.sensor import MarkerSensorSpec


@kernel
def _along(run, term, x, y, z):
    """Component of (x, y, z) along the axis of a term."""
    a = term["a"]
    if term["I"] < 0:
        return x if a == 0 else y if a == 1 else z
    R = run.work.now.marker[term["I"]]["R"]
    return R[0, a] * x + R[1, a] * y + R[2, a] * z


@kernel
def _put_gradients(run, term, level, place, u):
    """Gradients of d·u: with the pose of I if d turns with it, with the motion `place` of J."""
    g, a = run.work.feedback.g, term["a"]
    x, y, z = 1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2)
    if term["I"] >= 0:
        R = run.work.now.marker[term["I"]]["R"]
        x, y, z = R[0, a], R[1, a], R[2, a]
        p, q, r = cross(x, y, z, u[0], u[1], u[2])
        put(g[0], 3, p, q, r)
    put(g[level], place, x, y, z)


@unit
def position(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·x."""
    term = sensors.terms[t]
    x = run.work.now.marker[term["J"]]["x"]
    return _along(run, term, x[0], x[1], x[2])  # type: ignore[no-any-return]


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
    return _along(run, term, v[0], v[1], v[2])  # type: ignore[no-any-return]


@unit
def velocity_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·v; with accelerations that of d·v̇."""
    term = sensors.terms[t]
    _put_gradients(run, term, 1, 6, run.work.now.marker[term["J"]]["vx"])
    return 0.0


@unit
def angular_velocity(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·ω."""
    term = sensors.terms[t]
    om = run.work.now.marker[term["J"]]["om"]
    return _along(run, term, om[0], om[1], om[2])  # type: ignore[no-any-return]


@unit
def angular_velocity_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·ω; with accelerations that of d·ω̇."""
    term = sensors.terms[t]
    _put_gradients(run, term, 1, 9, run.work.now.marker[term["J"]]["om"])
    return 0.0


@unit
def acceleration(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·v̇."""
    term = sensors.terms[t]
    x, y, z = marker_acceleration(run, at, term["J"], 0)
    return _along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def angular_acceleration(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·ω̇."""
    term = sensors.terms[t]
    x, y, z = marker_acceleration(run, at, term["J"], 3)
    return _along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def turning_of_axes(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """d·(ω_I × ω_J)."""
    term, markers = sensors.terms[t], run.work.now.marker
    p, q = markers[term["I"]]["om"], markers[term["J"]]["om"]
    x, y, z = cross(p[0], p[1], p[2], q[0], q[1], q[2])
    return _along(run, term, x, y, z)  # type: ignore[no-any-return]


@unit
def turning_of_axes_gradient(run: Run, sensors: Sensors, at: Point, t: int) -> float:
    """Gradients of d·(ω_I × ω_J)."""
    term, markers, g = sensors.terms[t], run.work.now.marker, run.work.feedback.g
    mi, a = markers[term["I"]], term["a"]
    R, p, q = mi["R"], mi["om"], markers[term["J"]]["om"]
    dx, dy, dz = R[0, a], R[1, a], R[2, a]
    x, y, z = cross(q[0], q[1], q[2], dx, dy, dz)
    put(g[1], 3, x, y, z)
    x, y, z = cross(dx, dy, dz, p[0], p[1], p[2])
    put(g[1], 9, x, y, z)
    x, y, z = cross(p[0], p[1], p[2], q[0], q[1], q[2])
    x, y, z = cross(dx, dy, dz, x, y, z)
    put(g[0], 3, x, y, z)
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
    """Three channels of the motion of a marker, absolute, relative, or as an observer sees it."""
    lowering, motion = channels.lowering, _MOTIONS[spec.type]
    j = lowering.marker(spec.of)
    for a in range(3):
        if spec.seen_from is not None:
            channels.add_sum(_observed(motion, lowering.marker(spec.seen_from), j, a))
            continue
        axes = GLOBAL_AXES if spec.axes == "global" else lowering.marker(spec.axes)
        terms = [Term(motion, -1, axes, j, a)]
        if spec.relative_to is not None:
            other = lowering.marker(spec.relative_to)
            terms.append(Term(motion, -1, axes, other, a, factor=-1.0))
        channels.add_sum(terms)


def _observed(motion: Measure, observer: int, j: int, a: int) -> list[Term]:
    """Component a of a motion of j in the axes of a marker that the observer moves with."""
    if motion in _POINT_MOTIONS:
        return [Term(ROW_MEASURES[_POINT_MOTIONS.index(motion)], DOT2, observer, j, a, a)]
    terms = [Term(motion, -1, observer, j, a), Term(motion, -1, observer, observer, a, factor=-1.0)]
    if motion is ANGULAR_ACCELERATION:
        terms.append(Term(TURNING_OF_AXES, -1, observer, j, a, factor=-1.0))
    return terms


MARKER_MOTIONS = SensorKind(
    tuple(_MOTIONS),
    add_marker_motion,
    measures=(*_MOTIONS.values(), TURNING_OF_AXES),
)
