"""Kinematic analysis: the motion that joints and drivers fix, point by point, in compiled code.

At every time q from C(q, t) = 0 by Newton's method, then v and v̇ from Cq v = −C_t and Cq v̇ = γ,
all with one factor of [[W, Cqᵀ], [Cq, 0]], W a diagonal metric: masses play no part, and rows that
repeat others do no harm. The factor of one point begins the next; reactions follow from
Cqᵀ λ = Q − M v̇. Prediction: q ∘ exp(h v + h²/2 v̇ + h³/6 j), j the last difference of v̇. An
increment is halved where Newton's method fails or the new point does not continue the motion
(`engine.continuity`); Haug, Computer Aided Kinematics and Dynamics, 1989, ch. 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine import continuity
from flexmb.engine.inverse import reactions
from flexmb.engine.jit import entry, inlined
from flexmb.engine.kernels import energy
from flexmb.engine.kernels.algebra.ldl import solve_refined
from flexmb.engine.kernels.algebra.vector import copy, largest, weighted_size
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.bodies.motion import move
from flexmb.engine.kernels.forces import contact, element, force, joint_friction, memory
from flexmb.engine.kernels.functions.time_function import evaluate_all
from flexmb.engine.kernels.joints import constraint, coordinate, reaction, slider
from flexmb.engine.kernels.kkt import factorise_metric
from flexmb.engine.kernels.sensors import sensor, signal
from flexmb.engine.method import (
    CURVE_END,
    FAILED,
    FINE,
    NOT_FINITE,
    OUTPUTS,
    STEPS,
)
from flexmb.engine.point import close, rates
from flexmb.engine.tables import System
from flexmb.engine.work import sizes

# What the entry is asked for.
POINTS, CORRECT, EVALUATE = 0, 1, 2
# Places in Path.number: the increment to try next, motion since the factor (< 0: none of use),
# largest of the least pivots so far.
NEXT, MOVED = 0, 1
# An increment is at least this share of the interval between outputs.
_SMALLEST = 2.0**-22
_KEPT = 8  # singular poses of which time and positions are kept
_CUT = 0.3  # a correction of first positions is cut to this


class Sweep(NamedTuple):
    """What a sweep is asked to do."""

    start: float  # s
    interval: float  # between points, s
    outputs: int  # intervals
    closed: float  # gap that is round-off, weighted
    redundant: int  # rows that repeat others


class Path(NamedTuple):
    """Memory of a sweep, from point to point."""

    metric: np.ndarray  # (nv,) W
    probe: np.ndarray  # (nc,) right side whose solution shows singular poses
    seen: np.ndarray  # (nv,) that solution at the last point
    look: np.ndarray  # (nv,) and at the trial point
    jerk: np.ndarray  # (nv,) last difference of v̇
    change: np.ndarray  # (nv,) corrections of the prediction
    before: np.ndarray  # (functions, 3) functions at the last point
    powers: np.ndarray  # (4, 3) powers at the last outputs, newest first
    number: np.ndarray  # (3,)
    passed: np.ndarray  # (8, 2) times before and after a singular pose
    passed_q: np.ndarray  # (8, nq) positions there
    count: np.ndarray  # (3,) Newton iterations, factorisations, singular poses passed


def new_path(system: System) -> Path:
    """Memory for one sweep; the metric is that of the weights."""
    nq, nv, nc = sizes(system)
    weights = np.where(system.weights > 0.0, system.weights, 1.0)
    signs = np.where(np.random.default_rng(1).random(nc) < 0.5, -1.0, 1.0)
    sizes_of_rows = np.linspace(0.7, 1.3, nc)  # so that no symmetry hides a pose
    n_functions = max(1, len(system.functions.start) - 1)
    return Path(
        weights**2, signs * sizes_of_rows / system.row_weights,
        *(np.zeros(nv) for _ in range(4)), np.zeros((n_functions, 3)), np.zeros((4, 3)),
        np.array([np.inf, -1.0, 0.0]), np.zeros((_KEPT, 2)), np.zeros((_KEPT, nq)),
        np.zeros(3, dtype=np.int64),
    )  # fmt: skip


@inlined
def _reach(sys, settings, st, wk, path):
    """Go to the next output time in one increment, or in several; returns the status."""
    tr, fun, w = wk.trial, wk.con.fun, sys.weights
    target = settings.start + st.count[OUTPUTS] * settings.interval
    first = st.count[OUTPUTS] == 0
    while first or st.t[0] < target:
        left = target - st.t[0]
        h = left
        if not first:
            speed = weighted_size(st.v, w)
            h = continuity.increment(left, min(path.number[NEXT], settings.interval), speed)
        last = h <= _SMALLEST * settings.interval
        tr.t[0] = st.t[0] + h
        evaluate_all(sys.functions, tr.t[0], tr.variables, tr.stack, fun)
        continuity.predict(st.v, st.vd, path.jerk, h, tr.dq, tr.v, tr.vd, path.change)
        if path.number[MOVED] >= 0.0:
            path.number[MOVED] += weighted_size(tr.dq, w)
        move(sys.parts, st.q, tr.dq, tr.q)
        status = NOT_FINITE
        if continuity.finite(sys.functions, fun):
            status = close(sys, settings, wk, path)
        if status == FINE:
            status = rates(sys, settings, wk, path)
        if status == FINE and slider.beyond(sys.parts.sliders, sys.parts, tr.q) >= 0:
            status = CURVE_END
        if status == FINE and not first:
            status = continuity.judge(
                sys.functions, w, st.v, st.vd, tr.v, tr.vd, path, fun, h, last
            )
        if status == FINE:
            if not first:
                continuity.note_passed(w, path, st.t[0], tr.t[0], tr.q)
            continuity.keep(st.vd, tr.vd, h, path.jerk, path.look, path.seen, fun, path.before)
            st.t[0] = target if h == left else tr.t[0]
            copy(tr.q, st.q)
            copy(tr.v, st.v)
            copy(tr.vd, st.vd)
            sensor.follow_angles(sys.sensors, wk.now.marker, st.angles)
            sensor.follow_turns(sys.further, sys.sensors, wk.now.marker, st.angles)
            signal.remember(sys.signals, wk, st.angles)
            st.count[STEPS] += 1
            path.number[NEXT] = max(2.0 * h, path.number[NEXT])
            first = False
            continue
        if last:
            return status
        path.number[MOVED] = -1.0
        path.number[NEXT] = 0.5 * h
        st.count[FAILED] += 1
    return FINE


@inlined
def _report(sys, settings, st, wk, path, out):
    """Write the present point, with reactions and energies."""
    row, now = out.rows[0], wk.now
    contacts, frictions, scalars = sys.contacts, sys.frictions, sys.parts.coordinates
    if st.count[OUTPUTS] == 0:
        memory.begin(sys, contacts, frictions, now, st.t[0], st.q, st.kept)
    status = reactions(sys, st, wk)
    if status != FINE:
        return status
    reaction.read(sys, now.marker, st.lam, wk.dense.g, out.reactions[row])
    out.t[row] = st.t[0]
    copy(st.q, out.q[row])
    copy(st.v, out.v[row])
    copy(st.vd, out.vd[row])
    copy(st.lam, out.lam[row])
    out.drift[row, 0] = largest(wk.con.C)
    out.drift[row, 1] = largest(wk.con.rate)
    e = out.energy[row]
    e[0] = energy.kinetic(sys.parts, now, st.v, wk.dense.B)
    e[1] = energy.strain(sys.parts, st.q)
    e[2] = energy.gravitational(sys.parts, now, st.q)
    e[3] = force.spring_energy(sys.springs, now.marker)
    e[3] += coordinate.spring_energy(scalars, st.q) + contact.energy(contacts, now.marker)
    e[3] += element.energy(sys.elements, scalars, now, st.v)
    energy.powers(sys, now, wk.con.fun, st.v, st.lam, st.power)
    st.power[1] += joint_friction.power(frictions, scalars, now, st.q, st.v)
    continuity.add_works(settings.interval, st.count[OUTPUTS], st.power, path.powers, st.work_done)
    for k in range(3):
        e[4 + k] = st.work_done[k]
    # The power of friction counts what goes into its bristles too; that is not lost yet.
    bristles = contact.bristle_energy(contacts, now)
    bristles += joint_friction.bristle_energy(frictions, scalars, now, st.q, st.v)
    e[3] += bristles
    e[5] += bristles
    memory.keep(sys, contacts, frictions, now, st.t[0], st.q, st.v, st.kept)
    sensor.read(
        sys.further, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam, e, st.angles, out.sensors[row]
    )
    if not (np.isfinite(e[0]) and np.isfinite(largest(st.lam))):
        return NOT_FINITE
    out.rows[0] += 1
    st.count[OUTPUTS] += 1
    return FINE


@entry
def sweep(sys, settings, st, wk, path, out, what, n):
    """POINTS: the next n output points, returns the status.

    EVALUATE: C, Cq, markers and rates at the state. CORRECT: the same, and one Gauss–Newton
    correction of q with least change; returns its weighted size.
    """
    if what == POINTS:
        out.rows[0] = 0
        status = FINE
        while status == FINE and out.rows[0] < n and st.count[OUTPUTS] <= settings.outputs:
            status = _reach(sys, settings, st, wk, path)
            if status == FINE:
                status = _report(sys, settings, st, wk, path, out)
        return float(status)
    evaluate_all(sys.functions, st.t[0], wk.trial.variables, wk.trial.stack, wk.con.fun)
    coordinate.put_values(sys.parts.coordinates, sys, st.q, wk.con.fun)
    kinematics.position(sys.parts, wk.now, st.q)
    constraint.evaluate(sys.lines, sys.rows, wk.now.marker, wk.con)
    factorise_metric(sys, wk, path.metric)
    kinematics.velocity(sys.parts, wk.now, st.v)
    coordinate.put_rates(sys.parts.coordinates, sys, st.v, wk.con.fun)
    constraint.rates(sys.lines, sys.rows, wk.now.marker, wk.con, wk.dense.g[0])
    sensor.follow_angles(sys.sensors, wk.now.marker, st.angles)
    sensor.follow_turns(sys.further, sys.sensors, wk.now.marker, st.angles)
    signal.remember(sys.signals, wk, st.angles)
    if what == EVALUATE:
        return 0.0
    fac, place, nv = wk.factor, sys.kkt.place, st.v.shape[0]
    for i in range(nv):
        fac.rhs[place[i]] = 0.0
    for i in range(wk.con.C.shape[0]):
        fac.rhs[place[nv + i]] = -wk.con.C[i]
    solve_refined(sys.kkt, fac, 2)
    size = 0.0
    for i in range(nv):
        wk.trial.dq[i] = fac.sol[place[i]]
        size = max(size, abs(wk.trial.dq[i]) * sys.weights[i])
    if size > _CUT:
        for i in range(nv):
            wk.trial.dq[i] *= _CUT / size
    move(sys.parts, st.q, wk.trial.dq, st.q)
    return size
