"""Generalized-α on the Lie group for index-3 equations of motion, one step.

Arnold & Brüls, Multibody Syst. Dyn. 18 (2007) 185; Brüls, Cardona & Arnold, Mech. Mach. Theory 48
(2012) 121. Unknown of Newton's method: the increment δq of the step's motion, with
δv = γ/(βh) δq, δv̇ = δq/b, b = β'h² = βh²(1−α_f)/(1−α_m); multipliers scaled by b. One factor of
S = M + (γb/(βh)) ∂F/∂v + b ∂F/∂q bordered by Cq serves as long as its measured contraction is good:
symmetric LDLᵀ below 0.2, then the unsymmetric twin; renewed before a step that expects more than
0.1 and within one that measures more than 0.3; given up above 0.9.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import inlined, kernel
from flexmb.engine.kernels.algebra.ldl import solve, solve_refined
from flexmb.engine.kernels.algebra.vector import weighted_size
from flexmb.engine.kernels.bodies import inertia_tangent
from flexmb.engine.kernels.bodies.motion import move
from flexmb.engine.kernels.kkt import factorise
from flexmb.engine.kernels.residual import residual
from flexmb.engine.method import (
    AGE,
    CONTRACTION,
    FACTOR_STEP,
    FACTORISATIONS,
    FINE,
    FIXED_PIVOTS,
    JERK_ERROR,
    LAST_STEP,
    MOTION,
    NO_CONVERGENCE,
    NO_METHOD,
    NOT_FINITE,
    RESIDUALS,
    SINCE,
    SPEED,
    SYMMETRIC,
    ZERO_LENGTH,
)

_UNSYMMETRIC_ABOVE = 0.2
# Before a step, an expected contraction above this costs more iterations than a new factor
# (flexible slider-crank: 27 µs per step at 0.03, 30 at 0.1, 35 at 0.3; a single rigid body pays
# for factors, not for iterations).
_RENEW_ABOVE = 0.1
# Within a step, a measured one above this.
_REFACTOR_ABOVE = 0.3
_GIVE_UP_ABOVE = 0.9
# Corrections of this size relative to the model, or of this many units in the last place of the
# positions where the model is far from the origin, are round-off; so are corrections of positions
# up to `_NOISE` times as large that no longer shrink.
_ROUND_OFF = 2e-15
_LAST_PLACES = 1e-15
_NOISE = 50.0
# With error control Newton's method stops at these shares of the local tolerance of positions and
# of velocities.
_SHARE, _SPEED_SHARE = 0.05, 0.3
# Steps of one size after which differences of accelerations are smooth.
_SETTLED = 3
# Refinements of a solve by a factor with replaced pivots.
_REFINEMENTS = 3


@inlined
def step(sys, alpha, settings, st, wk, h):
    """One step from `st`; see the contract in `engine.method`."""
    if alpha is None:
        return NO_METHOD
    b = alpha.beta * h * h * (1.0 - alpha.alpha_f) / (1.0 - alpha.alpha_m)
    cv = alpha.gamma / (alpha.beta * h)
    tr, memory, count = wk.trial, st.memory, st.count
    _predict(alpha, st, tr, h)
    if memory[FACTOR_STEP] != h and settings.stiff == 1:
        memory[AGE] = -1.0  # without stiffness the matrix hardly knows the step
    if settings.newton_tolerance > 0.0:
        # Newton decides the accelerations: what it leaves is compared with their share of motion.
        tolerance = settings.newton_tolerance * h * h * weighted_size(st.vd, sys.weights)
    else:
        # A correction δ changes velocities by some δ/h, and their estimated error by δ/(4h).
        allowed = min(_SHARE * memory[MOTION], _SPEED_SHARE * h * memory[SPEED])
        tolerance = settings.tolerance * allowed
    floor = _round_off(sys.parts.bodies, sys.weights, st.q)
    tolerance = max(tolerance, floor)
    if memory[CONTRACTION] > _RENEW_ABOVE and memory[AGE] > 0.0:
        memory[AGE] = -1.0
    last = 0.0
    for _ in range(settings.max_iterations):
        move(sys.parts, st.q, tr.dq, tr.q)
        count[RESIDUALS] += 1
        if residual(sys, wk, tr.t[0], tr.q, tr.v, tr.vd, tr.lam) >= 0:
            return ZERO_LENGTH
        if memory[AGE] < 0.0:
            wk.factor.symmetric[0] = int(memory[SYMMETRIC])
            count[FIXED_PIVOTS] += factorise(sys, wk, tr.v, tr.vd, tr.lam, b * cv, b)
            count[FACTORISATIONS] += 1
            memory[AGE] = 0.0
            memory[CONTRACTION] = 1.0
            memory[FACTOR_STEP] = h
            last = 0.0  # a contraction is measured between corrections by one factor
        size, moved = _correct(sys, wk, b, cv)
        if not math.isfinite(size):
            return NOT_FINITE
        if last > 0.0:
            memory[CONTRACTION] = size / last
        noise = moved <= _NOISE * floor and last > 0.0 and size > _REFACTOR_ABOVE * last
        if noise:
            memory[CONTRACTION] = 0.0  # it measures nothing here
        elif last > 0.0 and size > tolerance and _judge(memory, size / last):
            return NO_CONVERGENCE
        last = size
        theta = min(memory[CONTRACTION], 0.99)
        if noise or size <= floor or theta / (1.0 - theta) * size <= tolerance:
            move(sys.parts, st.q, tr.dq, tr.q)  # the last correction too
            _finish(sys.weights, alpha, st, tr)
            if settings.tolerance > 0.0:
                _estimate_error(sys, alpha, st, wk, h)
            return FINE
    return NO_CONVERGENCE


@kernel
def _round_off(bodies, weights, q):
    """Weighted size of a correction that positions cannot show."""
    size = _ROUND_OFF
    for k in range(bodies.shape[0]):
        i, o = bodies[k]["iq"], bodies[k]["iv"]
        for a in range(3):
            size = max(size, _LAST_PLACES * abs(q[i + a]) * weights[o + a])
    return size


@kernel
def _predict(alpha, st, tr, h):
    """Trial state with acceleration and multipliers extrapolated over the last step.

    The algorithmic acceleration belongs to the time (α_m − α_f) h after the state's, so it moves
    with the step size.
    """
    last = st.memory[LAST_STEP]
    ratio = h / last if last > 0.0 else 1.0
    shift = (alpha.alpha_m - alpha.alpha_f) * (ratio - 1.0)
    tr.t[0] = st.t[0] + h
    for i in range(st.v.shape[0]):
        change = st.vd[i] - st.vd_before[i]
        aa = st.aa[i] + shift * change
        tr.aa_start[i] = aa
        tr.vd[i] = st.vd[i] + ratio * change
        new = (1.0 - alpha.alpha_f) * tr.vd[i] + alpha.alpha_f * st.vd[i]
        aa1 = (new - alpha.alpha_m * aa) / (1.0 - alpha.alpha_m)
        tr.dq[i] = h * st.v[i] + h * h * ((0.5 - alpha.beta) * aa + alpha.beta * aa1)
        tr.v[i] = st.v[i] + h * ((1.0 - alpha.gamma) * aa + alpha.gamma * aa1)
    for i in range(st.lam.shape[0]):
        tr.lam[i] = st.lam[i] + ratio * (st.lam[i] - st.lam_before[i])


@inlined
def _correct(sys, wk, b, cv):
    """Newton correction of the trial state; returns what was still wrong, and the size of δq.

    Forces out of balance count by what they would move their own coordinate: with an old factor
    they move positions in the next iteration. The multipliers are solved for from zero (−ε b λ on
    the left), so that redundant rows share the least; the bias of C is 1e-9 of h² v̇.
    """
    tr, fac, sol, C, kkt = wk.trial, wk.factor, wk.factor.sol, wk.con.C, sys.kkt
    nv = tr.res.shape[0]
    for i in range(nv):
        sol[kkt.place[i]] = -b * tr.res[i]
    for i in range(C.shape[0]):
        k = kkt.place[nv + i]
        sol[k] = fac.eps[k] * b * tr.lam[i] - C[i]
    if fac.replaced[0] == 0:
        solve(kkt, fac, sol)
    else:
        _solve_repaired(sys, wk, b)
    moved, size = 0.0, 0.0
    for i in range(nv):
        k = kkt.place[i]
        d = sol[k]
        tr.dq[i] += d
        tr.v[i] += cv * d
        tr.vd[i] += d / b
        s = abs(d) * sys.weights[i]
        if not s <= moved:
            moved = s
        s = abs(b * tr.res[i]) / fac.diagonal[k] * sys.weights[i]
        if not s <= size:
            size = s
    for i in range(C.shape[0]):
        tr.lam[i] += sol[kkt.place[nv + i]] / b
    return max(size, moved), moved


@kernel
def _solve_repaired(sys, wk, b):
    """The same solve where pivots had to be replaced: refined against the matrix itself."""
    fac, nv = wk.factor, wk.trial.res.shape[0]
    for i in range(fac.sol.shape[0]):
        fac.rhs[i] = fac.sol[i]
    for i in range(wk.con.C.shape[0]):
        fac.rhs[sys.kkt.place[nv + i]] = -wk.con.C[i]
    solve_refined(sys.kkt, fac, _REFINEMENTS)


@kernel
def _judge(memory, contraction):
    """What the measured contraction asks for; true: give the step up."""
    fresh = memory[AGE] == 0.0
    if contraction > _UNSYMMETRIC_ABOVE and memory[SYMMETRIC] == 1.0 and fresh:
        memory[SYMMETRIC] = 0.0
        memory[AGE] = -1.0
    elif contraction > _REFACTOR_ABOVE and not fresh:
        memory[AGE] = -1.0
    return contraction > _GIVE_UP_ABOVE and fresh and memory[AGE] == 0.0


@kernel
def _finish(weights, alpha, st, tr):
    """Algorithmic acceleration of the new state; the factor ages by the motion of the step.

    The matrix changes by about as much as the model moves relative to its size (or turns), so the
    contraction of an old factor is the last one measured plus the motion since.
    """
    for i in range(tr.vd.shape[0]):
        new = (1.0 - alpha.alpha_f) * tr.vd[i] + alpha.alpha_f * st.vd[i]
        tr.aa[i] = (new - alpha.alpha_m * tr.aa_start[i]) / (1.0 - alpha.alpha_m)
    if st.memory[AGE] >= 0.0:  # else a renewal is due
        st.memory[AGE] += 1.0
    measured = st.memory[CONTRACTION] if st.memory[CONTRACTION] < 1.0 else 0.0
    st.memory[CONTRACTION] = min(0.99, measured + weighted_size(tr.dq, weights))


@kernel
def _estimate_error(sys, alpha, st, wk, h):
    """Local error of the step in trial.error: |κ_q| h³ q⃛ of positions, |κ_v| h³ q⁗ of velocities.

    κ_q = β + c/2 − 1/6 and κ_v = c²/2 − 1/12, c = α_m − α_f; the Taylor series of the formulas with
    a(t) = v̇(t + c h). The factor S of the step takes out what stiff modes and constraints do not
    let move: S⁻¹ M (a₁ − a₀) = h q⃛. Accelerations ring with alternating sign after a change of the
    step; means and differences over two steps hardly see it, and right after the change the q⁗ of
    before is taken.
    """
    tr, sol, kkt = wk.trial, wk.factor.sol, sys.kkt
    nv = tr.aa.shape[0]
    for i in range(nv):
        tr.res[i] = (tr.aa[i] - tr.aa_start[i]) / h
    inertia_tangent.multiply_mass(sys.parts, wk.now, tr.res, wk.dense.B, sol, kkt.place)
    for i in range(wk.con.C.shape[0]):
        sol[kkt.place[nv + i]] = 0.0
    solve(kkt, wk.factor, sol)
    positions, velocities = 0.0, 0.0
    same = h == st.memory[LAST_STEP] and st.memory[SINCE] >= 1.0
    for i in range(nv):
        tr.jerk[i] = sol[kkt.place[i]]
        smooth = 0.5 * (tr.jerk[i] + st.jerk[i]) if same else tr.jerk[i]
        s = abs(smooth) * sys.weights[i]
        if not s <= positions:
            positions = s
        s = 0.5 * abs(tr.jerk[i] - st.jerk_before[i]) * sys.weights[i]
        if not s <= velocities:
            velocities = s
    c = alpha.alpha_m - alpha.alpha_f
    tr.error[0] = abs(alpha.beta + 0.5 * c - 1.0 / 6.0) * h**3 * positions
    if st.memory[SINCE] >= _SETTLED and h == st.memory[LAST_STEP]:
        tr.error[1] = abs(0.5 * c * c - 1.0 / 12.0) * h**2 * velocities
    else:
        tr.error[1] = st.memory[JERK_ERROR] * h**3
