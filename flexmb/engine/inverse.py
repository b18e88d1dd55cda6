"""Inverse dynamics: reactions and driving forces of a motion that is known.

With the factor of [[W, Cqᵀ], [Cq, 0]] at the pose, Cqᵀ λ = Q − M v̇ is solved for λ; where rows
repeat others, the least λ. What holds the shapes of flexible bodies takes the modal forces.
"""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.algebra.ldl import solve_refined
from flexmb.engine.kernels.bodies import inertia
from flexmb.engine.kernels.forces import element, joint_friction, memory
from flexmb.engine.kernels.residual import forces
from flexmb.engine.kernels.sensors import signal
from flexmb.engine.method import FINE, NO_LOOP, SELF_LOCKING, ZERO_LENGTH

# Forces that depend on reactions: rounds until these settle, relative.
_LOOPS, _SETTLED = 100, 1e-12


@kernel
def reactions(sys, st, wk):
    """λ of Cqᵀ λ = Q − M v̇ with the factor of this pose; returns the status."""
    fac, place, nv, before = wk.factor, sys.kkt.place, st.v.shape[0], wk.con.gamma
    inertia.prepare(sys.parts, wk.now, st.q)
    element.position(sys.elements, sys.parts.coordinates, wk.now, st.q)
    memory.put_span(sys.contacts, wk.now, st.t[0])
    for n in range(_LOOPS):
        signal.stage(sys.signals, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
        joint_friction.put_grips(sys, sys.frictions, wk, st.lam)
        for i in range(st.lam.shape[0]):
            before[i] = st.lam[i]
            st.lam[i] = 0.0
            fac.rhs[place[nv + i]] = 0.0
        if forces(sys, wk, st.q, st.v, st.vd, st.lam) >= 0:
            return ZERO_LENGTH
        _hold_shapes(sys.parts.bodies, wk.trial.res)
        for i in range(nv):
            fac.rhs[place[i]] = -wk.trial.res[i]
        solve_refined(sys.kkt, fac, 1)  # takes the regularisation, 1e-9, back to round-off
        change, size = 0.0, 0.0
        for i in range(st.lam.shape[0]):
            st.lam[i] = fac.sol[place[nv + i]]
            change = max(change, abs(st.lam[i] - before[i]))
            size = max(size, abs(st.lam[i]))
        if _independent(sys.signals, sys.frictions) or (n > 0 and change <= _SETTLED * size):
            return FINE
    return SELF_LOCKING if joint_friction.rubs(sys.frictions) else NO_LOOP


@kernel
def _independent(signals, frictions):
    """Whether no force depends on reactions or accelerations."""
    if joint_friction.rubs(frictions):
        return False
    if signals is not None:
        return signals.implicit[0] == 0
    return True


@kernel
def _hold_shapes(bodies, res):
    """No forces on modal coordinates: what holds the shapes takes them."""
    for k in range(bodies.shape[0]):
        for j in range(bodies[k]["m"]):
            res[bodies[k]["iv"] + 6 + j] = 0.0
