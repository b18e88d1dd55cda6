"""Output rows of states that are not integrated: equilibria, and states of a prescribed motion."""

from __future__ import annotations

import numpy as np

from flexmb.engine.algebra.vector import copy, largest
from flexmb.engine.equations_of_motion import (
    begin_history,
    begin_run,
    bias_stage,
    complete_poses,
    constraint_stage,
    position_stage,
    powers,
    put_energies,
    residual,
    update_history,
    velocity_stage,
)
from flexmb.engine.iteration_matrix import factorise_metric, least_pivot
from flexmb.engine.jit import Vector, kernel, unit
from flexmb.engine.joints.constraint import read_reactions
from flexmb.engine.kinematics_point import solve_reactions
from flexmb.engine.method import NOT_FINITE, SUCCESS
from flexmb.engine.sensors.sensor import count_turns, read_channels
from flexmb.engine.state import Run


@kernel
def write_motion(run, at, state, velocity_drift):
    """Write time, coordinates, multipliers, reactions and drift of a state into the next row."""
    out = run.output
    row = out.rows[0]
    read_reactions(run, at, out.reactions[row])
    out.t[row] = state.t[0]
    copy(state.q, out.q[row])
    copy(state.v, out.v[row])
    copy(state.vd, out.vd[row])
    copy(state.lam, out.lam[row])
    out.drift[row, 0] = largest(run.work.con.C)
    out.drift[row, 1] = velocity_drift


@kernel
def end_row(run, at, state):
    """Write the channels of a state; if the row is finite, count it. Returns the status."""
    out = run.output
    row = out.rows[0]
    read_channels(run, at, state.angles, out.sensors[row])
    if not (np.isfinite(out.energy[row, 0]) and np.isfinite(largest(state.lam))):
        return NOT_FINITE
    out.rows[0] += 1
    run.state.count[0]["outputs"] += 1
    return SUCCESS


@unit
def write_equilibrium(run: Run) -> int:
    """Write the state at rest with its own multipliers; returns the status."""
    st, at = run.state, run.state_point
    copy(st.history, run.work.now.history)
    begin_run(run, at)
    status = residual(run, at)
    if status != SUCCESS:
        return status
    velocity_stage(run, at)
    bias_stage(run, at)
    complete_poses(run, at)
    if st.count[0]["outputs"] == 0:
        count_turns(run, at, st.angles)
    count_turns(run, at, st.angles)
    write_motion(run, at, st, 0.0)
    put_energies(run, at, st.work_done, run.output.energy[run.output.rows[0]])
    return end_row(run, at, st)


@unit
def store_row_history(run: Run, is_first: int) -> int:
    """Update the internal variables of all elements to the state that was evaluated last.

    `is_first`: they begin there.
    """
    if is_first:
        begin_history(run, run.state_point, run.state.history)
    else:
        update_history(run, run.state_point, run.state.history)
    return SUCCESS


@unit
def write_reactions(run: Run, metric: Vector, quality: Vector) -> int:
    """Write the state with the multipliers that its motion requires; returns the status.

    `quality` (3): largest generalised force over its weight that joints and drivers cannot provide;
    largest generalised force over its weight; least pivot of a row over its own compliance.
    """
    st, at, tr, fac = run.state, run.state_point, run.work.trial, run.work.factor
    weights, place, nv = run.system.weights, run.system.kkt.place, run.state.v.shape[0]
    begin_run(run, at)
    position_stage(run, at)
    velocity_stage(run, at)
    if st.count[0]["outputs"] == 0:
        begin_history(run, at, st.history)
    factorise_metric(run, at, metric)
    status = solve_reactions(run)
    if status != SUCCESS:
        return status
    quality[0], quality[1], quality[2] = 0.0, 0.0, least_pivot(run, nv)
    for i in range(nv):
        if weights[i] > 0.0 and place[i] < fac.sol.shape[0] - 1:
            quality[0] = max(quality[0], abs(metric[i] * fac.sol[place[i]]) / weights[i])
            quality[1] = max(quality[1], abs(tr.res[i]) / weights[i])
    bias_stage(run, at)
    complete_poses(run, at)
    constraint_stage(run, at)
    count_turns(run, at, st.angles)
    write_motion(run, at, st, 0.0)
    powers(run, at)
    put_energies(run, at, st.work_done, run.output.energy[run.output.rows[0]])
    update_history(run, at, st.history)
    return end_row(run, at, st)
