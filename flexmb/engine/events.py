"""Events: times at which a force law changes or a function of time jumps; steps end there.

State events are zeros of event functions, which the kinds evaluate (stage `events`): the depth of a
contact or stop and its rate; what makes friction in contacts and joints slide or stick; arguments
at which a function of the motion is not smooth (corners of a table, equal arguments of max, a
vector of zero); jumps of the curvature of a curve, or of its slope. One that may exceed zero and
return within a step is detected from its values and rates at both ends. Under error control, a step
with a zero well inside is repeated shorter, to end a little before the zero; then a small step ends
a little beyond it (regula falsi, in a few tries). No step then has a kink, which no estimate sees.
The step after an event is short too, as forces may grow fast. Fixed steps are not shortened.
Source: Shampine & Thompson, Event location for ODEs, Comput. Math. Appl. 39 (2000) 43.

Time events: integration formulas assume that forces and motions are smooth within a step. If a
function of time or its derivative jumps (the end of a step function, a corner of a table), a step
ends just before, and the state just after it is computed as at the start of a run: velocities are
projected onto their constraints (if the velocity of a driver jumps, by an impulse of the joints),
accelerations and multipliers follow from the equations of motion, and the next step is short. All
of it follows from `State` alone, so a resumed run repeats it.
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
from flexmb.engine.method import SUCCESS, count_passed, next_end, time_round_off
from flexmb.engine.projection import VELOCITIES, accelerations, put_vd_round_off
from flexmb.engine.state import Run

# A repeated step first aims at _AIM_BEFORE, then, when the zero is close, at _AIM_BEYOND times the
# linearly interpolated time to the zero. A step may end beyond the zero by _MAX_OVERRUN times the
# step that met it first: too little for its stages to notice. Of 240 explicit runs with stops,
# contacts and sticking friction, 23 report less than a third of their error or exceed twice the
# accuracy if steps end up to 0.02 beyond; 2 to 5 do with 0.95 to 0.99 and 3e-5 to 3e-3, in as many
# steps within 5 %. If a law jumps, no stage knows its side: there steps are shortened until the one
# that crosses moves the model by a small share of the accuracy.
_AIM_BEFORE, _MAX_OVERRUN, _AIM_BEYOND = 0.98, 3e-4, 1.01
# Where a force d^n of a fractional n ends, its derivatives are infinite: the error of a step up to
# there falls as its h^(n + 1), whatever the order. A step of an explicit method that goes beyond,
# or would if _NEAR_END times as long, ends at _AIM_BEFORE_END of the way: a hundredth of the error.
_AIM_BEFORE_END, _NEAR_END = 0.8, 1.1
_MAX_TRIES = 10
# Events shorten steps to no less than the smaller of these shares: of the duration of the run, and
# of its longest step so far (equal in a run of two steps). A step that ends beyond an event by d
# has an error of d², small even after a thousand events.
_MIN_STEP_FRACTION, _MIN_PART = 1e-7, 2e-7
_MIN_STEPS = 100.0  # and no less than this many times the round-off of time
# One event in _STEPS_AFTER_EVENT steps is located, so that friction without load, which chatters,
# stalls no run; after a while without events _CLOSE_EVENTS, as sticking and sliding back. Those of
# functions (`of_law`) count separately, so that a controller that switches hides no contact.
_STEPS_AFTER_EVENT, _CLOSE_EVENTS = 5.0, 3.0
# Events of functions are not located in a step that moves the model by less than this share of the
# requested accuracy, nor would its change of velocity over the run: a decaying vibration crosses
# zero without end.
_NEGLIGIBLE_MOTION = 0.1
_NOTED_STEPS = 8  # steps after an event that update the velocities stored with its state
# First step after an event over the step before it: the error estimate knows nothing of the motion.
_RESTART_FRACTION = 0.1


@kernel
def _evaluate_events(run, at, out):
    """Evaluate all event functions into `out`, after the stages of `_evaluate_stages`."""
    now = run.work.events.now
    run_stage(run.stages.events, run, at)
    for k in range(now.shape[0]):
        out[k]["value"], out[k]["rate"] = now[k]["value"], now[k]["rate"]


@kernel
def _evaluate_stages(run, at):
    """Positions, velocities and bias accelerations of markers at a state, and joint reactions."""
    pose_stage(run, at)
    velocity_stage(run, at)
    bias_stage(run, at)
    reaction_stage(run, at)


@unit
def begin_events(run: Run) -> int:
    """Before the first step: evaluate the event functions at the state."""
    if len(run.stages.events.units) > 0:
        _evaluate_stages(run, run.state_point)
        run.work.now.span[0] = 0.0
        _evaluate_events(run, run.state_point, run.work.events.before)
        taken = run.work.events.taken
        taken[0], taken[1], taken[2], taken[3] = 0, 0, 1, 0
    return SUCCESS


@kernel
def _record_velocities(run):
    """Update the velocities stored with the state after the last event, for a few steps."""
    st, events = run.state, run.work.events
    if events.taken[1] > 0 and events.taken[3] < _NOTED_STEPS:
        events.taken[3] += 1
        row, nv = events.states[events.taken[1] - 1], st.v.shape[0]
        begin = 2 + st.q.shape[0] + nv
        copy(st.v, row[begin : begin + nv])


@kernel
def _record_state(run):
    """Store the state after an event; of many events every third one, then every ninth, ..."""
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
        copy(st.angles, row[at + st.history.shape[0] :])
        taken[1], taken[3] = taken[1] + 1, 0
    taken[0] += 1


@kernel
def _crossing_share(events, k):
    """Share of the step at which event function k crosses zero, by a straight line; 1: never. Of a
    vector its component along what it was before counts."""
    a, b = events.before[k]["value"], events.now[k]["value"]
    if events.now[k]["of_law"] == 3.0:
        y = events.before[k + 1]["value"]
        a, b = a * a + y * y, a * b + y * events.now[k + 1]["value"]
    crosses = (a < 0.0 and b > 0.0) or (a > 0.0 and b < 0.0)
    return a / (a - b) if crosses and events.now[k]["of_law"] != 4.0 else 1.0


@kernel
def _peak_share(events, k, h):
    """Share of the step at which function k may exceed zero, being negative at both ends; 1: never.

    It is where the tangents at both ends meet, an upper bound of a concave function; if they do not
    meet within the step, the maximum of the cubic with these values and rates. The cubic also shows
    a function that falls below zero and returns, as of a contact that opens for a moment.
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
    # a + s (rise + s (c2 + s c3)) with the share s; at its maximum the derivative is zero and falls
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
    """Share of the step at the first zero of all event functions; 1: there is none.

    With h = 0 zeros between equal signs at both ends do not count. Those of elements and those of
    functions (`of_law`) count if the flag is true.
    """
    share = 1.0
    for k in range(events.now.shape[0]):
        if laws if events.now[k]["of_law"] > 0.0 else elements:
            share = min(share, _crossing_share(events, k), _peak_share(events, k, h))
    return share


@kernel
def _crosses_jump(events, share):
    """Whether a law that jumps, not only its slope, has a zero up to this share of the step."""
    for k in range(events.now.shape[0]):
        if events.now[k]["of_law"] == 2.0 and _crossing_share(events, k) <= share < 1.0:
            return True
    return False


@kernel
def _end_of_force(events):
    """Share of the step, or of a longer one, at which the first contact or stop ends; inf: none."""
    share = math.inf
    for k in range(events.now.shape[0]):
        a, b = events.before[k]["value"], events.now[k]["value"]
        is_depth = not (events.now[k]["of_law"] > 0.0 or math.isnan(events.now[k]["rate"]))
        if is_depth and a > 0.0 and b < a:
            share = min(share, a / (a - b))
    return share


@unit
def has_inner_event(run: Run, h: float) -> int:
    """1 if the proposed step of size h has an event well inside, so that it is repeated shorter."""
    settings, memory, events = run.settings, run.state.memory[0], run.work.events
    if len(run.stages.events.units) == 0 or settings.step > 0.0:
        return 0
    _evaluate_stages(run, run.trial_point)
    run_stage(run.stages.events, run, run.trial_point)
    elements = memory["steps_until_event_search"] <= 0.0
    laws = memory["steps_until_law_search"] <= 0.0 and not _hardly_moves(run, h, 1.0)
    share = _first_crossing(events, h, elements, laws)
    tried = memory["event_trials"] >= _MAX_TRIES
    longest = max(memory["step_before_event"], h) if memory["event_trials"] > 0.0 else h
    near = share * h <= 2.0 * (1.0 - _AIM_BEFORE) * longest
    enough = (1.0 - share) * h <= _MAX_OVERRUN * longest
    shortest = max(_MIN_PART * memory["largest_step"], _MIN_STEPS * time_round_off(settings))
    least = min(_MIN_STEP_FRACTION * (settings.end - settings.start), shortest)
    if laws and _crosses_jump(events, share):
        near, enough = near and _hardly_moves(run, h, _AIM_BEYOND * share), False
        if run.method.stages > 0:  # implicit methods divide round-off of positions by the step
            least = min(least, _MIN_STEPS * time_round_off(settings))
        tried = memory["event_trials"] >= 2.0 * _MAX_TRIES
    aim = _AIM_BEYOND if near else _AIM_BEFORE
    if settings.fractional == 1 and run.method.stages > 0 and elements:
        end = _end_of_force(events)
        is_first = end <= share or (share == 1.0 and end < _NEAR_END)
        if is_first and end * h > 2.0 * (1.0 - _AIM_BEFORE) * longest:
            share, aim, enough = end, _AIM_BEFORE_END, False
    if enough or tried:
        return 0
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
    """Whether this part of a step moves no coordinate by more than a share of the accuracy.

    The change of velocity counts as well, by its displacement over the whole run: a function of a
    velocity may have a zero where nothing moves.
    """
    st, v, weights, settings = run.state, run.work.trial.v, run.system.weights, run.settings
    least, span = _NEGLIGIBLE_MOTION * settings.accuracy, settings.end - settings.start
    for i in range(v.shape[0]):
        moved = max(h * abs(st.v[i]), h * abs(v[i]), span * abs(v[i] - st.v[i]))
        if weights[i] * part * moved > least * st.q_scale[i]:
            return False
    return True


@kernel
def _count_search(memory):
    """Count a step since the last events; whether those of elements, of functions are located."""
    least = (1.0 - _CLOSE_EVENTS) * _STEPS_AFTER_EVENT
    memory["steps_until_event_search"] = max(memory["steps_until_event_search"] - 1.0, least)
    memory["steps_until_law_search"] = max(memory["steps_until_law_search"] - 1.0, least)
    return memory["steps_until_event_search"] <= 0.0, memory["steps_until_law_search"] <= 0.0


@unit
def accept_events(run: Run, h: float) -> int:
    """After an accepted step of size h: count its events; after one, make the next step short."""
    settings, memory = run.settings, run.state.memory[0]
    if len(run.stages.events.units) == 0 or settings.step > 0.0:
        return SUCCESS
    elements, laws = _count_search(memory)
    _record_velocities(run)
    events, located = run.work.events, memory["event_trials"] > 0.0
    # a short step may cross an event by chance: for its state the motion in a long one counts
    noted = laws and run.method.stages == 0
    noted = noted and not _hardly_moves(run, h, memory["largest_step"] / h)
    noted = _first_crossing(events, 0.0, elements, noted) < 1.0
    laws = laws and (located or not _hardly_moves(run, h, 1.0))
    if _first_crossing(events, 0.0, True, True) < 1.0:
        longest = memory["step_before_event"] if memory["event_trials"] > 0.0 else h
        least = _MIN_STEP_FRACTION * (settings.end - settings.start)
        longest = max(_RESTART_FRACTION * longest, least)
        if _first_crossing(events, 0.0, elements, laws) < 1.0:
            run.state.count[0]["events"] += 1
            noted = True
            memory["next_step"] = min(memory["next_step"], longest)
            if _first_crossing(events, 0.0, elements, False) < 1.0:
                memory["steps_until_event_search"] += _STEPS_AFTER_EVENT
            else:
                memory["steps_until_law_search"] += _STEPS_AFTER_EVENT
        memory["event_trials"] = 0.0
    elif memory["event_trials"] > 0.0:  # the event is still ahead, or does not occur any more
        if h < memory["earlier_step"]:  # a step no longer than this one reaches it
            memory["next_step"] = min(memory["next_step"], h)
        memory["event_trials"] += 1.0
        if memory["event_trials"] > 2.0 * _MAX_TRIES:
            memory["event_trials"] = 0.0
    _evaluate_events(run, run.state_point, run.work.events.before)
    if noted and run.method.stages > 0:
        put_vd_round_off(run, run.trial_point)
    if noted and run.work.events.states.shape[0] > 0:
        _record_state(run)
    return SUCCESS


@unit
def cross_time_event(run: Run, cp: float) -> int:
    """Take a state just before a time event to just after it; returns the status.

    cp is b of M + b ∂F/∂q, as for reported accelerations; it is reduced where velocities jump. A
    jump within the tolerance of the next step does not reset the memory of the step control.
    """
    st, settings, time_events = run.state, run.settings, run.system.time_events
    k = count_passed(time_events, st.t[0]) - 1
    if k < 0 or time_events[k, 0] != st.t[0]:
        return SUCCESS
    st.t[0] = time_events[k, 1]
    status = _solve_right_limit(run, cp)
    if status == SUCCESS and _impulse_tangent_factor(run, st.v, cp) < cp:
        tr = run.work.trial
        copy(tr.v, tr.dense_correction)
        st.t[0] = time_events[k, 0]  # constraint drift before the event is no part of the jump
        status = _solve_right_limit(run, cp)
        cp = _impulse_tangent_factor(run, tr.dense_correction, cp)
        zero(tr.dense_correction)
        st.t[0] = time_events[k, 1]
        if status == SUCCESS:
            status = _solve_right_limit(run, cp)
    if status == SUCCESS:
        if _relative_jump(run, st.v, st.memory[0]["next_step"], 1.0) > settings.tolerance:
            _accept_right_limit(run)
            _forget_steps(st)
        elif run.method.stages > 0:  # it is the first stage of the next step
            _accept_right_limit(run)
    return status


@kernel
def _solve_right_limit(run, cp):
    """Velocities, accelerations and multipliers just after the event, into the trial state."""
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
    moved = _relative_jump(run, v, 1.0, 0.0)
    return min(cp, (run.settings.accuracy / moved) ** 2) if moved > 0.0 else cp


@kernel
def _relative_jump(run, v, h, of_accelerations):
    """Change of position in a step h by the jump of velocities, from v to those of the trial state.

    The factor of_accelerations (1 or 0) adds the jump of accelerations. Relative to the largest
    motion so far of the same part of the model, or, of a part at rest, to its motion by this jump
    until the next time event; the maximum over all coordinates.
    """
    st, tr, part, weights = run.state, run.work.trial, run.system.part, run.system.weights
    motion, jump = tr.dq, 0.0
    left = next_end(run.system.time_events, st.t[0], run.settings.end) - st.t[0]
    zero(motion)
    for i in range(weights.shape[0]):
        motion[part[i]] = max(motion[part[i]], st.q_scale[i])
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
    """Make the trial state the state; add the work of the impulse and evaluate powers again."""
    st, tr, total, at = run.state, run.work.trial, run.work.energies, run.state_point
    energies(run, at)
    before = total[0]
    store(tr.v, st.v)
    store(tr.vd, st.vd)
    store(tr.lam, st.lam)
    velocity_stage(run, at)
    rows = run.system.rows
    for k in range(rows.shape[0]):
        if rows[k]["fun"] >= 0:  # only impulses of drivers do work
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
    """Reset the memory of the motion before the event; only the accelerations after it remain."""
    copy(st.vd, st.vd_before)
    copy(st.vd, st.aa)
    copy(st.lam, st.lam_before)
    zero(st.jerk)
    zero(st.jerk_before)
    st.memory[0]["steps_at_this_size"] = 0.0
    st.memory[0]["velocity_error"] = 0.0
    st.memory[0]["steps_until_growth"] = 0.0
    st.memory[0]["next_step"] *= _RESTART_FRACTION
