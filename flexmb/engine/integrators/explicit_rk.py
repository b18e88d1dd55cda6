"""Explicit Runge–Kutta pair on the index-1 form, one step.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ) and integrates q̇ = N(q) v, v̇; the Euler
parameters are normalised after the step, then positions and velocities are put back on the
constraints. For scenes without stiff forces. The embedded formula gives the error estimate.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.kernels.bodies.motion import normalise, position_rate
from flexmb.engine.kernels.kkt import factorise
from flexmb.engine.kernels.projection import (
    NOTHING,
    accelerations,
    project_positions,
    project_velocity,
)
from flexmb.engine.kernels.stages import position_stage
from flexmb.engine.method import (
    FACTORISATIONS,
    FINE,
    NO_CONVERGENCE,
    NOT_FINITE,
    RESIDUALS,
    Method,
)
from flexmb.engine.records import Matrix, Vector
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.tasks.dynamics import DynamicsSpec

_MAX_PROJECTIONS = 10


class Tableau(NamedTuple):
    """Butcher tableau of an explicit pair: y1 from b, error from b - b_hat."""

    A: Matrix  # (stages, stages)
    b: Vector
    c: Vector
    difference: Vector  # b - b_hat


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene; nothing is to choose."""
    return bogacki_shampine()


def bogacki_shampine() -> Method:
    """The explicit 3(2) pair of Bogacki & Shampine (Appl. Math. Lett. 2, 1989, 321)."""
    A = np.zeros((4, 4))
    A[1, 0] = 1 / 2
    A[2, 1] = 3 / 4
    A[3, :3] = 2 / 9, 1 / 3, 4 / 9
    b = np.array([2 / 9, 1 / 3, 4 / 9, 0.0])
    b_hat = np.array([7 / 24, 1 / 4, 1 / 3, 1 / 8])
    tableau = Tableau(A, b, np.array([0.0, 0.5, 0.75, 1.0]), b - b_hat)
    return Method(
        (step,), (tableau,), order=3, stages=len(b), filter=0.0, tolerance_factor=0.2,
        tolerance_power=1.0,
    )  # fmt: skip


@unit
def step(run: Run, tableau: Tableau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    st, tr, parts, at = run.state, run.work.trial, run.system.parts, run.trial_point
    nq = st.q.shape[0]
    stages = tableau.b.shape[0]
    copy(st.lam, tr.lam)
    for s in range(stages):
        _combine(st.q, tr.stages, 0, tableau.A[s], s, h, tr.q)
        _combine(st.v, tr.stages, nq, tableau.A[s], s, h, tr.v)
        normalise(parts.bodies, tr.q)
        st.count[RESIDUALS] += 1
        st.count[FACTORISATIONS] += 1
        tr.t[0] = st.t[0] + tableau.c[s] * h
        status = accelerations(run, at, 0.0, NOTHING)
        if status != FINE:
            return status
        position_rate(parts, tr.q, tr.v, tr.stages[s])
        for i in range(st.v.shape[0]):
            tr.stages[s, nq + i] = tr.vd[i]
    copy(tr.vd, tr.aa)
    tr.t[0] = st.t[0] + h
    _combine(st.q, tr.stages, 0, tableau.b, stages, h, tr.q)
    _combine(st.v, tr.stages, nq, tableau.b, stages, h, tr.v)
    normalise(parts.bodies, tr.q)
    _estimate_error(parts.bodies, run.system.weights, tr.stages, tableau.difference, h, tr.error)
    if not math.isfinite(tr.error[0] + tr.error[1]):
        return NOT_FINITE
    return _return_to_constraints(run)


@kernel
def _combine(y, slopes, at, weights, n, h, out):
    """out = y + h Σ weights_s slope_s."""
    for i in range(y.shape[0]):
        s = 0.0
        for k in range(n):
            s += weights[k] * slopes[k, at + i]
        out[i] = y[i] + h * s


@kernel
def _estimate_error(bodies, weights, slopes, difference, h, error):
    """Weighted sizes of h Σ difference_s slope_s: the local error of the formula of lower order."""
    error[0] = 0.0
    error[1] = 0.0
    nv = weights.shape[0]
    nq = slopes.shape[1] - nv
    for k in range(bodies.shape[0]):
        iq, iv = bodies[k]["iq"], bodies[k]["iv"]
        for i in range(7 + bodies[k]["m"]):
            # Euler parameters change by half the angle.
            w = weights[iv + i] if i < 3 else 2.0 if i < 7 else weights[iv + i - 1]
            s = w * _sum(slopes, iq + i, difference, h)
            if not s <= error[0]:
                error[0] = s
    for i in range(nv):
        s = weights[i] * _sum(slopes, nq + i, difference, h)
        if not s <= error[1]:
            error[1] = s


@kernel
def _sum(slopes, at, difference, h):
    s = 0.0
    for n in range(difference.shape[0]):
        s += difference[n] * slopes[n, at]
    return abs(h * s)


@kernel
def _return_to_constraints(run):
    """Positions onto C = 0 by Newton's method, then velocities, with one factor of M."""
    at = run.trial_point
    position_stage(run, at)
    if run.work.con.C.shape[0] == 0:
        return FINE
    factorise(run, at, 0.0, 0.0)
    run.state.count[FACTORISATIONS] += 1
    if project_positions(run, at, _MAX_PROJECTIONS) == 0:
        return NO_CONVERGENCE
    project_velocity(run, at)
    return FINE
