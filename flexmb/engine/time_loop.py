"""The loop over the steps of a dynamic run, inside compiled code.

A chunk starts by forgetting the factor and ends with the complete state in `State`, so that a run
resumed at a chunk's border repeats the uninterrupted one bit for bit. Between chunks Python shows
progress, writes to the file and honours an interruption. Outputs inside an accepted step are
interpolated and put back on the constraints, with a factor of their own (`work.output_run`).
"""

from __future__ import annotations

import math

from flexmb.engine import step_control
from flexmb.engine.algebra.vector import copy, store, weighted_max
from flexmb.engine.bodies.motion import rotates_too_far
from flexmb.engine.equations_of_motion import (
    begin_run,
    constraint_stage,
    feedback_stage,
    pose_stage,
    powers,
    put_energies,
    reaction_stage,
    run_stage,
    update_energy_range,
    update_history,
    velocity_stage,
    work_of_step,
)
from flexmb.engine.error_scales import update_error_scales
from flexmb.engine.events import accept_events, begin_events, cross_time_event, has_inner_event
from flexmb.engine.initial_conditions import begin_deformation
from flexmb.engine.iteration_matrix import remove_self_stress
from flexmb.engine.jit import call_step, kernel, unit
from flexmb.engine.method import NO_CONVERGENCE, STEP_TOO_SMALL, SUCCESS, time_round_off
from flexmb.engine.projection import (
    POSITIONS,
    VELOCITIES,
    accelerations,
    add_stiff_accelerations,
    put_vd_round_off,
)
from flexmb.engine.sensors.sensor import count_turns, follow_angles
from flexmb.engine.state import Run
from flexmb.engine.state_rows import end_row, write_motion

# With fixed steps, the error that Newton's method leaves with an old factor is systematic. So an
# output renews a factor that has served this many steps.
_MAX_FACTOR_AGE = 5.0

# Energies are evaluated at outputs, and in between after every this many steps.
_ENERGY_INTERVAL = 5.0


@unit
def accept_step(run: Run, h: float) -> int:
    """Add the works of the step and make the trial state the state."""
    st, tr, settings, at = run.state, run.work.trial, run.settings, run.trial_point
    before, controlled = tr.before, settings.step == 0.0
    before.t[0] = st.t[0]
    angles = len(run.stages.angles.units) > 0
    if controlled or angles or step_control.is_output_due(settings, run.times, st, tr.t[0], 0):
        copy(st.q, before.q)
        copy(st.v, before.v)
        copy(st.work_done, before.work_done)
        copy(st.power, before.power)
        copy(st.history, before.history)
    st.memory[0]["steps_since_output"] += 1.0
    looks = st.memory[0]["steps_since_output"] % _ENERGY_INTERVAL == 0.0
    if settings.does_work == 1 or angles or looks:
        pose_stage(run, at)
        velocity_stage(run, at)
    if settings.does_work == 1:
        feedback_stage(run, at)
        reaction_stage(run, at)
        powers(run, at)
        for k in range(3):
            # kinetostatic modes change after the step, so that works of collocation stages are off
            if (
                run.method.stages > 0
                or run.method.collocation > 0
                and settings.static_after_step == 0
            ):
                st.work_done[k] = tr.work[k]
            else:
                st.work_done[k] += work_of_step(run.method, st, k, run.work.powers[k], h)
            st.power_before[1, k] = st.power_before[0, k]
            st.power_before[0, k] = st.power[k]
            st.power[k] = run.work.powers[k]
    if looks:
        update_energy_range(run, at)
    update_history(run, at, st.history)
    if angles:
        copy(st.angles, tr.angles)
        count_turns(run, at, st.angles)
    st.t[0] = tr.t[0]
    store(tr.q, st.q)
    store(tr.v, st.v)
    copy(st.vd, st.vd_before)
    store(tr.vd, st.vd)
    store(tr.aa, st.aa)
    if controlled:
        copy(st.jerk, st.jerk_before)
        copy(tr.jerk, st.jerk)
    copy(st.lam, st.lam_before)
    store(tr.lam, st.lam)
    st.count[0]["steps"] += 1
    if controlled:
        update_error_scales(run)
        st.memory[0]["travel"] += h * weighted_max(st.v, run.system.weights)
        step_control.write_plan(settings, run.plan, st)
    return SUCCESS


@unit
def advance(run: Run, room: int) -> int:
    """Try steps until one is accepted; returns SUCCESS, or the status of the last one tried."""
    st, settings, time_events = run.state, run.settings, run.system.time_events
    error, units, coefficients = run.work.trial.error, run.method.step, run.method.coefficients
    if settings.step == 0.0 and time_events.shape[0] > 0:
        before = st.t[0]
        status = cross_time_event(run, _tangent_factor(run))
        if status != SUCCESS:
            return status
        if st.t[0] > before:
            st.memory[0]["driven_rate"] = step_control.rate_of_driven(run.system, st, st.vd)
            if settings.static_after_step == 1:
                _begin_deformation(run)
    while True:
        h = step_control.propose_step(
            run.method, settings, run.plan, time_events, st, run.times, room, run.system
        )
        status = call_step(units[0], run, coefficients[0], h)
        if status == SUCCESS:
            status = run_stage(run.stages.limits, run, run.trial_point)
        if status == SUCCESS and _changes_too_much(run, h):
            status = NO_CONVERGENCE
        verdict = step_control.judge_step(run.method, settings, st, error, status, h)
        if verdict == SUCCESS:
            if has_inner_event(run, h) == 1:
                continue
            run.work.trial.t[0] = step_control.exact_time(settings, run.plan, time_events, st, h)
            accept_step(run, h)
            step_control.record_step(run.method, settings, st, error, h)
            step_control.watch_alternation(settings, run.times, st, run.work.alternation, h)
            accept_events(run, h)
            return SUCCESS
        if verdict == STEP_TOO_SMALL:
            return status if status != SUCCESS else STEP_TOO_SMALL


@kernel
def _changes_too_much(run, h):
    """Whether a controlled step turned or moved too far; a fixed one may contain a driver jump."""
    if run.settings.step > 0.0:
        return False
    return rotates_too_far(run, h) or step_control.exceeds_max_change(run, h)


@kernel
def _begin_deformation(run):
    """Start kinetostatic modes without a past, with points ahead within the next step."""
    st, settings, sys, plan = run.state, run.settings, run.system, run.plan
    if settings.refinement > 0.0 and plan.used[0] <= 1:  # the plan is still empty
        h = step_control.initial_step(sys, settings, st)
    else:
        h = step_control.propose_step(
            run.method, settings, plan, sys.time_events, st, run.times, 1, sys
        )
    begin_deformation(run, h, 0.1 * (settings.end - st.t[0]), _tangent_factor(run))


@kernel
def _is_output_due(run):
    """Whether an output is due at the present time or before."""
    return step_control.is_output_due(run.settings, run.times, run.state, run.state.t[0], 0)


@kernel
def _place_output(run):
    """Put the state at the next output time into the trial state; returns the status."""
    st, tr, settings, history = run.state, run.work.trial, run.settings, run.work.now.history
    before, now = tr.before, run.times[st.count[0]["outputs"]]
    copy(st.angles, tr.angles)
    if now >= st.t[0] - time_round_off(settings):
        tr.t[0] = st.t[0]
        copy(st.q, tr.q)
        copy(st.v, tr.v)
        copy(st.aa if run.method.collocation > 0 else st.vd, tr.aa)
        copy(st.work_done, tr.work_done)
        copy(st.history, history)
        status = SUCCESS
    else:
        copy(before.history, history)
        share = (now - before.t[0]) / (st.t[0] - before.t[0])
        status = call_step(run.method.interpolate[0], run, run.method.coefficients[0], share)
        status = max(status, follow_angles(run, 1.0, share))
        tr.t[0] = now
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    return status


@unit
def write_output(run: Run) -> int:
    """Write the next output row, with projected accelerations and multipliers."""
    st, tr, at = run.state, run.work.trial, run.trial_point
    status = _place_output(run)
    if status != SUCCESS:
        return status
    on_step = run.settings.step > 0.0 and tr.t[0] == st.t[0]
    project = VELOCITIES if on_step else POSITIONS
    st.count[0]["factorisations"] += 1
    if run.settings.step > 0.0 and st.memory[0]["factor_age"] >= _MAX_FACTOR_AGE:
        st.memory[0]["factor_age"] = -1.0
    status = accelerations(run, at, _tangent_factor(run), project)
    if status != SUCCESS:
        return status
    if run.settings.static_after_step == 0 and _tangent_factor(run) > 0.0:
        add_stiff_accelerations(run, at, tr.aa)
    remove_self_stress(run, at, _tangent_factor(run))
    constraint_stage(run, at)
    count_turns(run, at, tr.angles)
    write_motion(run, at, tr, run.work.con.drift[0])
    if run.settings.step == 0.0:  # at a jump the row shows the state just before it
        run.output.t[run.output.rows[0]] = run.times[st.count[0]["outputs"]]
    put_energies(run, at, tr.work_done, run.output.energy[run.output.rows[0]])
    copy(st.history, run.work.now.history)
    status = end_row(run, at, tr)
    st.memory[0]["steps_since_output"] = 0.0
    copy(st.angles, run.work.feedback.near)
    return status


@kernel
def _tangent_factor(run):
    """Factor cp = filter × h² of ∂F/∂q in the matrix for reported accelerations; 0 in row one."""
    if run.settings.determinate == 0:
        return run.method.filter * run.state.memory[0]["last_step"] ** 2
    return 0.0


@unit
def integrate_steps(run: Run, aside: Run, n_steps: int) -> int:
    """Run n_steps, or until the end of the run, or until `out` is full; returns the status.

    Outputs that are due are written, also before the first step. They use `aside`, the same run
    with a factor of its own.
    """
    settings, st, out = run.settings, run.state, run.output
    out.rows[0] = 0
    out.extent[:] = math.nan
    done, status, st.memory[0]["factor_age"] = 0, SUCCESS, -1.0
    run.work.collocation.span[1] = 0.0
    run.work.collocation.age[0] = -1.0
    run.work.partition.age[0] = -1.0
    copy(st.angles, run.work.feedback.near)
    copy(st.history, run.work.now.history)
    begin_run(run, run.state_point)
    step_control.select_initial_step(run.system, settings, st)
    if settings.static_after_step == 1 and st.count[0]["steps"] + st.count[0]["outputs"] == 0:
        _begin_deformation(run)
    if settings.step == 0.0:
        update_error_scales(run)
        if run.method.stages > 0 and n_steps > 0:
            put_vd_round_off(run, run.trial_point)
    begin_events(run)
    if settings.refinement == 0.0:
        run.plan.used[0] = 0
        step_control.write_plan(settings, run.plan, st)
    while status == SUCCESS:
        if _is_output_due(run):
            status = write_output(aside)
            continue
        room = out.t.shape[0] - out.rows[0]
        if done == n_steps or step_control.is_at_end(settings, run.plan, st):
            break
        full = room < 3 or step_control.is_output_due(
            settings, run.times, st, st.t[0] + settings.step, room
        )
        if full and done > 0:
            break
        status = advance(run, room)
        if status == SUCCESS and len(run.stages.angle_path.units) > 0:
            status = follow_angles(aside, 0.0, 1.0)
            copy(run.work.feedback.near, st.angles)
        done += 1
    return status
