"""What sensors read: motions of markers, coordinates, reactions, energies, expressions.

A channel is a sum of terms with factors, each a component of a marker's motion along an axis, the
value or rate of a constraint primitive, or one of three turning angles; or it is read off the
wrench of an element, an energy, a state, or a program over other channels. All but motions along
axes and angles are compiled only where `further` is not None.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import inlined, kernel
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.bodies.tangent import marker_jacobian
from flexmb.engine.kernels.functions.function import evaluate
from flexmb.engine.kernels.joints import primitive
from flexmb.engine.kernels.joints.primitive import joint_angle, wrapped
from flexmb.engine.kernels.sensors import turning, wrench
from flexmb.engine.sensor_tables import (
    ALONG,
    ALONG_A,
    ALONG_OM,
    ALONG_OMD,
    ALONG_V,
    ALONG_X,
    ANGLES_TURN,
    ENERGY,
    EXPRESSION,
    PLACE,
    SEEN_OMD,
    STATE,
    SUM,
)
from flexmb.engine.tables import ANGLE


@kernel
def follow_angles(sensors, markers, angles):
    """Carry the continuous angles to the present position; a NaN before gives that within ±π."""
    for c in range(sensors.channels.shape[0]):
        channel = sensors.channels[c]
        if channel["turns"] == 1:
            term = sensors.terms[channel["first"]]
            now = joint_angle(markers[term["I"]]["R"], markers[term["J"]]["R"], term["b"])
            angles[c] = now if math.isnan(angles[c]) else angles[c] + wrapped(now - angles[c])


@kernel
def follow_turns(further, sensors, markers, angles):
    """The same of the turning angles of orientations."""
    if further is not None:
        for c in range(sensors.channels.shape[0]):
            channel = sensors.channels[c]
            if channel["turns"] == ANGLES_TURN and channel["a"] == 0:
                term = sensors.terms[channel["first"]]
                Ri, Rj = turning.axes(markers, term)
                angles[c], angles[c + 1], angles[c + 2] = turning.angles(
                    term["a"], Ri, Rj, angles[c], angles[c + 1], angles[c + 2]
                )


@kernel
def forget(sensors, angles):
    """No angles yet: the next ones are those nearest to zero."""
    for c in range(angles.shape[0]):
        angles[c] = math.nan if sensors.channels[c]["turns"] != 0 else 0.0


@kernel
def read(further, sys, wk, t, q, v, vd, lam, energies, angles, out):
    """out (channels) of all sensors; after position, velocity and bias stages.

    `energies`: those of the output; `angles`: the continuous ones, at this position.
    """
    for c in range(out.shape[0]):
        channel = sys.sensors.channels[c]
        if channel["turns"] != 0:
            out[c] = angles[c]
        elif channel["what"] == SUM:
            out[c] = total(
                further, sys.lines, sys.parts, wk.now, channel, sys.sensors, vd, wk.dense
            )
        else:
            out[c] = other(further, sys, wk, channel, q, v, lam, energies)
    _read_expressions(further, sys, wk, t, v, out)


@kernel
def _read_expressions(further, sys, wk, t, v, out):
    """Channels that are computed of others, which are the variables of their programs."""
    if further is not None:
        variables, channels = wk.trial.variables, sys.sensors.channels
        for k in range(channels.shape[0]):
            x = out[k] if k < out.shape[0] else v[channels[k]["first"]]
            variables[k, 0], variables[k, 1], variables[k, 2] = x, 0.0, 0.0
        for c in range(out.shape[0]):
            channel = channels[c]
            if channel["what"] == EXPRESSION:
                out[c], _, _ = evaluate(
                    sys.sensors.programs, channel["first"], t, variables, wk.trial.stack
                )


@inlined
def total(further, lines, parts, now, channel, sensors, vd, dense):
    """Sum of the terms of a channel."""
    s = 0.0
    for k in range(channel["first"], channel["first"] + channel["n"]):
        term = sensors.terms[k]
        if term["kind"] >= ALONG:
            s += term["factor"] * _along(further, parts, now, term, vd, dense.J[0])
        else:
            s += term["factor"] * _coordinate(further, lines, parts, now, term, vd, dense)
    return s


@inlined
def _along(further, parts, now, term, vd, J):
    """Component of a motion of marker J along the axis a of marker I, or the global one."""
    mj, kind = now.marker[term["J"]], term["kind"]
    if kind == ALONG_X:
        x, y, z = mj["x"][0], mj["x"][1], mj["x"][2]
    elif kind == ALONG_V:
        x, y, z = mj["vx"][0], mj["vx"][1], mj["vx"][2]
    elif kind == ALONG_A:
        x, y, z = acceleration(parts, now, term["J"], vd, 0, J)
    else:
        x, y, z = _spin(further, parts, now, term, vd, J)
    if term["I"] < 0:
        return x if term["a"] == 0 else y if term["a"] == 1 else z
    R, a = now.marker[term["I"]]["R"], term["a"]
    return R[0, a] * x + R[1, a] * y + R[2, a] * z


@kernel
def _spin(further, parts, now, term, vd, J):
    """Angular velocity or acceleration of marker J; SEEN_OMD: what turning axes of I add."""
    if further is not None:
        mj = now.marker[term["J"]]
        if term["kind"] == ALONG_OM:
            return mj["om"][0], mj["om"][1], mj["om"][2]
        if term["kind"] == ALONG_OMD:
            return acceleration(parts, now, term["J"], vd, 3, J)
        if term["kind"] == SEEN_OMD:
            a, b = now.marker[term["I"]]["om"], mj["om"]
            return cross(a[0], a[1], a[2], b[0], b[1], b[2])
    return math.nan, math.nan, math.nan


@kernel
def acceleration(parts, now, k, vd, o, J):
    """Acceleration (o = 0) or angular acceleration (o = 3) of a marker, global axes."""
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


@inlined
def _coordinate(further, lines, parts, now, term, vd, dense):
    """A primitive between two markers, or its first or second derivative in time."""
    i, j, kind, a, b = term["I"], term["J"], term["kind"], term["a"], term["b"]
    mi, mj = now.marker[i], now.marker[j]
    if further is None or term["level"] == 0:
        return (
            joint_angle(mi["R"], mj["R"], b)
            if kind == ANGLE
            else _length(further, lines, term, mi, mj)
        )
    g = dense.g[0]
    primitive.gradient(lines, kind, a, b, mi, mj, g)
    if term["level"] == 1:
        return primitive.rate(g, mi, mj)
    s = primitive.curvature(lines, kind, a, b, mi, mj)
    for side in range(2):
        k, o = (i, 0) if side == 0 else (j, 6)
        for p in range(2):
            x, y, z = acceleration(parts, now, k, vd, 3 * p, dense.J[0])
            q = o + 3 * p
            s += g[q] * x + g[q + 1] * y + g[q + 2] * z
    return s


@kernel
def _length(further, lines, term, mi, mj):
    if further is not None:
        return primitive.value(lines, term["kind"], term["a"], term["b"], mi, mj, 0.0)
    return math.nan


@kernel
def other(further, sys, wk, channel, q, v, lam, energies):
    """What is no sum of terms: a component of a wrench, an energy, a state, a place."""
    if further is not None:
        if channel["what"] == STATE:
            return v[channel["first"]]
        if channel["what"] == PLACE:
            return q[channel["first"]] if channel["n"] == 0 else v[channel["first"]]
        if channel["what"] == ENERGY:
            return wrench.energy(sys, wk, channel, q, v, energies)
        if channel["what"] != EXPRESSION:
            return wrench.component(sys, wk, channel, lam)
    return math.nan
