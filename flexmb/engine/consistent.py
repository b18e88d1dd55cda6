"""Single solves at one state, for the analyses that prepare a run: positions, velocities,
accelerations with multipliers, residual. One entry for all, so that it compiles once."""

from __future__ import annotations

from flexmb.engine.jit import entry, kernel
from flexmb.engine.kernels import energy
from flexmb.engine.kernels.algebra.ldl import solve_refined
from flexmb.engine.kernels.algebra.vector import copy, weighted_size
from flexmb.engine.kernels.bodies.motion import move
from flexmb.engine.kernels.forces import joint_friction, memory
from flexmb.engine.kernels.joints import constraint
from flexmb.engine.kernels.kkt import factorise
from flexmb.engine.kernels.projection import accelerations, project_velocity
from flexmb.engine.kernels.residual import position_stage, residual, velocity_stage
from flexmb.engine.kernels.sensors import sensor, signal

POSITIONS, VELOCITIES, ACCELERATIONS, RESIDUAL, BEGIN, REMEMBER = 0, 1, 2, 3, 4, 5
# A correction of positions is cut to this share of the model size (or radians) per round.
_LONGEST = 0.3


@entry
def solve_level(sys, st, wk, level):
    """Solve one level of the state in place with M as the metric.

    POSITIONS: one Gauss–Newton correction of q towards C = 0, returns its weighted size.
    VELOCITIES: v onto Cq v + C_t = 0; returns 0.
    ACCELERATIONS: v̇ and λ; returns −1 − k for a spring k of no length, `projection.UNSETTLED` where
    friction does not settle, else ≥ 0.
    RESIDUAL: wk.trial.res and wk.con.C; returns the same. REMEMBER: memory of the elements, at rest
    here. BEGIN: works and joint angles from here.
    """
    tr = wk.trial
    signal.forget(sys.signals, sys.sensors, wk)
    copy(st.kept, wk.now.kept)
    if level == ACCELERATIONS:
        return float(accelerations(sys, wk, st.t[0], st.q, st.v, st.vd, st.lam, 0.0, 0))
    if level == RESIDUAL:
        return -1.0 - residual(sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
    position_stage(sys, wk, st.t[0], st.q)
    velocity_stage(sys, wk, st.v)
    if level == REMEMBER:
        memory.begin(sys, sys.contacts, sys.frictions, wk.now, st.t[0], st.q, st.kept)
        return 0.0
    if level == BEGIN:
        signal.stage(sys.signals, sys, wk, st.t[0], st.q, st.v, st.vd, st.lam)
        joint_friction.put_grips(sys, sys.frictions, wk, st.lam)
        energy.powers(sys, wk.now, wk.con.fun, st.v, st.lam, st.power)
        coordinates = sys.parts.coordinates
        st.power[1] += joint_friction.power(sys.frictions, coordinates, wk.now, st.q, st.v)
        sensor.forget(sys.sensors, st.angles)
        sensor.follow_angles(sys.sensors, wk.now.marker, st.angles)
        sensor.follow_turns(sys.further, sys.sensors, wk.now.marker, st.angles)
        return 0.0
    wk.factor.symmetric[0] = 1
    factorise(sys, wk, tr.zero, tr.zero, st.lam, 0.0, 0.0)
    if level == VELOCITIES:
        project_velocity(sys, wk, st.v)
        return 0.0
    return _correct_positions(sys, st, wk)


@kernel
def _correct_positions(sys, st, wk):
    tr, fac, place = wk.trial, wk.factor, sys.kkt.place
    constraint.evaluate(sys.lines, sys.rows, wk.now.marker, wk.con)
    nv = tr.dq.shape[0]
    for i in range(nv):
        fac.rhs[place[i]] = 0.0
    for i in range(wk.con.C.shape[0]):
        fac.rhs[place[nv + i]] = -wk.con.C[i]
    solve_refined(sys.kkt, fac, 2)
    for i in range(nv):
        tr.dq[i] = fac.sol[place[i]]
    size = weighted_size(tr.dq, sys.weights)
    if size > _LONGEST:
        for i in range(nv):
            tr.dq[i] *= _LONGEST / size
    move(sys.parts, st.q, tr.dq, st.q)
    return size
