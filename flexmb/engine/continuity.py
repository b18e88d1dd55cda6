"""Whether a point of a kinematic analysis continues the motion, and the work up to it.

With the prediction h v + h²/2 v̇ and a motion without jumps, the solution is off by h²/6 (v̇₁ − v̇₀)
to the next order; on another branch of the mechanism it is off by the distance of the branches,
however small h is. Velocities are compared likewise, by the trapezoidal rule. A pose where Cq is
singular lies between two points if the solution of Cq x = probe has changed its direction.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.method import FINE, JUMP, LEAP

_LONGEST = 0.5  # motion of an increment at most, of the model size or rad
_APART = 0.25  # off by this share of the motion: another branch, or too long an increment
_NOTHING = 1e-5  # of the model size: branches this close are one
_TURNED = 0.55  # a jump of v̇ amid the increment leaves 0.5
_STILL = 1e-12  # motion by which velocities may differ, of the model size
_STEEPER = 3.0  # a change of this many times what the slopes say is a jump
_LAST_DIGITS = 1e-9
_FLIPPED = -0.5  # cosine


@kernel
def finite(functions, fun):
    """Whether all functions of time alone and their derivatives are finite numbers."""
    s = 0.0
    for k in range(functions.live.shape[0]):
        if functions.live[k] == 0:
            s += fun[k, 0] + fun[k, 1] + fun[k, 2]
    return math.isfinite(s)


@kernel
def increment(left, h, speed):
    """The increment to try: h or less, in parts of the time `left` that are about equal."""
    if h * speed > _LONGEST:
        h = _LONGEST / speed
    if h > left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


@kernel
def predict(v0, vd0, jerk, h, dq, v, vd, change):
    """Motion and rates at h by Taylor's series; no corrections yet."""
    for i in range(v0.shape[0]):
        j = jerk[i]
        dq[i] = h * (v0[i] + h * (0.5 * vd0[i] + h * j / 6.0))
        v[i] = v0[i] + h * (vd0[i] + 0.5 * h * j)
        vd[i] = vd0[i] + h * j
        change[i] = 0.0


@kernel
def keep(vd0, vd, h, jerk, look, seen, fun, before):
    """What the next point needs of an accepted one."""
    for i in range(vd.shape[0]):
        jerk[i] = (vd[i] - vd0[i]) / h if h > 0.0 else 0.0
        seen[i] = look[i]
    for k in range(before.shape[0]):
        for c in range(3):
            before[k, c] = fun[k, c]


@kernel
def judge(functions, w, v0, vd0, v, vd, path, fun, h, last):
    """Compare a point with the one before it (0); returns the status.

    `last`: there is no smaller increment, so a kink in a function is taken as it is.
    """
    if last and _jumps(functions, path.before, fun, h, 0):
        return LEAP
    off, motion, turned, speed = 0.0, 0.0, 0.0, 0.0
    for i in range(w.shape[0]):
        c = path.change[i]
        d = c + h * h * (h * path.jerk[i] - (vd[i] - vd0[i])) / 6.0
        off = max(off, w[i] * abs(d))
        motion = max(motion, w[i] * (0.5 * h * abs(v0[i] + v[i]) + abs(c)))
        mean = 0.5 * h * (vd0[i] + vd[i])
        turned = max(turned, w[i] * abs(v[i] - v0[i] - mean))
        speed = max(speed, w[i] * max(abs(v0[i]), abs(v[i]), abs(mean)))
    far = off > _APART * motion and off > _NOTHING
    other = turned > _TURNED * speed and h * turned > _STILL
    if far or (other and not (last and _jumps(functions, path.before, fun, h, 1))):
        return JUMP
    return FINE


@kernel
def _jumps(functions, before, now, h, order):
    """Whether a function (order 0) or its rate (order 1) jumps between two times.

    Otherwise it changes by no more than the larger of its slopes says.
    """
    for k in range(functions.live.shape[0]):
        if functions.live[k] == 1:
            continue
        change = abs(now[k, order] - before[k, order])
        slope = max(abs(before[k, order + 1]), abs(now[k, order + 1]))
        size = 1.0 + max(abs(before[k, order]), abs(now[k, order]))
        if change > _STEEPER * h * slope and change > _LAST_DIGITS * size:
            return True
    return False


@kernel
def note_passed(weights, path, t0, t, q):
    """Count a singular pose between the last point and this one, and keep when and where."""
    both, first, second = 0.0, 0.0, 0.0
    for i in range(weights.shape[0]):
        w = weights[i] * weights[i]
        both += w * path.seen[i] * path.look[i]
        first += w * path.seen[i] * path.seen[i]
        second += w * path.look[i] * path.look[i]
    if both < _FLIPPED * math.sqrt(first * second):
        k = path.count[2]
        if k < path.passed.shape[0]:
            path.passed[k, 0] = t0
            path.passed[k, 1] = t
            copy(q, path.passed_q[k])
        path.count[2] += 1


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
