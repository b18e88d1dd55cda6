"""Tangents of functions over channels: rank-one blocks −(what acts) (∂f/∂m) (∂m/∂q, ∂m/∂v)ᵀ.

∂f/∂m of a channel m is the first derivative of the program with the rate of that channel alone set
to one. ∂m/∂q has two parts: the gradient with the motions of the markers, and, for velocities, what
their moment arms do at constant v. Exact for positions, velocities and states; of accelerations the
part with v̇ is kept, what the pose does to them and to reactions is left to Newton's iteration.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import call_channel, kernel, unit
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.algebra.rotation import cross
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies import tangent
from flexmb.engine.kernels.bodies.kinematics import add_pulled_back
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.kernels.joints import primitive, row_tangent
from flexmb.engine.kernels.sensors import turning
from flexmb.engine.method import FINE
from flexmb.engine.sensor_tables import (
    ALONG,
    ALONG_A,
    ALONG_OM,
    ALONG_OMD,
    ALONG_V,
    ALONG_X,
    TURNING,
    Feedback,
)
from flexmb.engine.state import Point, Run

_POSITION, _VELOCITY, _ACCELERATION = 0, 1, 2


@unit
def add_tangents(run: Run, feedback: Feedback, at: Point, cv: float, cp: float) -> int:
    """Add the tangents of all functions over channels to the matrix of a step."""
    if cv == 0.0:
        return FINE
    _put_slopes(run, feedback)
    tangents, partials, work = feedback.tangents, feedback.partials, run.work.feedback
    slopes, right, block = work.slopes, work.right, work.block
    for k in range(tangents.shape[0]):
        row = tangents[k]
        slope = slopes[row["partial"]]
        if slope == 0.0:
            continue
        _put_left(run, row, at)
        if row["state"] >= 0:
            right[0] = cv
            block[2], block[3] = row["state"], 1
        else:
            channel = partials[row["partial"]]["channel"]
            _put_right(run, at, row["term"], row["side"], channel, cv, cp)
        _add_outer(run, row["panel"], row["link"], -slope)
    return FINE


@kernel
def _put_slopes(run, feedback):
    """Slopes of the programs with each of their channels; none where there is no finite one."""
    x, stack, functions = run.work.trial.variables, run.work.trial.stack, run.system.functions
    partials, slopes, t = feedback.partials, run.work.feedback.slopes, run.work.feedback.t[0]
    for k in range(partials.shape[0]):
        p, c = partials[k]["program"], partials[k]["channel"]
        run_program(functions, p, t, x, stack)
        own = stack[0, 1]
        x[c, 1] = 1.0
        run_program(functions, p, t, x, stack)
        slope = stack[0, 1]
        x[c, 1] = 0.0
        slopes[k] = slope - own if math.isfinite(slope - own) else 0.0


@kernel
def _put_left(run, row, at):
    """Generalised force per unit of what acts, into feedback.left, and its place into block."""
    kind, work, stage = row["kind"], run.work.feedback, run.stages.unit_force
    if kind < 0:
        left, block = work.left, work.block
        left[0] = 1.0
        block[0], block[1] = row["iv"], 1
    else:
        part = 6 * row["row"] + 3 * row["on"] + row["a"]
        call_channel(stage.units[kind], run, stage.tables[kind], at, part)


@unit
def _put_right(run: Run, at: Point, t: int, side: int, channel: int, cv: float, cp: float) -> int:
    """cp ∂m/∂q + cv ∂m/∂v (+ ∂m/∂v̇) of term t on one side, into feedback.right and block."""
    parts, now, work, B = run.system.parts, run.work.now, run.work.feedback, run.work.dense.B
    term, v = run.system.sensors.terms[t], at.v
    right, block, position, velocity = work.right, work.block, work.g[0], work.g[1]
    level = _put_gradients(run, t, channel)
    k, o = term["I"] if side == 0 else term["J"], 6 * side
    body = parts.bodies[parts.markers[k]["body"]]
    n, iv, f = 6 + body["m"], body["iv"], term["factor"]
    block[2], block[3] = iv, n
    for c in range(n):
        right[c] = 0.0
    if level == _ACCELERATION:
        add_pulled_back(parts, now, k, velocity, o, f, right, 0)
        return FINE
    add_pulled_back(parts, now, k, position, o, cp * f, right, 0)
    if level == _VELOCITY:
        add_pulled_back(parts, now, k, velocity, o, cv * f, right, 0)
        clear(B, n, n)
        tangent.add_lever_tangent(parts, now, k, velocity, o, cp * f, B)
        for r in range(n):
            for c in range(n):
                right[c] += v[iv + r] * B[r, c]
    return FINE


@kernel
def _put_gradients(run, t, channel):
    """Gradients of term t with poses (g[0]) and velocities (g[1]) of its markers; its level."""
    g, kind = run.work.feedback.g, run.system.sensors.terms[t]["kind"]
    for c in range(12):
        g[0, c] = 0.0
        g[1, c] = 0.0
    if kind >= ALONG:
        return _put_motion_gradients(run, t)
    return _put_turning_gradient(run, t, channel) if kind == TURNING else _put_row_gradients(run, t)


@unit
def _put_row_gradients(run: Run, t: int) -> int:
    """Gradients of term t, the measure of a constraint row or a derivative of it; its level."""
    term, markers, g = run.system.sensors.terms[t], run.work.now.marker, run.work.feedback.g
    mi, mj, kind, a, b = markers[term["I"]], markers[term["J"]], term["kind"], term["a"], term["b"]
    level = term["level"]
    primitive.axis_gradient(kind, a, b, mi, mj, g[0] if level == _POSITION else g[1])
    if level == _VELOCITY:
        # the rate is g·u, and its change with the poses Hᵀ u
        H, u = run.work.dense.H, g[2]
        clear(H, 12, 12)
        row_tangent.add_axis_tangent(kind, a, b, mi, mj, 1.0, H)
        for c in range(3):
            u[c], u[3 + c], u[6 + c], u[9 + c] = mi["vx"][c], mi["om"][c], mj["vx"][c], mj["om"][c]
        for c in range(12):
            for r in range(12):
                g[0, c] += H[r, c] * u[r]
    return level


@unit
def _put_motion_gradients(run: Run, t: int) -> int:
    """Gradients of term t, d·u of a motion u of marker J along an axis d of marker I; its level."""
    term, markers, g = run.system.sensors.terms[t], run.work.now.marker, run.work.feedback.g
    kind, a, mj = term["kind"], term["a"], markers[term["J"]]
    u = mj["x"] if kind == ALONG_X else mj["vx"] if kind in (ALONG_V, ALONG_A) else mj["om"]
    dx, dy, dz = 1.0 * (a == 0), 1.0 * (a == 1), 1.0 * (a == 2)
    ux, uy, uz = u[0], u[1], u[2]
    if term["I"] >= 0:
        R, om = markers[term["I"]]["R"], markers[term["I"]]["om"]
        dx, dy, dz = R[0, a], R[1, a], R[2, a]
        if kind > ALONG_OMD:  # d·(ω_I × ω_J)
            x, y, z = cross(ux, uy, uz, dx, dy, dz)
            put(g[1], 3, x, y, z)
            x, y, z = cross(dx, dy, dz, om[0], om[1], om[2])
            put(g[1], 9, x, y, z)
            ux, uy, uz = cross(om[0], om[1], om[2], ux, uy, uz)
        x, y, z = cross(dx, dy, dz, ux, uy, uz)
        put(g[0], 3, x, y, z)
    if kind == ALONG_X:
        put(g[0], 6, dx, dy, dz)
        return _POSITION
    if kind <= ALONG_OMD:
        put(g[1], 9 if kind in (ALONG_OM, ALONG_OMD) else 6, dx, dy, dz)
    return _ACCELERATION if kind in (ALONG_A, ALONG_OMD) else _VELOCITY


@unit
def _put_turning_gradient(run: Run, t: int, channel: int) -> int:
    """Gradient of term t, one of the three turning angles, on the branch of its last value."""
    term, markers, near = run.system.sensors.terms[t], run.work.now.marker, run.work.feedback.near
    g, c, (Ri, Rj) = run.work.feedback.g[0], channel - term["b"], turning.axes(markers, term)
    first, _, _ = turning.angles(term["a"], Ri, Rj, near[c], near[c + 1], near[c + 2])
    x, y, z = turning.gradient(term["a"], term["b"], Ri, Rj, first)
    put(g, 3, -x, -y, -z)
    put(g, 9, x, y, z)
    return _POSITION


@kernel
def _add_outer(run, panel, link, f):
    """Add f left rightᵀ as the block of two sets of coordinates, or on the diagonal of one."""
    kkt, work, low, up = run.system.kkt, run.work.feedback, run.work.factor.low, run.work.factor.up
    column, left, right, block = kkt.column, work.left, work.right, work.block
    diagonal, early = link < 0, False
    at, stride = kkt.panels[panel]["at"], kkt.panels[panel]["nc"]
    if not diagonal:
        place = kkt.links[link]
        at, stride, early = place["at"], place["stride"], place["flipped"] == 1
    iv, n, jv, m = block[0], block[1], block[2], block[3]
    for r in range(n):
        pr = column[iv + r]
        for c in range(m):
            pc = column[jv + c]
            if pr < 0 or pc < 0:
                continue
            x = f * left[r] * right[c]
            if early or (diagonal and pr <= pc):
                up[at + pc * stride + pr] += x
            if not early and (not diagonal or pr >= pc):
                low[at + pr * stride + pc] += x
