"""The equations of motion: M v̇ − Q + Cqᵀ λ and C at one state."""

from __future__ import annotations

from flexmb.engine.jit import inlined, kernel
from flexmb.engine.kernels.bodies import inertia, kinematics
from flexmb.engine.kernels.forces import contact, element, force, joint_friction, memory
from flexmb.engine.kernels.functions.time_function import evaluate_all
from flexmb.engine.kernels.joints import constraint, coordinate, slider
from flexmb.engine.kernels.sensors import signal


@kernel
def position_stage(sys, wk, t, q):
    """Functions of time, body rotations, markers and deformation integrals at (t, q)."""
    evaluate_all(sys.functions, t, wk.trial.variables, wk.trial.stack, wk.con.fun)
    coordinate.put_values(sys.parts.coordinates, sys, q, wk.con.fun)
    kinematics.position(sys.parts, wk.now, q)
    element.position(sys.elements, sys.parts.coordinates, wk.now, q)
    inertia.prepare(sys.parts, wk.now, q)
    memory.put_span(sys.contacts, wk.now, t)


@kernel
def velocity_stage(sys, wk, v):
    """Velocities of the markers and of the scalar coordinates after a position stage."""
    kinematics.velocity(sys.parts, wk.now, v)
    coordinate.put_rates(sys.parts.coordinates, sys, v, wk.con.fun)


@kernel
def _velocities_for_forces(springs, contacts, elements, parts, now, v):
    if springs is not None or contacts is not None or elements is not None:
        kinematics.velocity(parts, now, v)


@inlined
def residual(sys, wk, t, q, v, vd, lam):
    """res = M v̇ − Q + Cqᵀ λ and C, in the work; returns a spring of no length, or −1."""
    position_stage(sys, wk, t, q)
    _velocities_for_forces(sys.springs, sys.contacts, sys.elements, sys.parts, wk.now, v)
    signal.stage(sys.signals, sys, wk, t, q, v, vd, lam)
    constraint.evaluate(sys.lines, sys.rows, wk.now.marker, wk.con)
    joint_friction.put_grips(sys, sys.frictions, wk, lam)
    return forces(sys, wk, q, v, vd, lam)


@kernel
def forces(sys, wk, q, v, vd, lam):
    """res = M v̇ − Q + Cqᵀ λ after the stages of position (with springs: velocity) and signals.

    Friction in joints is that of the normal forces in wk.now.grip.
    """
    kinematics.clear_wrenches(wk.now)
    bad = force.add_spring_wrenches(sys.springs, wk.now.marker)
    undefined = element.add_wrenches(sys.elements, wk.now, wk.con.fun)
    force.add_load_wrenches(sys.loads, wk.now.marker, wk.con.fun)
    contact.add_wrenches(sys.contacts, wk.now, wk.dense.g[0])
    constraint.subtract_reactions(sys.lines, sys.rows, wk.now.marker, lam, wk.dense.g[0])
    inertia.inertia_forces(sys.parts, wk.now, q, v, vd, wk.trial.res)
    kinematics.subtract_wrenches(sys.parts, wk.now, wk.trial.res)
    coordinate.put_forces(sys, sys.parts.coordinates, wk, q, v, vd, lam)
    element.put_coordinate_forces(
        sys.elements, sys.parts.coordinates, wk.now, wk.con.fun, v, wk.trial.res
    )
    slider.subtract_forces(sys.parts.sliders, sys.parts, wk.now, wk.trial.res)
    joint_friction.put_forces(sys, sys.frictions, wk, q, v)
    return max(bad, undefined)
