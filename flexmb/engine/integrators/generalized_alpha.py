"""Generalized-α on the Lie group for index-3 equations of motion, one step.

Arnold & Brüls, Multibody Syst. Dyn. 18 (2007) 185; Brüls, Cardona & Arnold, Mech. Mach. Theory 48
(2012) 121. Unknown of Newton's method: the increment δq of the step's motion, with
δv = γ/(βh) δq, δv̇ = δq/b, b = β'h² = βh²(1−α_f)/(1−α_m); multipliers scaled by b. One factor of
S = M + (γb/(βh)) ∂F/∂v + b ∂F/∂q bordered by Cq serves as long as its measured contraction is good:
symmetric LDLᵀ below 0.2, then the unsymmetric twin; renewed before a step that expects more than
0.1 and within one that measures more than 0.3; given up above 0.9.

Under error control one correction may do for a step. What it leaves is carried on: along stiff
dampers it alternates and grows if the contraction exceeds (1 − ρ)/(8 + 3.4 ρ), up to the tolerance
of Newton's method, which is much for reactions. (The recursion of m v̇ + c v = 0 for all c h/m:
0.126, 0.053, 0.0188, 0.0045 at ρ = 0, 0.5, 0.8, 0.95.) Half of it, as directions differ.

Methods of Hilber, Hughes & Taylor and of Newmark are cases of it (Géradin & Rixen, Mechanical
Vibrations, 2015, §7.3). In directions that joints hold, all of them repeat the recursion of an
oscillator of infinite frequency: errors of velocities and accelerations there shrink by the
spectral radius ρ at infinity, after they have grown by about 1/(1 − ρ)². Above 0.95 they grow
faster than the motion forgets them (measured: at 0.98 a chain of three bodies fails), and with 1
for ever (Cardona & Géradin, Computers & Structures 33 (1989) 801). There velocities, accelerations
and multipliers are put on the constraints after each step, at the price of a second factor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.ldl import solve, solve_refined
from flexmb.engine.algebra.vector import copy, weighted_max
from flexmb.engine.bodies.motion import interpolate_step, move, put_dq_round_off
from flexmb.engine.equations_of_motion import residual, run_stage
from flexmb.engine.iteration_matrix import (
    REFACTOR_ABOVE,
    SETTLED_NOISE,
    check_contraction,
    factorise,
)
from flexmb.engine.jit import kernel, unit
from flexmb.engine.method import NO_CONVERGENCE, NOT_FINITE, SUCCESS, Method
from flexmb.engine.projection import POSITIONS, VELOCITIES, accelerations, depends_on_solution
from flexmb.engine.state import Run

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# Before a step, an expected contraction above this costs more iterations than a new factor
# (flexible slider-crank: 27 µs per step at 0.03, 30 at 0.1, 35 at 0.3; a single rigid body pays
# for factors, not for iterations).
_RENEW_ABOVE = 0.1
# Corrections of positions up to so many times round-off that no longer shrink are noise.
_NOISE = 50.0
# With error control Newton's method stops at these shares of the local tolerance of positions and
# of velocities.
_SHARE, _SPEED_SHARE = 0.05, 0.3
# Steps of one size after which differences of accelerations are smooth; growth of their bound from
# step to step till then.
_SETTLED, _FORGETTING = 3, 1.5
# Spectral radius up to which what joints hold needs no projection.
_FREE_RADIUS = 0.95
_ROUND_OFF = 1e-12
# Refinements of a solve by a factor with replaced pivots.
_REFINEMENTS = 3


class Alpha(NamedTuple):
    """Coefficients of generalized-α."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    project: int  # 1: velocities and accelerations are put on the constraints after each step
    settling: float  # contraction up to which one correction may do for a step


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
    """The trapezoidal rule; nothing is to choose."""
    return newmark(0.25, 0.5)


def generalized_alpha(spectral_radius: float) -> Method:
    """Chung & Hulbert's coefficients for a spectral radius at infinity in [0, 1]."""
    rho = spectral_radius
    alpha_m = (2.0 * rho - 1.0) / (rho + 1.0)
    alpha_f = rho / (rho + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return _method(alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma, rho)


def hilber_hughes_taylor(alpha: float) -> Method:
    """Their coefficients for α in [−1/3, 0]."""
    return _method(
        0.0, -alpha, 0.25 * (1.0 - alpha) ** 2, 0.5 - alpha, (1.0 + alpha) / (1.0 - alpha)
    )


def newmark(beta: float, gamma: float) -> Method:
    """Newmark's method, stable for 2 β ≥ γ ≥ 1/2; of order 2 with γ = 1/2."""
    # velocity and acceleration where nothing moves, from step to step
    amplification = np.array(
        [[1.0 - gamma / beta, 1.0 - 0.5 * gamma / beta], [-1.0 / beta, 1.0 - 0.5 / beta]]
    )
    return _method(0.0, 0.0, beta, gamma, np.abs(np.linalg.eigvals(amplification)).max())


def _method(alpha_m: float, alpha_f: float, beta: float, gamma: float, radius: float) -> Method:
    project = int(radius > _FREE_RADIUS)
    settling = max(1.0 - radius, 0.0) / (16.0 + 6.8 * radius)
    alpha = Alpha(alpha_m, alpha_f, beta, gamma, project, settling)
    order = 2 if abs(gamma - 0.5 - alpha_f + alpha_m) < _ROUND_OFF else 1
    return Method(
        step=(step,), interpolate=(interpolate,), coefficients=(alpha,), order=order,
        error_order=order + 1, stages=0, filter=beta * (1.0 - alpha_f) / (1.0 - alpha_m),
        prefers_constant_step=1, collocation=0, max_tolerance=1e-4,
        # these accelerations are used in the next step; those by M + b K change the frequency
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
        memory["factor_age"] = -1.0  # without stiffness the matrix hardly knows the step
    if settings.newton_tolerance > 0.0:
        # Newton decides the accelerations: what it leaves is compared with their share of motion.
        tolerance = settings.newton_tolerance * h * h * weighted_max(st.vd, sys.weights)
    else:
        tolerance = settings.tolerance  # of each coordinate over its own motion, as its error is
    relative = settings.newton_tolerance == 0.0
    put_dq_round_off(run)
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
            last = slowest = 0.0  # a contraction is measured between corrections by one factor
        size, units, share, wrong = correct(run, b, cv, h)
        if not math.isfinite(size):
            return NOT_FINITE
        quiet = units <= _NOISE and last > 0.0 and size > REFACTOR_ABOVE * last
        noise, stuck = quiet and size > REFACTOR_ABOVE * earlier > 0.0, False
        if quiet:  # it measures nothing here
            memory["contraction"] = memory["contraction"] if memory["contraction"] < 1.0 else 0.0
        elif last > 0.0:
            slowest = max(slowest, size / last)  # where the next one happens to be small too
            memory["contraction"] = slowest if settings.step == 0.0 else size / last
            small = wrong <= 1.0 or (share if relative else size) <= tolerance
            stuck = not small and check_contraction(memory, size / last)
        earlier, last = last, size
        theta = min(max(memory["contraction"], slowest), 0.99)
        # What an old factor leaves in a first correction is a bias that adds up over many steps,
        # below the last places of positions too; under error control in any.
        again = n == 0 and theta > alpha.settling and settings.step == 0.0
        left = theta / (1.0 - theta)
        done = left * (share if relative else size) <= tolerance
        # in last places, where singular poses let noise grow, and no correction is better
        if n > 0 and (1.0 if relative else min(1.0, left)) * wrong <= 1.0:
            settled = max(settled, size)
        stuck = stuck or n == settings.max_iterations - 1
        if stuck and size > SETTLED_NOISE * settled and not done:
            return NO_CONVERGENCE
        if noise or stuck or (done and not again):
            move(sys.parts, st.q, tr.dq, tr.q)  # the last correction too
            _finish(sys.weights, alpha, st, tr)
            if settings.tolerance > 0.0:
                estimate_error(run, alpha, h)
            if settings.static_after_step == 1:
                return _project(run, alpha, b, POSITIONS)
            # what loads friction in joints must not come from how far it moved positions
            if (alpha.project == 1 or depends_on_solution(run)) and st.lam.shape[0] > 0:
                return _project(run, alpha, b, VELOCITIES)
            return SUCCESS
    return NO_CONVERGENCE


@kernel
def _predict(alpha, st, tr, h):
    """Trial state with acceleration and multipliers extrapolated over the last step.

    The algorithmic acceleration belongs to the time (α_m − α_f) h after the state's, so it moves
    with the step size.
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
    nv, last, motion, speed = res.shape[0], run.state.lam, run.state.motion, run.state.speed
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
        allowed = min(_SHARE * motion[i], _SPEED_SHARE * h * speed[i])
        s = max(s, force)
        if s > share * allowed:
            share = s / allowed if allowed > 0.0 else math.inf
    for i in range(C.shape[0]):
        lam[i] += sol[place[nv + i]] / b
    return max(size, moved), units, share, max(units, wrong)


@kernel
def _solve_repaired(run):
    """The same solve where pivots had to be replaced: refined against the matrix itself."""
    fac, place, C = run.work.factor, run.system.kkt.place, run.work.con.C
    nv = run.work.trial.res.shape[0]
    copy(fac.sol, fac.rhs)
    for i in range(C.shape[0]):
        fac.rhs[place[nv + i]] = -C[i]
    solve_refined(run.system.kkt, fac, _REFINEMENTS)


@kernel
def _finish(weights, alpha, st, tr):
    """Algorithmic acceleration of the new state; the factor ages by the motion of the step.

    The matrix changes by about as much as the model moves relative to its size (or turns), so the
    contraction of an old factor is the last one measured plus the motion since.
    """
    _put_algorithmic(alpha, st, tr)
    if st.memory[0]["factor_age"] >= 0.0:  # else a renewal is due
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
    """Velocities, accelerations and multipliers of the trial state as the constraints want them."""
    cp = b if run.settings.determinate == 0 else 0.0
    run.state.count[0]["factorisations"] += 1
    run.state.memory[0]["factor_age"] = -1.0
    status = accelerations(run, run.trial_point, cp, project)
    _put_algorithmic(alpha, run.state, run.work.trial)
    return status


@unit
def estimate_error(run: Run, alpha: Alpha, h: float) -> int:
    """Local error of the step in trial.error: |κ_q| h³ q⃛ of positions, |κ_v| h³ q⁗ of velocities.

    κ_q = β + c/2 − 1/6 and κ_v = c²/2 − 1/12, c = α_m − α_f; the Taylor series of the formulas with
    a(t) = v̇(t + c h). The factor S of the step takes out what stiff modes and constraints do not
    let move: S⁻¹ M (a₁ − a₀) = h q⃛. Accelerations ring with alternating sign after a change of the
    step; means and differences over two steps hardly see it, and right after the change the q⁗ of
    before is a bound, which loosens: taken from tiny steps it is noise, and steps that follow a
    plan may never be equal for long.
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
        s = abs(smooth) * sys.weights[i] / st.motion[i]
        if not s <= positions:
            positions = s
        s = 0.5 * abs(tr.jerk[i] - st.jerk_before[i]) * sys.weights[i] / st.speed[i]
        if not s <= velocities:
            velocities = s
    c = alpha.alpha_m - alpha.alpha_f
    tr.error[0] = abs(alpha.beta + 0.5 * c - 1.0 / 6.0) * h**3 * positions
    tr.error[1] = abs(0.5 * c * c - 1.0 / 12.0) * h**2 * velocities
    if st.memory[0]["steps_at_this_size"] < _SETTLED or h != st.memory[0]["last_step"]:
        tr.error[1] = min(tr.error[1], _FORGETTING * st.memory[0]["velocity_error"] * h**3)
    return SUCCESS


@unit
def interpolate(run: Run, alpha: Alpha, share: float) -> int:
    """Positions and velocities at a share of the last accepted step, into the trial state.

    `Trial.aa` are the method's own accelerations there.
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
