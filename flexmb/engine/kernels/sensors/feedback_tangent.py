"""Tangents of functions over channels: rank-one blocks −(what acts) (∂f/∂m) (∂m/∂q, ∂m/∂v)ᵀ.

∂f/∂m of a channel m is the first derivative of the program with the rate of that channel alone set
to one. ∂m/∂q has two parts: the gradient with the motions of the markers, and, for velocities, what
their moment arms do at constant v. Exact for positions, velocities and states; of accelerations the
part with v̇ is kept, what the pose does to them and to reactions is left to Newton's iteration.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.bodies import wrench
from flexmb.engine.bodies.wrench import add_pulled_back
from flexmb.engine.jit import call_channel, kernel, unit
from flexmb.engine.kernels.functions.function import run_program
from flexmb.engine.method import FINE
from flexmb.engine.sensor_tables import Feedback
from flexmb.engine.state import Point, Run

_VELOCITY, _ACCELERATION = 1, 2  # levels of measures


@unit
def add_tangents(run: Run, feedback: Feedback, at: Point, cv: float, cp: float) -> int:
    """Add the tangents of all functions over channels to the matrix of a step."""
    if cv == 0.0:
        return FINE
    _put_slopes(run, feedback)
    tangents, work = feedback.tangents, run.work.feedback
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
            _put_right(run, at, row["term"], row["side"], cv, cp)
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
def _put_right(run: Run, at: Point, t: int, side: int, cv: float, cp: float) -> int:
    """cp ∂m/∂q + cv ∂m/∂v (+ ∂m/∂v̇) of term t on one side, into feedback.right and block."""
    parts, now, work, B = run.system.parts, run.work.now, run.work.feedback, run.work.dense.B
    sensors, right, block, position, velocity = (
        run.system.sensors, work.right, work.block, work.g[0], work.g[1]
    )  # fmt: skip
    term, v = sensors.terms[t], at.v
    clear(work.g, 2, 12)
    call_channel(run.sensors.gradient[term["measure"]], run, sensors, at, t)
    level = run.sensors.level[term["measure"]]
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
        wrench.add_moment_arm(parts, now, k, velocity, o, cp * f, B)
        for r in range(n):
            for c in range(n):
                right[c] += v[iv + r] * B[r, c]
    return FINE


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
