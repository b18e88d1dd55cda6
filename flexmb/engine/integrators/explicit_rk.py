"""Explicit Runge–Kutta of high order on the index-1 form, one step.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ) and integrates q̇ = N(q) v, v̇ as one vector
(q, v); the Euler parameters of a stage are normalised before it is evaluated. After the step
positions and velocities are put on the constraints, and the accelerations there are the first stage
of the next step. Tableaux, error estimates and dense output are those of SciPy's `DOP853` and
`RK45`: Dormand & Prince 8(5,3) and 5(4) (Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, 1993, §II.5, II.6, II.10). For scenes without stiff forces.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.vector import copy, scaled_size, weighted_size
from flexmb.engine.kernels.bodies.motion import motion_of_rate, normalise, position_rate
from flexmb.engine.kernels.projection import NOTHING, POSITIONS, accelerations
from flexmb.engine.kernels.stages import constraint_stage, powers
from flexmb.engine.method import (
    FACTORISATIONS,
    FINE,
    NO_CONVERGENCE,
    NOT_FINITE,
    RESIDUALS,
    STIFF_STEPS,
    Method,
)
from flexmb.engine.records import Matrix, Vector
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.tasks.dynamics import DynamicsSpec

# Gap of a joint over the size of the model after its corrections: the step is too long for them.
_OPEN = 1e-9
# Share of the third-order estimate in that of DOP853 (Hairer, Nørsett & Wanner, eq. II.10.17).
_THIRD = 0.1


class Tableau(NamedTuple):
    """An explicit method: stages, the end of the step as one more, stages of the dense output."""

    A: Matrix  # (all, all) coefficients; row `stages` gives the end of the step
    c: Vector  # (all,)
    stages: int  # of a step
    stable: float  # step times rate from which on it is near its limit of stability
    errors: Matrix  # (1 or 2, stages + 1): error estimate; beside that of order 5 one of order 3
    dense: Matrix  # (all, degree): weight of each stage at the share θ, times θ, θ², ...


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `order`."""
    return dormand_prince_5() if spec.order == 5 else dormand_prince_8()


def dormand_prince_5() -> Method:
    """The 5(4) pair of Dormand & Prince, with its dense output of order 4."""
    from scipy.integrate import RK45

    A = np.zeros((7, 7))
    A[:6, :5] = RK45.A
    A[6, :6] = RK45.B
    tableau = Tableau(A, np.array([*RK45.C, 1.0]), 6, 2.5, RK45.E[None, :].copy(), RK45.P.copy())
    return _method(tableau, order=5, loosest=2e-6)


def dormand_prince_8() -> Method:
    """The method 8(5,3) of Dormand & Prince, with its dense output of order 7."""
    from scipy.integrate import DOP853

    A = np.zeros((16, 16))
    A[:12, :12] = DOP853.A
    A[12, :12] = DOP853.B
    A[13:] = DOP853.A_EXTRA
    c = np.array([*DOP853.C, 1.0, *DOP853.C_EXTRA])
    tableau = Tableau(A, c, 12, 4.5, np.array([DOP853.E5, DOP853.E3]), _dense_weights(DOP853))
    return _method(tableau, order=8, loosest=3e-7)


@cache
def _dense_weights(method: type) -> np.ndarray:
    """Weights (16, 7) of the stages in the dense output of DOP853, as powers of the share θ.

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


def _method(tableau: Tableau, order: int, loosest: float) -> Method:
    return Method(
        (step,), (interpolate,), (tableau,), order=order, error_order=order,
        stages=len(tableau.c), filter=0.0, keeps_step=0, collocation=0, loosest=loosest,
    )  # fmt: skip


@unit
def step(run: Run, tableau: Tableau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    st, tr, stages = run.state, run.work.trial, tableau.stages
    position_rate(run.system.parts, st.q, st.v, tr.stages[0])
    nq, nv = st.q.shape[0], st.v.shape[0]
    copy(st.vd, tr.stages[0, nq:])
    copy(st.power, tr.stages[0, nq + nv :])
    copy(st.lam, tr.lam)
    for s in range(1, stages):
        status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], s, h, NOTHING)
        if status != FINE:
            return status
    copy(tr.v, tr.aa_start)
    status = _evaluate_stage(run, tableau, st.q, st.v, st.t[0], stages, h, POSITIONS)
    if h * _stiffness(run, stages) > tableau.stable:
        st.memory[STIFF_STEPS] += 1.0
    constraint_stage(run, run.trial_point)
    if status == FINE and not weighted_size(run.work.con.C, run.system.row_weights) < _OPEN:
        return NO_CONVERGENCE
    copy(tr.vd, tr.aa)
    tr.extended[0] = 0
    if run.settings.works == 1:
        _combine(st.work_done, tr.stages, nq + nv, tableau.A[stages], stages, h, tr.work)
    _estimate_error(run, tableau.errors, h)
    if status == FINE and not math.isfinite(tr.error[0] + tr.error[1]):
        return NOT_FINITE
    return status


@kernel
def _stiffness(run, stages):
    """Largest rate of the motion, by the two last stages, which stand at the same time [1/s].

    Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, §IV.2.
    """
    tr, weights, nq = run.work.trial, run.system.weights, run.state.q.shape[0]
    change, apart = 0.0, 0.0
    for i in range(tr.v.shape[0]):
        difference = tr.stages[stages, nq + i] - tr.stages[stages - 1, nq + i]
        change = max(change, abs(difference) * weights[i])
        apart = max(apart, abs(tr.v[i] - tr.aa_start[i]) * weights[i])
    return change / apart if apart > 0.0 else 0.0


@kernel
def _evaluate_stage(run, tableau, q, v, t, s, h, project):
    """Slopes of stage s of a step h from (t, q, v); leaves its state in the trial state."""
    tr, parts, count = run.work.trial, run.system.parts, run.state.count
    nq = q.shape[0]
    _combine(q, tr.stages, 0, tableau.A[s], s, h, tr.q)
    _combine(v, tr.stages, nq, tableau.A[s], s, h, tr.v)
    normalise(parts.bodies, tr.q)
    tr.t[0] = t + tableau.c[s] * h
    count[RESIDUALS] += 1
    count[FACTORISATIONS] += 1
    status = accelerations(run, run.trial_point, 0.0, project)
    position_rate(parts, tr.q, tr.v, tr.stages[s])
    copy(tr.vd, tr.stages[s, nq:])
    if run.settings.works == 1:
        powers(run, run.trial_point)
        copy(run.work.powers, tr.stages[s, nq + tr.vd.shape[0] :])
    return status


@kernel
def _combine(y, slopes, at, weights, n, h, out):
    """out = y + h Σ weights_s slope_s; y may not be out."""
    for i in range(y.shape[0]):
        out[i] = 0.0
    _add_slopes(slopes, at, weights, n, out)
    for i in range(y.shape[0]):
        out[i] = y[i] + h * out[i]


@kernel
def _add_slopes(slopes, at, weights, n, out):
    """out += Σ weights_s slope_s."""
    for k in range(n):
        weight = weights[k]
        if weight != 0.0:
            for i in range(out.shape[0]):
                out[i] += weight * slopes[k, at + i]


@unit
def interpolate(run: Run, tableau: Tableau, share: float) -> int:
    """Positions and velocities at a share of the last accepted step, into the trial state."""
    tr, before = run.work.trial, run.work.trial.before
    h = run.state.t[0] - before.t[0]
    count, weights, nq = tableau.c.shape[0], tr.shares, before.q.shape[0]
    if tr.extended[0] == 0:
        for s in range(tableau.stages + 1, count):
            status = _evaluate_stage(run, tableau, before.q, before.v, before.t[0], s, h, NOTHING)
            if status != FINE:
                return status
        tr.extended[0] = 1
    for s in range(count):
        weights[s] = 0.0
        for k in range(tableau.dense.shape[1]):
            weights[s] = share * (weights[s] + tableau.dense[s, tableau.dense.shape[1] - 1 - k])
    _combine(before.q, tr.stages, 0, weights, count, h, tr.q)
    _combine(before.v, tr.stages, nq, weights, count, h, tr.v)
    copy(before.work_done, tr.work_done)
    if run.settings.works == 1:
        _combine(before.work_done, tr.stages, nq + tr.v.shape[0], weights, count, h, tr.work_done)
    normalise(run.system.parts.bodies, tr.q)
    return FINE


@kernel
def _estimate_error(run, errors, h):
    """Local errors of positions and velocities over the motion so far, into trial.error.

    With two estimates, of orders 5 and 3, e₅² / √(e₅² + 0.01 e₃²), of the order of the method.
    """
    st, tr, n = run.state, run.work.trial, errors.shape[1]
    for level in range(2):
        size, low = 0.0, 0.0
        for k in range(errors.shape[0]):
            if level == 0:
                _put_motion(run, errors[k], n, tr.dq)
                part = scaled_size(tr.dq, run.system.weights, st.motion, 0.0)
            else:
                for i in range(tr.dq.shape[0]):
                    tr.dq[i] = 0.0
                _add_slopes(tr.stages, st.q.shape[0], errors[k], n, tr.dq)
                part = scaled_size(tr.dq, run.system.weights, st.speed, 0.0)
            if k == 0:
                size = h * part
            else:
                low = _THIRD * h * part
        if low > 0.0:
            size *= size / math.sqrt(size * size + low * low)
        tr.error[level] = size


@kernel
def _put_motion(run, weights, n, out):
    """out (nv) = Σ weights_s of the position rates, as motion: rotations as rotation vectors."""
    tr = run.work.trial
    rate = tr.rate
    for i in range(rate.shape[0]):
        rate[i] = 0.0
    _add_slopes(tr.stages, 0, weights, n, rate)
    motion_of_rate(run.system.parts, run.state.q, rate, out)
