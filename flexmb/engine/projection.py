"""Projection onto the constraints; accelerations and multipliers as they are reported.

Generalized-α is of order 2 only if its own velocities and multipliers stay as they are from step to
step (projection with the factor of an earlier pose costs an order). Reported ones are therefore
computed apart, with a factor of the present pose: v from (0; −(Cq v + C_t)), (v̇; λ) from (Q; γ),
with refinement. The mass matrix is M + b ∂F/∂q. With M alone a stiff mode at a joint spoils λ,
which b K, of order h², prevents; gyroscopic and damping terms, of order h, are left out. Where the
constraints alone fix the motion, b = 0.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.ldl import multiply, solve, solve_refined
from flexmb.engine.algebra.vector import copy, largest, weighted_max, zero
from flexmb.engine.bodies.motion import RELATIVE_ROUND_OFF, is_round_off, move, put_q_round_off
from flexmb.engine.bodies.static_modes import STATIC_TOLERANCE
from flexmb.engine.equations_of_motion import (
    bias_stage,
    constraint_stage,
    feedback_stage,
    forces,
    position_stage,
    rate_stage,
    reaction_stage,
    run_stage,
    velocity_stage,
)
from flexmb.engine.iteration_matrix import factorise, has_dependent_rows, permute, solve_motion
from flexmb.engine.jit import Vector, call_value, kernel, unit
from flexmb.engine.joints.constraint import constraint_right_side
from flexmb.engine.method import NO_LOOP_CONVERGENCE, NOT_FINITE, SELF_LOCKING, SUCCESS
from flexmb.engine.state import Point, Run

_MAX_ROUNDS = 3  # Newton corrections of a projection
# Pivot of a row over its regularisation, above which one refinement leaves only round-off.
_WELL_CONDITIONED_PIVOT = 1e7
# Forces that depend on accelerations or reactions (an algebraic loop): most iterations, and the
# change of the accelerations, over their largest value, at which the iteration has converged.
_MAX_LOOP_ROUNDS, _LOOP_TOLERANCE = 100, 1e-12
# Iteration of quasi-static modes: after this many rounds the tolerance doubles with each round (a
# slowly converging iteration reaches its round-off); largest tolerance.
_STRICT_ROUNDS, _MAX_STATIC_TOLERANCE = 20, 1e-8
# Correction of positions that is round-off: over the size of the model, and over the round-off of
# its own part.
_POSITION_ROUND_OFF, _ROUND_OFF_OF_PART = 1e-13, 50.0
# Correction of positions, over the size of the model, from which on the factor of the old pose is
# not used: with it redundant rows would get reactions.
_SAME_POSE_DISTANCE = 1e-12
# Loads that depend on reactions, such as joint friction, have converged if they change by less than
# this share of the largest force (moments are divided by a length, so that units do not matter).
_REACTION_TOLERANCE = 1e-10
# Second perturbation over the first, and the factor within which the change of accelerations must
# be proportional to it to count as round-off; that of a force that jumps is not.
_PERTURBATION, _SPREAD = 8.0, 2.5
# Factor by which b is reduced if the matrix is not positive definite, and most reductions.
_TANGENT_REDUCTION, _MAX_REDUCTIONS = 0.25, 5
# What `accelerations` projects onto the constraints first; POSITIONS: velocities as well.
NOTHING, VELOCITIES, POSITIONS = 0, 1, 2


@unit
def project_velocity(run: Run, at: Point, cp: float) -> int:
    """Project v onto Cq v + C_t = 0 after a position stage, with a factor of this position.

    cp is that of the factor. The correction is the least one in the metric M, not M + cp ∂F/∂q.
    Constraints.drift gets max |Cq v + C_t| before, impulse_work the work of drivers in it.
    """
    con, sol, kkt = run.work.con, run.work.factor.sol, run.system.kkt
    rate, place, v, weights = con.rate, kkt.place, at.v, run.system.weights
    nv, firm = v.shape[0], _is_well_conditioned(run.work.factor)
    con.drift[0] = con.impulse_work[0] = 0.0
    if rate.shape[0] == 0:
        return SUCCESS
    for n in range(_MAX_ROUNDS):
        velocity_stage(run, at)
        rate_stage(run, at)
        if n == 0:
            con.drift[0] = largest(rate)
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(rate.shape[0]):
            sol[place[nv + i]] = -rate[i]
        solve(kkt, run.work.factor, sol)
        if n == 0 and cp != 0.0:
            change, push, top = run.work.trial.dq, con.gamma, run.work.trial.res
            for i in range(nv):
                change[i], top[i] = sol[place[i]], 0.0
            for i in range(rate.shape[0]):
                push[i], rate[i] = sol[place[nv + i]], -rate[i]
            _refine_by_mass(run, at, top, rate, change, push)
            permute(kkt, change, push, sol)
        for i in range(rate.shape[0]):
            of = run.system.rows[i]["fun"]
            con.impulse_work[0] -= sol[place[nv + i]] * con.fun[of, 1] if of >= 0 else 0.0
        moved, speed = 0.0, 0.0
        for i in range(nv):
            v[i] += sol[place[i]]
            moved = max(moved, abs(sol[place[i]]) * weights[i])
            speed = max(speed, abs(v[i]) * weights[i])
        # explicit methods stop at the error of a solve; implicit ones take all rounds, since with
        # them they pass singular positions better
        enough = _POSITION_ROUND_OFF * (_WELL_CONDITIONED_PIVOT if firm else 1.0) * speed
        if run.method.stages > 0 and moved <= enough:
            break
    return SUCCESS


@unit
def project_positions(run: Run, at: Point, rounds: int) -> float:
    """Project q onto C = 0 by Newton corrections with the present factor.

    To be called after a position stage at q. Returns the first correction, weighted. The position
    stage is then that of the new q, or of one that differs by round-off.
    """
    kkt, parts, weights = run.system.kkt, run.system.parts, run.system.weights
    C, sol, place, dq = run.work.con.C, run.work.factor.sol, kkt.place, run.work.trial.dq
    nv, first = dq.shape[0], 0.0
    for n in range(rounds):
        constraint_stage(run, at)
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(C.shape[0]):
            sol[place[nv + i]] = -C[i]
        solve(kkt, run.work.factor, sol)
        for i in range(nv):
            dq[i] = sol[place[i]]
        move(parts, at.q, dq, at.q)
        moved = weighted_max(dq, weights)
        first = moved if n == 0 else first
        if moved <= _POSITION_ROUND_OFF and is_round_off(run, dq, _ROUND_OFF_OF_PART):
            break
        position_stage(run, at)
    return first


@unit
def accelerations(run: Run, at: Point, cp: float, project: int) -> int:
    """Solve for (v̇; λ) at (t, q, v) into vd and lam, which hold estimates before (for tangents).

    The mass matrix is M + cp ∂F/∂q. With `project` = VELOCITIES, v is projected onto its
    constraints first, with POSITIONS q and v are; a method with Baumgarte stabilisation projects
    neither and adds its terms to γ. Kinetostatic modes are iterated with their loads. Returns the
    status: NO_LOOP_CONVERGENCE if the iteration with forces that depend on accelerations or
    reactions, or with such modes, does not converge; SELF_LOCKING if that with friction does not.
    """
    if run.settings.static_after_step == 1 and project != NOTHING:
        zero(run.work.trial.mode_force)
        zero(run.work.trial.res)
        follow_loads(run, at)  # without loads: sets only the rates to zero
    status = _solve_motion(run, at, cp, project)
    if run.settings.static_after_step == 0 or project == NOTHING or status != SUCCESS:
        return status
    for n in range(_MAX_LOOP_ROUNDS):
        status = max(status, forces(run, at))
        change = follow_loads(run, at)
        if status == NOT_FINITE or not math.isfinite(change):
            return NO_LOOP_CONVERGENCE  # the forces were finite before the modes changed
        if status != SUCCESS:
            return status
        if change <= min(
            STATIC_TOLERANCE * 2.0 ** max(n - _STRICT_ROUNDS, 0), _MAX_STATIC_TOLERANCE
        ):
            run_stage(run.stages.static_rates, run, at)
            run_stage(run.stages.static_force, run, at)
            return _solve_motion(run, at, cp, VELOCITIES)
        status = _solve_motion(run, at, cp, project)
    return NO_LOOP_CONVERGENCE


@kernel
def follow_loads(run, at):
    """Move kinetostatic modes to equilibrium with Trial.res; returns their largest change."""
    units, tables, change = run.stages.static.units, run.stages.static.tables, 0.0
    for k in range(len(units)):
        change = max(change, call_value(units[k], run, tables[k], at))
    return change


@unit
def put_vd_round_off(run: Run, at: Point) -> int:
    """Estimate the round-off of accelerations, weighted, into Trial.vd_round_off.

    All positions and velocities are perturbed by their round-off, with alternating signs, once and
    `_PERTURBATION` times; stiff forces amplify this. A difference counts if it grows in proportion
    to the perturbation: where a force jumps it does not.
    """
    tr, weights, noise = run.work.trial, run.system.weights, run.work.trial.vd_round_off
    zero(noise)
    if _perturbed_accelerations(run, at, 0.0) != SUCCESS:
        return SUCCESS
    copy(tr.vd, tr.spare)
    if _perturbed_accelerations(run, at, 1.0) != SUCCESS:
        return SUCCESS
    for i in range(noise.shape[0]):
        tr.dense_correction[i] = abs(tr.vd[i] - tr.spare[i])
    if _perturbed_accelerations(run, at, _PERTURBATION) != SUCCESS:
        return SUCCESS
    for i in range(noise.shape[0]):
        before, change = tr.dense_correction[i], abs(tr.vd[i] - tr.spare[i])
        if before * _PERTURBATION / _SPREAD <= change <= before * _PERTURBATION * _SPREAD:
            noise[i] = weights[i] * change / _PERTURBATION
    zero(tr.dense_correction)
    return SUCCESS


@kernel
def _perturbed_accelerations(run, at, times):
    """Accelerations of the state perturbed by `times` the round-off of q and v; the status."""
    st, tr, sign = run.state, run.work.trial, times
    put_q_round_off(run.system.parts, st.q, tr.dq)
    for i in range(tr.dq.shape[0]):
        tr.dq[i] *= sign
        tr.v[i] = (1.0 + sign * RELATIVE_ROUND_OFF) * st.v[i]
        sign = -sign
    tr.t[0] = st.t[0]
    st.count[0]["residuals"] += 1
    st.count[0]["factorisations"] += 1
    move(run.system.parts, st.q, tr.dq, tr.q)
    copy(st.vd, tr.vd)
    copy(st.lam, tr.lam)
    return accelerations(run, at, 0.0, NOTHING)


@unit
def _solve_motion(run: Run, at: Point, cp: float, project: int) -> int:
    """`accelerations` at constant quasi-static modes."""
    if run.method.stabilised == 1:
        project = NOTHING
    position_stage(run, at)
    velocity_stage(run, at)
    feedback_stage(run, at)
    reaction_stage(run, at)
    run.work.factor.symmetric[0] = 1
    cp = _factorise_definite(run, at, cp)
    if project == POSITIONS and at.lam.shape[0] > 0:
        has_moved = project_positions(run, at, _MAX_ROUNDS) > _SAME_POSE_DISTANCE
        if has_moved and (
            run.settings.static_after_step == 1 or has_dependent_rows(run.work.factor, 0.0)
        ):
            factorise(run, at, 0.0, cp)
    if project != NOTHING:
        project_velocity(run, at, cp)
        velocity_stage(run, at)
        feedback_stage(run, at)
    bias_stage(run, at)
    constraint_right_side(run)
    if run.method.stabilised == 1:
        _stabilise(run, at)
    status = _solve(run, at, cp)
    if status != SUCCESS:
        return status
    if depends_on_solution(run) and not _solve_loop(run, at, cp):
        return SELF_LOCKING if len(run.stages.reaction.units) > 0 else NO_LOOP_CONVERGENCE
    return SUCCESS


@kernel
def _factorise_definite(run, at, cp):
    """Factor M + b ∂F/∂q with the largest b ≤ cp tried for which M + 2b ∂F/∂q is definite.

    Returns b. In an unstable pose ∂F/∂q is negative. If b ∂F/∂q is then as large as a light mass,
    M + b ∂F/∂q is nearly singular, and velocities and reactions would be arbitrary. If no b tried
    is small enough, b = cp.
    """
    b = cp
    for n in range(_MAX_REDUCTIONS):
        if b == 0.0 or _is_definite(run, at, 2.0 * b):
            break
        b = _TANGENT_REDUCTION * b if n + 1 < _MAX_REDUCTIONS else cp
    factorise(run, at, 0.0, b)
    return b


@kernel
def _is_definite(run, at, cp):
    """Whether M + cp ∂F/∂q is positive definite on the null space of Cq.

    By Sylvester's law of inertia: then [[S, Cqᵀ], [Cq, −ε]] has one negative pivot per row of Cq.
    """
    factorise(run, at, 0.0, cp)
    d, negative = run.work.factor.d, 0
    for k in range(d.shape[0]):
        negative += 1 if d[k] < 0.0 else 0
    return negative <= at.lam.shape[0]


@kernel
def _stabilise(run, at):
    """Baumgarte: γ −= 2α (Cq v + C_t) + β² C; stores max |Cq v + C_t| in Constraints.drift."""
    con, rate_gain, gain = run.work.con, 2.0 * run.method.alpha, run.method.beta**2
    constraint_stage(run, at)
    rate_stage(run, at)
    con.drift[0] = largest(con.rate)
    for k in range(con.gamma.shape[0]):
        con.gamma[k] -= rate_gain * con.rate[k] + gain * con.C[k]


@kernel
def depends_on_solution(run):
    """Whether forces depend on accelerations or reactions."""
    return len(run.stages.reaction.units) > 0 or run.system.implicit_feedback == 1


@kernel
def _mass_rounds(run):
    """Number of refinements with M; at least one if forces or deformations depend on (v̇; λ).

    Otherwise these would depend on the term b ∂F/∂q, which uses accelerations and reactions of the
    previous iteration.
    """
    follows = depends_on_solution(run) or run.settings.static_after_step == 1
    return max(run.method.mass_refinements, int(follows))


@kernel
def _is_well_conditioned(fac):
    """Whether all row pivots are far above their regularisation: one refinement is enough."""
    firm = fac.replaced[0] == 0
    for k in range(fac.eps.shape[0]):
        firm = firm and abs(fac.d[k]) >= _WELL_CONDITIONED_PIVOT * fac.eps[k]
    return firm


@unit
def _solve(run: Run, at: Point, cp: float) -> int:
    """(v̇; λ) from (Q; γ) with the present factor; returns the status of the forces."""
    res, fac, kkt = run.work.trial.res, run.work.factor, run.system.kkt
    place, vd, lam = kkt.place, at.vd, at.lam
    nv = vd.shape[0]
    for i in range(nv):
        vd[i] = 0.0
    for i in range(lam.shape[0]):
        lam[i] = 0.0
    status = forces(run, at)
    for i in range(nv):
        res[i] = -res[i]
    permute(kkt, res, run.work.con.gamma, fac.rhs)
    if run.settings.static_after_step == 1:
        for i in range(nv):
            fac.rhs[place[i]] += run.work.trial.mode_force[i]
    if _is_well_conditioned(fac):
        solve_refined(kkt, fac, 1)
    else:
        solve_motion(run)
    for i in range(nv):
        vd[i] = fac.sol[place[i]]
    for i in range(lam.shape[0]):
        lam[i] = fac.sol[place[nv + i]]
    if cp != 0.0:
        _refine_by_mass(run, at, res, run.work.con.gamma, vd, lam)
    return status


@unit
def _refine_by_mass(run: Run, at: Point, top: Vector, bottom: Vector, x: Vector, y: Vector) -> int:
    """Refine (x; y) of [[M, Cqᵀ], [Cq, 0]] (x; y) = (top; bottom) by a factor with M + b ∂F/∂q.

    b, of order h², changes the acceleration of slow motions by a relative error of that order. Each
    round reduces the error by two more orders of h; stiff modes stay filtered.
    """
    fac, kkt, tr = run.work.factor, run.system.kkt, run.work.trial
    place, sol, both, own = kkt.place, fac.sol, fac.tmp, fac.rhs
    nv = x.shape[0]
    copy(top, tr.spare)
    for _ in range(_mass_rounds(run)):
        permute(kkt, x, y, sol)
        multiply(kkt, fac, sol, both)  # (S x + Cqᵀ y; Cq x)
        for i in range(y.shape[0]):
            sol[place[nv + i]] = 0.0
        multiply(kkt, fac, sol, own)  # (S x; Cq x)
        copy(x, tr.res)
        run_stage(run.stages.mass, run, at)  # sol = M x
        for i in range(nv):
            k = place[i]
            own[k] = tr.spare[i] - sol[k] - (both[k] - own[k])
        for i in range(y.shape[0]):
            k = place[nv + i]
            own[k] = bottom[i] - both[k]
        solve(kkt, fac, own)
        for i in range(nv):
            x[i] += own[place[i]]
        for i in range(y.shape[0]):
            y[i] += own[place[nv + i]]
    copy(tr.spare, tr.res)
    return SUCCESS


@unit
def add_stiff_accelerations(run: Run, at: Point, smooth: Vector) -> int:
    """Add to v̇ the part of `smooth` (nv) that `accelerations` has filtered out.

    With S = M + cp ∂F/∂q and r rounds of refinement, v̇ holds the share 1 − s^(r+1) of each mode,
    where s = S⁻¹ cp ∂F/∂q: almost nothing of stiff modes. The missing share s^(r+1) is taken from
    the accelerations of the method itself (`smooth`), on the null space of the constraints. To be
    called after `accelerations`, with its factor.
    """
    fac, kkt, tr = run.work.factor, run.system.kkt, run.work.trial
    place, x, nv = kkt.place, tr.dq, at.vd.shape[0]
    copy(smooth, x)
    for _ in range(_mass_rounds(run) + 1):
        zero(fac.rhs)
        for i in range(nv):
            fac.rhs[place[i]] = tr.res[i] = x[i]
        multiply(kkt, fac, fac.rhs, fac.tmp)
        run_stage(run.stages.mass, run, at)  # sol = M x
        for i in range(nv):
            fac.rhs[place[i]] = fac.tmp[place[i]] - fac.sol[place[i]]
        solve(kkt, fac, fac.rhs)
        for i in range(nv):
            x[i] = fac.rhs[place[i]]
    for i in range(nv):
        at.vd[i] += x[i]
    return SUCCESS


@kernel
def _largest_force(sys, res, lam):
    """The largest force in the equations of motion [N]; moments over the size of the model."""
    size, bodies, weights = 0.0, sys.parts.bodies, sys.weights
    for i in range(res.shape[0]):
        if abs(res[i]) > size * weights[i]:
            size = abs(res[i]) / weights[i]
    for k in range(lam.shape[0]):
        size = max(size, abs(lam[k]) / sys.row_weights[k])
    return size * weights[bodies[0]["iv"]] if bodies.shape[0] > 0 else size


@kernel
def _solve_loop(run, at, cp):
    """Fixed-point iteration of forces that depend on v̇ and λ; returns whether it converged."""
    before, vd, weights = run.work.trial.jerk, at.vd, run.system.weights
    for _ in range(_MAX_LOOP_ROUNDS):
        copy(vd, before)
        change = reaction_stage(run, at)
        feedback_stage(run, at)
        at_rest = change <= _REACTION_TOLERANCE * _largest_force(
            run.system, run.work.trial.res, at.lam
        )
        _solve(run, at, cp)
        size = weighted_max(vd, weights)
        for i in range(vd.shape[0]):
            before[i] -= vd[i]
        change = weighted_max(before, weights)
        if not math.isfinite(change):
            return False
        if at_rest and change <= _LOOP_TOLERANCE * size:
            return True
    return False
