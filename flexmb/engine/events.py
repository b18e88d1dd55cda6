"""Events: moments at which a force changes its law or a function of time jumps; steps end there.

State events: what is watched is told by the kinds (stage `events`): each contact by its depth and
the rate of this, one with friction by what makes it slide or stick; so is friction in each joint,
and each bound of a stop by its penetration, as are the places at which a function of what moves
changes its law (corners of a table, equal arguments of max). What may peak above zero and return
within a step shows in its values and rates at both ends of the step: by their tangents, and by the
cubic through them. With error control a step in which one of them crosses zero, and not just at its
end, is repeated shorter, so that it ends a little before the crossing, and then one of a small
length a little beyond it (regula falsi; each shorter step is closer, and tries are bounded): no
estimate sees what a kink in the last stages adds. After it begins one of a small length, as forces
may grow fast from there.
With fixed steps nothing is shortened. Source: Shampine & Thompson, Event location for ordinary
differential equations, Comput. Math. Appl. 39 (2000) 43.

Time events: the formulas of the methods take forces and motions for smooth within a step. Where a
function of time or its derivative jumps (the end of a step function, a corner of a table) a step
ends just before, and the state is computed again on the far side, as at the start of a run:
velocities back on their constraints (where the speed of a driver jumps, by the impulse of the
joints), accelerations and multipliers from the equations of motion, a short step. All of it follows
from `State` alone, so that a resumed run repeats it.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import copy, store, zero
from flexmb.engine.equations_of_motion import (
    bias_stage,
    energies,
    feedback_stage,
    pose_stage,
    powers,
    reaction_stage,
    run_stage,
    velocity_stage,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import SUCCESS, time_round_off
from flexmb.engine.projection import VELOCITIES, accelerations, put_vd_round_off
from flexmb.engine.state import Run

# Steps end before a crossing first, at this share of the way by a straight line, and pass it by one
# so short that what changes within it is none of their stages' business: a share of the step that
# met it. Of 240 runs by explicit methods with stops, contacts and sticking friction 23 report less
# than a third of their error, or exceed twice the accuracy, with steps that end up to 0.02 beyond;
# 2 to 5 with 0.95 to 0.99 and 3e-5 to 3e-3, in as many steps but for 5 %. What is aimed at in the
# end, over the way to the crossing. Where a law jumps, no stage knows which side it is on: steps
# come closer, until the one that passes it is a small share of the accuracy.
_BEFORE, _NEAR_EVENT, _OVERSHOOT = 0.98, 3e-4, 1.01
_MAX_TRIES = 10
# Steps are not made shorter for events than this fraction of the run, or that of its longest step,
# however long the run is: what a step passes an event by is an error of its square, in each of a
# thousand. Both are the same in a run of two steps.
_MIN_STEP_FRACTION, _MIN_PART = 1e-7, 2e-7
_MIN_STEPS = 100.0  # and no shorter than so many times round-off of the time
# One event in so many steps may shorten steps, so that what flutters about zero, such as friction
# without load, does not stop the run; after as many steps without, this many may follow each other
# closely, as stick after slip and slip the other way. Laws of functions are counted by themselves,
# so that a controller that switches all the time hides no contact.
_STEPS_AFTER_EVENT, _CLOSE_EVENTS = 5.0, 3.0
# Where a step moves by less than this share of the requested accuracy (over the motion so far), and
# so does its change of speeds over the run, changes of force laws are not located: a vibration that
# decays crosses zero without end.
_NEGLIGIBLE_MOTION = 0.1
# Steps after an event whose last velocities are noted with the state there.
_NOTED_STEPS = 8
# First step after an event, over the one before it was shortened: estimates begin again.
_RESTART_FRACTION = 0.1


@kernel
def _put_all_events(run, at, out):
    """What is watched, after position and velocity stages and those of reactions."""
    now = run.work.events.now
    run_stage(run.stages.events, run, at)
    for k in range(now.shape[0]):
        out[k]["value"], out[k]["rate"] = now[k]["value"], now[k]["rate"]


@kernel
def _stages(run, at):
    """Markers at a state, and the loads that follow from its multipliers."""
    pose_stage(run, at)
    velocity_stage(run, at)
    bias_stage(run, at)
    reaction_stage(run, at)


@unit
def begin_events(run: Run) -> int:
    """Before the first step: what is watched at the state."""
    if len(run.stages.events.units) > 0:
        _stages(run, run.state_point)
        run.work.now.span[0] = 0.0
        _put_all_events(run, run.state_point, run.work.events.before)
        taken = run.work.events.taken
        taken[0], taken[1], taken[2], taken[3] = 0, 0, 1, 0
    return SUCCESS


@kernel
def _note_velocities(run):
    """Let the last state behind an event know the velocities that follow it."""
    st, events = run.state, run.work.events
    if events.taken[1] > 0 and events.taken[3] < _NOTED_STEPS:
        events.taken[3] += 1
        row, nv = events.states[events.taken[1] - 1], st.v.shape[0]
        begin = 2 + st.q.shape[0] + nv
        copy(st.v, row[begin : begin + nv])


@kernel
def _take_state(run):
    """Note the state behind an event, or every third, ninth, ... where there are many."""
    st, events = run.state, run.work.events
    states, taken = events.states, events.taken
    if taken[1] == states.shape[0]:
        for k in range(states.shape[0] // 3):
            copy(states[3 * k], states[k])
        taken[1] //= 3
        taken[2] *= 3
    if taken[0] % taken[2] == 0:
        row, at, nv = states[taken[1]], 1, st.v.shape[0]
        row[0] = st.t[0]
        copy(st.q, row[at : at + st.q.shape[0]])
        at += st.q.shape[0]
        copy(st.v, row[at : at + nv])
        at += nv
        row[at] = st.memory[0]["next_step"]
        at += 1
        copy(st.v, row[at : at + nv])
        at += nv
        copy(st.vd, row[at : at + nv])
        at += nv
        copy(st.lam, row[at : at + st.lam.shape[0]])
        at += st.lam.shape[0]
        copy(st.history, row[at : at + st.history.shape[0]])
        taken[1] += 1
        taken[3] = 0
    taken[0] += 1


@kernel
def _crossing(events, k):
    """Share of the step at which number k crosses zero; 1: it does not."""
    a, b = events.before[k]["value"], events.now[k]["value"]
    if (a < 0.0 and b > 0.0) or (a > 0.0 and b < 0.0):
        return a / (a - b)
    return 1.0


@kernel
def _peak(events, k, h):
    """Share of the step at which k may peak above zero, below it at both ends; 1: never.

    Where the tangents of both ends meet, which a value that rises ever slower does not exceed; or,
    where it also turns in the step, at the peak of the cubic with these values and rates. By that
    also where it falls below zero and returns, as a contact does that opens for a moment.
    """
    a, b = events.before[k]["value"], events.now[k]["value"]
    rise, fall = h * events.before[k]["rate"], h * events.now[k]["rate"]
    falls = a > 0.0 and b > 0.0
    if falls:
        a, b, rise, fall = -a, -b, -rise, -fall
    if math.isnan(rise + fall) or not (a < 0.0 and b < 0.0):
        return 1.0
    if rise > 0.0 and fall < 0.0 and not falls:
        share = (b - a - fall) / (rise - fall)
        if 0.0 < share < 1.0:
            return share if a + rise * share > 0.0 else 1.0
    # a + s (rise + s (c2 + s c3)), whose slope falls through zero at its peak
    c2 = 3.0 * (b - a) - 2.0 * rise - fall
    c3 = rise + fall - 2.0 * (b - a)
    root = c2 * c2 - 3.0 * c3 * rise
    if root <= 0.0:
        return 1.0
    if c2 > 0.0:
        share = (-c2 - math.sqrt(root)) / (3.0 * c3) if c3 != 0.0 else 1.0
    else:
        share = rise / (math.sqrt(root) - c2)
    peak = a + share * (rise + share * (c2 + share * c3))
    return share if 0.0 < share < 1.0 and peak > 0.0 else 1.0


@kernel
def _first_crossing(events, h, elements, laws):
    """Share of the step at which the first of all crosses zero; 1: none does.

    With h = 0 only what has crossed in the end counts; of elements, or of laws of functions, only
    if asked for.
    """
    share = 1.0
    for k in range(events.now.shape[0]):
        if laws if events.now[k]["of_law"] > 0.0 else elements:
            share = min(share, _crossing(events, k), _peak(events, k, h))
    return share


@kernel
def _crosses_jump(events, share):
    """Whether a law that jumps crosses zero first, at a share of the step."""
    for k in range(events.now.shape[0]):
        if events.now[k]["of_law"] == 2.0 and _crossing(events, k) <= share < 1.0:
            return True
    return False


@unit
def has_inner_event(run: Run, h: float) -> int:
    """1 if the step that is proposed has an event well inside; then a shorter one is due."""
    settings, memory, events = run.settings, run.state.memory[0], run.work.events
    if len(run.stages.events.units) == 0 or settings.step > 0.0:
        return 0
    _stages(run, run.trial_point)
    run_stage(run.stages.events, run, run.trial_point)
    elements = memory["steps_until_event_search"] <= 0.0
    laws = memory["steps_until_law_search"] <= 0.0 and not _hardly_moves(run, h, 1.0)
    share = _first_crossing(events, h, elements, laws)
    tried = memory["event_trials"] >= _MAX_TRIES
    longest = max(memory["step_before_event"], h) if memory["event_trials"] > 0.0 else h
    near = share * h <= 2.0 * (1.0 - _BEFORE) * longest
    enough = (1.0 - share) * h <= _NEAR_EVENT * longest
    least = _MIN_STEP_FRACTION * (settings.end - settings.start)
    shortest = max(_MIN_PART * memory["largest_step"], _MIN_STEPS * time_round_off(settings))
    least = min(least, shortest)
    if laws and _crosses_jump(events, share):
        near, enough = near and _hardly_moves(run, h, _OVERSHOOT * share), False
        if run.method.stages > 0:  # implicit ones divide round-off of positions by their steps
            least = min(least, _MIN_STEPS * time_round_off(settings))
        tried = memory["event_trials"] >= 2.0 * _MAX_TRIES
    if enough or tried:
        return 0
    aim = _OVERSHOOT if near else _BEFORE
    if memory["event_trials"] == 0.0:
        memory["step_before_event"] = h
    shorter = max(h * max(share * aim, 1e-3), least)
    if shorter >= h:
        return 0
    memory["event_trials"] += 1.0
    memory["next_step"] = shorter
    memory["factor_age"] = -1.0
    return 1


@kernel
def _hardly_moves(run, h, part):
    """Whether a part of a step moves nothing by a share of its motion that the accuracy asks for.

    Nor by what it changes of the speeds, within the run: a law of a speed changes where nothing
    moves.
    """
    st, v, weights, settings = run.state, run.work.trial.v, run.system.weights, run.settings
    least, span = _NEGLIGIBLE_MOTION * settings.accuracy, settings.end - settings.start
    for i in range(v.shape[0]):
        moved = max(h * abs(st.v[i]), h * abs(v[i]), span * abs(v[i] - st.v[i]))
        if weights[i] * part * moved > least * st.motion[i]:
            return False
    return True


@kernel
def _count_search(memory):
    """Count a step since the last events; whether those of elements, and of laws, are located."""
    least = (1.0 - _CLOSE_EVENTS) * _STEPS_AFTER_EVENT
    memory["steps_until_event_search"] = max(memory["steps_until_event_search"] - 1.0, least)
    memory["steps_until_law_search"] = max(memory["steps_until_law_search"] - 1.0, least)
    return memory["steps_until_event_search"] <= 0.0, memory["steps_until_law_search"] <= 0.0


@unit
def accept_events(run: Run, h: float) -> int:
    """After an accepted step: count its events, and begin with a small step after one."""
    settings, memory = run.settings, run.state.memory[0]
    if len(run.stages.events.units) == 0 or settings.step > 0.0:
        return SUCCESS
    elements, laws = _count_search(memory)
    _note_velocities(run)
    counted = run.state.count[0]["events"]
    events, located = run.work.events, memory["event_trials"] > 0.0
    laws = laws and (located or not _hardly_moves(run, h, 1.0))
    if _first_crossing(events, 0.0, True, True) < 1.0:
        longest = memory["step_before_event"] if memory["event_trials"] > 0.0 else h
        least = _MIN_STEP_FRACTION * (settings.end - settings.start)
        longest = max(_RESTART_FRACTION * longest, least)
        if _first_crossing(events, 0.0, elements, laws) < 1.0:
            run.state.count[0]["events"] += 1
            memory["next_step"] = min(memory["next_step"], longest)
            if _first_crossing(events, 0.0, elements, False) < 1.0:
                memory["steps_until_event_search"] += _STEPS_AFTER_EVENT
            else:
                memory["steps_until_law_search"] += _STEPS_AFTER_EVENT
        memory["event_trials"] = 0.0
    elif memory["event_trials"] > 0.0:  # the event is still to come, or it has gone away
        if h < memory["earlier_step"]:  # it would be in the next step that is not longer
            memory["next_step"] = min(memory["next_step"], h)
        memory["event_trials"] += 1.0
        if memory["event_trials"] > 2.0 * _MAX_TRIES:
            memory["event_trials"] = 0.0
    _put_all_events(run, run.state_point, run.work.events.before)
    if run.state.count[0]["events"] > counted:
        if run.method.stages > 0:
            put_vd_round_off(run, run.trial_point)
        if run.work.events.states.shape[0] > 0:
            _take_state(run)
    return SUCCESS


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

    cp is the factor of the tangent that M is added to, as for reported accelerations, or less where
    speeds jump. A jump within the tolerance of the next step leaves the memory of steps as it is.
    """
    st, settings, time_events = run.state, run.settings, run.system.time_events
    k = _passed(time_events, st.t[0]) - 1
    if k < 0 or time_events[k, 0] != st.t[0]:
        return SUCCESS
    st.t[0] = time_events[k, 1]
    status = _solve_right_limit(run, cp)
    if status == SUCCESS and _impulse_tangent_factor(run, st.v, cp) < cp:
        tr = run.work.trial
        copy(tr.v, tr.dense_correction)
        st.t[0] = time_events[k, 0]  # what velocities are off before the event is no jump
        status = _solve_right_limit(run, cp)
        cp = _impulse_tangent_factor(run, tr.dense_correction, cp)
        zero(tr.dense_correction)
        st.t[0] = time_events[k, 1]
        if status == SUCCESS:
            status = _solve_right_limit(run, cp)
    if status == SUCCESS:
        if _jump(run, st.v, st.memory[0]["next_step"], 1.0) > settings.tolerance:
            _accept_right_limit(run)
            _forget_steps(st)
        elif run.method.stages > 0:  # whose first stage it is
            _accept_right_limit(run)
    return status


@kernel
def _solve_right_limit(run, cp):
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
def _impulse_tangent_factor(run, v, cp):
    """Factor b of M + b ∂F/∂q for an impulse that changes velocities from v to the trial ones.

    √b is the time in which this change moves the model by the requested accuracy: vibrations of
    smaller amplitude are filtered. At most cp, which after a long step would filter slow motions.
    """
    moved = _jump(run, v, 1.0, 0.0)
    return min(cp, (run.settings.accuracy / moved) ** 2) if moved > 0.0 else cp


@kernel
def _jump(run, v, h, of_accelerations):
    """What jumps of velocities from v, and of accelerations or not, do to positions in a step h.

    Over the largest motion so far of the same part of the model; of one that has not moved, over
    what these velocities are to move until the next event.
    """
    st, tr, part, weights = run.state, run.work.trial, run.system.part, run.system.weights
    motion, jump = tr.dq, 0.0
    left = next_end(run.system.time_events, st.t[0], run.settings.end) - st.t[0]
    zero(motion)
    for i in range(weights.shape[0]):
        motion[part[i]] = max(motion[part[i]], st.motion[i])
    for i in range(weights.shape[0]):
        speed = abs(tr.v[i] - v[i])
        moved = speed + 0.5 * h * of_accelerations * abs(tr.vd[i] - st.vd[i])
        moved, most = weights[i] * h * moved, motion[part[i]]
        if most < run.settings.least_motion:
            most = max(most, weights[i] * speed * left)
        if not moved <= jump * most:
            jump = moved / most if most > 0.0 else math.inf
    return jump


@kernel
def _accept_right_limit(run):
    """The trial state becomes the state; powers again."""
    st, tr, total, at = run.state, run.work.trial, run.work.energies, run.state_point
    energies(run, at)
    before = total[0]
    store(tr.v, st.v)
    store(tr.vd, st.vd)
    store(tr.lam, st.lam)
    velocity_stage(run, at)
    rows = run.system.rows
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:  # only drivers do work by impulses
            energies(run, at)
            st.work_done[0] += total[0] - before
            break
    feedback_stage(run, at)
    reaction_stage(run, at)
    run_stage(run.stages.jump, run, at)
    powers(run, at)
    copy(run.work.powers, st.power)
    for k in range(3):
        st.power_before[0, k] = st.power_before[1, k] = math.nan


@kernel
def _forget_steps(st):
    """Nothing is known of the motion beyond an event but its present accelerations."""
    copy(st.vd, st.vd_before)
    copy(st.vd, st.aa)
    copy(st.lam, st.lam_before)
    zero(st.jerk)
    zero(st.jerk_before)
    st.memory[0]["steps_at_this_size"] = 0.0
    st.memory[0]["velocity_error"] = 0.0
    st.memory[0]["steps_until_growth"] = 0.0
    st.memory[0]["next_step"] *= _RESTART_FRACTION
