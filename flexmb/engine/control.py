"""Which step to try next: fixed steps with halving where one fails, or error control.

Fixed: a step that fails is repeated in halves, quarters, ... until the next grid point is reached.
Error control: the local error of a step, relative to the motion so far, is kept below a tolerance.
Its third root rules the step, as the error of both methods is of order h³; the step grows only by a
quarter at least, because each change costs a factorisation, and not right after a rejection, while
estimates still ring. Steps under error control end at known kinks of functions of time (`kinks`).
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.vector import weighted_size
from flexmb.engine.method import (
    AGE,
    CALM,
    CONTRACTION,
    ERROR_SUM,
    FAILED,
    FINE,
    GREATEST_STEP,
    GRID,
    JERK_ERROR,
    LAST_STEP,
    LEAST_STEP,
    MOTION,
    OUTPUTS,
    PART,
    REJECTED,
    REPEAT,
    SHARE,
    SINCE,
    SPEED,
    STEP,
    TOO_SMALL,
)
from flexmb.engine.time_events import next_end

# A fixed step is halved this often, one under error control may fall to this share of the run.
_SMALLEST_PART = 1.0 / 1024.0
_SMALLEST_SHARE = 1e-12
# At a jump of forces the error of any step is of its own size; this share of the run will do.
_JUMP_SHARE = 1e-9
# One under error control is at most this share of the run, so that what begins to happen to a scene
# at rest is seen.
_LONGEST_SHARE = 0.01
_ROUND_OFF = 1e-6  # parts of a fixed step are powers of a half, so this is far below them
_SAFETY = 0.9
_LEAST, _MOST, _KEEP, _SHRINK = 0.2, 2.0, 1.25, 0.8
# Velocities, whose estimate rings after a change of the step, may be off by this many times more
# before a step is rejected; the next one is shorter anyhow.
_PATIENCE = 4.0
# Steps after a rejection before the step grows again: until estimates have stopped to ring.
_REST = 10.0
# Error of the order-3 method over the 4/3 power of the measured one (oscillator, pendulum: 3 to 7).
_THIRD = 4.0
# From this share of the run on the error in the end is extrapolated; it reduces the tolerance to
# this share at most.
_LOOK_AHEAD = 0.02
_LEAST_SHARE = 1e-6
# Motion of the model below which it counts as at rest, over its size.
_AT_REST = 1e-6


@kernel
def begin(sys, settings, st):
    """Before the first step: step to try, and motion so far at least that of nothing."""
    if st.memory[STEP] > 0.0:
        return
    st.memory[STEP] = settings.step
    st.memory[MOTION] = _AT_REST
    speed = weighted_size(st.v, sys.weights)
    st.memory[SPEED] = speed
    if settings.step == 0.0:
        change = weighted_size(st.vd, sys.weights)
        h = 0.1 * settings.interval
        if speed > 0.0:
            h = min(h, 0.01 / speed)
        if change > 0.0:
            h = min(h, math.sqrt(2.0 * math.sqrt(settings.tolerance * _AT_REST) / change))
        st.memory[STEP] = max(h, _SMALLEST_SHARE * (settings.end - settings.start))


@kernel
def at_end(settings, st):
    """Whether the run has reached its end."""
    return st.t[0] >= settings.end - 1e-9 * _least_interval(settings)


@kernel
def _least_interval(settings):
    return settings.step if settings.step > 0.0 else settings.interval


@kernel
def proposed(settings, time_events, st, room):
    """The step to try; `room` is how many more outputs there is space for."""
    h = st.memory[STEP]
    if settings.step > 0.0:
        return h
    h = min(h, max(room - 2, 1) * settings.interval)
    h = min(h, _LONGEST_SHARE * (settings.end - settings.start))
    if settings.determined == 1 and st.memory[SPEED] > 0.0:
        # Nothing is integrated but the work of the drivers, by the trapezoidal rule.
        h = min(h, math.sqrt(12.0 * settings.accuracy) / st.memory[SPEED])
    left = next_end(time_events, st.t[0], settings.end) - st.t[0]
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


@kernel
def rejected(settings, st, error, status, h):
    """FINE: accept it; REPEAT it with the step in memory; TOO_SMALL: there is no such step."""
    memory, count = st.memory, st.count
    if status != FINE:
        count[FAILED] += 1
        memory[STEP] = 0.5 * h if settings.step > 0.0 else 0.25 * h
    else:
        ratio = _ratio(settings, memory, error, _PATIENCE)
        if ratio <= 1.0 or (h <= _JUMP_SHARE * (settings.end - settings.start) and ratio < 1e9):
            return FINE
        count[REJECTED] += 1
        memory[STEP] = h * max(_LEAST, _SAFETY * ratio ** (-1.0 / 3.0))
    memory[AGE] = -1.0
    memory[CONTRACTION] = 1.0
    memory[CALM] = _REST
    smallest = _SMALLEST_PART * settings.step
    if settings.step == 0.0:
        smallest = _SMALLEST_SHARE * max(settings.end - settings.start, abs(st.t[0]))
    return TOO_SMALL if memory[STEP] < smallest else REPEAT


@kernel
def _ratio(settings, memory, error, patience):
    """Error over what is allowed; that of velocities over `patience` times as much."""
    if settings.step > 0.0:
        return 0.0
    ratio = _size(memory, error, patience) / (settings.tolerance * memory[SHARE] * memory[MOTION])
    return ratio if math.isfinite(ratio) else 1e9


@kernel
def _size(memory, error, patience):
    """Local error of positions, or as much of the motion as that of velocities is of the speed."""
    if memory[SPEED] > 0.0:
        return max(error[0], error[1] / (patience * memory[SPEED]) * memory[MOTION])
    return error[0]


@kernel
def exact_time(settings, time_events, st, h):
    """Time after the step: grid points, kinks and the end without the round-off of a sum."""
    if settings.step > 0.0 and st.memory[PART] + h / settings.step >= 1.0 - _ROUND_OFF:
        return settings.start + (st.count[GRID] + 1) * settings.step
    if settings.step == 0.0:
        end = next_end(time_events, st.t[0], settings.end)
        if h == end - st.t[0]:
            return end
    return st.t[0] + h


@kernel
def accepted(settings, st, error, h):
    """After an accepted step: the next one, the place in the grid, statistics."""
    memory, count = st.memory, st.count
    if memory[LAST_STEP] == 0.0:
        memory[LEAST_STEP] = h
    memory[SINCE] = memory[SINCE] + 1.0 if h == memory[LAST_STEP] else 0.0
    memory[LEAST_STEP] = min(memory[LEAST_STEP], h)
    memory[GREATEST_STEP] = max(memory[GREATEST_STEP], h)
    memory[LAST_STEP] = h
    if settings.step > 0.0:
        memory[PART] += h / settings.step
        if memory[PART] >= 1.0 - _ROUND_OFF:
            memory[PART] = 0.0
            memory[STEP] = settings.step
            count[GRID] += 1
        return
    memory[JERK_ERROR] = error[1] / h**3
    _add_up(settings, st, error)
    ratio = max(_ratio(settings, memory, error, 1.0), 1e-9)
    factor = min(_MOST, _SAFETY * ratio ** (-1.0 / 3.0))
    memory[CALM] = max(memory[CALM] - 1.0, 0.0)
    if factor > _KEEP and memory[CALM] == 0.0:
        memory[STEP] = max(memory[STEP], h * factor)
    elif factor < _SHRINK:
        memory[STEP] = h * factor


@kernel
def _add_up(settings, st, error):
    """Sum of the local errors: the error in the end, unless errors grow or decay by themselves.

    Where it would exceed the accuracy by then, the tolerance of the steps to come is reduced. A
    method of order 3 leaves the 4/3 power of the local error that is measured, which is that of a
    formula of order 2.
    """
    memory = st.memory
    size = _size(memory, error, 1.0)
    if settings.order == 3:
        size = _THIRD * memory[MOTION] * (size / memory[MOTION]) ** (4.0 / 3.0)
    memory[ERROR_SUM] += size
    done = (st.t[0] - settings.start) / (settings.end - settings.start)
    if done > _LOOK_AHEAD:
        ahead = memory[ERROR_SUM] / (memory[MOTION] * done)
        if ahead > settings.accuracy:
            memory[SHARE] = max((settings.accuracy / ahead) ** 3, _LEAST_SHARE)
        else:
            memory[SHARE] = 1.0


@kernel
def follow_motion(sys, st):
    """The largest speed, and motion from the first position over the model size, at most one."""
    st.memory[SPEED] = max(st.memory[SPEED], weighted_size(st.v, sys.weights))
    if st.memory[MOTION] >= 1.0:
        return
    size = st.memory[MOTION]
    bodies, weights = sys.parts.bodies, sys.weights
    q, q_first = st.q, st.q_first
    for k in range(bodies.shape[0]):
        iq, iv = bodies[k]["iq"], bodies[k]["iv"]
        for i in range(7 + bodies[k]["m"]):
            # Euler parameters change by half the angle.
            w = weights[iv + i] if i < 3 else 2.0 if i < 7 else weights[iv + i - 1]
            size = max(size, w * abs(q[iq + i] - q_first[iq + i]))
    st.memory[MOTION] = min(size, 1.0)


@kernel
def next_output(settings, st):
    """Time of the next output."""
    return settings.start + st.count[OUTPUTS] * settings.interval
