"""What sensors read: position, velocity, acceleration of a marker, and the angle between two."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.primitive import joint_angle, wrapped
from flexmb.engine.kernels.tangent import marker_jacobian
from flexmb.engine.tables import ACCELERATION, ANGLE_SENSOR, POSITION, VELOCITY


@kernel
def follow_angles(sensors, markers, angles):
    """Carry the continuous joint angles to the present position (called at accepted steps)."""
    for k in range(sensors.shape[0]):
        s = sensors[k]
        if s["kind"] == ANGLE_SENSOR:
            now = joint_angle(markers[s["I"]]["R"], markers[s["J"]]["R"], s["axis"])
            c = s["channel"]
            angles[c] += wrapped(now - angles[c])


@kernel
def read(sensors, parts, now, vd, angles, J, out):
    """out (channels) of all sensors; after position, velocity and bias stages. J is scratch."""
    for k in range(sensors.shape[0]):
        s = sensors[k]
        c = s["channel"]
        if s["kind"] == ANGLE_SENSOR:
            out[c] = angles[c]
            continue
        for a in range(3):
            out[c + a] = 0.0
        _add_reading(s["kind"], parts, now, s["J"], vd, 1.0, J, out, c)
        if s["I"] >= 0:
            _add_reading(s["kind"], parts, now, s["I"], vd, -1.0, J, out, c)


@kernel
def _add_reading(kind, parts, now, k, vd, f, J, out, o):
    mn = now.marker[k]
    if kind == ACCELERATION:
        _add_acceleration(parts, now, k, vd, f, J, out, o)
        return
    for a in range(3):
        if kind == POSITION:
            out[o + a] += f * mn["x"][a]
        elif kind == VELOCITY:
            out[o + a] += f * mn["vx"][a]


@kernel
def _add_acceleration(parts, now, k, vd, f, J, out, o):
    b = parts.markers[k]["body"]
    if b < 0:
        return
    iv, n = parts.bodies[b]["iv"], 6 + parts.bodies[b]["m"]
    marker_jacobian(parts, now, k, J)
    for a in range(3):
        s = now.marker[k]["bx"][a]
        for c in range(n):
            s += J[a, c] * vd[iv + c]
        out[o + a] += f * s
