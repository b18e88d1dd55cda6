"""Explicit Runge–Kutta of high order on the index-1 form, one step, or Baumgarte's method.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ) and integrates q̇ = N(q) v, v̇ as one vector
(q, v); the Euler parameters of a stage are normalised before it is evaluated. A stage stores the
rates of positions, velocities and works in a row of `Trial.stages`. After the step, positions and
velocities are projected onto the constraints, and the accelerations there are the first stage of
the next step. For models without stiff forces. Tableaux, error estimates and dense output are those
of SciPy's `DOP853` and `RK45`: Dormand & Prince 8(5,3) and 5(4) (Hairer, Nørsett & Wanner, Solving
Ordinary Differential Equations I, 1993, §II.5, II.6, II.10).

Baumgarte's method replaces γ by γ − 2α (Cq v + C_t) − β² C. Then constraint violations obey
C̈ + 2α Ċ + β² C = 0 and decay, with critical damping for α = β (Baumgarte, Comput. Methods Appl.
Mech. Eng. 1 (1972) 1). Nothing is projected, neither after a step nor for outputs: the constraint
drift depends on the step size and the gains. With α = β = 0 it is the plain augmented method, whose
drift grows with t². A step must be short compared to 1/α and 1/β; only then it has its order.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import copy, largest, scaled_max_above, weighted_max, zero
from flexmb.engine.bodies.motion import (
    max_over_round_off,
    motion_of_rate,
    normalise,
    position_rate,
    put_dq_round_off,
)
from flexmb.engine.equations_of_motion import constraint_stage, powers, run_stage
from flexmb.engine.error_scales import add_static_error
from flexmb.engine.jit import CompiledUnit, Matrix, Vector, kernel, unit
from flexmb.engine.method import NO_CONVERGENCE, NOT_FINITE, SUCCESS, Method
from flexmb.engine.projection import NOTHING, POSITIONS, accelerations
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec


# Constraint violation after the projection, over the model size, above which a step is too long.
_MAX_GAP = 1e-9
# Least ratio of stability limits by positions and by velocities: a damper has 0.4, a vibration 0.6.
_POSITION_LIMIT = 0.3
# After _LIMIT_STEPS steps at the stability limit no step exceeds _LIMIT_MARGIN times it, where the
# method damps. Otherwise fast components oscillate by the tolerance, and reactions by much more.
_LIMIT_STEPS, _LIMIT_MARGIN = 10.0, 1.2
# Largest ratio of steps while fast components are at rest but for round-off: beyond the limit they
# grow a hundredfold in a step, which the error estimate detects in time. They are at rest if the
# error is below this share of the allowed one.
_REST_GROWTH, _REST_ERROR = 2.0, 1e-3
# Velocity error over the allowed one that limits the step: the control aims at 0.9⁸ = 0.43, and
# 0.83 of that step has a tenth. Largest ratio of the step that position errors allow to h.
_LIMITING_ERROR, _MAX_STEP_RATIO = 0.1, 5.0
# Largest tolerances (`max_tolerance`): the error ratio of fine and coarse runs is more than three
# times off the order in 10 % of 204 passes of test scenes at 1e-7, 8 % of 122 at 1e-8 and 1e-9, no
# one of 22 below (order 8); 9 % of 153 at 1e-6, 6 % of 72 at 1e-7, 1 of 223 below (order 5).
# Weight of the third-order estimate in that of DOP853 (Hairer, Nørsett & Wanner, eq. II.10.17).
_THIRD_ORDER_SHARE = 0.1


class Tableau(NamedTuple):
    """An explicit method: its stages, the end of the step, and stages of the dense output (all)."""

    A: Matrix  # (all, all) coefficients; row `stages` gives the end of the step
    c: Vector  # (all,)
    stages: int  # of a step
    order: int
    stable: float  # step size times rate of the motion at the limit of stability
    max_tolerance: float  # see `Method`
    errors: Matrix  # (1 or 2, stages + 1): error estimates, the second of order 3
    dense: Matrix  # (all, degree): coefficients of θ, θ², ... in the weight of each stage


def tableau_of(spec: DynamicsSpec) -> Tableau:
    """The tableau for a scene, by its `order`."""
    return dormand_prince_5() if spec.order == 5 else dormand_prince_8()


def dormand_prince_5() -> Tableau:
    """The 5(4) pair of Dormand & Prince, with its dense output of order 4."""
    from scipy.integrate import RK45

    A = np.zeros((7, 7))
    A[:6, :5] = RK45.A
    A[6, :6] = RK45.B
    E, P = RK45.E[None, :].copy(), RK45.P.copy()
    return Tableau(A, np.array([*RK45.C, 1.0]), 6, 5, 2.5, 2e-6, E, P)


def dormand_prince_8() -> Tableau:
    """The method 8(5,3) of Dormand & Prince, with its dense output of order 7."""
    from scipy.integrate import DOP853

    A = np.zeros((16, 16))
    A[:12, :12] = DOP853.A
    A[12, :12] = DOP853.B
    A[13:] = DOP853.A_EXTRA
    c = np.array([*DOP853.C, 1.0, *DOP853.C_EXTRA])
    E = np.array([DOP853.E5, DOP853.E3])
    return Tableau(A, c, 12, 8, 4.5, 1.2e-7, E, _dense_weights(DOP853))


@cache
def _dense_weights(method: type) -> np.ndarray:
    """Weights (16, 7) of the stages in the dense output of DOP853, as powers of the fraction θ.

    It is nested, θ (F₀ + (1 − θ) (F₁ + θ (F₂ + ...))), with F linear in the stages.
    """
    step, first, last = np.zeros(16), np.zeros(16), np.zeros(16)
    step[:12], first[0], last[12] = method.B, 1.0, 1.0
    F = [step, first - step, 2.0 * step - last - first, *method.D]
    weights = np.zeros((16, 7))
    share, basis = np.polynomial.Polynomial([0.0, 1.0]), np.polynomial.Polynomial([1.0])
    for k, coefficients in enumerate(F):
        basis = basis * (share if k % 2 == 0 else 1.0 - share)
        weights += np.outer(coefficients, np.pad(basis.coef[1:], (0, 7 - basis.degree())))
    return weights


def explicit_method(
    tableau: Tableau, step: CompiledUnit, interpolate: CompiledUnit, **more: Any
) -> Method:
    """The record of a method that uses a tableau."""
    return Method(
        (step,), (interpolate,), (tableau,), order=tableau.order, error_order=tableau.order,
        stages=len(tableau.c), filter=0.0, prefers_constant_step=0, collocation=0,
        max_tolerance=tableau.max_tolerance, **more,
    )  # fmt: skip


@kernel
def combine(y, slopes, at, weights, n, h, out):
    """out = y + h Σ weights_s slope_s; y may not be out."""
    zero(out)
    add_slopes(slopes, at, weights, n, out)
    for i in range(y.shape[0]):
        out[i] = y[i] + h * out[i]


@kernel
def add_slopes(slopes, at, weights, n, out):
    """out += Σ weights_s slope_s."""
    for k in range(n):
        weight = weights[k]
        if weight != 0.0:
            for i in range(out.shape[0]):
                out[i] += weight * slopes[k, at + i]


@kernel
def begin_step(run):
    """Accelerations and powers of the state as those of the first stage."""
    st, tr, nq = run.state, run.work.trial, run.state.q.shape[0]
    copy(st.vd, tr.stages[0, nq:])
    copy(st.power, tr.stages[0, nq + st.vd.shape[0] :])
    copy(st.lam, tr.lam)


@kernel
def put_slopes(run, s):
    """Store accelerations and powers of the trial state as those of stage s."""
    tr, count, nq = run.work.trial, run.state.count[0], run.state.q.shape[0]
    count["residuals"] += 1
    count["factorisations"] += 1
    copy(tr.vd, tr.stages[s, nq:])
    if run.settings.does_work == 1:
        powers(run, run.trial_point)
        copy(run.work.powers, tr.stages[s, nq + tr.vd.shape[0] :])


@kernel
def end_step(run, tableau, h, status, of_parameters):
    """Error estimate and works of a step whose end is the trial state; returns its status.

    `status` is that of the end. `of_parameters`: position rates of the stages are q̇, else rates of
    the displacement. Velocities of the last but one stage are in `Trial.aa_start`.
    """
    st, tr, stages = run.state, run.work.trial, tableau.stages
    nq, nv = st.q.shape[0], st.v.shape[0]
    constraint_stage(run, run.trial_point)
    gap = weighted_max(run.work.con.C, run.system.row_weights)
    if status == SUCCESS and run.method.stabilised == 0 and not gap < _MAX_GAP:
        tr.error[0] = tr.error[1] = 0.0  # there is no estimate
        _watch_stability(run, tableau, h, of_parameters)
        return NO_CONVERGENCE
    copy(tr.vd, tr.aa)
    tr.dense_ready[0] = 0
    if run.settings.does_work == 1:
        combine(st.work_done, tr.stages, nq + nv, tableau.A[stages], stages, h, tr.work)
    size = largest(tr.q) + largest(tr.vd)
    if run.settings.step == 0.0:
        _estimate_error(run, tableau.errors, h, of_parameters)
        if run.settings.static_after_step == 1:
            _weighted_motion(run, tableau.A[stages], stages, of_parameters)
            add_static_error(run, h, tableau.order)
        size += tr.error[0] + tr.error[1]
    _watch_stability(run, tableau, h, of_parameters)
    return NOT_FINITE if status == SUCCESS and not math.isfinite(size) else status


@kernel
def put_dense_weights(tableau, share, weights):
    """Weights of the stages in the dense output at a fraction of the step."""
    dense = tableau.dense
    for s in range(tableau.c.shape[0]):
        weights[s] = 0.0
        for k in range(dense.shape[1]):
            weights[s] = share * (weights[s] + dense[s, dense.shape[1] - 1 - k])


@kernel
def _watch_stability(run, tableau, h, of_parameters):
    """Count steps at the stability limit; also those that only velocity errors keep below it.

    The largest rate of the motion is estimated by the difference of accelerations over that of
    velocities between the last two stages, which have the same time (Hairer & Wanner, Solving
    Ordinary Differential Equations II, 1996, §IV.2). Differences that are round-off of positions do
    not count, as in short steps far from the origin.
    """
    tr, weights, nq, last = run.work.trial, run.system.weights, run.state.q.shape[0], tableau.stages
    change, apart, memory = 0.0, 0.0, run.state.memory[0]
    memory["stable_step"] = math.inf
    v, vd = tr.v, tr.stages[last, nq:]
    if run.settings.static_after_step == 1 and of_parameters:
        v, vd = tr.dq_round_off, tr.jerk
    for i in range(tr.v.shape[0]):
        difference = abs(vd[i] - tr.stages[last - 1, nq + i]) * weights[i]
        if not difference <= change:
            change = difference
        apart = max(apart, abs(v[i] - tr.aa_start[i]) * weights[i])
    rate, longer = change / apart if apart > 0.0 else 0.0, _step_of_positions(run, h)
    fastest = rate
    if (h * rate > tableau.stable or longer > h) and math.isfinite(rate):
        for k in range(last):
            tr.shares[k] = h * (tableau.A[last, k] - tableau.A[last - 1, k])
        _weighted_motion(run, tr.shares, last, of_parameters)
        if _is_round_off(run, h):
            if memory["steps_at_stability_limit"] > _LIMIT_STEPS:
                memory["stable_step"] = _REST_GROWTH * h
            return
        moved = weighted_max(tr.dq, weights)
        if longer > h and moved > 0.0:  # rate of a vibration, independent of its phase
            fastest = max(rate, math.sqrt(change / moved))
        # positive root of moved r² + apart r = change: valid also if velocities happen to agree
        slow = 2.0 * change / (apart + math.sqrt(apart * apart + 4.0 * change * moved))
        if longer * slow < _POSITION_LIMIT * tableau.stable:
            return
    if memory["steps_at_stability_limit"] > _LIMIT_STEPS and rate > 0.0:
        memory["stable_step"] = _LIMIT_MARGIN * tableau.stable / rate
    if not longer * fastest <= tableau.stable:  # not finite: unstable as well
        if memory["fastest_rate"] == 0.0 and math.isfinite(rate):
            memory["fastest_rate"] = rate  # later rates are of components that have grown
        memory["steps_at_stability_limit"] += 1.0


@kernel
def _is_round_off(run, h):
    """Whether position differences in Trial.dq, from which stiff forces give any rate, are
    round-off and the error is negligible."""
    tr, allowed = run.work.trial, run.settings.tolerance * run.settings.rejection_factor
    if not max(tr.error[0], tr.error[1]) <= _REST_ERROR * allowed:
        return False
    put_dq_round_off(run, h)
    return max_over_round_off(run, tr.dq) <= 1.0


@kernel
def _step_of_positions(run, h):
    """The step size that position errors alone allow, if velocity errors limit h; otherwise h [s].

    A vibration of rate ω has a position error of 1/ω times its velocity error. So a small vibration
    that is resolved only for its velocity has steps far shorter than positions need. If the longer
    step would be unstable, the motion is stiff nevertheless.
    """
    error, allowed = run.work.trial.error, run.settings.tolerance * run.settings.rejection_factor
    if run.settings.step > 0.0 or not error[1] > max(error[0], _LIMITING_ERROR * allowed):
        return h
    left = max(error[0] / allowed, _MAX_STEP_RATIO ** (-run.method.error_order))
    return h * max(left ** (-1.0 / run.method.error_order), 1.0)


@kernel
def _estimate_error(run, errors, h, of_parameters):
    """Local errors of positions and velocities over their error scales, into trial.error.

    With two estimates, of orders 5 and 3, the error is e₅² / √(e₅² + 0.01 e₃²), which has the order
    of the method. The round-off of accelerations (`projection.put_vd_round_off`) is subtracted.
    """
    st, tr, n, weights = run.state, run.work.trial, errors.shape[1], run.system.weights
    for level in range(2):
        size, low = 0.0, 0.0
        for k in range(errors.shape[0]):
            times = _sum_of_absolutes(errors[k])
            if level == 0:
                _weighted_motion(run, errors[k], n, of_parameters)
                part = scaled_max_above(tr.dq, weights, st.q_scale, h * times, tr.vd_round_off)
            else:
                for i in range(tr.dq.shape[0]):
                    tr.dq[i] = 0.0
                add_slopes(tr.stages, st.q.shape[0], errors[k], n, tr.dq)
                part = scaled_max_above(tr.dq, weights, st.v_scale, times, tr.vd_round_off)
            if k == 0:
                size = h * part
            else:
                low = _THIRD_ORDER_SHARE * h * part
        if low > 0.0:
            size *= size / math.hypot(size, low)  # squares of 1e-170 would be zero
        tr.error[level] = size


@kernel
def _sum_of_absolutes(x):
    """Σ |x_i|."""
    total = 0.0
    for i in range(x.shape[0]):
        total += abs(x[i])
    return total


@kernel
def _weighted_motion(run, weights, n, of_parameters):
    """Trial.dq (nv) = Σ weights_s × position rates, with rotations as rotation vectors."""
    tr = run.work.trial
    out = tr.rate if of_parameters else tr.dq
    zero(out)
    add_slopes(tr.stages, 0, weights, n, out)
    if of_parameters:
        motion_of_rate(run.system.parts, run.state.q, out, tr.dq)


# Default gains: violations decay to 1/e in this share of the run, or in a (longer) fixed step.
_DECAY_TIME_SHARE = 0.05


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `order`."""
    return explicit_method(tableau_of(spec), step, interpolate)


def stabilised_method(spec: DynamicsSpec) -> Method:
    """Baumgarte's method for a scene, by its `order`, `baumgarte_alpha` and `baumgarte_beta`."""
    usual = 1.0 / max(_DECAY_TIME_SHARE * spec.duration, spec.step or 0.0)
    alpha = usual if spec.baumgarte_alpha is None else spec.baumgarte_alpha
    beta = usual if spec.baumgarte_beta is None else spec.baumgarte_beta
    return explicit_method(
        tableau_of(spec), step, interpolate, stabilised=1, alpha=alpha, beta=beta
    )


@unit
def step(run: Run, tableau: Tableau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    st, tr, stages = run.state, run.work.trial, tableau.stages
    position_rate(run.system.parts, st.q, st.v, tr.stages[0])
    begin_step(run)
    for s in range(1, stages):
        status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], s, h, NOTHING)
        if status != SUCCESS:
            return status
    copy(tr.v, tr.aa_start)
    if run.settings.static_after_step == 1:  # the end once more, before kinetostatic modes change
        status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], stages, h, NOTHING)
        copy(tr.vd, tr.jerk)
        copy(tr.v, tr.dq_round_off)
        if status != SUCCESS:
            return status
    status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], stages, h, POSITIONS)
    return end_step(run, tableau, h, status, True)


@kernel
def _evaluate_stage(run, tableau, q, v, t, s, h, project):
    """Rates of stage s of a step h from (t, q, v); the stage becomes the trial state."""
    tr, parts, nq = run.work.trial, run.system.parts, q.shape[0]
    combine(q, tr.stages, 0, tableau.A[s], s, h, tr.q)
    combine(v, tr.stages, nq, tableau.A[s], s, h, tr.v)
    normalise(parts.bodies, tr.q)
    tr.t[0] = t + tableau.c[s] * h
    if run.settings.static_after_step == 1:
        _extrapolate(run)
    status = accelerations(run, run.trial_point, 0.0, project)
    position_rate(parts, tr.q, tr.v, tr.stages[s])
    put_slopes(run, s)
    return status


@kernel
def _extrapolate(run):
    """Prescribe accelerations of kinetostatic modes, extrapolated from the last two points."""
    st, tr, last = run.state, run.work.trial, run.state.memory[0]["last_step"]
    share = (tr.t[0] - st.t[0]) / last if last > 0.0 else 0.0
    for i in range(tr.vd.shape[0]):
        tr.vd[i] = st.vd[i] + share * (st.vd[i] - st.vd_before[i])
    run_stage(run.stages.static_force, run, run.trial_point)


@unit
def interpolate(run: Run, tableau: Tableau, share: float) -> int:
    """Positions and velocities at a fraction of the last accepted step, into the trial state."""
    tr, before = run.work.trial, run.work.trial.before
    h = run.state.t[0] - before.t[0]
    count, weights, nq = tableau.c.shape[0], tr.shares, before.q.shape[0]
    if tr.dense_ready[0] == 0:
        for s in range(tableau.stages + 1, count):
            status = _evaluate_stage(run, tableau, before.q, before.v, before.t[0], s, h, NOTHING)
            if status != SUCCESS:
                return status
        tr.dense_ready[0] = 1
    put_dense_weights(tableau, share, weights)
    combine(before.q, tr.stages, 0, weights, count, h, tr.q)
    combine(before.v, tr.stages, nq, weights, count, h, tr.v)
    copy(before.work_done, tr.work_done)
    if run.settings.does_work == 1:
        combine(before.work_done, tr.stages, nq + tr.v.shape[0], weights, count, h, tr.work_done)
    normalise(run.system.parts.bodies, tr.q)
    return SUCCESS


METHODS = {"explicit-rk": make_method, "baumgarte": stabilised_method}
