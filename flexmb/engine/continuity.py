"""Whether a point of a kinematic analysis continues the motion, and the work up to it.

With the prediction h v + h²/2 v̇ and a motion without jumps, the solution is off by h²/6 (v̇₁ − v̇₀)
to the next order; on another branch of the mechanism it is off by the distance of the branches,
however small h is. Velocities are compared likewise, by the trapezoidal rule. A pose where Cq is
singular lies between two points if the solution of Cq x = probe has changed its direction.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import copy
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kinematics_state import Path
from flexmb.engine.method import FINE, JUMP, LEAP
from flexmb.engine.state import Run

_MAX_MOTION = 0.5  # of an increment, of the model size or rad
_APART = 0.25  # off by this share of the motion: another branch, or too long an increment
_SAME_BRANCH = 1e-5  # of the model size: branches this close are one
_TURNED = 0.55  # a jump of v̇ within the increment leaves 0.5
_STILL = 1e-12  # motion by which velocities may differ, of the model size
_STEEPER = 3.0  # a change of this many times what the slopes say is a jump
_LAST_DIGITS = 1e-9
_FLIPPED = -0.5  # cosine


@kernel
def are_finite(functions, fun):
    """Whether all functions of time alone and their derivatives are finite numbers."""
    s, live = 0.0, functions.live
    for k in range(live.shape[0]):
        if live[k] == 0:
            s += fun[k, 0] + fun[k, 1] + fun[k, 2]
    return math.isfinite(s)


@kernel
def next_increment(left, h, speed):
    """The increment to try: h or less, in parts of the time `left` that are about equal."""
    if h * speed > _MAX_MOTION:
        h = _MAX_MOTION / speed
    if h > left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


@unit
def predict(run: Run, path: Path, h: float) -> int:
    """Trial motion and rates at h by Taylor's series; no corrections yet."""
    st, dq, at = run.state, run.work.trial.dq, run.trial_point
    v0, vd0, jerk, v, vd, correction = st.v, st.vd, path.jerk, at.v, at.vd, path.correction
    for i in range(v0.shape[0]):
        j = jerk[i]
        dq[i] = h * (v0[i] + h * (0.5 * vd0[i] + h * j / 6.0))
        v[i] = v0[i] + h * (vd0[i] + 0.5 * h * j)
        vd[i] = vd0[i] + h * j
        correction[i] = 0.0
    return FINE


@unit
def remember_point(run: Run, path: Path, h: float) -> int:
    """What the next point needs of the trial point, which is accepted."""
    fun, before = run.work.con.fun, path.functions_before
    vd0, vd, jerk = run.state.vd, run.work.trial.vd, path.jerk
    for i in range(vd.shape[0]):
        jerk[i] = (vd[i] - vd0[i]) / h if h > 0.0 else 0.0
    copy(path.direction, path.direction_before)
    for k in range(before.shape[0]):
        for c in range(3):
            before[k, c] = fun[k, c]
    return FINE


@unit
def check_branch(run: Run, path: Path, h: float, last: int) -> int:
    """Compare the trial point with the state before it (0); returns the status.

    `last` = 1: there is no smaller increment, so a kink in a function is taken as it is.
    """
    functions, fun, w = run.system.functions, run.work.con.fun, run.system.weights
    v0, vd0, v, vd = run.state.v, run.state.vd, run.work.trial.v, run.work.trial.vd
    jerk, correction = path.jerk, path.correction
    if last == 1 and _jumps(functions, path.functions_before, fun, h, 0):
        return LEAP
    off, motion, turned, speed = 0.0, 0.0, 0.0, 0.0
    for i in range(w.shape[0]):
        c = correction[i]
        d = c + h * h * (h * jerk[i] - (vd[i] - vd0[i])) / 6.0
        off = max(off, w[i] * abs(d))
        motion = max(motion, w[i] * (0.5 * h * abs(v0[i] + v[i]) + abs(c)))
        mean = 0.5 * h * (vd0[i] + vd[i])
        turned = max(turned, w[i] * abs(v[i] - v0[i] - mean))
        speed = max(speed, w[i] * max(abs(v0[i]), abs(v[i]), abs(mean)))
    far = off > _APART * motion and off > _SAME_BRANCH
    other = turned > _TURNED * speed and h * turned > _STILL
    if far or (other and not (last == 1 and _jumps(functions, path.functions_before, fun, h, 1))):
        return JUMP
    return FINE


@kernel
def _jumps(functions, before, now, h, order):
    """Whether a function (order 0) or its rate (order 1) jumps between two times.

    Otherwise it changes by no more than the larger of its slopes says.
    """
    live = functions.live
    for k in range(live.shape[0]):
        if live[k] == 1:
            continue
        change = abs(now[k, order] - before[k, order])
        slope = max(abs(before[k, order + 1]), abs(now[k, order + 1]))
        size = 1.0 + max(abs(before[k, order]), abs(now[k, order]))
        if change > _STEEPER * h * slope and change > _LAST_DIGITS * size:
            return True
    return False


@unit
def note_singular_pose(run: Run, path: Path) -> int:
    """Count a singular pose between the state and the trial point, and note when and where."""
    weights, before, here = run.system.weights, path.direction_before, path.direction
    times, count = path.singular_times, path.count[0]
    both, first, second = 0.0, 0.0, 0.0
    for i in range(weights.shape[0]):
        w = weights[i] * weights[i]
        both += w * before[i] * here[i]
        first += w * before[i] * before[i]
        second += w * here[i] * here[i]
    if both < _FLIPPED * math.sqrt(first * second):
        k = count["singular_poses"]
        if k < times.shape[0]:
            times[k, 0], times[k, 1] = run.state.t[0], run.work.trial.t[0]
            copy(run.work.trial.q, path.singular_positions[k])
        count["singular_poses"] += 1
    return FINE


@kernel
def add_works(h, k, power, powers, work):
    """Works (3) up to output k at interval h, by formulas of order four (Adams–Moulton, Simpson).

    `powers` (4, 3) keeps those of the last outputs, newest first.
    """
    for c in range(3):
        for n in range(3):
            powers[3 - n, c] = powers[2 - n, c]
        powers[0, c] = power[c]
        p0, p1, p2, p3 = powers[0, c], powers[1, c], powers[2, c], powers[3, c]
        if k == 1:
            work[c] = 0.5 * h * (p0 + p1)
        elif k == 2:
            work[c] = h * (p0 + 4.0 * p1 + p2) / 3.0
        elif k > 2:
            work[c] += h * (9.0 * p0 + 19.0 * p1 - 5.0 * p2 + p3) / 24.0
