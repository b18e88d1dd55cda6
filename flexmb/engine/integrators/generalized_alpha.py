"""Generalized-α on the Lie group for index-3 equations of motion, one step.

Arnold & Brüls, Multibody Syst. Dyn. 18 (2007) 185; Brüls, Cardona & Arnold, Mech. Mach. Theory 48
(2012) 121. The unknown of Newton's method is the correction δq of the displacement of the step,
with δv = γ/(βh) δq, δv̇ = δq/b, b = β'h² = βh²(1−α_f)/(1−α_m); multipliers are scaled by b. One
factor of S = M + (γb/(βh)) ∂F/∂v + b ∂F/∂q, bordered by Cq, is used as long as Newton's method
contracts well with it: the symmetric LDLᵀ, or the unsymmetric LDU if that contracts by more than
0.2 when it is new. It is renewed before a step if the expected contraction exceeds 0.1, and within
a step if the measured one exceeds 0.3; above 0.9 the step fails.

Under error control one correction may be enough for a step. The error that it leaves is carried to
the next step: along stiff dampers it alternates and grows if the contraction exceeds
(1 − ρ)/(8 + 3.4 ρ), up to the tolerance of Newton's method, which is a large error of reactions.
(From the recursion for m v̇ + c v = 0, the limit for all c h/m is 0.126, 0.053, 0.0188, 0.0045 at
ρ = 0, 0.5, 0.8, 0.95.) Half of this limit is used, since contractions differ with direction.

The methods of Hilber, Hughes & Taylor and of Newmark are special cases (Géradin & Rixen, Mechanical
Vibrations, 2015, §7.3). In constrained directions all of them have the recursion of an oscillator
of infinite frequency: errors of velocities and accelerations decay by the spectral radius ρ at
infinity, after growing by about 1/(1 − ρ)². Above ρ = 0.95 they grow faster than they decay
(measured: at 0.98 a chain of three bodies fails), and with ρ = 1 they never decay (Cardona &
Géradin, Computers & Structures 33 (1989) 801). For such ρ, velocities, accelerations and
multipliers are projected onto the constraints after each step, which costs a second factor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.ldl import solve, solve_refined
from flexmb.engine.algebra.vector import copy, weighted_max
from flexmb.engine.bodies.motion import interpolate_step, move, put_dq_round_off
from flexmb.engine.equations_of_motion import position_stage, residual, run_stage
from flexmb.engine.error_scales import add_static_error_of_path
from flexmb.engine.iteration_matrix import (
    LARGEST_REDUNDANT_PIVOT,
    REFACTOR_ABOVE,
    SETTLED_NOISE,
    check_contraction,
    factorise,
    has_dependent_rows,
    remove_self_stress,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import NO_CONVERGENCE, NOT_FINITE, SUCCESS, Method
from flexmb.engine.projection import POSITIONS, VELOCITIES, accelerations, depends_on_solution
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# If the contraction expected for a step exceeds this, iterations cost more than a new factor
# (flexible slider-crank: 27 µs per step at 0.03, 30 at 0.1, 35 at 0.3; a single rigid body pays
# for factors, not for iterations).
_RENEW_ABOVE = 0.1
# Corrections of positions up to this many times round-off that no longer decrease are noise.
_NOISE_FACTOR = 50.0
# Under error control Newton's method stops when the error that remains is below these shares of the
# local tolerance of positions and of velocities.
_POSITION_SHARE, _VELOCITY_SHARE = 0.05, 0.3
# Number of equal steps after which differences of accelerations are smooth. Until then the velocity
# error is at most the last one, scaled by h³, times _BOUND_GROWTH.
_SMOOTH_STEPS, _BOUND_GROWTH = 3, 1.5
# Largest spectral radius at infinity without projection after each step.
_MAX_UNPROJECTED_RADIUS = 0.95
# Steps shorter than these shares of the longest one, as near an event, are projected if drivers do
# work or rows are redundant: their multipliers have what is left of the constraints, over h².
# Later steps keep the self-stress of redundant rows.
_SHORT_STEP, _SHORT_STEP_OF_REDUNDANT_ROWS = 0.01, 0.5
# Self-stress of redundant rows is removed after so many steps: round-off of positions adds to it
# 1e-7 of the mass over b in each, which the tangent of Cqᵀλ brings into the matrix.
_RELIEF_INTERVAL = 50
_ROUND_OFF = 1e-12
# Iterative refinements of a solve with a factor whose pivots were replaced.
_REFINEMENTS = 3


class Alpha(NamedTuple):
    """Coefficients of generalized-α."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    project: int  # 1: velocities and accelerations are projected after each step
    settling: float  # largest contraction with which one correction may be enough for a step


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `spectral_radius`."""
    return generalized_alpha(0.8 if spec.spectral_radius is None else spec.spectral_radius)


def make_hht(spec: DynamicsSpec) -> Method:
    """The method of Hilber, Hughes & Taylor, by its `alpha`."""
    return hilber_hughes_taylor(-0.1 if spec.alpha is None else spec.alpha)


def make_newmark(spec: DynamicsSpec) -> Method:
    """Newmark's method by its `gamma` and `beta`, without `beta` of most damping."""
    gamma = 0.5 if spec.gamma is None else spec.gamma
    return newmark(0.25 * (gamma + 0.5) ** 2 if spec.beta is None else spec.beta, gamma)


def make_trapezoidal(spec: DynamicsSpec) -> Method:
    """The trapezoidal rule, without options."""
    return newmark(0.25, 0.5)


def generalized_alpha(spectral_radius: float) -> Method:
    """Chung & Hulbert's coefficients for a spectral radius at infinity in [0, 1]."""
    rho = spectral_radius
    alpha_m = (2.0 * rho - 1.0) / (rho + 1.0)
    alpha_f = rho / (rho + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return _method(alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma, rho)


def hilber_hughes_taylor(alpha: float) -> Method:
    """Coefficients of Hilber, Hughes & Taylor for α in [−1/3, 0]."""
    return _method(
        0.0, -alpha, 0.25 * (1.0 - alpha) ** 2, 0.5 - alpha, (1.0 + alpha) / (1.0 - alpha)
    )


def newmark(beta: float, gamma: float) -> Method:
    """Newmark's method, stable for 2 β ≥ γ ≥ 1/2; of order 2 with γ = 1/2."""
    # recursion of velocity and acceleration in constrained directions, from step to step
    amplification = np.array(
        [[1.0 - gamma / beta, 1.0 - 0.5 * gamma / beta], [-1.0 / beta, 1.0 - 0.5 / beta]]
    )
    return _method(0.0, 0.0, beta, gamma, np.abs(np.linalg.eigvals(amplification)).max())


def _method(alpha_m: float, alpha_f: float, beta: float, gamma: float, radius: float) -> Method:
    project = int(radius > _MAX_UNPROJECTED_RADIUS)
    settling = max(1.0 - radius, 0.0) / (16.0 + 6.8 * radius)
    alpha = Alpha(alpha_m, alpha_f, beta, gamma, project, settling)
    order = 2 if abs(gamma - 0.5 - alpha_f + alpha_m) < _ROUND_OFF else 1
    return Method(
        step=(step,), interpolate=(interpolate,), coefficients=(alpha,), order=order,
        error_order=order + 1, stages=0, filter=beta * (1.0 - alpha_f) / (1.0 - alpha_m),
        prefers_constant_step=1, collocation=0, max_tolerance=1e-4,
        # projected accelerations enter the next step; those by M + b K would change frequencies
        mass_refinements=project,
    )  # fmt: skip


@unit
def step(run: Run, alpha: Alpha, h: float) -> int:
    """One step from the state; see the contract in `engine.method`."""
    b = alpha.beta * h * h * (1.0 - alpha.alpha_f) / (1.0 - alpha.alpha_m)
    cv = alpha.gamma / (alpha.beta * h)
    sys, st, tr, settings = run.system, run.state, run.work.trial, run.settings
    memory, count, factor = st.memory[0], st.count[0], run.work.factor
    iteration = run.work.now.iteration
    _predict(alpha, st, tr, h)
    if memory["factor_step"] != h and settings.stiff == 1:
        memory["factor_age"] = -1.0  # without stiffness the matrix hardly depends on h
    if settings.newton_tolerance > 0.0:
        # the error of Newton's method is one of accelerations: relative to their displacement
        tolerance = settings.newton_tolerance * h * h * weighted_max(st.vd, sys.weights)
    else:
        tolerance = settings.tolerance  # over the error scale of each coordinate
    relative = settings.newton_tolerance == 0.0
    put_dq_round_off(run, h)
    if memory["contraction"] > _RENEW_ABOVE and memory["factor_age"] > 0.0:
        memory["factor_age"] = -1.0
    earlier, last, slowest, settled = 0.0, 0.0, 0.0, 0.0
    for n in range(settings.max_iterations):
        move(sys.parts, st.q, tr.dq, tr.q)
        count["residuals"] += 1
        iteration[0] = n
        status = residual(run, run.trial_point)
        iteration[0] = 0.0
        if status != SUCCESS:
            return status
        if memory["factor_age"] < 0.0:
            factor.symmetric[0] = int(memory["symmetric"])
            count["regularised_pivots"] += factorise(run, run.trial_point, b * cv, b)
            count["factorisations"] += 1
            memory["factor_age"] = 0.0
            memory["contraction"] = 1.0
            memory["factor_step"] = h
            last = slowest = 0.0  # a contraction is a ratio of corrections with one factor
        size, units, share, wrong = correct(run, b, cv, h)
        if not math.isfinite(size):
            return NOT_FINITE
        quiet = units <= _NOISE_FACTOR and last > 0.0 and size > REFACTOR_ABOVE * last
        noise, stuck = quiet and size > REFACTOR_ABOVE * earlier > 0.0, False
        if quiet:  # corrections are noise: the contraction cannot be measured
            memory["contraction"] = memory["contraction"] if memory["contraction"] < 1.0 else 0.0
        elif last > 0.0:
            slowest = max(slowest, size / last)  # the next one may be small by chance
            memory["contraction"] = slowest if settings.step == 0.0 else size / last
            small = wrong <= 1.0 or (share if relative else size) <= tolerance
            stuck = not small and check_contraction(memory, size / last)
        earlier, last = last, size
        theta = min(max(memory["contraction"], slowest), 0.99)
        # Under error control the error that a first correction leaves is propagated to the next
        # step, and grows above this contraction: correct again.
        again = n == 0 and theta > alpha.settling and settings.step == 0.0
        left = theta / (1.0 - theta)
        done = left * (share if relative else size) <= tolerance
        # within round-off, which singular poses amplify: further corrections do not help
        if n > 0 and (1.0 if relative else min(1.0, left)) * wrong <= 1.0:
            settled = max(settled, size)
        stuck = stuck or n == settings.max_iterations - 1
        if stuck and size > SETTLED_NOISE * settled and not done:
            return NO_CONVERGENCE
        if noise or stuck or (done and not again):
            move(sys.parts, st.q, tr.dq, tr.q)  # including the last correction
            _finish(sys.weights, alpha, st, tr)
            if settings.tolerance > 0.0:
                estimate_error(run, alpha, h)
            if settings.static_after_step == 1:
                status = _project(run, alpha, b, POSITIONS)
                if settings.tolerance > 0.0 and settings.step == 0.0:
                    add_static_error_of_path(run, h, run.method.error_order)
                return status
            # reactions that cause joint friction must not contain errors of position corrections
            clean = alpha.project == 1 or depends_on_solution(run) or _is_short(run, h)
            if clean and st.lam.shape[0] > 0:
                return _project(run, alpha, b, VELOCITIES)
            if count["steps"] % _RELIEF_INTERVAL == 0 and _has_redundant_rows(factor):
                _relieve_redundant_rows(run, b)
            return SUCCESS
    return NO_CONVERGENCE


@kernel
def _is_short(run, h):
    """Whether a step under error control is so short that round-off spoils its multipliers."""
    rows, longest = run.system.rows, run.state.memory[0]["largest_step"]
    if run.settings.step > 0.0 or h >= _SHORT_STEP_OF_REDUNDANT_ROWS * longest:
        return False
    short = has_dependent_rows(run.work.factor, 0.0)
    for k in range(rows.shape[0]):
        short = short or (rows[k]["fun"] >= 0 and h < _SHORT_STEP * longest)
    return short


@kernel
def _has_redundant_rows(factor):
    """Whether rows are redundant, and none is nearly dependent as near a dead point."""
    dependent = has_dependent_rows(factor, LARGEST_REDUNDANT_PIVOT)
    return has_dependent_rows(factor, 0.0) and not dependent


@kernel
def _relieve_redundant_rows(run, b):
    """Remove the self-stress from the multipliers of the trial state; the factor is used up."""
    run.work.factor.symmetric[0] = 1
    position_stage(run, run.trial_point)
    remove_self_stress(run, run.trial_point, b)
    run.state.memory[0]["factor_age"] = -1.0


@kernel
def _predict(alpha, st, tr, h):
    """Trial state with acceleration and multipliers extrapolated over the last step.

    The algorithmic acceleration is that of the time (α_m − α_f) h after the state, so it is shifted
    when the step size changes.
    """
    last = st.memory[0]["last_step"]
    ratio = h / last if last > 0.0 else 1.0
    alpha_m, alpha_f, beta, gamma = alpha.alpha_m, alpha.alpha_f, alpha.beta, alpha.gamma
    shift = (alpha_m - alpha_f) * (ratio - 1.0)
    tr.t[0] = st.t[0] + h
    v, vd, vd_before, aa0, aa_start = st.v, st.vd, st.vd_before, st.aa, tr.aa_start
    tr_vd, tr_v, dq = tr.vd, tr.v, tr.dq
    for i in range(v.shape[0]):
        change = vd[i] - vd_before[i]
        aa = aa0[i] + shift * change
        aa_start[i] = aa
        tr_vd[i] = vd[i] + ratio * change
        new = (1.0 - alpha_f) * tr_vd[i] + alpha_f * vd[i]
        aa1 = (new - alpha_m * aa) / (1.0 - alpha_m)
        dq[i] = h * v[i] + h * h * ((0.5 - beta) * aa + beta * aa1)
        tr_v[i] = v[i] + h * ((1.0 - gamma) * aa + gamma * aa1)
    lam, lam_before, tr_lam = st.lam, st.lam_before, tr.lam
    for i in range(lam.shape[0]):
        tr_lam[i] = lam[i] + ratio * (lam[i] - lam_before[i])


@kernel
def correct(run, b, cv, h):
    """One Newton correction of the trial state; returns four sizes of it, all maximum norms.

    1: of δq or of the force residual as a displacement b r / diag(S), weighted. 2: of δq over the
    round-off of its coordinate. 3: of 1 over what may remain, shares of the scales of position and
    of h × velocity. 4: of 1 over round-off. (δ changes the estimated velocity error by δ/(4 h).)

    The residual counts since an old factor turns it into motion in the next iteration. Multipliers
    are regularised towards those of the last step: towards zero, each step would yield to them.
    """
    tr, fac, kkt, weights = run.work.trial, run.work.factor, run.system.kkt, run.system.weights
    sol, C, place, eps, diagonal = fac.sol, run.work.con.C, kkt.place, fac.eps, fac.diagonal
    res, lam, dq, v, vd = tr.res, tr.lam, tr.dq, tr.v, tr.vd
    nv, last, motion, speed = res.shape[0], run.state.lam, run.state.q_scale, run.state.v_scale
    for i in range(nv):
        sol[place[i]] = -b * res[i]
    for i in range(C.shape[0]):
        k = place[nv + i]
        sol[k] = eps[k] * b * (lam[i] - last[i]) - C[i]
    if fac.replaced[0] == 0:
        solve(kkt, fac, sol)
    else:
        _solve_repaired(run)
    moved, size, share, units, wrong, places = 0.0, 0.0, 0.0, 0.0, 0.0, tr.dq_round_off
    for i in range(nv):
        k = place[i]
        d = sol[k]
        dq[i] += d
        v[i] += cv * d
        vd[i] += d / b
        s = abs(d) * weights[i]
        if not s <= moved:
            moved = s
        force = abs(b * res[i]) / diagonal[k] * weights[i]
        if not force <= size:
            size = force
        if not s <= units * places[i]:
            units = s / places[i] if places[i] > 0.0 else math.inf
        if not force <= wrong * places[i]:
            wrong = force / places[i] if places[i] > 0.0 else math.inf
        allowed = min(_POSITION_SHARE * motion[i], _VELOCITY_SHARE * h * speed[i])
        s = max(s, force)
        if s > share * allowed:
            share = s / allowed if allowed > 0.0 else math.inf
    for i in range(C.shape[0]):
        lam[i] += sol[place[nv + i]] / b
    return max(size, moved), units, share, max(units, wrong)


@kernel
def _solve_repaired(run):
    """Solve with a factor whose pivots were replaced: iterative refinement by the matrix itself."""
    fac, place, C = run.work.factor, run.system.kkt.place, run.work.con.C
    nv = run.work.trial.res.shape[0]
    copy(fac.sol, fac.rhs)
    for i in range(C.shape[0]):
        fac.rhs[place[nv + i]] = -C[i]
    solve_refined(run.system.kkt, fac, _REFINEMENTS)


@kernel
def _finish(weights, alpha, st, tr):
    """Set the algorithmic acceleration of the new state, and the expected contraction.

    The matrix changes by about as much as the model moves relative to its size, or rotates [rad].
    So the expected contraction of an old factor is the last measured one plus the displacement
    since.
    """
    _put_algorithmic(alpha, st, tr)
    if st.memory[0]["factor_age"] >= 0.0:  # otherwise the factor is to be renewed
        st.memory[0]["factor_age"] += 1.0
    measured = st.memory[0]["contraction"] if st.memory[0]["contraction"] < 1.0 else 0.0
    st.memory[0]["contraction"] = min(0.99, measured + weighted_max(tr.dq, weights))


@kernel
def _put_algorithmic(alpha, st, tr):
    """Algorithmic acceleration of the trial state."""
    for i in range(tr.vd.shape[0]):
        new = (1.0 - alpha.alpha_f) * tr.vd[i] + alpha.alpha_f * st.vd[i]
        tr.aa[i] = (new - alpha.alpha_m * tr.aa_start[i]) / (1.0 - alpha.alpha_m)


@unit
def _project(run: Run, alpha: Alpha, b: float, project: int) -> int:
    """Project velocities, accelerations and multipliers of the trial state onto the constraints."""
    cp = b if run.settings.determinate == 0 else 0.0
    run.state.count[0]["factorisations"] += 1
    run.state.memory[0]["factor_age"] = -1.0
    status = accelerations(run, run.trial_point, cp, project)
    _put_algorithmic(alpha, run.state, run.work.trial)
    return status


@unit
def estimate_error(run: Run, alpha: Alpha, h: float) -> int:
    """Local error of the step in trial.error: |κ_q| h³ q⃛ of positions, |κ_v| h³ q⁗ of velocities.

    κ_q = β + c/2 − 1/6 and κ_v = c²/2 − 1/12 with c = α_m − α_f follow from the Taylor series of
    the formulas with a(t) = v̇(t + c h). With the factor S of the step, S⁻¹ M (a₁ − a₀) = h q⃛ has
    no components of stiff modes and in constrained directions. After a change of the step size
    accelerations oscillate with alternating sign. Means and differences over two steps hardly
    contain that. Until steps are equal, the q⁗ of the step before is an upper bound, which grows
    from step to step: from very short steps it is noise, and steps of a plan may never be equal.
    """
    sys, st, tr, sol = run.system, run.state, run.work.trial, run.work.factor.sol
    kkt, nv = sys.kkt, tr.aa.shape[0]
    for i in range(nv):
        tr.res[i] = (tr.aa[i] - tr.aa_start[i]) / h
    run_stage(run.stages.mass, run, run.trial_point)
    for i in range(run.work.con.C.shape[0]):
        sol[kkt.place[nv + i]] = 0.0
    solve(kkt, run.work.factor, sol)
    positions, velocities = 0.0, 0.0
    same = h == st.memory[0]["last_step"] and st.memory[0]["steps_at_this_size"] >= 1.0
    for i in range(nv):
        tr.jerk[i] = sol[kkt.place[i]]
        smooth = 0.5 * (tr.jerk[i] + st.jerk[i]) if same else tr.jerk[i]
        s = abs(smooth) * sys.weights[i] / st.q_scale[i]
        if not s <= positions:
            positions = s
        s = 0.5 * abs(tr.jerk[i] - st.jerk_before[i]) * sys.weights[i] / st.v_scale[i]
        if not s <= velocities:
            velocities = s
    c = alpha.alpha_m - alpha.alpha_f
    tr.error[0] = abs(alpha.beta + 0.5 * c - 1.0 / 6.0) * h**3 * positions
    tr.error[1] = abs(0.5 * c * c - 1.0 / 12.0) * h**2 * velocities
    if st.memory[0]["steps_at_this_size"] < _SMOOTH_STEPS or h != st.memory[0]["last_step"]:
        tr.error[1] = min(tr.error[1], _BOUND_GROWTH * st.memory[0]["velocity_error"] * h**3)
    return SUCCESS


@unit
def interpolate(run: Run, alpha: Alpha, share: float) -> int:
    """Positions and velocities at a fraction of the last accepted step, into the trial state.

    `Trial.aa` becomes the interpolated acceleration of the method itself.
    """
    st, smooth = run.state, run.work.trial.aa
    for i in range(smooth.shape[0]):
        smooth[i] = st.vd_before[i] + share * (st.vd[i] - st.vd_before[i])
    return interpolate_step(run, share)  # type: ignore[no-any-return]


METHODS = {
    "generalized-alpha": make_method,
    "hht": make_hht,
    "newmark": make_newmark,
    "trapezoidal": make_trapezoidal,
}
