"""Radau IIA with three stages on the index-3 equations of motion, one step.

The constraints hold at the stages. The velocities of the new point are projected onto theirs in the
metric of the mass matrix, which gives order 5 in positions, velocities and multipliers. Unknowns
are the displacements uᵢ of the stages from the start of the step, rotations as rotation vectors:
u̇ = A⁻¹ u / h, ω = T(u) u̇, v̇ = A⁻¹ (v − v₀) / h. Simplified Newton iteration solves two linear
systems (`radau_systems`). The error is estimated by an embedded formula of order 3, filtered by
S(h/γ)⁻¹ M. Stiff modes are damped, not resolved. Source: Hairer & Wanner, Solving Ordinary
Differential Equations II, 1996, §IV.8; for constraints Hairer, Lubich & Roche, The Numerical
Solution of Differential-Algebraic Systems by Runge–Kutta Methods, 1989, §6.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexmb.engine import method
from flexmb.engine.algebra.vector import copy, part, put_part, scaled_max_above, weighted_max, zero
from flexmb.engine.bodies.motion import (
    angular_velocity,
    interpolate_step,
    move,
    put_dq_round_off,
    put_motion,
    rotation_rate,
)
from flexmb.engine.equations_of_motion import (
    feedback_stage,
    pose_stage,
    powers,
    reaction_stage,
    residual,
    run_stage,
    velocity_stage,
)
from flexmb.engine.error_scales import add_static_error_of_path
from flexmb.engine.integrators.one_stage import one_stage_step
from flexmb.engine.integrators.radau_coefficients import (
    STAGES,
    Radau,
    put_stage_weights,
    radau_coefficients,
    stage_sum,
)
from flexmb.engine.integrators.radau_systems import correct_stages, factorise_stages, filter_motion
from flexmb.engine.iteration_matrix import (
    LARGEST_REDUNDANT_PIVOT,
    REFACTOR_ABOVE,
    SETTLED_NOISE,
    check_contraction,
    has_dependent_rows,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import Method
from flexmb.engine.projection import POSITIONS, accelerations
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# Newton's method stops at the first share of the error of a step whose estimate equals the
# tolerance. For accuracies up to _CLOSE_ACCURACY it stops at the second one, and on the shorter
# steps of a plan at less, as their errors are: else the difference of both runs would hardly show
# what is left, though a motion may multiply it (a body about its middle axis). Everywhere that
# would cost a quarter more evaluations.
_NEWTON_SHARE, _CLOSE_SHARE, _CLOSE_ACCURACY = 5e-3, 5e-4, 1e-7
# An old factor is renewed before a step if the expected contraction exceeds this.
_RENEW_ABOVE = 0.1
# Largest relative change of the step size with which an old factor is used.
_STEP_CHANGE = 0.1
# Corrections of positions up to this many times round-off that no longer decrease are noise. They
# are compared with the last two, since contractions with an old factor vary.
_NOISE_FACTOR = 50.0
# Across a singular pose: regularisation of constraint rows over the standard one.
_SINGULAR_REGULARISATION = 1e5
# After such a step: if a constraint violation before the last correction exceeds this many times
# the allowed correction, a shorter step is tried; most of these trials.
_GAP_RATIO, _MAX_TRIES = 10.0, 3.0
# Longest step over the last one for which its stages are extrapolated; a short step at the end of a
# jump does not predict what follows. With 1e4 and 1e5 runs fail in which the table of a reference
# value changes within 1e-9 to 1e-5 s.
_MAX_EXTRAPOLATION = 20.0
# Error estimates below this many times round-off are noise, as of stiff components at rest.
_ERROR_NOISE = 50.0


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene; it has no options."""
    return radau_5()


def radau_5() -> Method:
    """Radau IIA of order 5."""
    coefficients = radau_coefficients()
    return Method(
        (step,), (interpolate,), (coefficients,), order=5, error_order=4, stages=0,
        filter=coefficients.filter, prefers_constant_step=1, max_tolerance=3e-4,
        collocation=STAGES, mass_refinements=2,
    )  # fmt: skip


@unit
def step(run: Run, radau: Radau, h: float) -> int:
    """One step from the state; see the contract in `engine.method`.

    Near a singular pose the constraint rows may be dependent at one stage and conflicting at the
    next, so that one factor does not fit all stages. Then Newton's method is repeated with stronger
    regularisation, which keeps the multipliers of dependent rows near their prediction. If it fails
    with quasi-static modes, a step of one stage is tried.
    """
    memory, real = run.state.memory[0], run.work.collocation.real
    status = _iterate(run, radau, h)
    if status == method.NO_CONVERGENCE and has_dependent_rows(real, LARGEST_REDUNDANT_PIVOT):
        memory["regularisation"], memory["factor_step"] = _SINGULAR_REGULARISATION, 0.0
        status = _iterate(run, radau, h)
        memory["regularisation"], memory["factor_step"] = 0.0, 0.0
        shorter = run.settings.step == 0.0 and memory["failures_since"] < _MAX_TRIES
        if status == method.SUCCESS and shorter and not _constraints_hold(run, h):
            status = method.NO_CONVERGENCE
    failed = status == method.NO_CONVERGENCE and len(run.stages.static.units) > 0
    return one_stage_step(run, radau, h) if failed else status


@kernel
def _constraints_hold(run, h):
    """Whether the constraints hold at all stages, which a small correction does not guarantee."""
    gap, weights = run.work.collocation.gap, run.system.row_weights
    most = _GAP_RATIO * _allowed_correction(run, h)
    for i in range(STAGES):
        for k in range(gap.shape[1]):
            if not abs(gap[i, k]) * weights[k] <= most:
                return False
    return True


@kernel
def _iterate(run, radau, h):
    """Newton's method for the stages of a step."""
    memory, age = run.state.memory[0], run.work.collocation.age
    _predict(run, radau, h)
    memory["factor_age"], age[0] = age[0], -1.0  # outputs do not change the factors
    if abs(memory["factor_step"] - h) > _STEP_CHANGE * h or memory["contraction"] > _RENEW_ABOVE:
        memory["factor_age"] = -1.0
    allowed = _allowed_correction(run, h)
    put_dq_round_off(run, h)
    earlier, last, last_moved, least, slowest, settled = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(run.settings.max_iterations):
        _put_rates(run, radau, h)
        for i in (0, 2, 1):
            status = _evaluate_stage(run, radau, h, i)
            if status != method.SUCCESS:
                return status
        if memory["factor_age"] < 0.0:  # at the middle stage, which was evaluated last
            factorise_stages(run, radau, h)
            last = slowest = 0.0  # a contraction is a ratio of corrections with one factor
        size, moved, units = correct_stages(run, radau, h)
        if not math.isfinite(size):
            return method.NOT_FINITE
        quiet = units <= _NOISE_FACTOR and last > 0.0 and size > REFACTOR_ABOVE * last
        noise, stuck = quiet and size > REFACTOR_ABOVE * earlier > 0.0, False
        if last > 0.0 and not quiet:
            slowest = max(slowest, size / last)  # the next one may be small by chance
            memory["contraction"] = slowest
            # corrections of fast components may change slow ones as much, over their small scales
            if size > allowed and check_contraction(memory, size / last):
                least = 0.5
                stuck = moved > 0.5 * last_moved
        earlier, last, last_moved = last, size, moved
        theta = max(min(memory["contraction"], 0.99), least)
        if n > 0 and units <= 1.0:  # within round-off, which singular poses amplify
            settled = max(settled, size)
        if stuck and size > SETTLED_NOISE * settled:
            return method.NO_CONVERGENCE
        if noise or stuck or theta / (1.0 - theta) * size <= allowed:
            return _finish(run, radau, h)
    if last <= SETTLED_NOISE * settled:
        return _finish(run, radau, h)
    return method.NO_CONVERGENCE


@kernel
def _allowed_correction(run, h):
    """Allowed size of the error that Newton's method leaves, over the error scales."""
    settings = run.settings
    if settings.newton_tolerance > 0.0:
        return settings.newton_tolerance * h * h * weighted_max(run.state.vd, run.system.weights)
    # the error estimate is of order h⁴, the error of the step of order h⁶
    share = _NEWTON_SHARE
    if settings.accuracy <= _CLOSE_ACCURACY:
        share = _CLOSE_SHARE / max(settings.refinement, 1.0) ** (run.method.order + 1)
    return share * settings.tolerance**1.5


@kernel
def _predict(run, radau, h):
    """Predict the stages by extrapolating accelerations and multipliers of the last step."""
    st, col, span = run.state, run.work.collocation, run.work.collocation.span
    has_step, before = h <= _MAX_EXTRAPOLATION * span[1], st.memory[0]["last_step"]
    for i in range(STAGES):
        x = (st.t[0] + radau.c[i] * h - span[0]) / span[1] if has_step else 0.0
        put_stage_weights(radau, x, col.share[i])
    for k in range(st.v.shape[0]):
        for i in range(STAGES):
            col.next_a[i, k] = stage_sum(col.share[i], col.a, k) if has_step else st.vd[k]
    if run.settings.static_after_step == 1:
        run_stage(run.stages.static_path, run, run.state_point)
    for k in range(st.v.shape[0]):
        for i in range(STAGES):
            col.v[i, k] = st.v[k] + h * stage_sum(radau.A[i], col.next_a, k)
        for i in range(STAGES):
            col.u[i, k] = h * stage_sum(radau.A[i], col.v, k)
    bodies = run.system.parts.bodies
    for b in range(bodies.shape[0]):
        o = bodies[b]["iv"] + 3
        for _ in range(2):  # from angular velocities to rotation vectors
            for i in range(STAGES):
                put_part(col.change[i], o, rotation_rate(part(col.u[i], o), part(col.v[i], o)))
            for i in range(STAGES):
                for k in range(o, o + 3):
                    col.u[i, k] = h * stage_sum(radau.A[i], col.change, k)
    for k in range(st.lam.shape[0]):
        for i in range(STAGES):
            col.next_lam[i, k] = stage_sum(col.share[i], col.lam, k) if has_step else st.lam[k]
        rise = (st.lam[k] - st.lam_before[k]) / before if h <= _MAX_EXTRAPOLATION * before else 0.0
        for i in range(STAGES):
            col.lam[i, k] = col.next_lam[i, k]
            col.next_lam[i, k] = st.lam[k] + radau.c[i] * h * rise  # for the regularisation
    span[1] = 0.0


@unit
def _put_rates(run: Run, radau: Radau, h: float) -> int:
    """Velocities and accelerations of all stages from their displacements."""
    st, col, bodies = run.state, run.work.collocation, run.system.parts.bodies
    nv = st.v.shape[0]
    for n in range(STAGES):
        for k in range(nv):
            col.v[n, k] = stage_sum(radau.inverse[n], col.u, k) / h
        for b in range(bodies.shape[0]):
            o, u, v = bodies[b]["iv"] + 3, col.u[n], col.v[n]
            put_part(v, o, angular_velocity(part(u, o), part(v, o)))
    for n in range(STAGES):
        rate = radau.inverse[n]
        for k in range(nv):
            col.a[n, k] = (stage_sum(rate, col.v, k) - (rate[0] + rate[1] + rate[2]) * st.v[k]) / h
    return method.SUCCESS


@unit
def _evaluate_stage(run: Run, radau: Radau, h: float, i: int) -> int:
    """Residual and constraint values of stage i, into its rows of the collocation; the status."""
    tr, col = run.work.trial, run.work.collocation
    _place_stage(run, radau, h, i)
    run.state.count[0]["residuals"] += 1
    status = residual(run, run.trial_point)
    copy(tr.res, col.res[i])
    copy(run.work.con.C, col.gap[i])
    return status


@kernel
def _place_stage(run, radau, h, i):
    """Make stage i the trial state."""
    st, tr, col = run.state, run.work.trial, run.work.collocation
    move(run.system.parts, st.q, col.u[i], tr.q)
    copy(col.v[i], tr.v)
    copy(col.a[i], tr.vd)
    copy(col.lam[i], tr.lam)
    tr.t[0] = st.t[0] + radau.c[i] * h


@kernel
def _add_works(run, radau, h):
    """Works of the step by the quadrature of the method, without the projection at its end."""
    st, tr, col, at = run.state, run.work.trial, run.work.collocation, run.trial_point
    copy(st.work_done, tr.work)
    for i in range(STAGES):
        _place_stage(run, radau, h, i)
        run_stage(run.stages.functions, run, at)
        pose_stage(run, at)
        velocity_stage(run, at)
        feedback_stage(run, at)
        reaction_stage(run, at)
        powers(run, at)
        for k in range(3):
            col.power[i, k] = run.work.powers[k]
            tr.work[k] += h * radau.A[STAGES - 1, i] * col.power[i, k]


@kernel
def _finish(run, radau, h):
    """End of the step: its last stage with projected velocities; works; returns the status."""
    st, tr, col, memory, last = (
        run.state, run.work.trial, run.work.collocation, run.state.memory[0], STAGES - 1
    )  # fmt: skip
    if run.settings.step == 0.0:
        _estimate_error(run, radau, h)
    if memory["factor_age"] >= 0.0:  # otherwise the factor is to be renewed
        memory["factor_age"] += 1.0
    measured = memory["contraction"] if memory["contraction"] < 1.0 else 0.0
    # the matrix changes by about the displacement over the model size, or the rotation
    memory["contraction"] = min(0.99, measured + weighted_max(col.u[last], run.system.weights))
    _put_rates(run, radau, h)  # including the last correction
    does_work = run.settings.does_work == 1 and run.settings.static_after_step == 0
    if does_work:
        _add_works(run, radau, h)
    _place_stage(run, radau, h, last)
    col.span[0], col.span[1] = st.t[0], h
    col.age[0] = memory["factor_age"]
    st.count[0]["factorisations"] += 1
    cp = radau.filter * h * h if run.settings.determinate == 0 else 0.0
    copy(col.a[last], tr.aa)
    status = accelerations(run, run.trial_point, cp, POSITIONS)
    if does_work:
        tr.work[0] += run.work.con.impulse_work[0]  # else drivers had their works of order 3
    if run.settings.step == 0.0 and run.settings.static_after_step == 1:
        add_static_error_of_path(run, h, run.method.error_order)
    return status


@kernel
def _estimate_error(run, radau, h):
    """Local error of the embedded formula of order 3, filtered by S(h/γ)⁻¹ M, into trial.error.

    The velocity error is f and, by (I − h/γ ∂f/∂y)⁻¹, the position error e + h/γ f, both in the
    directions that the constraints allow.
    """
    st, tr, col = run.state, run.work.trial, run.work.collocation
    e, c = radau.error, h / radau.gamma
    for k in range(st.v.shape[0]):
        motion, change = c * st.v[k], c * st.vd[k]
        for i in range(STAGES):
            motion += e[i] * col.u[i, k]
            change += e[i] * (col.v[i, k] - st.v[k])
        tr.dq[k], tr.jerk[k] = motion + c * change, change
    filter_motion(run, tr.dq)
    filter_motion(run, tr.jerk)
    tr.error[0] = scaled_max_above(tr.dq, run.system.weights, st.q_scale, 0.0, tr.dq_round_off)
    tr.error[1] = scaled_max_above(
        tr.jerk, run.system.weights, st.v_scale, _ERROR_NOISE / c, tr.dq_round_off
    )


@unit
def interpolate(run: Run, radau: Radau, share: float) -> int:
    """Positions, velocities and works at a fraction of the last accepted step, as trial state.

    The differences of the stages from the cubic give its next term. `Trial.aa` becomes the
    interpolated acceleration of the stages.
    """
    st, tr, col, works = run.state, run.work.trial, run.work.collocation, radau.works
    before = tr.before
    zero(tr.dense_correction)
    put_stage_weights(radau, share, col.share[0])
    for k in range(tr.aa.shape[0]):
        tr.aa[k] = stage_sum(col.share[0], col.a, k)
    for i in range(
        STAGES - 1 if run.settings.static_after_step == 0 else 0
    ):  # kinetostatic modes differ from the stages
        put_motion(run, radau.c[i], tr.dq, tr.v)
        for k in range(tr.dq.shape[0]):
            tr.dense_correction[k] += radau.bend[i] * (col.u[i, k] - tr.dq[k])
    status = interpolate_step(run, share)
    h = st.t[0] - before.t[0]
    for k in range(3 * run.settings.does_work if run.settings.static_after_step == 0 else 0):
        work, whole = 0.0, 0.0
        for n in range(STAGES, -1, -1):
            rate = works[n, 0] * before.power[k] + works[n, STAGES] * st.power[k]
            for i in range(STAGES - 1):
                rate += works[n, 1 + i] * col.power[i, k]
            work, whole = share * (work + rate), whole + rate
        rest = st.work_done[k] - before.work_done[k] - h * whole
        tr.work_done[k] = before.work_done[k] + h * work + share * rest
    return status  # type: ignore[no-any-return]


METHODS = {"radau": make_method}
