"""Kinematic analysis: the motion that joints and drivers fix, point by point, in compiled code.

At every time q from C(q, t) = 0 by Newton's method, then v and v̇ from Cq v = −C_t and Cq v̇ = γ,
all with one factor of [[W, Cqᵀ], [Cq, 0]], W a diagonal metric: masses play no part, and rows that
repeat others do no harm. The factor of one point begins the next; reactions follow from
Cqᵀ λ = Q − M v̇. Prediction: q ∘ exp(h v + h²/2 v̇ + h³/6 j), j the last difference of v̇. An
increment is halved where Newton's method fails or the new point does not continue the motion
(`engine.kinematics_point`); Haug, Computer Aided Kinematics and Dynamics, 1989, ch. 4.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.algebra.vector import copy, largest, weighted_size
from flexmb.engine.bodies.motion import move
from flexmb.engine.equations_of_motion import (
    begin_history,
    begin_run,
    complete_poses,
    constraint_stage,
    factorise_metric,
    pose_stage,
    powers,
    put_energies,
    rate_stage,
    remember,
    velocity_stage,
    walk,
)
from flexmb.engine.initial_conditions import correct_positions
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.constraint import read_reactions
from flexmb.engine.kinematics_point import (
    KinematicsSettings,
    Path,
    add_works,
    are_finite,
    check_branch,
    next_increment,
    note_singular_pose,
    predict,
    remember_point,
    solve_positions,
    solve_reactions,
    solve_velocities_accelerations,
)
from flexmb.engine.method import FINE, NOT_FINITE
from flexmb.engine.sensors.sensor import count_turns, read_channels
from flexmb.engine.state import Run

# What the loop is asked for.
POINTS, CORRECT, EVALUATE = 0, 1, 2
# An increment is at least this share of the interval between outputs.
_LEAST_INCREMENT = 2.0**-22


@unit
def reach_output(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Go to the next output time in one increment, or in several; returns the status."""
    st, tr, at, w = run.state, run.work.trial, run.trial_point, run.system.weights
    memory, count = path.memory[0], st.count[0]
    target = settings.start + count["outputs"] * settings.interval
    first = count["outputs"] == 0
    while first or st.t[0] < target:
        left = target - st.t[0]
        h = left
        if not first:
            speed = weighted_size(st.v, w)
            most = min(memory["next_increment"], settings.interval)
            h = next_increment(left, most, speed)
        last = h <= _LEAST_INCREMENT * settings.interval
        tr.t[0] = st.t[0] + h
        walk(run.stages.functions, run, at)
        predict(run, path, h)
        if memory["motion_since_factor"] >= 0.0:
            memory["motion_since_factor"] += weighted_size(tr.dq, w)
        move(run.system.parts, st.q, tr.dq, tr.q)
        status = _solve_point(run, path, settings)
        if status == FINE and not first:
            status = check_branch(run, path, h, 1 if last else 0)
        if status == FINE:
            if not first:
                note_singular_pose(run, path)
            remember_point(run, path, h)
            st.t[0] = target if h == left else tr.t[0]
            copy(tr.q, st.q)
            copy(tr.v, st.v)
            copy(tr.vd, st.vd)
            count_turns(run, run.state_point, st.angles)
            count["steps"] += 1
            memory["next_increment"] = max(2.0 * h, memory["next_increment"])
            first = False
            continue
        if last:
            return status
        memory["motion_since_factor"] = -1.0
        memory["next_increment"] = 0.5 * h
        count["failed"] += 1
    return FINE


@kernel
def _solve_point(run, path, settings):
    """Trial positions, velocities and accelerations from their predictions; returns the status."""
    if not are_finite(run.system.functions, run.work.con.fun):
        return NOT_FINITE
    status = solve_positions(run, path, settings)
    if status == FINE:
        status = solve_velocities_accelerations(run, path, settings)
    return walk(run.stages.limits, run, run.trial_point) if status == FINE else status


@unit
def write_point(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Write the present point, with reactions and energies; returns the status."""
    st, out, con, at = run.state, run.output, run.work.con, run.state_point
    row = out.rows[0]
    if st.count[0]["outputs"] == 0:
        begin_history(run, at, st.history)
    status = solve_reactions(run)
    if status != FINE:
        return status
    read_reactions(run, at, out.reactions[row])
    out.t[row] = st.t[0]
    copy(st.q, out.q[row])
    copy(st.v, out.v[row])
    copy(st.vd, out.vd[row])
    copy(st.lam, out.lam[row])
    out.drift[row, 0] = largest(con.C)
    out.drift[row, 1] = largest(con.rate)
    powers(run, at)
    copy(run.work.powers, st.power)
    add_works(settings.interval, st.count[0]["outputs"], st.power, path.powers, st.work_done)
    put_energies(run, at, st.work_done, out.energy[row])
    remember(run, at, st.history)
    read_channels(run, at, st.angles, out.sensors[row])
    if not (np.isfinite(out.energy[row, 0]) and np.isfinite(largest(st.lam))):
        return NOT_FINITE
    out.rows[0] += 1
    st.count[0]["outputs"] += 1
    return FINE


@unit
def evaluate_state(run: Run, path: Path) -> int:
    """C, Cq, markers and rates at the state, and the factor of its pose."""
    at = run.state_point
    walk(run.stages.functions, run, at)
    pose_stage(run, at)
    constraint_stage(run, at)
    factorise_metric(run, at, path.metric)
    velocity_stage(run, at)
    rate_stage(run, at)
    count_turns(run, at, run.state.angles)
    return complete_poses(run, at)


@unit
def kinematics_loop(run: Run, path: Path, settings: KinematicsSettings, what: int, n: int) -> float:
    """See `entries.analyse_kinematics`."""
    begin_run(run, run.state_point)
    if what == POINTS:
        st, out = run.state, run.output
        out.rows[0] = 0
        status = FINE
        while status == FINE and out.rows[0] < n and st.count[0]["outputs"] <= settings.outputs:
            status = reach_output(run, path, settings)
            if status == FINE:
                status = write_point(run, path, settings)
        return float(status)
    evaluate_state(run, path)
    return correct_positions(run) if what == CORRECT else 0.0
