"""The loop over the output times of a kinematic analysis, inside compiled code.

The motion is the one that joints and drivers fix. At each time, q follows from C(q, t) = 0 by
Newton's method, then v and v̇ from Cq v = −C_t and Cq v̇ = γ. All use one factor of
[[W, Cqᵀ], [Cq, 0]] with a diagonal metric W, so masses play no part and redundant rows do no harm.
The factor of one point starts Newton's method of the next. Reactions follow from Cqᵀ λ = Q − M v̇.

Prediction over an increment h: q ∘ exp(h v + h²/2 v̇ + h³/6 j), with j the last difference of v̇
over its increment. The increment is halved if Newton's method fails or if the new point does not
continue the motion (`engine.kinematics_point`). Source: Haug, Computer Aided Kinematics and
Dynamics of Mechanical Systems, 1989, ch. 4.
"""

from __future__ import annotations

from flexmb.engine.algebra.vector import copy, largest, weighted_max
from flexmb.engine.bodies.motion import move
from flexmb.engine.equations_of_motion import (
    begin_history,
    begin_run,
    complete_poses,
    constraint_stage,
    pose_stage,
    powers,
    put_energies,
    rate_stage,
    run_stage,
    update_history,
    velocity_stage,
)
from flexmb.engine.initial_conditions import correct_positions
from flexmb.engine.iteration_matrix import factorise_metric
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kinematics_point import (
    KinematicsSettings,
    Path,
    add_works,
    are_finite,
    check_branch,
    next_increment,
    predict,
    record_singular_pose,
    solve_positions,
    solve_reactions,
    solve_velocities_accelerations,
    store_point,
)
from flexmb.engine.method import NOT_FINITE, SUCCESS
from flexmb.engine.sensors.sensor import count_turns
from flexmb.engine.state import Run
from flexmb.engine.state_rows import end_row, write_motion

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
            speed = weighted_max(st.v, w)
            most = min(memory["next_increment"], settings.interval)
            h = next_increment(left, most, speed)
        last = h <= _LEAST_INCREMENT * settings.interval
        tr.t[0] = st.t[0] + h
        run_stage(run.stages.functions, run, at)
        predict(run, path, h)
        if memory["motion_since_factor"] >= 0.0:
            memory["motion_since_factor"] += weighted_max(tr.dq, w)
        move(run.system.parts, st.q, tr.dq, tr.q)
        status = _solve_point(run, path, settings)
        if status == SUCCESS and not first:
            status = check_branch(run, path, h, 1 if last else 0)
        if status == SUCCESS and not last:
            copy(st.angles, tr.angles)
            status = run_stage(run.stages.angle_path, run, at)
        if status == SUCCESS:
            if not first:
                record_singular_pose(run, path)
            store_point(run, path, h)
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
    return SUCCESS


@kernel
def _solve_point(run, path, settings):
    """Trial positions, velocities and accelerations from their predictions; returns the status."""
    if not are_finite(run.system.functions, run.work.con.fun):
        return NOT_FINITE
    status = solve_positions(run, path, settings)
    if status == SUCCESS:
        status = solve_velocities_accelerations(run, path, settings)
    return run_stage(run.stages.limits, run, run.trial_point) if status == SUCCESS else status


@unit
def write_point(run: Run, path: Path, settings: KinematicsSettings) -> int:
    """Write the present point, with reactions and energies; returns the status."""
    st, at = run.state, run.state_point
    if st.count[0]["outputs"] == 0:
        begin_history(run, at, st.history)
    status = solve_reactions(run)
    if status != SUCCESS:
        return status
    write_motion(run, at, st, largest(run.work.con.rate))
    powers(run, at)
    copy(run.work.powers, st.power)
    add_works(settings.interval, st.count[0]["outputs"], st.power, path.powers, st.work_done)
    put_energies(run, at, st.work_done, run.output.energy[run.output.rows[0]])
    update_history(run, at, st.history)
    return end_row(run, at, st)


@unit
def evaluate_state(run: Run, path: Path) -> int:
    """C, Cq, markers and rates at the state, and the factor of its pose."""
    at = run.state_point
    run_stage(run.stages.functions, run, at)
    pose_stage(run, at)
    constraint_stage(run, at)
    factorise_metric(run, at, path.metric)
    velocity_stage(run, at)
    rate_stage(run, at)
    count_turns(run, at, run.state.angles)
    return complete_poses(run, at)


@unit
def kinematics_loop(run: Run, path: Path, settings: KinematicsSettings, what: int, n: int) -> float:
    """See `compiled_calls.analyse_kinematics`."""
    begin_run(run, run.state_point)
    if what == POINTS:
        st, out = run.state, run.output
        out.rows[0] = 0
        status = SUCCESS
        while status == SUCCESS and out.rows[0] < n and st.count[0]["outputs"] <= settings.outputs:
            status = reach_output(run, path, settings)
            if status == SUCCESS:
                status = write_point(run, path, settings)
        return float(status)
    evaluate_state(run, path)
    return correct_positions(run) if what == CORRECT else 0.0
