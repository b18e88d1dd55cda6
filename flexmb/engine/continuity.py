"""Whether a point of a kinematic analysis continues the motion, and the work up to it.

With the prediction h v + h²/2 v̇ and a motion without jumps, the solution is off by h²/6 (v̇₁ − v̇₀)
to the next order; on another branch of the mechanism it is off by the distance of the branches,
however small h is. Velocities are compared likewise, by the trapezoidal rule. A pose where Cq is
singular lies between two points if the solution of Cq x = probe has changed its direction.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.method import FINE, JUMP, LEAP

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
def judge(sys, st, wk, path, h, last):
    """Compare the trial point with the state before it; returns the status."""
    tr, w = wk.trial, sys.weights
    if last and _jumps(sys.functions, path.before, wk.con.fun, h, 0):
        return LEAP
    off, motion, turned, speed = 0.0, 0.0, 0.0, 0.0
    for i in range(w.shape[0]):
        c = path.change[i]
        d = c + h * h * (h * path.jerk[i] - (tr.vd[i] - st.vd[i])) / 6.0
        off = max(off, w[i] * abs(d))
        motion = max(motion, w[i] * (0.5 * h * abs(st.v[i] + tr.v[i]) + abs(c)))
        mean = 0.5 * h * (st.vd[i] + tr.vd[i])
        turned = max(turned, w[i] * abs(tr.v[i] - st.v[i] - mean))
        speed = max(speed, w[i] * max(abs(st.v[i]), abs(tr.v[i]), abs(mean)))
    far = off > _APART * motion and off > _NOTHING
    other = turned > _TURNED * speed and h * turned > _STILL
    if far or (other and not (last and _jumps(sys.functions, path.before, wk.con.fun, h, 1))):
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
def passed(weights, path):
    """Whether a singular pose lies between the last point and the trial one."""
    both, first, second = 0.0, 0.0, 0.0
    for i in range(weights.shape[0]):
        w = weights[i] * weights[i]
        both += w * path.seen[i] * path.look[i]
        first += w * path.seen[i] * path.seen[i]
        second += w * path.look[i] * path.look[i]
    return both < _FLIPPED * math.sqrt(first * second)


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
