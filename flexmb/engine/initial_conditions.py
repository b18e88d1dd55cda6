"""Single solves at one state, for analyses that prepare a run.

Consistent positions, velocities, accelerations with multipliers; residual; constraint rows in one
pose; start of the deformation of kinetostatic bodies.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.ldl import solve_refined
from flexmb.engine.algebra.vector import copy, store, weighted_max
from flexmb.engine.bodies.motion import move
from flexmb.engine.equations_of_motion import (
    begin_history,
    begin_run,
    bias_stage,
    complete_poses,
    constraint_stage,
    energies,
    feedback_stage,
    pose_stage,
    position_stage,
    powers,
    reaction_stage,
    residual,
    run_stage,
    velocity_stage,
)
from flexmb.engine.iteration_matrix import factorise
from flexmb.engine.jit import Vector, call_step, call_value, kernel, unit
from flexmb.engine.joints.constraint import constraint_jacobian
from flexmb.engine.method import SUCCESS
from flexmb.engine.projection import NOTHING, accelerations, project_velocity
from flexmb.engine.projection import POSITIONS as ON_CONSTRAINTS
from flexmb.engine.sensors.sensor import count_turns, read_channels
from flexmb.engine.state import Run

POSITIONS, VELOCITIES, ACCELERATIONS, RESIDUAL, BEGIN, REMEMBER = 0, 1, 2, 3, 4, 5

# Largest correction of positions in one round, over the size of the model or in radians; a larger
# one is scaled down, since the linearisation does not hold for it.
_MAX_CORRECTION = 0.3


@unit
def solve_stage(run: Run, level: int) -> float:
    """Solve one level of the state in place, metric M; see `compiled_calls.solve_stage`."""
    near, channels = run.work.feedback.near, run.system.sensors.channels
    for c in range(near.shape[0]):
        near[c] = math.nan if run.sensors.turns[channels[c]["what"]] == 1 else 0.0
    copy(run.state.history, run.work.now.history)
    begin_run(run, run.state_point)
    result = _solve(run, run.state_point, level)
    complete_poses(run, run.state_point)
    return result


@kernel
def _solve(run, at, level):
    st, near = run.state, run.work.feedback.near
    if level == ACCELERATIONS:
        return float(accelerations(run, at, 0.0, NOTHING))
    if level == RESIDUAL:
        return float(residual(run, at))
    position_stage(run, at)
    velocity_stage(run, at)
    if level == REMEMBER:
        begin_history(run, at, st.history)
        return 0.0
    if level == BEGIN:
        feedback_stage(run, at)
        reaction_stage(run, at)
        powers(run, at)
        copy(run.work.powers, st.power)
        for c in range(st.angles.shape[0]):
            st.angles[c] = near[c]
        count_turns(run, at, st.angles)
        return 0.0
    run.work.factor.symmetric[0] = 1
    factorise(run, at, 0.0, 0.0)
    if level == VELOCITIES:
        project_velocity(run, at, 0.0)
        return 0.0
    constraint_stage(run, at)
    return correct_positions(run)


@unit
def correct_positions(run: Run) -> float:
    """One Gauss–Newton correction of q towards C = 0 with the present factor; its weighted size."""
    dq, fac, kkt, weights = run.work.trial.dq, run.work.factor, run.system.kkt, run.system.weights
    C, place, q, nv = run.work.con.C, kkt.place, run.state.q, run.work.trial.dq.shape[0]
    for i in range(nv):
        fac.rhs[place[i]] = 0.0
    for i in range(C.shape[0]):
        fac.rhs[place[nv + i]] = -C[i]
    solve_refined(kkt, fac, 2)
    for i in range(nv):
        dq[i] = fac.sol[place[i]]
    size = weighted_max(dq, weights)
    if size > _MAX_CORRECTION:
        for i in range(nv):
            dq[i] *= _MAX_CORRECTION / size
    move(run.system.parts, q, dq, q)
    return size  # type: ignore[no-any-return]


# Points ahead of the state that define a cubic with it; rounds, since loads depend on the rates
# that follow from these points.
_AHEAD, _ROUNDS = 3, 2


@unit
def begin_deformation(run: Run, h: float, longest: float, cp: float) -> int:
    """Put kinetostatic modes into equilibrium with their loads, with smooth rates.

    At the start of a run and after a jump there is no past from which rates follow. So they are
    those of the cubic through the state and the ends of three trial steps from it, of h/3, 2h/3 and
    h. h is increased so that the points are no closer than round-off allows, and is at most
    `longest` [s]. cp is that of `accelerations`.
    """
    st, tr, at, limits = run.state, run.work.trial, run.trial_point, run.state.memory[0]
    slow, rate = limits["steps_at_stability_limit"], limits["fastest_rate"]
    run_stage(run.stages.static_begin, run, at)
    for n in range(_ROUNDS + 1):
        copy(st.history, run.work.now.history)
        tr.t[0] = st.t[0]
        copy(st.q, tr.q)
        copy(st.v, tr.v)
        copy(st.vd, tr.vd)
        copy(st.lam, tr.lam)
        status = accelerations(run, at, cp, ON_CONSTRAINTS)
        if n == _ROUNDS or status != SUCCESS:
            break
        h = min(max(h, _AHEAD * _look_ahead(run)), longest)
        for k in range(_AHEAD):
            ahead = h * (k + 1.0) / _AHEAD
            if status == SUCCESS:
                status = call_step(run.method.step[0], run, run.method.coefficients[0], ahead)
            if status == SUCCESS:
                _look_ahead(run)
        if status != SUCCESS:
            run_stage(run.stages.static_begin, run, at)
    limits["steps_at_stability_limit"], limits["fastest_rate"] = slow, rate
    copy(st.history, run.work.now.history)
    limits["factor_age"] = run.work.collocation.age[0] = run.work.partition.age[0] = -1.0
    run.work.collocation.span[1] = 0.0
    if status != SUCCESS:
        return status
    store(tr.q, st.q)
    for now, after in ((st.v, tr.v), (st.vd, tr.vd), (st.vd_before, tr.vd), (st.aa, tr.vd)):
        store(after, now)
    store(tr.lam, st.lam)
    store(tr.lam, st.lam_before)
    powers(run, run.state_point)
    copy(run.work.powers, st.power)
    st.power_before[:] = math.nan  # powers jump with the rates
    return SUCCESS


@kernel
def _look_ahead(run):
    """Record the trial state as a point ahead; returns the least interval of such points [s]."""
    units, tables, least = run.stages.static_ahead.units, run.stages.static_ahead.tables, 0.0
    for k in range(len(units)):
        least = max(least, call_value(units[k], run, tables[k], run.trial_point))
    return least


@unit
def evaluate_equations(run: Run, channels: Vector) -> int:
    """Evaluate Trial.res, Constraints.C and all channels at the state with its v̇, λ; the status."""
    at, st = run.state_point, run.state
    begin_run(run, at)
    status = residual(run, at)
    velocity_stage(run, at)
    bias_stage(run, at)
    complete_poses(run, at)
    energies(run, at)
    count_turns(run, at, st.angles)
    read_channels(run, at, st.angles, channels)
    return status


ROW_STAGES = ("constants", "functions", "position", "axes", "constraint")
"""The stages that `evaluate_rows` runs."""


@unit
def evaluate_rows(run: Run) -> int:
    """All markers, C, and the rows of Cq on bodies (Dense.jac) at the time and positions given."""
    at = run.state_point
    begin_run(run, at)
    run_stage(run.stages.functions, run, at)
    pose_stage(run, at)
    complete_poses(run, at)
    constraint_stage(run, at)
    return constraint_jacobian(run)
