"""Radau IIA with one stage (backward Euler), used if Newton's method for three stages fails.

Modes without mass respond to forces at once, however short the step. If a stop with a damper acts
at one stage and not at the next, no single matrix is close to those of both stages. With one stage
the matrix is renewed in each iteration. Under error control, steps of order 1 are as short as their
error estimate requires.
"""

from __future__ import annotations

import math

from flexmb.engine import method
from flexmb.engine.algebra.ldl import solve
from flexmb.engine.algebra.vector import copy, scaled_max, zero
from flexmb.engine.bodies.motion import move, put_dq_round_off
from flexmb.engine.equations_of_motion import residual, run_stage
from flexmb.engine.integrators.generalized_alpha import correct
from flexmb.engine.integrators.radau_coefficients import STAGES, Radau
from flexmb.engine.iteration_matrix import factorise
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import SUCCESS
from flexmb.engine.projection import POSITIONS, accelerations
from flexmb.engine.state import Run

# Fixed steps are first halved to this share, so that order 1 does not reduce the accuracy.
_SHORT_STEP = 1.0 / 32.0


@unit
def one_stage_step(run: Run, radau: Radau, h: float) -> int:
    """One step with one stage, stored as a linear motion at the three stages; the status."""
    st, tr, settings, col = run.state, run.work.trial, run.settings, run.work.collocation
    if h > _SHORT_STEP * settings.step > 0.0:
        return method.NO_CONVERGENCE
    status = _iterate(run, h)
    if status != SUCCESS:
        return status
    if settings.step == 0.0:
        _estimate_error(run, h)
    for i in range(STAGES):
        for k in range(tr.dq.shape[0]):
            col.u[i, k] = radau.c[i] * tr.dq[k]
        copy(st.power, col.power[i])
        copy(tr.vd, col.a[i])
    for k in range(3):
        tr.work[k] = st.work_done[k] + h * st.power[k]
    st.count[0]["factorisations"] += 1
    cp = radau.filter * h * h if settings.determinate == 0 else 0.0
    copy(tr.vd, tr.aa)
    return accelerations(run, run.trial_point, cp, POSITIONS)


@kernel
def _iterate(run, h):
    """Newton's method for v = v₀ + h v̇, u = h v at the end; a new matrix in each iteration."""
    st, tr, path = run.state, run.work.trial, run.work.collocation.next_a
    for i in range(STAGES):
        zero(path[i])
    if run.settings.static_after_step == 1:
        run_stage(run.stages.static_path, run, run.state_point)
    for k in range(st.v.shape[0]):
        tr.vd[k] = path[0, k]
        tr.v[k] = st.v[k] + h * tr.vd[k]
        tr.dq[k] = h * tr.v[k]
    copy(st.lam, tr.lam)
    tr.t[0] = st.t[0] + h
    put_dq_round_off(run, h)
    for _ in range(run.settings.max_iterations):
        move(run.system.parts, st.q, tr.dq, tr.q)
        st.count[0]["residuals"] += 1
        status = residual(run, run.trial_point)
        if status != SUCCESS:
            return status
        run.work.factor.symmetric[0] = 0
        st.count[0]["regularised_pivots"] += factorise(run, run.trial_point, h, h * h)
        st.count[0]["factorisations"] += 1
        _, units, _, _ = correct(run, h * h, 1.0 / h, h)
        if units <= 1.0:
            move(run.system.parts, st.q, tr.dq, tr.q)
            return SUCCESS
    return method.NO_CONVERGENCE


@kernel
def _estimate_error(run, h):
    """Local error into trial.error: h² v̇/2 of positions, h (v̇ − v̇₀)/2 of velocities, filtered.

    Relative to the error that a step of three stages has if its estimate, which is of lower order,
    equals the tolerance.
    """
    st, tr, fac, kkt = run.state, run.work.trial, run.work.factor, run.system.kkt
    nv, share = tr.dq.shape[0], math.sqrt(run.settings.tolerance)
    for n in range(2):
        for k in range(nv):
            tr.res[k] = 0.5 * h * (h * tr.vd[k] if n == 0 else tr.vd[k] - st.vd[k])
        run_stage(run.stages.mass, run, run.trial_point)
        for k in range(st.lam.shape[0]):
            fac.sol[kkt.place[nv + k]] = 0.0
        solve(kkt, fac, fac.sol)
        for k in range(nv):
            tr.jerk[k] = fac.sol[kkt.place[k]]
        scale = st.q_scale if n == 0 else st.v_scale
        tr.error[n] = scaled_max(tr.jerk, run.system.weights, scale) / share
