"""Quasi-static modes: modal coordinates η_s in static equilibrium, K_ss η_s = Q_s − Cq_sᵀ λ.

Their bodies have no modal mass of them (`flexbody.effects.without_modal_inertia`): next to dynamic
modes they act as a residual flexibility (MacNeal, Computers & Structures 1, 1971, 581). Implicit
methods solve for η_s together with all other unknowns; the iteration matrix then holds b K_ss.

Kinetostatic bodies (deformation "quasi-static"; all such bodies in explicit methods) have
prescribed accelerations of η_s within a step, by a large artificial mass τ² K_ss. After the step
η_s is moved to equilibrium with the loads, with the λ of a motion at constant η_s, and positions
are projected with the deformed body: the slow solution, without vibrations on this compliance. In
this iteration η̇_s = 0 from the start: with other rates the loads change, and projecting velocities
at another pose would change the motion by the same amount in each step, however short.

Rates and accelerations for the next step are those of the cubic through the last values, so that a
mass carried outwards slows a rotation and loads do work. Points closer than a share of the
vibration period are left out, since second differences would be round-off. Motion and λ are then
solved with these rates; a driver also supplies d/dt (M η̇_s), and the energy balance lacks only
η̇_sᵀ M η̇_s/2. The rates do not act on η_s itself: with a damper on soft modes, or η_s driven by
its own acceleration, short steps would be unstable. Other single solves keep all η_s constant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.anderson import Iterates, accelerate, new_iterates
from flexmb.engine.algebra.vector import larger, largest
from flexmb.engine.jit import Integers, Matrix, Vector, array_of, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import Point, Run
from flexmb.engine.tables import System

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexmb.flexbody import FlexBody

# Change of modes in equilibrium, over the size of their part of the model; what of them is no lag.
SETTLED, _UNSEEN = 1e-11, 1e-10
_SLOW = 1e8  # τ² K_ss over the inertia of its part of the model in the softest of them
# Points of the past: stored, the last of which may be the present; for the slope.
_POINTS, _CUBIC = 4, 3
# A point counts if it is this part of the last interval before the next one; the last ones, if the
# present is this part of the interval before them away: a jump at an event is one of long steps.
_FAR_ENOUGH, _NEAR = 0.3, 0.08
# Detection of a jump of η_s, as at an impact: its rate and acceleration are then set to zero. Two
# ratios are compared with those of a jump in the last interval: the difference between the second
# derivatives of cubic and parabola over that of the cubic, and second over first derivative of the
# cubic: both are least when it lies there, for ratios of intervals of 0.3 to 3.3. Smooth motion
# never reaches 0.9 and 0.275 of them together at ω h = 0.2, and at 1.5 % of the phases at 0.3.
_JUMP, _FAST = 0.9, 0.275
# Square of third differences over that of first ones from which on points ahead are not smooth.
_SMOOTH = 0.1
# Intervals of the past after a jump grow by this factor up to the window.
_GROWTH = 1.5
# Change of an iteration over the one before, above which it is accelerated.
_SETTLING = 0.3
# Stiffness with the loads, negative, over that of the body, from which on it is no round-off.
_UNSTABLE = 0.05


LOOP = np.dtype([
    ("change", "f8"),  # the last one, weighted
    ("grows", "i8"),  # 1: it does not settle of itself
    ("noted", "i8"),  # points ahead of the state
])  # fmt: skip


class Scratch(NamedTuple):
    """Of the iteration in which modes and their loads settle."""

    iterates: Iterates
    residual: Vector  # of the last iterate, of each mode
    move: Vector  # from the one before to it
    ahead: Matrix  # (_POINTS, modes) at the state and ahead of it
    loop: array_of(LOOP)  # (1,)


class StaticModes(NamedTuple):
    """Quasi-static modes, body after body."""

    rows: Integers  # (b,) bodies that have some
    first: Integers  # (b + 1,) where those of a body begin
    modes: Integers  # numbers of the modes in their bodies
    kinetostatic: Integers  # (b,) 1: held by implicit methods too
    mass_factor: Vector  # (b,) τ² [s²]
    compliance: Vector  # K_ss⁻¹ of the bodies, row by row
    history: Integers  # (b,) where a body has its past: _POINTS times [s], and η_s at each
    window: Vector  # (b,) least interval of the points of its past [s]
    reach: Vector  # most that one unit of each mode moves, over the size of its part of the model
    scratch: Scratch = None  # of one run


@unit
def add_static_mass(run: Run, of: StaticModes, at: Point, cv: float, cp: float) -> int:
    """Add τ² K_ss to the matrix of bodies that hold η_s, and of single solves."""
    parts, kkt, fac = run.system.parts, run.system.kkt, run.work.factor
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 0 and (cv != 0.0 or cp != 0.0):
            continue
        body = parts.bodies[of.rows[n]]
        panel, m, o = kkt.panels[body["panel"]], body["m"], body["iv"] + 6
        K = body["flex"] + 12 * m + m * m
        for i in range(of.first[n], of.first[n + 1]):
            r = kkt.column[o + of.modes[i]]
            for j in range(of.first[n], of.first[n + 1]):
                c = kkt.column[o + of.modes[j]]
                x = of.mass_factor[n] * parts.pool[K + of.modes[i] * m + of.modes[j]]
                if r >= c:
                    fac.low[panel["at"] + r * panel["nc"] + c] += x
                if r <= c:
                    fac.up[panel["at"] + c * panel["nc"] + r] += x
    return SUCCESS


@unit
def hold(run: Run, of: StaticModes, at: Point) -> int:
    """No residual of the modes of kinetostatic bodies, so that Newton's method leaves them."""
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 1:
            iv = run.system.parts.bodies[of.rows[n]]["iv"] + 6
            for k in range(of.first[n], of.first[n + 1]):
                run.work.trial.res[iv + of.modes[k]] = 0.0
    return SUCCESS


@unit
def follow_loads(run: Run, of: StaticModes, at: Point) -> float:
    """Move the modes towards equilibrium with Trial.res, without rates; the largest change.

    Without a residual the iteration begins. Where loads follow the modes by more than these move,
    as the tension of a rod beyond its buckling load, it grows, and is accelerated. The change is
    infinite where they push the modes on, as beyond a critical speed: no equilibrium is stable.
    """
    bodies, weights, res = run.system.parts.bodies, of.reach, run.work.trial.res
    iterates, loop = of.scratch.iterates, of.scratch.loop[0]
    change, stiffness, elastic, place = 0.0, 0.0, 0.0, 0
    for n in range(of.rows.shape[0]):
        body, begin, end = bodies[of.rows[n]], of.first[n], of.first[n + 1]
        if of.kinetostatic[n] == 0 and run.method.stages == 0:
            place += (end - begin) ** 2
            continue
        iq, iv = body["iq"] + 7, body["iv"] + 6
        for i in range(begin, end):
            step, weight = 0.0, weights[i]
            for j in range(begin, end):
                step -= of.compliance[place] * res[iv + of.modes[j]]
                place += 1
            iterates.now[i], iterates.step[i] = weight * at.q[iq + of.modes[i]], weight * step
            change = larger(change, abs(iterates.step[i]))
            move = of.scratch.move
            move[i] = (iterates.now[i] - iterates.last[i]) / weight
            stiffness += move[i] * (res[iv + of.modes[i]] - of.scratch.residual[i])
            of.scratch.residual[i] = res[iv + of.modes[i]]
        elastic += _elastic(run, of, n)
    if change == 0.0:
        iterates.count[0], loop["grows"] = 0, 0
    elif math.isfinite(change):
        if iterates.count[0] > 0 and change > _SETTLING * loop["change"]:
            loop["grows"] = 1
        later = iterates.count[0] > 1  # the first reactions were those by the matrix of before
        if loop["grows"] == 1 and later and stiffness < -_UNSTABLE * elastic:
            return math.inf
        accelerate(iterates, loop["grows"] == 1)
    loop["change"] = change
    for n in range(of.rows.shape[0]):
        iq, iv = bodies[of.rows[n]]["iq"] + 7, bodies[of.rows[n]]["iv"] + 6
        if of.kinetostatic[n] == 1 or run.method.stages > 0:
            for i in range(of.first[n], of.first[n + 1]):
                at.q[iq + of.modes[i]] += iterates.step[i] / weights[i]
                at.v[iv + of.modes[i]] = 0.0
                at.vd[iv + of.modes[i]] = 0.0
    return change


@kernel
def _elastic(run, of, n):
    """Twice the elastic energy of the last moves of the modes of body n."""
    pool, body, twice = run.system.parts.pool, run.system.parts.bodies[of.rows[n]], 0.0
    m = body["m"]
    K = body["flex"] + 12 * m + m * m
    for i in range(of.first[n], of.first[n + 1]):
        for j in range(of.first[n], of.first[n + 1]):
            stiffness = pool[K + of.modes[i] * m + of.modes[j]]
            twice += of.scratch.move[i] * stiffness * of.scratch.move[j]
    return twice


@unit
def put_rates(run: Run, of: StaticModes, at: Point) -> int:
    """Rates and accelerations of the modes that follow loads, of the cubics through their past."""
    past = run.work.now.history
    for n in range(of.rows.shape[0]):
        body, m = run.system.parts.bodies[of.rows[n]], of.first[n + 1] - of.first[n]
        iq, iv, times, first, count = body["iq"] + 7, body["iv"] + 6, of.history[n], 0, 0
        while first < _POINTS and past[times + first] >= at.t[0]:
            first += 1
        while first + 1 < _POINTS and past[times + first + 1] > -math.inf:
            gap = past[times + first] - past[times + first + 1]
            if at.t[0] - past[times + first] >= _FAR_ENOUGH * gap:
                break
            first += 1
        most = min(_CUBIC, _POINTS - first)
        while count < most and past[times + first + count] > -math.inf:
            if count > 0:
                gap = past[times + first + count - 1] - past[times + first + count]
                if gap < _NEAR * (at.t[0] - past[times + first]):
                    break
            count += 1
        is_cubic = count == _CUBIC
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
                change = weight * (now - past[times + _POINTS + k * m + i])
                rate += change
                bend += more * change
                unit_rate += weight  # of a jump by one in the last interval
                unit_bend += more * weight
            at.v[iv + mode], at.vd[iv + mode] = rate, bend if is_cubic else 0.0
            if is_cubic:  # the parabola through the last three values
                a, b = at.t[0] - past[times + first], at.t[0] - past[times + first + 1]
                low = (now - past[times + _POINTS + first * m + i]) / a
                low -= (now - past[times + _POINTS + (first + 1) * m + i]) / b
                w = run.system.weights[iv + mode] ** 2
                bends += w * bend * bend
                steps += w * (bend - 2.0 * low / (b - a)) ** 2
                speed += w * rate * rate
                jump = (_JUMP * (1.0 - 2.0 / (a * b * unit_bend))) ** 2
                fast = (_FAST * unit_bend / unit_rate) ** 2
        if is_cubic and steps > jump * bends and bends > fast * speed:
            for i in range(m):
                at.v[iv + of.modes[of.first[n] + i]] = 0.0
                at.vd[iv + of.modes[of.first[n] + i]] = 0.0
    return SUCCESS


@unit
def put_forces(run: Run, of: StaticModes, at: Point) -> int:
    """Trial.mode_force: τ² K_ss η̈_s, by which a single solve has the accelerations of the point."""
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
def put_path(run: Run, of: StaticModes, at: Point) -> int:
    """Accelerations of the modes of kinetostatic bodies at all stages: those of the point."""
    stages = run.work.collocation.next_a
    for n in range(of.rows.shape[0]):
        if of.kinetostatic[n] == 1:
            iv = run.system.parts.bodies[of.rows[n]]["iv"] + 6
            for k in range(of.first[n], of.first[n + 1]):
                for i in range(stages.shape[0]):
                    stages[i, iv + of.modes[k]] = at.vd[iv + of.modes[k]]
    return SUCCESS


@unit
def lag(run: Run, of: StaticModes, at: Point) -> float:
    """How far the modes are from where a step took them, over their motion; its largest value.

    It took them by the mean of Trial.dq, of order h⁴ in a step as long as the interval H of their
    past. In shorter ones it is H³ h, and counts as h⁴; what the equilibrium leaves does not count.
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
            if left * of.reach[k] > _UNSEEN:
                most = larger(most, share**3 * left * run.system.weights[v] / st.motion[v])
    return most


@unit
def look_ahead(run: Run, of: StaticModes, at: Point) -> float:
    """Note a point; four, at equal intervals from the state on, give the modes the past of a cubic.

    What jumps between them has none. Returns the least interval [s].
    """
    ahead, loop, past = of.scratch.ahead, of.scratch.loop[0], run.state.history
    row = 0 if at.t[0] == run.state.t[0] else loop["noted"]
    loop["noted"] = row + 1
    for n in range(of.rows.shape[0]):
        body = run.system.parts.bodies[of.rows[n]]
        for k in range(of.first[n], of.first[n + 1]):
            ahead[row, k] = at.q[body["iq"] + 7 + of.modes[k]]
    if row + 1 < _POINTS:
        return largest(of.window)  # type: ignore[no-any-return]
    h = (at.t[0] - run.state.t[0]) / row
    for n in range(of.rows.shape[0]):
        o, m, first = of.history[n], of.first[n + 1] - of.first[n], of.first[n]
        moves, bends = 0.0, 0.0
        for k in range(first, first + m):
            a, b, c, d = ahead[0, k], ahead[1, k], ahead[2, k], ahead[3, k]
            moves += (of.reach[k] * (b - a)) ** 2
            bends += (of.reach[k] * (d - a - 3.0 * (c - b))) ** 2
            for i in range(_POINTS):
                j = float(i)  # steps before the state
                x = a + j * (a - b) + 0.5 * j * (j + 1.0) * (a - 2.0 * b + c)
                x += j * (j + 1.0) * (j + 2.0) / 6.0 * (a - 3.0 * b + 3.0 * c - d)
                past[o + _POINTS + i * m + k - first] = x
        for i in range(_POINTS):
            past[o + i] = run.state.t[0] - i * h if bends < _SMOOTH * moves else -math.inf
    return 0.0


@unit
def forget(run: Run, of: StaticModes, at: Point) -> int:
    """Begin without a past."""
    for n in range(of.rows.shape[0]):
        for k in range(_POINTS):
            run.state.history[of.history[n] + k] = -math.inf
    return SUCCESS


@unit
def update_history(run: Run, of: StaticModes, at: Point) -> int:
    """Add the present to the past of all modes, if it is far enough from the last point there."""
    past = run.state.history
    h = at.t[0] - past[0]
    for n in range(of.rows.shape[0]):
        o, m = of.history[n], of.first[n + 1] - of.first[n]
        if of.window[n] > h and past[o + 1] > -math.inf:
            iv, rate = run.system.parts.bodies[of.rows[n]]["iv"] + 6, 0.0
            for k in range(of.first[n], of.first[n + 1]):
                rate = max(rate, abs(at.v[iv + of.modes[k]]))
            if rate == 0.0:  # as after a jump: what was before it does not count
                past[o : o + _POINTS] = -math.inf
            elif at.t[0] - past[o] < min(of.window[n], _GROWTH * (past[o] - past[o + 1])):
                continue
        for k in range(_POINTS - 1, 0, -1):
            past[o + k] = past[o + k - 1]
            for i in range(m):
                past[o + _POINTS + k * m + i] = past[o + _POINTS + (k - 1) * m + i]
        past[o] = at.t[0]
        for i in range(m):
            place = run.system.parts.bodies[of.rows[n]]["iq"] + 7 + of.modes[of.first[n] + i]
            past[o + _POINTS + i] = at.q[place]
    return SUCCESS


def _new_scratch(of: StaticModes) -> Scratch:
    n = len(of.modes)
    ahead = np.zeros((_POINTS, n))
    return Scratch(new_iterates(n), np.zeros(n), np.zeros(n), ahead, np.zeros(1, LOOP))


STATIC_MODES = Kind("static_modes", StaticModes, {
    "matrix": add_static_mass, "static": follow_loads, "static_hold": hold,
    "static_rates": put_rates, "static_force": put_forces, "static_path": put_path,
    "static_lag": lag, "static_ahead": look_ahead, "static_begin": forget, "begin": forget,
    "update_history": update_history,
}, scratch=_new_scratch)  # fmt: skip


def static_modes(
    bodies: Sequence[tuple[int, FlexBody, NDArray[np.int64], bool]],
    add_history: Callable[[int], int],
) -> StaticModes:
    """Tables of the quasi-static modes of bodies by row, kinetostatic or not, each by itself."""
    mass_factor, compliance = [], []
    for _, body, modes, _ in bodies:
        square = np.diag(body.K)[modes] / np.diag(body.M_eta)[modes]
        mass_factor.append(_SLOW / square.min())
        compliance.append(np.linalg.inv(body.K[np.ix_(modes, modes)]).ravel())
    rows, _, modes, kinetostatic = zip(*bodies, strict=True)
    return StaticModes(
        np.array(rows, np.int64),
        np.cumsum([0, *map(len, modes)]),
        np.concatenate(modes),
        np.array(kinetostatic, np.int64),
        np.array(mass_factor),
        np.concatenate(compliance),
        np.array([add_history(_POINTS * (1 + len(some))) for some in modes], np.int64),
        np.zeros(len(rows)),
        np.zeros(sum(map(len, modes))),
    )


def of_their_parts(system: System, length: float, size: NDArray[np.float64]) -> System:
    """The system whose quasi-static modes know the part of the model that hangs on them; of size
    `length`, and `size` (nv,) is that of the part of each coordinate [m]."""
    static: StaticModes | None = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return system
    bodies, places = system.parts.bodies, static_coordinates(system)
    part, own = system.part[bodies["iv"]], np.maximum(bodies["mass"], np.finfo(float).tiny)
    gyration, size = np.sqrt(np.trace(bodies["S0"], axis1=1, axis2=2) / own), size.copy()
    for k, iv in enumerate(bodies["iv"]):  # where markers are few
        size[system.part == system.part[iv]] = np.maximum(size[iv], gyration[k])
    mass = np.bincount(part, bodies["mass"])[part]
    static = static._replace(
        mass_factor=static.mass_factor * (mass / own)[static.rows],
        reach=system.weights[places] * length / size[places],
    )
    return system._replace(kinds={**system.kinds, STATIC_MODES.name: static})


def static_bodies(system: System) -> tuple[list[int], list[int]]:
    """Numbers of the bodies with quasi-static modes, and of the kinetostatic ones."""
    static = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return [], []
    return static.rows.tolist(), static.rows[static.kinetostatic == 1].tolist()


def static_coordinates(system: System, *, kinetostatic: bool = False) -> Integers:
    """(k,) places in v of the quasi-static modes: of all, or of kinetostatic bodies."""
    static = system.kinds.get(STATIC_MODES.name)
    if static is None:
        return np.zeros(0, np.int64)
    begins = system.parts.bodies["iv"] + 6
    count = np.diff(static.first)
    places = np.asarray(np.repeat(begins[static.rows], count) + static.modes, np.int64)
    return places[np.repeat(static.kinetostatic == 1, count)] if kinetostatic else places


def free_static_modes(system: System) -> System:
    """The system with all quasi-static modes moving without mass."""
    static: StaticModes | None = system.kinds.get(STATIC_MODES.name)
    if static is None or not static.kinetostatic.any():
        return system
    free = static._replace(kinetostatic=np.zeros_like(static.kinetostatic))
    return system._replace(kinds={**system.kinds, STATIC_MODES.name: free})
