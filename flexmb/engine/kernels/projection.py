"""Back to the constraints: velocities, accelerations and multipliers as they are reported.

Generalized-α holds its own velocities and multipliers at second order only if they are left alone
from step to step (projected with the factor of an earlier pose they lose an order), so those that
are reported are computed aside, with a factor of the moment: v from (0; −(Cq v + C_t)), (v̇; λ) from
(Q; γ), refined. The mass matrix is M + b ∂F/∂q: with M a stiff mode at a joint spoils λ, which b K,
of order h², prevents; gyroscopic and damping terms, of order h, stay out. Where the constraints
alone fix the motion, it is M.
"""

from __future__ import annotations

import math

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.ldl import solve, solve_refined
from flexmb.engine.kernels.algebra.vector import copy, largest, weighted_size
from flexmb.engine.kernels.bodies import kinematics
from flexmb.engine.kernels.bodies.motion import move
from flexmb.engine.kernels.forces import joint_friction
from flexmb.engine.kernels.joints import constraint
from flexmb.engine.kernels.kkt import factorise, permute
from flexmb.engine.kernels.residual import forces, position_stage, velocity_stage
from flexmb.engine.kernels.sensors import signal

_ROUNDS = 3
_REFINEMENTS = 2
# Forces that depend on accelerations or reactions: rounds until they settle, relative.
_LOOP_ROUNDS, _LOOP_CLOSED = 100, 1e-12
LOOP = -1 << 40
# A correction of positions this small, relative to the model, is round-off.
_ROUND_OFF = 1e-13
# Rounds in which friction in joints and the reactions that cause it agree, to this share of the
# largest force.
_FRICTION_ROUNDS = 100
_SETTLED = 1e-10
UNSETTLED = -1_000_000_000
"""What `accelerations` returns where they do not: a joint locks itself."""


@kernel
def project_velocity(sys, wk, v):
    """Put v (nv) on Cq v + C_t = 0 after a position stage, with a factor of this position.

    wk.con.drift keeps how far v was off.
    """
    rate, sol, place = wk.con.rate, wk.factor.sol, sys.kkt.place
    nv = v.shape[0]
    wk.con.drift[0] = 0.0
    if rate.shape[0] == 0:
        return
    for n in range(_ROUNDS):
        velocity_stage(sys, wk, v)
        constraint.rates(sys.lines, sys.rows, wk.now.marker, wk.con, wk.dense.g[0])
        if n == 0:
            wk.con.drift[0] = largest(rate)
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(rate.shape[0]):
            sol[place[nv + i]] = -rate[i]
        solve(sys.kkt, wk.factor, sol)
        for i in range(nv):
            v[i] += sol[place[i]]


@kernel
def project_positions(sys, wk, t, q, rounds):
    """Put q on C = 0 by Newton corrections with the present factor, after a position stage at q.

    Returns whether the last correction was round-off; leaves a position stage at q.
    """
    tr, C, sol, place = wk.trial, wk.con.C, wk.factor.sol, sys.kkt.place
    nv = tr.dq.shape[0]
    for _ in range(rounds):
        constraint.evaluate(sys.lines, sys.rows, wk.now.marker, wk.con)
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(C.shape[0]):
            sol[place[nv + i]] = -C[i]
        solve(sys.kkt, wk.factor, sol)
        for i in range(nv):
            tr.dq[i] = sol[place[i]]
        if weighted_size(tr.dq, sys.weights) <= _ROUND_OFF:
            return True
        move(sys.parts, q, tr.dq, q)
        position_stage(sys, wk, t, q)
    return False


@kernel
def accelerations(sys, wk, t, q, v, vd, lam, cp, project):
    """Solve for (v̇; λ) at (t, q, v) into vd and lam (in: estimates for the tangents).

    The mass matrix is M + cp ∂F/∂q. With `project` = 1, v is put on its constraints first, with 2
    q and v are.

    Returns the number of replaced pivots, −1 − k for spring k of no length, LOOP where forces that
    depend on accelerations or reactions find none that fit, or UNSETTLED where friction does not.
    """
    fac = wk.factor
    position_stage(sys, wk, t, q)
    velocity_stage(sys, wk, v)
    signal.stage(sys.signals, sys, wk, t, q, v, vd, lam)
    joint_friction.put_grips(sys, sys.frictions, wk, lam)
    fac.symmetric[0] = 1
    fixes = factorise(sys, wk, v, vd, lam, 0.0, cp)
    if project == 2 and lam.shape[0] > 0:
        project_positions(sys, wk, t, q, _ROUNDS)
    if project > 0:
        project_velocity(sys, wk, v)
        velocity_stage(sys, wk, v)
        signal.stage(sys.signals, sys, wk, t, q, v, vd, lam)
    kinematics.bias(sys.parts, wk.now, v)
    constraint.right_side(sys.lines, sys.rows, wk.now.marker, wk.con, wk.dense.g[0])
    bad = _solve(sys, wk, q, v, vd, lam)
    if bad >= 0:
        return -1 - bad
    if not _settled(sys.signals, sys.frictions, sys, wk, t, q, v, vd, lam):
        return UNSETTLED if joint_friction.rubs(sys.frictions) else LOOP
    return fixes


@kernel
def _solve(sys, wk, q, v, vd, lam):
    """(v̇; λ) from (Q; γ) with the present factor; returns a spring of no length, or −1."""
    tr, fac, place = wk.trial, wk.factor, sys.kkt.place
    for i in range(lam.shape[0]):
        lam[i] = 0.0
    bad = forces(sys, wk, q, v, tr.zero, lam)
    for i in range(v.shape[0]):
        tr.res[i] = -tr.res[i]
    permute(sys.kkt, tr.res, wk.con.gamma, fac.rhs)
    solve_refined(sys.kkt, fac, _REFINEMENTS)
    for i in range(v.shape[0]):
        vd[i] = fac.sol[place[i]]
    for i in range(lam.shape[0]):
        lam[i] = fac.sol[place[v.shape[0] + i]]
    return bad


@kernel
def _settled(signals, frictions, sys, wk, t, q, v, vd, lam):
    """Solve again while forces depend on what was found; whether that came to an end."""
    if joint_friction.rubs(frictions):
        return _repeat(signals, frictions, sys, wk, t, q, v, vd, lam)
    if signals is not None and signals.implicit[0] == 1:
        return _repeat(signals, frictions, sys, wk, t, q, v, vd, lam)
    return True


@kernel
def _repeat(signals, frictions, sys, wk, t, q, v, vd, lam):
    before = wk.trial.jerk
    for _ in range(_LOOP_ROUNDS):
        copy(vd, before)
        grip = joint_friction.put_grips(sys, frictions, wk, lam)
        signal.stage(signals, sys, wk, t, q, v, vd, lam)
        at_rest = grip <= _SETTLED * max(largest(wk.trial.res), largest(lam))
        _solve(sys, wk, q, v, vd, lam)
        size = weighted_size(vd, sys.weights)
        for i in range(v.shape[0]):
            before[i] -= vd[i]
        change = weighted_size(before, sys.weights)
        if not math.isfinite(change):
            return False
        if at_rest and change <= _LOOP_CLOSED * size:
            return True
    return False
