"""Measures of the motion of a marker J along an axis: d·u, d axis a of a marker I or a global one.

u is the position, the velocity or acceleration, the angular velocity or acceleration of J, or what
the turning axes of I take from the latter for an observer on I, ω_I × ω_J.
"""

from __future__ import annotations

from flexmb.engine.algebra.rotation import cross
from flexmb.engine.algebra.vector import put
from flexmb.engine.bodies.wrench import marker_jacobian
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kind import Measure
from flexmb.engine.sensor_tables import Sensors
from flexmb.engine.state import Point, Run


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


@kernel
def marker_acceleration(run, at, k, o):
    """Acceleration (o = 0) or angular acceleration (o = 3) of a marker, global axes."""
    parts, now, J, vd = run.system.parts, run.work.now, run.work.dense.J[0], at.vd
    mn, b = now.marker[k], parts.markers[k]["body"]
    if b < 0:
        return 0.0, 0.0, 0.0
    iv, n = parts.bodies[b]["iv"], 6 + parts.bodies[b]["m"]
    marker_jacobian(parts, now, k, J)
    bias = mn["bx"] if o == 0 else mn["bom"]
    x, y, z = bias[0], bias[1], bias[2]
    for c in range(n):
        x += J[o, c] * vd[iv + c]
        y += J[o + 1, c] * vd[iv + c]
        z += J[o + 2, c] * vd[iv + c]
    return x, y, z


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
