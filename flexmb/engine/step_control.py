"""Which step to try next: fixed steps with halving where one fails, or error control.

Fixed: a step that fails is repeated in halves, quarters, ... until the next grid point is reached.
Error control: the local error of a step, of every body, mode and scalar coordinate relative to its
motion so far, is kept below a tolerance; the step follows by the order of the estimate. Where a
change costs a factorisation and lets the estimate ring, steps grow by a quarter at least, and not
right after a rejection. Steps under error control end at known kinks of functions of time, and
never turn a body by more than a radian, so that turns can be counted. A run that follows the plan
of another one takes as many times more steps as it is told, spread alike, and shorter ones where
its own estimate asks for that. Where a force jumps or has a kink, which shows in errors that fall
slower than the order says, a step must leave a small share of the accuracy.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import weighted_max
from flexmb.engine.events import next_end
from flexmb.engine.jit import kernel
from flexmb.engine.method import (
    HIGH_ORDER,
    REPEAT,
    STEP_ROUND_OFF,
    STEP_TOO_SMALL,
    SUCCESS,
    time_round_off,
)

# A fixed step is halved this often, one under error control may fall to this share of the run.
_SMALLEST_PART = 1.0 / 1024.0
_SMALLEST_SHARE = 1e-12
# So many steps within this share of the run would be 1e11 in all: its end is out of reach. So many
# that fail while it advances by no more than that: an event or a jump takes less than fifty.
_MOST_STEPS, _NO_ADVANCE = 1000.0, 1e-8
_MOST_FAILURES, _HARDLY_ADVANCES = 100.0, 1e-6
# Short steps at a jump of a force (shares of the run): below _KINK_SHARE the usual tolerance holds;
# below _JUMP_SHARE any error is accepted, in at most _MOST_AT_JUMP steps in a row.
_KINK_SHARE, _JUMP_SHARE, _MOST_AT_JUMP = 1e-9, 1e-11, 10.0
# A kink or jump within a step is suspected if its error is _SURPRISE times the predicted one (at
# least _SMALL), or if after a rejection it falls with a power of the step above _NOISE and below
# _ORDER_LOST times the order and _KINKED (_JUMPED if the rejected step began at another time).
# Estimates miss a kink: then they must be below _AT_KINK × accuracy.
_SURPRISE, _SMALL, _ORDER_LOST, _KINKED, _JUMPED, _NOISE = 30.0, 1e-3, 0.5, 2.6, 1.4, 0.3
_AT_KINK = 0.004
_SHORTER = 1.5  # times, at least, for errors to be compared
# One under error control is at most this share of the run, so that what begins to happen to a scene
# at rest is seen.
_LONGEST_SHARE = 0.1
_SAFETY = 0.9
# The last one where rates of a deformation follow from the last points.
_MIN_FACTOR, _MAX_FACTOR, _MOST_FOLLOWED = 0.2, 5.0, 3.0
# Where a change of the step is dear: most that it grows, and what is not worth a change.
_MAX_FACTOR_KEPT, _GROW_ABOVE, _SHRINK_BELOW = 2.0, 1.25, 0.8
# Share of what is allowed below which an error is noise, and growth that is safe then.
_NOISE_RATIO, _NOISE_GROWTH = 1e-6, 1.2
# Velocities, whose estimate rings after a change of the step, may be off by this many times more
# before a step is rejected; the next one is shorter anyhow.
_VELOCITY_ERROR_FACTOR = 4.0
# Steps after a rejection before the step grows again: until estimates have stopped to ring.
_STEPS_WITHOUT_GROWTH = 10.0
# Times the longest way, from which a step that went as far is repeated shorter.
_DISPLACEMENT_FACTOR = 2.0
# What is left of a step of the plan and not worth a step of its own.
_NEARLY = 0.1


@kernel
def select_initial_step(sys, settings, st):
    """Before the first step: the step to try, and motion so far at least that of nothing."""
    if st.memory[0]["next_step"] > 0.0:
        return
    st.memory[0]["next_step"] = settings.step
    speed, least = weighted_max(st.v, sys.weights), settings.least_motion
    if settings.step == 0.0:
        change = weighted_max(st.vd, sys.weights)
        h = min(0.1 * settings.interval, 0.01 / speed if speed > 0.0 else math.inf)
        if change > 0.0:
            h = min(h, math.sqrt(2.0 * math.sqrt(settings.tolerance * least) / change))
        st.memory[0]["next_step"] = max(h, _SMALLEST_SHARE * (settings.end - settings.start))
        if settings.refinement > 0.0:
            st.memory[0]["next_step"] = settings.end - settings.start


@kernel
def is_at_end(settings, plan, st):
    """Whether the run has reached its end, or that of the plan that it follows."""
    if settings.refinement > 0.0:
        return plan.used[0] == 0 or st.t[0] >= plan.knots[plan.used[0] - 1]
    return st.t[0] >= settings.end - time_round_off(settings)


@kernel
def is_output_due(settings, times, st, t, n):
    """Whether the next output but n is due at time t."""
    k = st.count[0]["outputs"] + n
    return k < times.shape[0] and times[k] <= t + time_round_off(settings)


@kernel
def propose_step(method, settings, plan, time_events, st, times, room, weights):
    """The step to try; `room` is how many more of the outputs at `times` there is space for."""
    h = st.memory[0]["next_step"]
    if settings.step > 0.0:
        return h
    first = st.count[0]["outputs"] + max(room - 2, 1)
    if first < times.shape[0]:
        h = min(h, times[first] - st.t[0])
    h = min(h, _LONGEST_SHARE * (settings.end - settings.start))
    if st.memory[0]["angular_velocity"] > 0.0:
        h = min(h, settings.max_rotation / st.memory[0]["angular_velocity"])
    most = _max_displacement(method, settings)
    if most > 0.0 and st.memory[0]["recent_speed"] > 0.0:
        h = min(h, most / max(st.memory[0]["recent_speed"], st.memory[0]["usual_speed"]))
        change = weighted_max(st.vd, weights)
        h = min(h, math.sqrt(2.0 * most / change)) if change > 0.0 else h
    left = next_end(time_events, st.t[0], settings.end) - st.t[0]
    follows = settings.refinement > 0.0
    if follows:
        left = min(left, _planned(settings, plan, st.t[0]) - st.t[0])
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left and not follows else h


@kernel
def _max_displacement(method, settings):
    """How far a step may move the model, weighted, where only works are integrated; 0: any way.

    Powers of the method's order give the work of the drivers.
    """
    if settings.determinate == 0 or (method.stages > 0 and settings.static_after_step == 0):
        return 0.0
    return (12.0 * settings.accuracy) ** (1.0 / min(method.order, 4))


@kernel
def exceeds_max_displacement(method, settings, speed, h):
    """Whether a controlled step went further than works allow, as a driver leaps within it."""
    most, span = _max_displacement(method, settings), settings.end - settings.start
    if most == 0.0 or settings.refinement > 0.0:
        return False
    return h > _KINK_SHARE * span and speed * h > _DISPLACEMENT_FACTOR * most


@kernel
def write_plan(settings, plan, st):
    """Keep the time, if there is room for a plan and the run follows none."""
    if settings.refinement == 0.0 and plan.used[0] < plan.knots.shape[0]:
        plan.knots[plan.used[0]] = st.t[0]
        plan.used[0] += 1


# Steps about an output whose multipliers are looked at: two second differences.
_NEAR = 3


@kernel
def watch_alternation(settings, times, st, alternation, h):
    """After a fixed step: what of the multipliers alternates, if an output is near."""
    lam, before, earlier, bend = st.lam, st.lam_before, alternation.earlier, alternation.bend
    if settings.step == 0.0 or earlier.shape[0] == 0:
        return
    count, size = alternation.count, alternation.size
    due = is_output_due(settings, times, st, st.t[0], 0)
    count[1] = 0 if due else count[1] + 1
    ahead = is_output_due(settings, times, st, st.t[0] + _NEAR * settings.step, 0)
    count[0] = count[0] + 1 if h == settings.step and (ahead or count[1] <= _NEAR) else 0
    if count[0] == 0:
        return
    ends = st.t[0] >= settings.end - time_round_off(settings)  # no more will tell
    for k in range(lam.shape[0]):
        now = lam[k] - 2.0 * before[k] + earlier[k]
        part = 0.0
        if count[0] >= _NEAR and (ends or now * bend[k] < 0.0):
            part = 0.25 * (abs(now) if ends else min(abs(now), abs(bend[k])))
        if part > size[k]:
            size[k], alternation.time[k] = part, st.t[0]
        bend[k], earlier[k] = now, before[k]
        alternation.low[k] = min(alternation.low[k], lam[k])
        alternation.high[k] = max(alternation.high[k], lam[k])


@kernel
def _planned(settings, plan, t):
    """Time at which a step from t ends by the plan."""
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
    j = math.floor(place + _NEARLY) + 1.0
    if j >= m:
        return knots[n]
    place = j * n / m
    k = min(int(place), n - 1)
    return knots[k] + (place - k) * (knots[k + 1] - knots[k])


@kernel
def judge_step(method, settings, st, error, status, h):
    """SUCCESS: accept it; REPEAT it with the step in memory; STEP_TOO_SMALL: there is none."""
    memory, count = st.memory[0], st.count[0]
    if memory["steps_since"] > _MOST_STEPS:
        return STEP_TOO_SMALL
    if status != SUCCESS:
        count["failed"] += 1
        memory["failures_since"] += 1.0
        if settings.step == 0.0 and memory["failures_since"] > _MOST_FAILURES:
            return STEP_TOO_SMALL
        memory["next_step"] = 0.5 * h if settings.step > 0.0 else 0.25 * h
    else:
        patience = _VELOCITY_ERROR_FACTOR if method.prefers_constant_step == 1 else 1.0
        ratio = _ratio(settings, error, patience)
        allowed = 1.0
        if _may_be_kink(method, memory, ratio, st.t[0], h):
            most = settings.tolerance * settings.rejection_factor
            allowed = min(1.0, _AT_KINK * settings.accuracy / most) if most > 0.0 else 1.0
        span = settings.end - settings.start
        if ratio <= allowed or (ratio <= 1.0 and h <= _KINK_SHARE * span):
            memory["steps_at_jump"] = 0.0
            return SUCCESS
        if ratio < 1e9 and h <= _JUMP_SHARE * span:
            memory["steps_at_jump"] += 1.0
            return SUCCESS if memory["steps_at_jump"] <= _MOST_AT_JUMP else STEP_TOO_SMALL
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
    return STEP_TOO_SMALL if memory["next_step"] < _smallest(settings, st.t[0]) else REPEAT


@kernel
def _smallest(settings, t):
    """The smallest step that is tried."""
    if settings.step > 0.0:
        return _SMALLEST_PART * settings.step
    return _SMALLEST_SHARE * max(settings.end - settings.start, abs(t))


@kernel
def _may_be_kink(method, memory, ratio, t, h):
    """Whether a force may jump or have a kink within the step, which its estimate misses.

    The error is far from what the step before tells, or that of shorter steps within one that was
    rejected falls slower than the method's order says; what does not fall at all is noise.
    """
    before = memory["rejected_step"]
    if method.order < HIGH_ORDER:
        return False
    if before == 0.0:
        last = memory["last_step"]
        if method.prefers_constant_step == 1 or not last > 0.0:
            return False
        expected = memory["error_ratio"] * (h / last) ** method.error_order
        return ratio > _SURPRISE * max(expected, _SMALL)
    if before > _SHORTER * h and ratio > 0.0 and t + h <= memory["rejected_end"]:
        slope = math.log(memory["rejected_ratio"] / ratio) / math.log(before / h)
        same = memory["rejected_start"] == t
        kinked = min(_ORDER_LOST * method.error_order, _KINKED if same else _JUMPED)
        if _NOISE < slope < kinked:
            memory["has_kink"] = 1.0
    return memory["has_kink"] == 1.0


@kernel
def _ratio(settings, error, patience):
    """Error over what is allowed; that of velocities over `patience` times as much."""
    if settings.step > 0.0:
        return 0.0
    ratio = max(error[0], error[1] / patience) / (settings.tolerance * settings.rejection_factor)
    return ratio if math.isfinite(ratio) and math.isfinite(error[1]) else 1e9


@kernel
def exact_time(settings, plan, time_events, st, h):
    """Time after the step: grid points, kinks and the end without the round-off of a sum."""
    if (
        settings.step > 0.0
        and st.memory[0]["step_fraction"] + h / settings.step >= 1.0 - STEP_ROUND_OFF
    ):
        return settings.start + (st.count[0]["fixed_steps"] + 1) * settings.step
    if settings.step == 0.0:
        end = next_end(time_events, st.t[0], settings.end)
        if h == end - st.t[0]:
            return end
        if settings.refinement > 0.0:
            end = _planned(settings, plan, st.t[0])
            if h == end - st.t[0]:
                return end
    return st.t[0] + h


@kernel
def record_step(method, settings, st, error, h):
    """After an accepted step: the next one, the place in the grid, statistics."""
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
    if st.t[0] - memory["recent_time"] > _NO_ADVANCE * (settings.end - settings.start):
        memory["recent_time"], memory["steps_since"] = st.t[0], 0.0
    if st.t[0] - memory["failing_time"] > _HARDLY_ADVANCES * (settings.end - settings.start):
        memory["failing_time"], memory["failures_since"] = st.t[0], 0.0
    memory["velocity_error"] = error[1] / h**3
    memory["error_sum"] += error[0]
    ratio = max(_ratio(settings, error, 1.0), 1e-12)
    memory["error_ratio"] = ratio
    factor = _SAFETY * ratio ** (-1.0 / method.error_order)
    calm = memory["steps_until_growth"] == 0.0
    memory["steps_until_growth"] = max(memory["steps_until_growth"] - 1.0, 0.0)
    if method.prefers_constant_step == 0:
        most = _MAX_FACTOR if settings.static_after_step == 0 else _MOST_FOLLOWED
        longer = h * (min(factor, most) if calm else min(factor, 1.0))
        # what is at rest but for round-off has no rate to tell
        least = _NOISE_GROWTH * h if ratio < _NOISE_RATIO else 0.0
        memory["next_step"] = min(longer, max(memory["stable_step"], least))
    elif factor > _GROW_ABOVE and memory["steps_until_growth"] == 0.0:
        memory["next_step"] = max(memory["next_step"], h * min(factor, _MAX_FACTOR_KEPT))
    elif factor < _SHRINK_BELOW:
        memory["next_step"] = h * factor
    memory["next_step"] = max(memory["next_step"], _smallest(settings, st.t[0]))
