"""Step size control: fixed steps that are halved if one fails, or steps under error control.

Fixed steps: a step that fails is repeated with a half, a quarter, ... of its size, until the next
grid point is reached.

Error control: the estimated local error of a step, of every body, mode and scalar coordinate over
its motion so far (`engine.error_scales`), must not exceed a tolerance. The next step size follows
from the error and the order of its estimate. For some methods a change of the step size costs a
factorisation and makes the estimate oscillate: there steps grow by a quarter at least, and not
right after a rejection. Steps end at known discontinuities of functions of time. No step turns a
body by more than `Settings.max_rotation`, so that full turns can be counted.

Plan: a run may follow the steps of another one. It then takes `Settings.refinement` times as many,
distributed over time in the same way, and shorter ones where its own error estimate asks for them.

If a force jumps or has a kink within a step, the error falls more slowly with the step size than
its order says, and the estimate misses part of it: such a step is accepted only if the estimate is
a small share of the requested accuracy.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import weighted_max
from flexmb.engine.jit import kernel
from flexmb.engine.method import (
    HIGH_ORDER,
    REPEAT,
    STEP_ROUND_OFF,
    STEP_TOO_SMALL,
    SUCCESS,
    next_end,
    time_round_off,
)

# Smallest step: this share of a fixed step (ten halvings); under error control this share of the
# duration of the run, or of the time itself.
_MIN_FIXED_SHARE = 1.0 / 1024.0
_MIN_STEP_SHARE = 1e-12
# The run ends with STEP_TOO_SMALL if more than _MAX_STALLED_STEPS steps in a row advance by no more
# than _STALL_SHARE of its duration (it would take 1e11 steps), or if more than _MAX_FAILED_STEPS
# steps fail while it advances by no more than _FAILURE_SHARE (an event or jump takes less than 50).
_MAX_STALLED_STEPS, _STALL_SHARE = 1000.0, 1e-8
_MAX_FAILED_STEPS, _FAILURE_SHARE = 100.0, 1e-6
# Short steps at a jump of a force (shares of the run): below _KINK_SHARE the usual tolerance holds;
# below _JUMP_SHARE any error is accepted, in at most _MAX_STEPS_AT_JUMP steps in a row.
_KINK_SHARE, _JUMP_SHARE, _MAX_STEPS_AT_JUMP = 1e-9, 1e-11, 10.0
# A kink or jump within a step is suspected if its error is this many times the one predicted from
# the step before (of which at least this share of the allowed error is assumed);
_SURPRISE_FACTOR, _MIN_EXPECTED_RATIO = 30.0, 1e-3
# or if, after the rejection of a step at least _MIN_STEP_RATIO times as long, the error has fallen
# with a power of the step size above _NOISE_POWER and below both _LOST_ORDER_SHARE times the order
# and _KINK_POWER (_JUMP_POWER if the rejected step began at another time).
_LOST_ORDER_SHARE, _KINK_POWER, _JUMP_POWER, _NOISE_POWER = 0.5, 2.6, 1.4, 0.3
_MIN_STEP_RATIO = 1.5
# The estimate misses part of the error at a kink: it must be below this share of the accuracy.
_KINK_ACCURACY_SHARE = 0.004
# Largest step under error control, over the duration of the run. A model at rest has no error that
# would limit the step, and the step could pass over a load that starts later.
_MAX_STEP_SHARE = 0.1
_SAFETY = 0.9  # of the step size that the error estimate allows
# Least and largest ratio of the next step to this one. The last is the largest with kinetostatic
# modes, whose rates are extrapolated from points of the past.
_MIN_FACTOR, _MAX_FACTOR, _MAX_FACTOR_STATIC = 0.2, 5.0, 3.0
# If a change of the step size is costly (Method.prefers_constant_step): largest ratio of the next
# step to this one; the step size stays if the ratio that the error allows is between the other two.
_MAX_FACTOR_COSTLY, _GROW_ABOVE, _SHRINK_BELOW = 2.0, 1.25, 0.8
# A step below this share of the one that met the last event was short for its sake alone: it grows
# by up to _MAX_FACTOR with a method of collocation, unless an exponent is fractional.
_SHORT_BY_EVENT = 0.02
# Below this share of the allowed error the model is at rest but for round-off, from which no
# stability limit of an explicit method follows: the step may then grow by this factor.
_NOISE_RATIO, _NOISE_GROWTH = 1e-6, 1.2
# The error estimate of velocities oscillates after a change of the step size. So a step is rejected
# only if that estimate exceeds this many times the tolerance; the next step is shorter anyway.
_VELOCITY_ERROR_FACTOR = 4.0
# Accepted steps after a rejection until the step size may grow: the estimate oscillates until then.
_STEPS_WITHOUT_GROWTH = 10.0
# A step that changes more than this many times `_max_change` is repeated shorter. Velocities below
# this share of the largest one of driven coordinates are rest, and so are those that the present
# acceleration reaches, from rest, over this share of the size of the model.
_CHANGE_FACTOR, _LEAST_DRIVEN_SHARE, _START = 2.0, 1e-6, 1e-4
# The power of that change over the error of works from the ends of steps, and from stages: those
# of a shaken table and a slider-crank are 2 to 6 times, and up to 0.4 times the accuracy off.
_WORKS_FACTOR, _STAGES_FACTOR = 12.0, 100.0
# If no more than this share of a planned step is left, the step goes on to the end of the next one.
_MIN_PLAN_REMAINDER = 0.1


@kernel
def select_initial_step(sys, settings, st):
    """Select the size of the first step, unless the state has one.

    By a plan, only the plan limits it.
    """
    memory = st.memory[0]
    if memory["next_step"] > 0.0:
        return
    memory["next_step"] = settings.step
    if settings.step == 0.0:
        memory["next_step"] = initial_step(sys, settings, st)
        if settings.refinement > 0.0:
            memory["next_step"] = settings.end - settings.start


@kernel
def initial_step(sys, settings, st):
    """Size of the first step under error control [s], at most a tenth of the output interval.

    In it the present velocity moves the model by no more than a hundredth of its size, and the
    present acceleration by no more than √(tolerance × least motion).
    """
    speed, change = weighted_max(st.v, sys.weights), weighted_max(st.vd, sys.weights)
    h = min(0.1 * settings.interval, 0.01 / speed if speed > 0.0 else math.inf)
    if change > 0.0:
        size = math.sqrt(settings.tolerance * settings.least_motion)
        h = min(h, math.sqrt(2.0 * size / change))
    return max(h, _MIN_STEP_SHARE * (settings.end - settings.start))


@kernel
def is_at_end(settings, plan, st):
    """Whether the state has reached the end of the run, or of the plan that the run follows."""
    if settings.refinement > 0.0:
        return plan.used[0] == 0 or st.t[0] >= plan.knots[plan.used[0] - 1]
    return st.t[0] >= settings.end - time_round_off(settings)


@kernel
def is_output_due(settings, times, st, t, n):
    """Whether the output that is n after the next one is due at time t or before."""
    k = st.count[0]["outputs"] + n
    return k < times.shape[0] and times[k] <= t + time_round_off(settings)


@kernel
def propose_step(method, settings, plan, time_events, st, times, room, sys):
    """Size of the step to try [s]; there is space for `room` more of the outputs at `times`."""
    h = st.memory[0]["next_step"]
    if settings.step > 0.0:
        return h
    first = st.count[0]["outputs"] + max(room - 2, 1)
    if first < times.shape[0]:
        h = min(h, times[first] - st.t[0])
    h = min(h, _MAX_STEP_SHARE * (settings.end - settings.start))
    if st.memory[0]["angular_velocity"] > 0.0:
        h = min(h, settings.max_rotation / st.memory[0]["angular_velocity"])
    h = min(h, _longest_step_of_driven(method, settings, sys, st))
    left = next_end(time_events, st.t[0], settings.end) - st.t[0]
    follows = settings.refinement > 0.0
    if follows:
        left = min(left, _plan_time(settings, plan, st.t[0]) - st.t[0])
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left and not follows else h


@kernel
def _longest_step_of_driven(method, settings, sys, st):
    """Longest step for what constraints alone move [s]; the last one, if it is hardly longer."""
    memory, most, longest = st.memory[0], _max_change(method, settings), math.inf
    if most > 0.0 and memory["driven_rate"] > 0.0:
        longest = most / memory["driven_rate"]
    if settings.determinate == 1 and most > 0.0 and memory["recent_speed"] > 0.0:
        longest = min(longest, most / max(memory["recent_speed"], memory["usual_speed"]))
        change = weighted_max(st.vd, sys.weights)
        longest = min(longest, math.sqrt(2.0 * most / change)) if change > 0.0 else longest
    last = memory["last_step"]
    return last if last <= longest < _GROW_ABOVE * last else longest


@kernel
def _max_change(method, settings):
    """Largest change in a step where constraints fix the motion; 0: no limit.

    It is that of velocities over their scales and, if all of the model is fixed, the weighted
    displacement. There only the works of drivers and forces are integrated. Their error grows with
    the power of the change that the order of the method gives.
    """
    if method.stages > 0 and settings.static_after_step == 0:
        return 0.0
    if method.collocation > 0 and settings.static_after_step == 0:  # works by its stages
        return (_STAGES_FACTOR * settings.accuracy) ** (1.0 / method.order)
    if settings.determinate == 0 and settings.stiff == 1:
        return 0.0  # other steps excite stiff vibrations, and these the accelerations
    return (_WORKS_FACTOR * settings.accuracy) ** (1.0 / min(method.order, 4))


@kernel
def exceeds_max_change(run, h):
    """Whether a controlled step of size h changed too much for its works.

    So it is if a driver jumps within it, or begins to move.
    """
    settings, tr = run.settings, run.work.trial
    most, span = _max_change(run.method, settings), settings.end - settings.start
    if most == 0.0 or settings.refinement > 0.0 or h <= _KINK_SHARE * span:
        return False
    change = h * rate_of_driven(run.system, run.state, tr.vd)
    if settings.determinate == 1:
        change = max(change, h * weighted_max(tr.v, run.system.weights))
    return change > _CHANGE_FACTOR * most


@kernel
def rate_of_driven(sys, st, vd):
    """Largest acceleration of driven coordinates over their largest velocities so far [1/s]."""
    largest, rate = 0.0, 0.0
    for i in range(vd.shape[0]):
        if sys.driven[i] == 1:
            largest = max(largest, st.v_scale[i])
    for i in range(vd.shape[0]):
        if sys.driven[i] == 1:
            change = sys.weights[i] * abs(vd[i])
            start = math.sqrt(_START * change)
            rate = max(rate, change / max(st.v_scale[i], _LEAST_DRIVEN_SHARE * largest, start))
    return rate


@kernel
def write_plan(settings, plan, st):
    """Append the time of the state to the plan, if the run follows none and there is room."""
    if settings.refinement == 0.0 and plan.used[0] < plan.knots.shape[0]:
        plan.knots[plan.used[0]] = st.t[0]
        plan.used[0] += 1


# Steps before and after an output whose multipliers are examined: two second differences each.
_ALTERNATION_STEPS = 3


@kernel
def watch_alternation(settings, times, st, alternation, h):
    """After a fixed step near an output: how much each multiplier alternates from step to step.

    If λ alternates by ±a, its second differences are ±4 a with alternating signs. So a quarter of
    the smaller one of two successive second differences of opposite sign is the amplitude; at the
    end of the run, where no further step follows, a quarter of the last one.
    """
    lam, before, earlier, bend = st.lam, st.lam_before, alternation.earlier, alternation.bend
    if settings.step == 0.0 or earlier.shape[0] == 0:
        return
    count, size = alternation.count, alternation.size
    due = is_output_due(settings, times, st, st.t[0], 0)
    count[1] = 0 if due else count[1] + 1
    ahead = is_output_due(settings, times, st, st.t[0] + _ALTERNATION_STEPS * settings.step, 0)
    count[0] = (
        count[0] + 1 if h == settings.step and (ahead or count[1] <= _ALTERNATION_STEPS) else 0
    )
    if count[0] == 0:
        return
    ends = st.t[0] >= settings.end - time_round_off(settings)  # no further difference follows
    for k in range(lam.shape[0]):
        now = lam[k] - 2.0 * before[k] + earlier[k]
        part = 0.0
        if count[0] >= _ALTERNATION_STEPS and (ends or now * bend[k] < 0.0):
            part = 0.25 * (abs(now) if ends else min(abs(now), abs(bend[k])))
        if part > size[k]:
            size[k], alternation.time[k] = part, st.t[0]
        bend[k], earlier[k] = now, before[k]
        alternation.low[k] = min(alternation.low[k], lam[k])
        alternation.high[k] = max(alternation.high[k], lam[k])


@kernel
def _plan_time(settings, plan, t):
    """Time at which a step from t ends by the refined plan [s]."""
    knots, n = plan.knots, plan.used[0] - 1
    m = max(math.ceil(n * settings.refinement - 1e-9), 1)
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= t:
            low = middle
        else:
            high = middle
    place = (low + (t - knots[low]) / (knots[low + 1] - knots[low])) * m / n
    j = math.floor(place + _MIN_PLAN_REMAINDER) + 1.0
    if j >= m:
        return knots[n]
    place = j * n / m
    k = min(int(place), n - 1)
    return knots[k] + (place - k) * (knots[k + 1] - knots[k])


@kernel
def judge_step(method, settings, st, error, status, h):
    """Acceptance test of a step of size h whose stages returned `status`.

    Returns SUCCESS: accept it. REPEAT: repeat it with the size in memory. STEP_TOO_SMALL: no
    smaller step is allowed, so the run ends.
    """
    memory, count = st.memory[0], st.count[0]
    if memory["steps_since"] > _MAX_STALLED_STEPS:
        return STEP_TOO_SMALL
    if status != SUCCESS:
        count["failed"] += 1
        memory["failures_since"] += 1.0
        if settings.step == 0.0 and memory["failures_since"] > _MAX_FAILED_STEPS:
            return STEP_TOO_SMALL
        memory["next_step"] = 0.5 * h if settings.step > 0.0 else 0.25 * h
    else:
        patience = _VELOCITY_ERROR_FACTOR if method.prefers_constant_step == 1 else 1.0
        ratio = _error_ratio(settings, error, patience)
        allowed = 1.0
        if _may_be_kink(method, memory, ratio, st.t[0], h):
            most = settings.tolerance * settings.rejection_factor
            allowed = (
                min(1.0, _KINK_ACCURACY_SHARE * settings.accuracy / most) if most > 0.0 else 1.0
            )
        span = settings.end - settings.start
        if ratio <= allowed or (ratio <= 1.0 and h <= _KINK_SHARE * span):
            memory["steps_at_jump"] = 0.0
            return SUCCESS
        if ratio < 1e9 and h <= _JUMP_SHARE * span:
            memory["steps_at_jump"] += 1.0
            return SUCCESS if memory["steps_at_jump"] <= _MAX_STEPS_AT_JUMP else STEP_TOO_SMALL
        count["rejected"] += 1
        power = 1 if memory["has_kink"] == 1.0 else method.error_order
        memory["next_step"] = h * max(_MIN_FACTOR, _SAFETY * (ratio / allowed) ** (-1.0 / power))
        memory["rejected_step"], memory["rejected_ratio"] = h, ratio
        memory["rejected_start"], memory["rejected_end"] = st.t[0], st.t[0] + h
    memory["factor_age"] = -1.0
    memory["contraction"] = 1.0
    memory["steps_until_growth"] = (
        _STEPS_WITHOUT_GROWTH if method.prefers_constant_step == 1 else 1.0
    )
    return STEP_TOO_SMALL if memory["next_step"] < _min_step(settings, st.t[0]) else REPEAT


@kernel
def _min_step(settings, t):
    """The smallest step that is tried at time t [s]."""
    if settings.step > 0.0:
        return _MIN_FIXED_SHARE * settings.step
    return _MIN_STEP_SHARE * max(settings.end - settings.start, abs(t))


@kernel
def _may_be_kink(method, memory, ratio, t, h):
    """Whether a force may jump or have a kink within the step, which the error estimate misses.

    Either the error is far larger than the one predicted from the step before, or errors of shorter
    steps within a rejected one fall more slowly than the order of the estimate says. An error that
    does not fall at all is noise, not a kink.
    """
    before = memory["rejected_step"]
    if method.order < HIGH_ORDER:
        return False
    if before == 0.0:
        last = memory["last_step"]
        if method.prefers_constant_step == 1 or not last > 0.0:
            return False
        expected = memory["error_ratio"] * (h / last) ** method.error_order
        return ratio > _SURPRISE_FACTOR * max(expected, _MIN_EXPECTED_RATIO)
    if before > _MIN_STEP_RATIO * h and ratio > 0.0 and t + h <= memory["rejected_end"]:
        slope = math.log(memory["rejected_ratio"] / ratio) / math.log(before / h)
        same = memory["rejected_start"] == t
        kinked = min(_LOST_ORDER_SHARE * method.error_order, _KINK_POWER if same else _JUMP_POWER)
        if _NOISE_POWER < slope < kinked:
            memory["has_kink"] = 1.0
    return memory["has_kink"] == 1.0


@kernel
def _error_ratio(settings, error, patience):
    """Estimated local error over the allowed one; for velocities `patience` times that is allowed.

    Not finite: 1e9. With fixed steps: 0.
    """
    if settings.step > 0.0:
        return 0.0
    ratio = max(error[0], error[1] / patience) / (settings.tolerance * settings.rejection_factor)
    return ratio if math.isfinite(ratio) and math.isfinite(error[1]) else 1e9


@kernel
def exact_time(settings, plan, time_events, st, h):
    """Time at the end of the step [s].

    A grid point, a time event, the end of a planned step or of the run is met exactly, without the
    round-off of t + h.
    """
    if (
        settings.step > 0.0
        and st.memory[0]["step_fraction"] + h / settings.step >= 1.0 - STEP_ROUND_OFF
    ):
        end = settings.start + (st.count[0]["fixed_steps"] + 1) * settings.step
        return settings.end if abs(settings.end - end) <= time_round_off(settings) else end
    if settings.step == 0.0:
        end = next_end(time_events, st.t[0], settings.end)
        if h == end - st.t[0]:
            return end
        if settings.refinement > 0.0:
            end = _plan_time(settings, plan, st.t[0])
            if h == end - st.t[0]:
                return end
    return st.t[0] + h


@kernel
def record_step(method, settings, st, error, h):
    """After an accepted step of size h: the next step size, the place in the grid, statistics."""
    memory, count = st.memory[0], st.count[0]
    if memory["last_step"] == 0.0:
        memory["smallest_step"] = h
    memory["steps_at_this_size"] = (
        memory["steps_at_this_size"] + 1.0 if h == memory["last_step"] else 0.0
    )
    memory["smallest_step"] = min(memory["smallest_step"], h)
    memory["largest_step"] = max(memory["largest_step"], h)
    memory["earlier_step"], memory["last_step"] = memory["last_step"], h
    if st.t[0] >= memory["rejected_end"]:
        memory["rejected_step"], memory["has_kink"] = 0.0, 0.0
    if settings.step > 0.0:
        memory["step_fraction"] += h / settings.step
        if memory["step_fraction"] >= 1.0 - STEP_ROUND_OFF:
            memory["step_fraction"] = 0.0
            memory["next_step"] = settings.step
            count["fixed_steps"] += 1
        return
    memory["steps_since"] += 1.0
    if st.t[0] - memory["recent_time"] > _STALL_SHARE * (settings.end - settings.start):
        memory["recent_time"], memory["steps_since"] = st.t[0], 0.0
    if st.t[0] - memory["failing_time"] > _FAILURE_SHARE * (settings.end - settings.start):
        memory["failing_time"], memory["failures_since"] = st.t[0], 0.0
    memory["velocity_error"] = error[1] / h**3
    memory["error_sum"] += error[0]
    ratio = max(_error_ratio(settings, error, 1.0), 1e-12)
    memory["error_ratio"] = ratio
    factor = _SAFETY * ratio ** (-1.0 / method.error_order)
    calm = memory["steps_until_growth"] == 0.0
    short = method.collocation > 0 and settings.fractional == 0
    memory["steps_until_growth"] = max(memory["steps_until_growth"] - 1.0, 0.0)
    if method.prefers_constant_step == 0:
        most = _MAX_FACTOR if settings.static_after_step == 0 else _MAX_FACTOR_STATIC
        longer = h * (min(factor, most) if calm else min(factor, 1.0))
        # at rest but for round-off: the rate that limits stable_step is not known
        least = _NOISE_GROWTH * h if ratio < _NOISE_RATIO else 0.0
        memory["next_step"] = min(longer, max(memory["stable_step"], least))
    elif short and h < _SHORT_BY_EVENT * memory["step_before_event"]:
        memory["next_step"] = max(memory["next_step"], h * min(factor, _MAX_FACTOR))
        memory["steps_until_growth"] = 0.0
    elif factor > _GROW_ABOVE and memory["steps_until_growth"] == 0.0:
        memory["next_step"] = max(memory["next_step"], h * min(factor, _MAX_FACTOR_COSTLY))
    elif factor < _SHRINK_BELOW:
        memory["next_step"] = h * factor
    memory["next_step"] = max(memory["next_step"], _min_step(settings, st.t[0]))
