"""Explicit Runge–Kutta pair on the index-1 form, one step.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ) and integrates q̇ = N(q) v, v̇; the Euler
parameters are normalised after the step, then positions and velocities are put back on the
constraints. For scenes without stiff forces. The embedded formula gives the error estimate.
"""

from __future__ import annotations

import math

from flexmb.engine import control
from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.kernels.bodies.motion import normalise, position_rate
from flexmb.engine.kernels.kkt import factorise
from flexmb.engine.kernels.projection import (
    accelerations,
    project_positions,
    project_velocity,
)
from flexmb.engine.kernels.residual import position_stage
from flexmb.engine.method import (
    FACTORISATIONS,
    FINE,
    NO_CONVERGENCE,
    NO_METHOD,
    NOT_FINITE,
    RESIDUALS,
)

_MAX_PROJECTIONS = 10


@kernel
def step(sys, tableau, settings, st, wk, h):
    """One step from `st`; see the contract in `engine.method`."""
    if tableau is None:
        return NO_METHOD
    tr = wk.trial
    nq = st.q.shape[0]
    stages = tableau.b.shape[0]
    copy(st.lam, tr.lam)
    for s in range(stages):
        _combine(st.q, tr.stages, 0, tableau.A[s], s, h, tr.q)
        _combine(st.v, tr.stages, nq, tableau.A[s], s, h, tr.v)
        normalise(sys.parts.bodies, tr.q)
        st.count[RESIDUALS] += 1
        st.count[FACTORISATIONS] += 1
        t = st.t[0] + tableau.c[s] * h
        code = accelerations(sys, wk, t, tr.q, tr.v, tr.vd, tr.lam, 0.0, 0)
        if code < 0:
            return control.failure(code)
        position_rate(sys.parts, tr.q, tr.v, tr.stages[s])
        for i in range(st.v.shape[0]):
            tr.stages[s, nq + i] = tr.vd[i]
    copy(tr.vd, tr.aa)
    tr.t[0] = st.t[0] + h
    _combine(st.q, tr.stages, 0, tableau.b, stages, h, tr.q)
    _combine(st.v, tr.stages, nq, tableau.b, stages, h, tr.v)
    normalise(sys.parts.bodies, tr.q)
    _estimate_error(sys.parts.bodies, sys.weights, tr.stages, tableau.difference, h, tr.error)
    if not math.isfinite(tr.error[0] + tr.error[1]):
        return NOT_FINITE
    return _return_to_constraints(sys, st, wk)


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
def _return_to_constraints(sys, st, wk):
    """Positions onto C = 0 by Newton's method, then velocities, with one factor of M."""
    tr = wk.trial
    position_stage(sys, wk, tr.t[0], tr.q)
    if wk.con.C.shape[0] == 0:
        return FINE
    factorise(sys, wk, tr.v, tr.vd, tr.lam, 0.0, 0.0)
    st.count[FACTORISATIONS] += 1
    if not project_positions(sys, wk, tr.t[0], tr.q, _MAX_PROJECTIONS):
        return NO_CONVERGENCE
    project_velocity(sys, wk, tr.v)
    return FINE
