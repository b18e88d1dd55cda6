"""Known jumps of functions of time as events: a step ends just before each, the next begins after.

The formulas of the methods take forces and motions for smooth within a step. Where a function of
time or its derivative jumps (the end of a step function, a corner of a table) the state is computed
again on the far side, as at the start of a run: velocities back on their constraints (where the
speed of a driver jumps, by the impulse of the joints), accelerations and multipliers from the
equations of motion, a short step. All of it follows from `State` alone, so that a resumed run
repeats it.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import copy, store
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.projection import VELOCITIES, accelerations
from flexmb.engine.kernels.stages import (
    energies,
    feedback_stage,
    powers,
    reaction_stage,
    velocity_stage,
)
from flexmb.engine.method import (
    FINE,
)
from flexmb.engine.state import Run

# The first step after an event, over the last one that was free: estimates begin again.
_RESTART = 0.1


@kernel
def next_end(time_events, t, end):
    """Where a step that begins at t must end at the latest [s]."""
    k = _passed(time_events, t)
    if k < time_events.shape[0]:
        return min(time_events[k, 0], end)
    return end


@kernel
def _passed(time_events, t):
    """How many events have their near side at t or before."""
    low, high = 0, time_events.shape[0]
    while low < high:
        middle = (low + high) // 2
        if time_events[middle, 0] <= t:
            low = middle + 1
        else:
            high = middle
    return low


@unit
def cross_time_event(run: Run, cp: float) -> int:
    """Take a state just before an event to its far side; returns the status.

    cp is the factor of the tangent beside M, as for reported accelerations. A jump within the
    tolerance of the next step changes nothing but the time.
    """
    st, settings, time_events = run.state, run.settings, run.system.time_events
    k = _passed(time_events, st.t[0]) - 1
    if k < 0 or time_events[k, 0] != st.t[0]:
        return FINE
    st.t[0] = time_events[k, 1]
    status = _accelerate(run, cp)
    allowed = settings.tolerance * st.memory[0]["max_displacement"]
    if status == FINE and _jump(run.system.weights, st, run.work.trial) > allowed:
        _restart(run)
    return status


@kernel
def _accelerate(run, cp):
    """Velocities, accelerations and multipliers of the far side in the trial state."""
    st, tr = run.state, run.work.trial
    st.count[0]["factorisations"] += 1
    st.memory[0]["factor_age"] = -1.0
    tr.t[0] = st.t[0]
    copy(st.q, tr.q)
    copy(st.v, tr.v)
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    copy(st.history, run.work.now.history)
    return accelerations(run, run.trial_point, cp, VELOCITIES)


@kernel
def _jump(weights, st, tr):
    """What the jumps of velocities and accelerations do to positions within the next step."""
    h = st.memory[0]["next_step"]
    jump = 0.0
    for i in range(weights.shape[0]):
        moved = h * abs(tr.v[i] - st.v[i]) + 0.5 * h * h * abs(tr.vd[i] - st.vd[i])
        jump = max(jump, weights[i] * moved)
    return jump


@kernel
def _restart(run):
    """The trial state becomes the state; powers again, memory of steps forgotten."""
    st, tr, total, at = run.state, run.work.trial, run.work.energies, run.state_point
    energies(run, at)
    before = total[0]
    store(tr.v, st.v)
    store(tr.vd, st.vd)
    store(tr.lam, st.lam)
    copy(st.vd, st.vd_before)
    copy(st.vd, st.aa)
    copy(st.lam, st.lam_before)
    for i in range(st.jerk.shape[0]):
        st.jerk[i] = 0.0
        st.jerk_before[i] = 0.0
    velocity_stage(run, at)
    rows = run.system.rows
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:  # only drivers do work by impulses
            energies(run, at)
            st.work_done[0] += total[0] - before
            break
    feedback_stage(run, at)
    reaction_stage(run, at)
    powers(run, at)
    copy(run.work.powers, st.power)
    for k in range(3):
        st.power_before[0, k] = st.power_before[1, k] = math.nan
    st.memory[0]["steps_at_this_size"] = 0.0
    st.memory[0]["velocity_error"] = 0.0
    st.memory[0]["steps_until_growth"] = 0.0
    st.memory[0]["next_step"] *= _RESTART
