"""Rates of kinetostatic modes η_s: derivatives of a cubic through the past.

Rates and accelerations for the next step are those of the cubic through the last values, so that a
mass carried outwards slows a rotation and loads do work. Points closer than a share of the
vibration period are left out, since second differences would be round-off. Motion and λ are then
solved with these rates; a driver also supplies d/dt (M η̇_s), and the energy balance lacks only
η̇_sᵀ M η̇_s/2. The rates do not act on η_s itself: with a damper on soft modes, or η_s driven by
its own acceleration, short steps would be unstable. Other single solves keep all η_s constant.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import larger, largest
from flexmb.engine.bodies.static_mode_tables import PAST_POINTS, StaticModes
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run

# Displacement of modes, over the size of their part of the model, within the tolerance of their
# equilibrium: it is no error of the extrapolation.
_UNRESOLVED_DISPLACEMENT = 1e-10

_CUBIC_POINTS = 3  # points of the past that define a cubic together with the present one

# Points of the past that are used: the first must precede the present by at least
# _MIN_FIRST_INTERVAL times the interval before it. A further one is used only if the interval to it
# is at least _MIN_LAST_INTERVAL times the distance of the first point: else there was a jump
# between short steps, as at an event, that long steps follow.
_MIN_FIRST_INTERVAL, _MIN_LAST_INTERVAL = 0.3, 0.08

# Points closer than this share of `window` are at the present time, as one just before an event:
# alone in the past behind a jump, it would make a rate of round-off.
_PRESENT_SHARE = 1e-3

# Detection of a jump of η_s, as at an impact: its rate and acceleration are then set to zero. Two
# ratios are compared with those of a jump in the last interval: the difference between the second
# derivatives of cubic and parabola over that of the cubic, and second over first derivative of the
# cubic: both are least when it lies there, for ratios of intervals of 0.3 to 3.3. Smooth motion
# never reaches 0.9 and 0.275 of them together at ω h = 0.2, and at 1.5 % of the phases at 0.3.
_JUMP_SHARE, _RATE_SHARE = 0.9, 0.275

# Sum of squares of third differences over that of first ones, above which points ahead are not
# smooth: the modes jump between them, and get no past.
_SMOOTH_SHARE = 0.1

# Growth of the intervals of the past from one to the next after a start, up to `window`.
_INTERVAL_GROWTH = 1.5


@unit
def put_rates(run: Run, of: StaticModes, at: Point) -> int:
    """Set rates and accelerations of the modes to those of the cubic through their past.

    With fewer points, the rates are those of the parabola or straight line, and the accelerations
    zero; without a past, or after a jump of the modes, both are zero.
    """
    past = run.work.now.history
    for n in range(of.rows.shape[0]):
        body, m = run.system.parts.bodies[of.rows[n]], of.first[n + 1] - of.first[n]
        iq, iv, times, first, count = body["iq"] + 7, body["iv"] + 6, of.history[n], 0, 0
        near = _PRESENT_SHARE * of.window[n]
        while first < PAST_POINTS and past[times + first] >= at.t[0] - near:
            first += 1
        while first + 1 < PAST_POINTS and past[times + first + 1] > -math.inf:
            gap = past[times + first] - past[times + first + 1]
            if at.t[0] - past[times + first] >= _MIN_FIRST_INTERVAL * gap:
                break
            first += 1
        most = min(_CUBIC_POINTS, PAST_POINTS - first)
        while count < most and past[times + first + count] > -math.inf:
            if count > 0:
                gap = past[times + first + count - 1] - past[times + first + count]
                if gap < _MIN_LAST_INTERVAL * (at.t[0] - past[times + first]):
                    break
            count += 1
        is_cubic = count == _CUBIC_POINTS
        bends, steps, speed, jump, fast = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(m):
            mode = of.modes[of.first[n] + i]
            now, rate, bend, unit_rate, unit_bend = at.q[iq + mode], 0.0, 0.0, 0.0, 0.0
            for k in range(first, first + count):
                weight, more = 1.0 / (at.t[0] - past[times + k]), 0.0
                for other in range(first, first + count):
                    if other != k:
                        away = at.t[0] - past[times + other]
                        weight *= away / (past[times + k] - past[times + other])
                        more += 2.0 / away
                change = weight * (now - past[times + PAST_POINTS + k * m + i])
                rate += change
                bend += more * change
                unit_rate += weight  # those of a jump by one in the last interval
                unit_bend += more * weight
            at.v[iv + mode], at.vd[iv + mode] = rate, bend if is_cubic else 0.0
            if is_cubic:  # the parabola through the last three values
                a, b = at.t[0] - past[times + first], at.t[0] - past[times + first + 1]
                low = (now - past[times + PAST_POINTS + first * m + i]) / a
                low -= (now - past[times + PAST_POINTS + (first + 1) * m + i]) / b
                w = run.system.weights[iv + mode] ** 2
                bends += w * bend * bend
                steps += w * (bend - 2.0 * low / (b - a)) ** 2
                speed += w * rate * rate
                jump = (_JUMP_SHARE * (1.0 - 2.0 / (a * b * unit_bend))) ** 2
                fast = (_RATE_SHARE * unit_bend / unit_rate) ** 2
        if is_cubic and steps > jump * bends and bends > fast * speed:
            for i in range(m):
                at.v[iv + of.modes[of.first[n] + i]] = 0.0
                at.vd[iv + of.modes[of.first[n] + i]] = 0.0
    return SUCCESS


@unit
def put_mode_forces(run: Run, of: StaticModes, at: Point) -> int:
    """Set Trial.mode_force to τ² K_ss η̈_s, with which a single solve returns the given η̈_s."""
    pool = run.system.parts.pool
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        m, iv = body["m"], body["iv"] + 6
        K = body["flex"] + 12 * m + m * m
        for i in range(of.first[n], of.first[n + 1]):
            force = 0.0
            for j in range(of.first[n], of.first[n + 1]):
                force += pool[K + of.modes[i] * m + of.modes[j]] * at.vd[iv + of.modes[j]]
            run.work.trial.mode_force[iv + of.modes[i]] = of.mass_factor[n] * force
    return SUCCESS


@unit
def put_stage_accelerations(run: Run, of: StaticModes, at: Point) -> int:
    """Set the accelerations of kinetostatic modes at all collocation stages to the given ones."""
    stages = run.work.collocation.next_a
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 1:
            iv = run.system.parts.bodies[of.rows[n]]["iv"] + 6
            for k in range(of.first[n], of.first[n + 1]):
                for i in range(stages.shape[0]):
                    stages[i, iv + of.modes[k]] = at.vd[iv + of.modes[k]]
    return SUCCESS


@unit
def extrapolation_error(run: Run, of: StaticModes, at: Point) -> float:
    """Largest difference of the modes from their extrapolated values, over their motion so far.

    The extrapolated values are q + h Trial.dq. If the step h is as long as the interval H of their
    past, the difference is of order h⁴. In a shorter step it is of order H³ h and is multiplied by
    (h/H)³, to have the order h⁴ as well. Differences within the tolerance of the equilibrium are
    left out.
    """
    st, tr, most = run.state, run.work.trial, 0.0
    h = at.t[0] - st.t[0]
    for n in range(of.rows.shape[0]):
        body, past = run.system.parts.bodies[of.rows[n]], of.history[n]
        interval = st.history[past] - st.history[past + 1]
        share = min(1.0, h / interval) if math.isfinite(interval) and interval > 0.0 else 1.0
        for k in range(of.first[n], of.first[n + 1]):
            q, v = body["iq"] + 7 + of.modes[k], body["iv"] + 6 + of.modes[k]
            left = abs(at.q[q] - st.q[q] - h * tr.dq[v])
            if left * of.reach[k] > _UNRESOLVED_DISPLACEMENT:
                most = larger(most, share**3 * left * run.system.weights[v] / st.q_scale[v])
    return most


@unit
def record_point_ahead(run: Run, of: StaticModes, at: Point) -> float:
    """Record a point ahead of the state; the last of four gives the modes a past.

    The points have equal intervals and begin with the state. The past consists of values of the
    cubic through them, extrapolated backwards; modes that jump between them get none. Returns the
    least interval of the points [s].
    """
    ahead, loop, past = of.scratch.ahead, of.scratch.loop[0], run.state.history
    row = 0 if at.t[0] == run.state.t[0] else loop["noted"]
    loop["noted"] = row + 1
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        for k in range(of.first[n], of.first[n + 1]):
            ahead[row, k] = at.q[body["iq"] + 7 + of.modes[k]]
    if row + 1 < PAST_POINTS:
        return largest(of.window)  # type: ignore[no-any-return]
    h = (at.t[0] - run.state.t[0]) / row
    for n in range(of.rows.shape[0]):
        o, m, first = of.history[n], of.first[n + 1] - of.first[n], of.first[n]
        moves, bends = 0.0, 0.0
        for k in range(first, first + m):
            a, b, c, d = ahead[0, k], ahead[1, k], ahead[2, k], ahead[3, k]
            moves += (of.reach[k] * (b - a)) ** 2
            bends += (of.reach[k] * (d - a - 3.0 * (c - b))) ** 2
            for i in range(PAST_POINTS):
                j = float(i)  # number of intervals before the state
                x = a + j * (a - b) + 0.5 * j * (j + 1.0) * (a - 2.0 * b + c)
                x += j * (j + 1.0) * (j + 2.0) / 6.0 * (a - 3.0 * b + 3.0 * c - d)
                past[o + PAST_POINTS + i * m + k - first] = x
        for i in range(PAST_POINTS):
            past[o + i] = run.state.t[0] - i * h if bends < _SMOOTH_SHARE * moves else -math.inf
    return 0.0


@unit
def clear_history(run: Run, of: StaticModes, at: Point) -> int:
    """Delete the past: no time of it is finite."""
    for n in range(of.rows.shape[0]):
        for k in range(PAST_POINTS):
            run.state.history[of.history[n] + k] = -math.inf
    return SUCCESS


@unit
def update_history(run: Run, of: StaticModes, at: Point) -> int:
    """Add the present values of the modes to their past, if far enough from the last point."""
    past = run.state.history
    h = at.t[0] - past[0]
    _measure_lag(run, of, at)
    for n in range(of.rows.shape[0]):
        o, m = of.history[n], of.first[n + 1] - of.first[n]
        if of.window[n] > h and past[o + 1] > -math.inf:
            iv, rate = run.system.parts.bodies[of.rows[n]]["iv"] + 6, 0.0
            for k in range(of.first[n], of.first[n + 1]):
                rate = max(rate, abs(at.v[iv + of.modes[k]]))
            if rate == 0.0:  # after a jump: points before it are not used
                past[o : o + PAST_POINTS] = -math.inf
            elif at.t[0] - past[o] < min(of.window[n], _INTERVAL_GROWTH * (past[o] - past[o + 1])):
                continue
        for k in range(PAST_POINTS - 1, 0, -1):
            past[o + k] = past[o + k - 1]
            for i in range(m):
                past[o + PAST_POINTS + k * m + i] = past[o + PAST_POINTS + (k - 1) * m + i]
        past[o] = at.t[0]
        for i in range(m):
            place = run.system.parts.bodies[of.rows[n]]["iq"] + 7 + of.modes[of.first[n] + i]
            past[o + PAST_POINTS + i] = at.q[place]
    return SUCCESS


@kernel
def _measure_lag(run, of, at):
    """Add this step's largest difference of the modes from q + h q̇ + h²/2 q̈, and their size."""
    st, lag, size = run.state, 0.0, 0.0
    h = at.t[0] - st.t[0]
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        for k in range(of.first[n], of.first[n + 1]):
            q, v = body["iq"] + 7 + of.modes[k], body["iv"] + 6 + of.modes[k]
            ahead = st.q[q] + h * (st.v[v] + 0.5 * h * st.vd[v])
            lag = max(lag, run.system.weights[v] * abs(at.q[q] - ahead))
            size = max(size, run.system.weights[v] * abs(at.q[q]))
    st.memory[0]["static_lag"] += lag
    st.memory[0]["static_size"] += size
