"""Known kinks of functions of time as events: a step ends just before each, the next begins after.

The formulas of the methods take forces and motions for smooth within a step. At a kink (the end of
a step function, a corner of a table) the state is therefore made anew on the far side, as at the
start of a run: velocities back on their constraints (where the speed of a driver jumps, by the
impulse of the joints), accelerations and multipliers from the equations of motion, a short step.
All of it follows from `State` alone, so that a resumed run repeats it.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels import energy
from flexmb.engine.kernels.algebra.vector import copy, store
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.forces import joint_friction
from flexmb.engine.kernels.projection import accelerations
from flexmb.engine.kernels.sensors import signal
from flexmb.engine.method import (
    AGE,
    CALM,
    FACTORISATIONS,
    JERK_ERROR,
    MOTION,
    SHARE,
    SINCE,
    STEP,
)

# The first step after a kink, over the last one that was free: estimates begin anew.
_RESTART = 0.1
_PROJECT_VELOCITIES = 1


@kernel
def next_end(kinks, t, end):
    """Where a step that begins at t must end at the latest [s]."""
    if kinks is not None:
        k = _reached(kinks, t)
        if k < kinks.shape[0]:
            return min(kinks[k, 0], end)
    return end


@kernel
def _reached(kinks, t):
    """How many kinks have their near side at t or before."""
    low, high = 0, kinks.shape[0]
    while low < high:
        middle = (low + high) // 2
        if kinks[middle, 0] <= t:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def cross(sys, kinks, settings, st, wk, cp):
    """Take a state just before a kink to its far side; returns what `accelerations` does, or 0.

    cp is the factor of the tangent beside M, as for reported accelerations. A kink whose jump is
    within the tolerance of the next step changes nothing but the time.
    """
    if kinks is not None:
        k = _reached(kinks, st.t[0]) - 1
        if k >= 0 and kinks[k, 0] == st.t[0]:
            st.t[0] = kinks[k, 1]
            code = _accelerate(sys, st, wk, cp)
            allowed = settings.tolerance * st.memory[SHARE] * st.memory[MOTION]
            if code >= 0 and _jump(sys.weights, st, wk.trial) > allowed:
                _begin_anew(sys, st, wk)
            return code
    return 0


@kernel
def _accelerate(sys, st, wk, cp):
    """Velocities, accelerations and multipliers of the far side in the trial state."""
    tr = wk.trial
    st.count[FACTORISATIONS] += 1
    st.memory[AGE] = -1.0
    copy(st.v, tr.v)
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    copy(st.kept, wk.now.kept)
    return accelerations(sys, wk, st.t[0], st.q, tr.v, tr.vd, tr.lam, cp, _PROJECT_VELOCITIES)


@kernel
def _jump(weights, st, tr):
    """What the jumps of velocities and accelerations do to positions within the next step."""
    h = st.memory[STEP]
    jump = 0.0
    for i in range(weights.shape[0]):
        moved = h * abs(tr.v[i] - st.v[i]) + 0.5 * h * h * abs(tr.vd[i] - st.vd[i])
        jump = max(jump, weights[i] * moved)
    return jump


@kernel
def _begin_anew(sys, st, wk):
    """The trial state becomes the state; powers anew, memory of steps forgotten."""
    tr, now = wk.trial, wk.now
    before = energy.kinetic(sys.parts, now, st.v, wk.dense.B)
    store(tr.v, st.v)
    store(tr.vd, st.vd)
    store(tr.lam, st.lam)
    copy(st.vd, st.vd_before)
    copy(st.vd, st.aa)
    copy(st.lam, st.lam_before)
    for i in range(st.jerk.shape[0]):
        st.jerk[i] = 0.0
        st.jerk_before[i] = 0.0
    for k in range(sys.rows.shape[0]):
        if sys.rows[k]["fun"] >= 0:  # only drivers do work by impulses
            st.work_done[0] += energy.kinetic(sys.parts, now, st.v, wk.dense.B) - before
            break
    kinematics.velocity(sys.parts, now, st.v)
    signal.stage(sys.signals, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
    joint_friction.put_grips(sys, sys.frictions, wk, st.lam)
    energy.powers(sys, now, wk.con.fun, st.v, st.lam, st.power)
    st.power[1] += joint_friction.power(sys.frictions, sys.parts.coordinates, now, st.q, st.v)
    st.memory[SINCE] = 0.0
    st.memory[JERK_ERROR] = 0.0
    st.memory[CALM] = 0.0
    st.memory[STEP] *= _RESTART
