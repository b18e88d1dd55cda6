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

from flexmb.engine.algebra.vector import weighted_size, zero
from flexmb.engine.events import next_end
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import FINE, REPEAT, ROUND_OFF, TOO_SMALL, round_off
from flexmb.engine.state import Run

# A fixed step is halved this often, one under error control may fall to this share of the run.
_SMALLEST_PART = 1.0 / 1024.0
_SMALLEST_SHARE = 1e-12
# So many steps within this share of the run would be 1e11 in all: its end is out of reach. So many
# that fail while it advances by no more than that: an event or a jump takes less than fifty.
_MOST_STEPS, _NO_ADVANCE = 1000.0, 1e-8
_MOST_FAILURES, _HARDLY_ADVANCES = 100.0, 1e-6
# At a jump of forces the error of any step is of its own size; these shares of the run will do: if
# the error is what is allowed anywhere, and if it is not. More than so many in a row are no jump.
_KINK_SHARE, _JUMP_SHARE, _MOST_AT_JUMP = 1e-9, 1e-11, 10.0
# Where forces jump or have a kink the error of a step is this many times what the step before tells
# (or what is not worth a look), and falls slower than by this share of its order and by this power
# (where steps from other times are compared: by that of a jump), yet faster than noise. Estimates
# miss it, so that it must be this share of the accuracy asked for.
_SURPRISE, _SMALL, _ORDER_LOST, _KINKED, _JUMPED, _NOISE = 30.0, 1e-3, 0.5, 2.6, 1.4, 0.3
_AT_KINK = 0.004
_HIGH_ORDER = 5  # of a method that has more to lose at a kink than its order
_SHORTER = 1.5  # times, at least, for errors to be compared
# One under error control is at most this share of the run, so that what begins to happen to a scene
# at rest is seen.
_LONGEST_SHARE = 0.1
_SAFETY = 0.9
# The last one where rates of a deformation follow from the last points.
_LEAST, _MOST, _MOST_FOLLOWED = 0.2, 5.0, 3.0
# Where a change of the step is dear: most that it grows, and what is not worth a change.
_MOST_KEPT, _KEEP, _SHRINK = 2.0, 1.25, 0.8
# Share of what is allowed below which an error is noise, and growth that is safe then.
_CALM, _CALM_GROWTH = 1e-6, 1.2
# Velocities, whose estimate rings after a change of the step, may be off by this many times more
# before a step is rejected; the next one is shorter anyhow.
_PATIENCE = 4.0
# Steps after a rejection before the step grows again: until estimates have stopped to ring.
_REST = 10.0
# Share of the speed so far that still counts after a step, where only work is integrated.
_FADE = 0.8
# Times the longest way, from which a step that went as far is repeated shorter.
_FURTHER = 2.0
# What is left of a step of the plan and not worth a step of its own.
_NEARLY = 0.1
# Motion counts as this share at least of the largest one: by low order of that of the same part
# of the model, by all of any.
_LEAST_SHARE, _NOTHING_SHARE = 1e-3, 1e-12


@kernel
def begin_steps(sys, settings, st):
    """Before the first step: the step to try, and motion so far at least that of nothing."""
    if st.memory[0]["next_step"] > 0.0:
        return
    st.memory[0]["next_step"] = settings.step
    speed, least = weighted_size(st.v, sys.weights), settings.least_motion
    if settings.step == 0.0:
        change = weighted_size(st.vd, sys.weights)
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
    return st.t[0] >= settings.end - round_off(settings)


@kernel
def is_output_due(settings, times, st, t, n):
    """Whether the next output but n is due at time t."""
    k = st.count[0]["outputs"] + n
    return k < times.shape[0] and times[k] <= t + round_off(settings)


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
        h = min(h, settings.turn / st.memory[0]["angular_velocity"])
    most = _longest_way(method, settings)
    if most > 0.0 and st.memory[0]["recent_speed"] > 0.0:
        h = min(h, most / max(st.memory[0]["recent_speed"], st.memory[0]["usual_speed"]))
        change = weighted_size(st.vd, weights)
        h = min(h, math.sqrt(2.0 * most / change)) if change > 0.0 else h
    left = next_end(time_events, st.t[0], settings.end) - st.t[0]
    follows = settings.refinement > 0.0
    if follows:
        left = min(left, _planned(settings, plan, st.t[0]) - st.t[0])
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left and not follows else h


@kernel
def _longest_way(method, settings):
    """How far a step may move the model, weighted, where only works are integrated; 0: any way.

    Powers of the method's order give the work of the drivers.
    """
    if settings.determined == 0 or (method.stages > 0 and settings.follow == 0):
        return 0.0
    return (12.0 * settings.accuracy) ** (1.0 / min(method.order, 4))


@kernel
def goes_too_far(method, settings, speed, h):
    """Whether a controlled step went further than works allow, as a driver leaps within it."""
    most, span = _longest_way(method, settings), settings.end - settings.start
    if most == 0.0 or settings.refinement > 0.0:
        return False
    return h > _KINK_SHARE * span and speed * h > _FURTHER * most


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
    ends = st.t[0] >= settings.end - round_off(settings)  # no more will tell
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
    """FINE: accept it; REPEAT it with the step in memory; TOO_SMALL: there is no such step."""
    memory, count = st.memory[0], st.count[0]
    if memory["steps_since"] > _MOST_STEPS:
        return TOO_SMALL
    if status != FINE:
        count["failed"] += 1
        memory["failures_since"] += 1.0
        if settings.step == 0.0 and memory["failures_since"] > _MOST_FAILURES:
            return TOO_SMALL
        memory["next_step"] = 0.5 * h if settings.step > 0.0 else 0.25 * h
    else:
        patience = _PATIENCE if method.keeps_step == 1 else 1.0
        ratio = _ratio(settings, error, patience)
        allowed = 1.0
        if _may_be_kink(method, memory, ratio, st.t[0], h):
            most = settings.tolerance * settings.slack
            allowed = min(1.0, _AT_KINK * settings.accuracy / most) if most > 0.0 else 1.0
        span = settings.end - settings.start
        if ratio <= allowed or (ratio <= 1.0 and h <= _KINK_SHARE * span):
            memory["steps_at_jump"] = 0.0
            return FINE
        if ratio < 1e9 and h <= _JUMP_SHARE * span:
            memory["steps_at_jump"] += 1.0
            return FINE if memory["steps_at_jump"] <= _MOST_AT_JUMP else TOO_SMALL
        count["rejected"] += 1
        power = 1 if memory["has_kink"] == 1.0 else method.error_order
        memory["next_step"] = h * max(_LEAST, _SAFETY * (ratio / allowed) ** (-1.0 / power))
        memory["rejected_step"], memory["rejected_ratio"] = h, ratio
        memory["rejected_start"], memory["rejected_end"] = st.t[0], st.t[0] + h
    memory["factor_age"] = -1.0
    memory["contraction"] = 1.0
    memory["steps_until_growth"] = _REST if method.keeps_step == 1 else 1.0
    return TOO_SMALL if memory["next_step"] < _smallest(settings, st.t[0]) else REPEAT


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
    if method.order < _HIGH_ORDER:
        return False
    if before == 0.0:
        last = memory["last_step"]
        if method.keeps_step == 1 or not last > 0.0:
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
    ratio = max(error[0], error[1] / patience) / (settings.tolerance * settings.slack)
    return ratio if math.isfinite(ratio) and math.isfinite(error[1]) else 1e9


@kernel
def exact_time(settings, plan, time_events, st, h):
    """Time after the step: grid points, kinks and the end without the round-off of a sum."""
    if settings.step > 0.0 and st.memory[0]["step_fraction"] + h / settings.step >= 1.0 - ROUND_OFF:
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
        if memory["step_fraction"] >= 1.0 - ROUND_OFF:
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
    if method.keeps_step == 0:
        most = _MOST if settings.follow == 0 else _MOST_FOLLOWED
        longer = h * (min(factor, most) if calm else min(factor, 1.0))
        # what is at rest but for round-off has no rate to tell
        least = _CALM_GROWTH * h if ratio < _CALM else 0.0
        memory["next_step"] = min(longer, max(memory["stable_step"], least))
    elif factor > _KEEP and memory["steps_until_growth"] == 0.0:
        memory["next_step"] = max(memory["next_step"], h * min(factor, _MOST_KEPT))
    elif factor < _SHRINK:
        memory["next_step"] = h * factor
    memory["next_step"] = max(memory["next_step"], _smallest(settings, st.t[0]))


@unit
def follow_motion(run: Run) -> int:
    """The largest motion from the first position and the largest speed of every coordinate so far.

    The coordinates of a translation and of a rotation count together. Of a flexible body nobody
    sees frame and modes, but its points, which are as far off as they are together: all of them
    count with the motion of the points.
    """
    st, settings, w = run.state, run.settings, run.system.weights
    bodies, coordinates = run.system.parts.bodies, run.system.parts.coordinates
    q, q_first, v, memory = st.q, st.q_first, st.v, st.memory[0]
    memory["angular_velocity"] = 0.0
    for k in range(bodies.shape[0]):
        iq, iv, m = bodies[k]["iq"], bodies[k]["iv"], bodies[k]["m"]
        _follow(st, w, iq, iv, 3)
        turn = 0.0
        for i in range(3, 7):  # Euler parameters change by half the angle
            turn = max(turn, 2.0 * abs(q[iq + i] - q_first[iq + i]))
        rate = max(abs(v[iv + 3]), abs(v[iv + 4]), abs(v[iv + 5]))
        _raise(st, iv + 3, 3, turn, rate)
        memory["angular_velocity"] = max(memory["angular_velocity"], rate)
        _follow(st, w, iq + 7, iv + 6, m)
        if m > 0:
            _join(st, iv, m, _gyration(bodies[k]) * w[iv])
    for k in range(coordinates.shape[0]):
        _follow(st, w, coordinates[k]["iq"], coordinates[k]["iv"], 1)
    motion, speed = 0.0, 0.0
    for i in range(v.shape[0]):
        motion, speed = max(motion, st.motion[i]), max(speed, st.speed[i])
    memory["max_displacement"] = max(motion, settings.least_motion)
    span = settings.end - settings.start
    speed = max(speed, memory["max_displacement"] / span)
    now = weighted_size(v, w)
    memory["max_velocity"] = max(memory["max_velocity"], now)
    memory["recent_speed"] = max(_FADE * memory["recent_speed"], now)
    if run.method.order < _HIGH_ORDER:
        _raise_to_part(run, st.motion)
        _raise_to_part(run, st.speed)
    for i in range(v.shape[0]):
        st.motion[i] = max(st.motion[i], _NOTHING_SHARE * memory["max_displacement"])
        st.speed[i] = max(st.speed[i], _NOTHING_SHARE * speed, st.motion[i] / span)
    return FINE


@kernel
def _raise_to_part(run, scale):
    """Let motions or speeds be a share of the largest one of points of their part of the model."""
    bodies, coordinates = run.system.parts.bodies, run.system.parts.coordinates
    part, w, trial = run.system.part, run.system.weights, run.work.trial
    points, turns, reach = trial.spare, trial.dq, trial.res  # by part
    zero(points)
    zero(turns)
    zero(reach)
    for k in range(bodies.shape[0]):
        iv = bodies[k]["iv"]
        p, own = part[iv + 3], _gyration(bodies[k]) * w[iv]
        points[p] = max(points[p], scale[iv], own * scale[iv + 3])
        turns[p], reach[p] = max(turns[p], scale[iv + 3]), max(reach[p], own)
    for k in range(coordinates.shape[0]):
        iv = coordinates[k]["iv"]
        points[part[iv]] = max(points[part[iv]], scale[iv])
    for k in range(bodies.shape[0]):
        iv, m = bodies[k]["iv"], bodies[k]["m"]
        p = part[iv + 3]
        turn = max(turns[p], points[p] / reach[p]) if reach[p] > 0.0 else turns[p]
        for i in range(iv, iv + 6 + m):
            least = turn if iv + 3 <= i < iv + 6 else points[p]
            scale[i] = max(scale[i], _LEAST_SHARE * least)
    for k in range(coordinates.shape[0]):
        iv = coordinates[k]["iv"]
        scale[iv] = max(scale[iv], _LEAST_SHARE * max(points[part[iv]], turns[part[iv]]))


@kernel
def _follow(st, weights, iq, iv, n):
    """Motion and speed of n coordinates that count together."""
    motion, speed = 0.0, 0.0
    for i in range(n):
        motion = max(motion, weights[iv + i] * abs(st.q[iq + i] - st.q_first[iq + i]))
        speed = max(speed, weights[iv + i] * abs(st.v[iv + i]))
    _raise(st, iv, n, motion, speed)


@kernel
def _gyration(body):
    """Radius of gyration about the origin of the frame [m]."""
    S0 = body["S0"]
    return math.sqrt((S0[0, 0] + S0[1, 1] + S0[2, 2]) / body["mass"])


@kernel
def _join(st, iv, m, reach):
    """Let all coordinates of a flexible body count with the motion of its points, `reach` away."""
    motion = max(st.motion[iv], reach * st.motion[iv + 3], st.motion[iv + 6])
    speed = max(st.speed[iv], reach * st.speed[iv + 3], st.speed[iv + 6])
    _raise(st, iv, 3, motion, speed)
    _raise(st, iv + 3, 3, motion / reach, speed / reach)
    _raise(st, iv + 6, m, motion, speed)


@kernel
def _raise(st, iv, n, motion, speed):
    """Let the scales of n coordinates be these at least."""
    for i in range(iv, iv + n):
        st.motion[i], st.speed[i] = max(st.motion[i], motion), max(st.speed[i], speed)
