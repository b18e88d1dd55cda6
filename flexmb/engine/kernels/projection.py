"""Back to the constraints: velocities, and the accelerations and multipliers that are reported.

Velocities use the factor of the last iteration matrix S: S (δv; μ) = (0; −(Cq v + C_t)).
Accelerations and multipliers: with M + b ∂F/∂q in place of M, (v̇; λ) from (Q; γ), refined; not with
M, because with a stiff mode at a joint it is b K of order h² that keeps the error of λ of second
order; and not with S, whose gyroscopic and damping terms of order h make it of first. Where the
constraints alone fix the motion, M.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels import constraint, kinematics
from flexmb.engine.kernels.kkt import factorise, permute
from flexmb.engine.kernels.ldl import solve, solve_refined
from flexmb.engine.kernels.residual import forces, position_stage

_ROUNDS = 3
_REFINEMENTS = 2


@kernel
def project_velocity(sys, wk, v, tolerance, contraction):
    """Put v (nv) on Cq v + C_t = 0 after a position stage; returns the solves made.

    A correction that leaves no more than `tolerance` (weighted) ends the iteration, with the
    contraction that Newton measured for this factor; wk.con.mu adds up μ.
    With velocities projected at every step of size h, v̇ and λ of generalized-α refer to a time
    c h off the step's end, c = 1/3 − 2β + α_f − α_m, and the drift of a step is −c h² times the
    third derivative: so v̇ + δv/h and λ + μ/h are those at its end, to second order.
    """
    rate, mu, sol, place = wk.con.rate, wk.con.mu, wk.factor.sol, sys.kkt.place
    nv = v.shape[0]
    for i in range(mu.shape[0]):
        mu[i] = 0.0
    if rate.shape[0] == 0:
        return 0
    for n in range(_ROUNDS):
        kinematics.velocity(sys.parts, wk.now, v)
        constraint.rates(sys.rows, wk.now.marker, wk.con, wk.dense.g[0])
        for i in range(nv):
            sol[place[i]] = 0.0
        for i in range(rate.shape[0]):
            sol[place[nv + i]] = -rate[i]
        solve(sys.kkt, wk.factor, sol)
        size = 0.0
        for i in range(nv):
            d = sol[place[i]]
            v[i] += d
            size = max(size, abs(d) * sys.weights[i])
        for i in range(mu.shape[0]):
            mu[i] += sol[place[nv + i]]
        if contraction / (1.0 - contraction) * size <= tolerance:
            return n + 1
    return _ROUNDS


@kernel
def accelerations(sys, wk, t, q, v, vd, lam, cp):
    """Solve for (v̇; λ) at (t, q, v) into vd and lam (in: estimates for the tangents).

    The mass matrix is M + cp ∂F/∂q.

    Returns the number of replaced pivots, or −1 − k for spring k of no length.
    """
    tr, fac, place = wk.trial, wk.factor, sys.kkt.place
    nv = v.shape[0]
    position_stage(sys, wk, t, q)
    kinematics.velocity(sys.parts, wk.now, v)
    fac.symmetric[0] = 1
    fixes = factorise(sys, wk, v, vd, lam, 0.0, cp)
    for i in range(lam.shape[0]):
        lam[i] = 0.0
    bad = forces(sys, wk, q, v, tr.zero, lam)
    if bad >= 0:
        return -1 - bad
    kinematics.bias(sys.parts, wk.now, v)
    constraint.right_side(sys.rows, wk.now.marker, wk.con, wk.dense.g[0])
    for i in range(nv):
        tr.res[i] = -tr.res[i]
    permute(sys.kkt, tr.res, wk.con.gamma, fac.rhs)
    solve_refined(sys.kkt, fac, _REFINEMENTS)
    for i in range(nv):
        vd[i] = fac.sol[place[i]]
    for i in range(lam.shape[0]):
        lam[i] = fac.sol[place[nv + i]]
    return fixes
