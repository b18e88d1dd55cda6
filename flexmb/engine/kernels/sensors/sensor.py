"""What sensors read: motions of markers, coordinates, reactions, energies, expressions.

A channel is a sum of terms with factors, each a component of a marker's motion along an axis, the
value or rate of a constraint primitive, or one of three turning angles; or it is read off the
wrench of an element, an energy, a state, or a program over other channels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexmb.engine.jit import call_channel, kernel, unit
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.kernels.bodies.energy import body_energy
from flexmb.engine.kernels.bodies.tangent import marker_jacobian
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.kernels.joints import primitive
from flexmb.engine.kernels.joints.primitive import joint_angle, wrapped
from flexmb.engine.kernels.sensors import turning
from flexmb.engine.kernels.stages import walk
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector
from flexmb.engine.sensor_tables import (
    ALONG,
    ALONG_A,
    ALONG_OM,
    ALONG_OMD,
    ALONG_V,
    ALONG_X,
    ANGLE_TURNS,
    ANGLES_TURN,
    ENERGY,
    EXPRESSION,
    PLACE,
    SEEN_OMD,
    STATE,
    SUM,
)
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import ANGLE


class TurningChannels(NamedTuple):
    """Channels that count turns (`System.sensors`)."""


@kernel
def count_turns(run, at, angles):
    """Carry what counts turns to the present position: in `angles`, and for feedback."""
    near = run.work.feedback.near
    copy(angles, near)
    walk(run.stages.angles, run, at)
    for c in range(angles.shape[0]):
        angles[c] = near[c]


@unit
def carry_angles(run: Run, of: TurningChannels, at: Point) -> int:
    """Carry continuous angles to the present position; a NaN before gives those next to zero."""
    sensors, markers, near = run.system.sensors, run.work.now.marker, run.work.feedback.near
    channels, terms = sensors.channels, sensors.terms
    for c in range(channels.shape[0]):
        channel = channels[c]
        if channel["turns"] == ANGLE_TURNS:
            term = terms[channel["first"]]
            angle = joint_angle(markers[term["I"]]["R"], markers[term["J"]]["R"], term["b"])
            before = near[c]
            near[c] = angle if math.isnan(before) else before + wrapped(angle - before)
        elif channel["turns"] == ANGLES_TURN and channel["a"] == 0:
            term = terms[channel["first"]]
            Ri, Rj = turning.axes(markers, term)
            near[c], near[c + 1], near[c + 2] = turning.angles(
                term["a"], Ri, Rj, near[c], near[c + 1], near[c + 2]
            )
    return FINE


TURNING_CHANNELS = Kind("turning_channels", TurningChannels, {"angles": carry_angles})


@unit
def read_channels(run: Run, at: Point, energies: Vector, angles: Vector, out: Vector) -> int:
    """out (channels) of all sensors; after position, velocity and bias stages.

    `energies`: those of the output; `angles`: the continuous ones, at this position.
    """
    channels = run.system.sensors.channels
    for c in range(out.shape[0]):
        channel = channels[c]
        if channel["turns"] != 0:
            out[c] = angles[c]
        elif channel["what"] == SUM:
            out[c] = sum_of_terms(run, at, c)
        elif channel["what"] != EXPRESSION:
            out[c] = other_channel(run, at, c, energies)
    _read_expressions(run, at, out)
    return FINE


@kernel
def _read_expressions(run, at, out):
    """Channels that are computed of others, which are the variables of their programs."""
    channels, programs = run.system.sensors.channels, run.system.sensors.programs
    variables, stack = run.work.trial.variables, run.work.trial.stack
    if programs.start.shape[0] < 2:
        return
    for k in range(channels.shape[0]):
        x = out[k] if k < out.shape[0] else at.v[channels[k]["first"]]
        variables[k, 0], variables[k, 1], variables[k, 2] = x, 0.0, 0.0
    for c in range(out.shape[0]):
        if channels[c]["what"] == EXPRESSION:
            out[c] = run_program(programs, channels[c]["first"], at.t[0], variables, stack)


@unit
def sum_of_terms(run: Run, at: Point, c: int) -> float:
    """Sum of the terms of channel c."""
    channel, terms = run.system.sensors.channels[c], run.system.sensors.terms
    s = 0.0
    for k in range(channel["first"], channel["first"] + channel["n"]):
        term = terms[k]
        if term["kind"] >= ALONG:
            s += term["factor"] * _along(run, at, term)
        else:
            s += term["factor"] * _coordinate(run, at, term)
    return s


@kernel
def _along(run, at, term):
    """Component of a motion of marker J along the axis a of marker I, or the global one."""
    now = run.work.now
    mj, kind = now.marker[term["J"]], term["kind"]
    if kind == ALONG_X:
        x, y, z = mj["x"][0], mj["x"][1], mj["x"][2]
    elif kind == ALONG_V:
        x, y, z = mj["vx"][0], mj["vx"][1], mj["vx"][2]
    elif kind == ALONG_A:
        x, y, z = acceleration(run, at, term["J"], 0)
    else:
        x, y, z = _spin(run, at, term)
    if term["I"] < 0:
        return x if term["a"] == 0 else y if term["a"] == 1 else z
    R, a = now.marker[term["I"]]["R"], term["a"]
    return R[0, a] * x + R[1, a] * y + R[2, a] * z


@kernel
def _spin(run, at, term):
    """Angular velocity or acceleration of marker J; SEEN_OMD: what turning axes of I add."""
    mj = run.work.now.marker[term["J"]]
    if term["kind"] == ALONG_OM:
        return mj["om"][0], mj["om"][1], mj["om"][2]
    if term["kind"] == ALONG_OMD:
        return acceleration(run, at, term["J"], 3)
    if term["kind"] == SEEN_OMD:
        a, b = run.work.now.marker[term["I"]]["om"], mj["om"]
        return cross(a[0], a[1], a[2], b[0], b[1], b[2])
    return math.nan, math.nan, math.nan


@kernel
def acceleration(run, at, k, o):
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


@kernel
def _coordinate(run, at, term):
    """A primitive between two markers, or its first or second derivative in time."""
    i, j, kind, a, b = term["I"], term["J"], term["kind"], term["a"], term["b"]
    mi, mj = run.work.now.marker[i], run.work.now.marker[j]
    if term["level"] == 0:
        if kind == ANGLE:
            return joint_angle(mi["R"], mj["R"], b)
        return primitive.value(kind, a, b, mi, mj, 0.0)
    g = run.work.dense.g[0]
    primitive.put_gradient(run, kind, a, b, i, j)
    if term["level"] == 1:
        return primitive.rate(g, mi, mj)
    s = primitive.curvature_between(run, kind, a, b, i, j)
    for side in range(2):
        k, o = (i, 0) if side == 0 else (j, 6)
        for p in range(2):
            x, y, z = acceleration(run, at, k, 3 * p)
            q = o + 3 * p
            s += g[q] * x + g[q + 1] * y + g[q + 2] * z
    return s


@unit
def other_channel(run: Run, at: Point, c: int, energies: Vector) -> float:
    """A channel that is no sum of terms: a state, a place on a curve, an energy, a wrench."""
    channel = run.system.sensors.channels[c]
    what, first = channel["what"], channel["first"]
    if what == STATE:
        return at.v[first]
    if what == PLACE:
        return at.q[first] if channel["n"] == 0 else at.v[first]
    if what == ENERGY:
        if first == 4:
            return energies[0] + energies[1] + energies[2] + energies[3]
        if channel["n"] < 0:
            return energies[first]
        return body_energy(run, channel["n"], first, at)
    return _wrench_component(run, at, c)


@kernel
def _wrench_component(run, at, c):
    """One component of the force or moment that an element has on one of its two markers."""
    channel, d, stage = run.system.sensors.channels[c], run.work.dense, run.stages.wrenches
    kind, axes, a = channel["kind"], channel["axes"], channel["a"]
    call_channel(stage.units[kind], run, stage.tables[kind], at, c)
    w = d.g[1]
    o = 6 * (1 - channel["side"]) + 3 * channel["quantity"]
    if axes == -1:
        return w[o + a]
    own = d.pair[1] if channel["side"] == 0 else d.pair[0]
    R = run.work.now.marker[own if axes < 0 else axes]["R"]
    return R[0, a] * w[o] + R[1, a] * w[o + 1] + R[2, a] * w[o + 2]
