"""Inverse dynamics: reactions and driving forces of a motion that is known.

With the factor of [[W, Cqᵀ], [Cq, 0]] at the pose, Cqᵀ λ = Q − M v̇ is solved for λ; where rows
repeat others, the least λ. What holds the shapes of flexible bodies takes the modal forces.
"""

from __future__ import annotations

from flexmb.engine.algebra.ldl import solve_refined
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.projection import depends_on_solution
from flexmb.engine.kernels.stages import feedback_stage, forces, reaction_stage, walk
from flexmb.engine.method import FINE, NO_LOOP, SELF_LOCKING
from flexmb.engine.state import Run

# Forces that depend on reactions: rounds until these settle, relative.
_MAX_ROUNDS, _SETTLED = 100, 1e-12


@unit
def solve_reactions(run: Run) -> int:
    """λ of Cqᵀ λ = Q − M v̇ at the state with the factor of its pose; returns the status."""
    at, fac, kkt, now = run.state_point, run.work.factor, run.system.kkt, run.work.now
    place, lam, before, res = kkt.place, at.lam, run.work.con.gamma, run.work.trial.res
    nv, nc = res.shape[0], lam.shape[0]
    walk(run.stages.inertia, run, at)
    if now.history.shape[0] > 0:
        now.span[0] = at.t[0] - now.history[0]
    for n in range(_MAX_ROUNDS):
        feedback_stage(run, at)
        reaction_stage(run, at)
        for i in range(nc):
            before[i] = lam[i]
            lam[i] = 0.0
            fac.rhs[place[nv + i]] = 0.0
        status = forces(run, at)
        if status != FINE:
            return status
        _fix_shapes(run.system.parts.bodies, res)
        for i in range(nv):
            fac.rhs[place[i]] = -res[i]
        solve_refined(kkt, fac, 1)  # takes the regularisation, 1e-9, back to round-off
        change, size = 0.0, 0.0
        for i in range(nc):
            lam[i] = fac.sol[place[nv + i]]
            change = max(change, abs(lam[i] - before[i]))
            size = max(size, abs(lam[i]))
        if not depends_on_solution(run) or (n > 0 and change <= _SETTLED * size):
            return FINE
    return SELF_LOCKING if len(run.stages.reaction.units) > 0 else NO_LOOP


@kernel
def _fix_shapes(bodies, res):
    """No forces on modal coordinates: what holds the shapes takes them."""
    for k in range(bodies.shape[0]):
        for j in range(bodies[k]["m"]):
            res[bodies[k]["iv"] + 6 + j] = 0.0
