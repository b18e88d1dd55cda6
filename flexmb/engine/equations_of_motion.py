"""The equations of motion: their stages in order, and the energy balance.

Each stage loops over the kinds that the model has (`engine.kind`) and names none of them.
The equations are M v̇ − Q + Cqᵀ λ = 0 and C = 0; `engine.iteration_matrix` has their matrix.
"""

from __future__ import annotations

import math

from flexmb.engine.algebra.vector import copy, zero
from flexmb.engine.jit import call_stage, call_value, kernel, unit
from flexmb.engine.method import HIGH_ORDER, SUCCESS
from flexmb.engine.state import DRIVER_POWER, Point, Run


@kernel
def run_stage(stage, run, at):
    """Run a stage of all kinds; returns SUCCESS or the largest status."""
    units, tables = stage.units, stage.tables
    worst = SUCCESS
    for k in range(len(units)):
        status = call_stage(units[k], run, tables[k], at)
        worst = max(worst, status)
    return worst


@unit
def begin_run(run: Run, at: Point) -> int:
    """Evaluate the constants of a run; before any other stage."""
    return run_stage(run.stages.constants, run, at)


@unit
def position_stage(run: Run, at: Point) -> int:
    """Functions of time, poses of bodies and markers, integrals of the deformation at (t, q)."""
    stages, now = run.stages, run.work.now
    run_stage(stages.functions, run, at)
    run_stage(stages.position, run, at)
    run_stage(stages.inertia, run, at)
    if now.history.shape[0] > 0:
        now.span[0] = at.t[0] - now.history[0]
    return SUCCESS


@unit
def pose_stage(run: Run, at: Point) -> int:
    """The part of the position stage that depends on q alone: poses of bodies and markers."""
    return run_stage(run.stages.position, run, at)


@unit
def velocity_stage(run: Run, at: Point) -> int:
    """Velocities of the markers and of the scalar coordinates, after a position stage."""
    return run_stage(run.stages.velocity, run, at)


@unit
def bias_stage(run: Run, at: Point) -> int:
    """Accelerations of the markers at zero v̇, after a velocity stage."""
    return run_stage(run.stages.bias, run, at)


@unit
def constraint_stage(run: Run, at: Point) -> int:
    """C of all rows, after a position stage."""
    return run_stage(run.stages.constraint, run, at)


@unit
def rate_stage(run: Run, at: Point) -> int:
    """Cq v + C_t of all rows, after a velocity stage."""
    return run_stage(run.stages.rate, run, at)


@unit
def complete_poses(run: Run, at: Point) -> int:
    """Poses and velocities that only outputs and sensors need, after a velocity stage."""
    return run_stage(run.stages.axes, run, at)


@kernel
def feedback_stage(run, at):
    """Forces and controller states that depend on sensor channels, after a position stage."""
    run_stage(run.stages.feedback, run, at)


@kernel
def reaction_stage(run, at):
    """Loads that depend on the multipliers; returns their largest change [N]."""
    units, tables = run.stages.reaction.units, run.stages.reaction.tables
    change = 0.0
    for k in range(len(units)):
        step = call_value(units[k], run, tables[k], at)
        if not step <= change:
            change = step
    return change


@unit
def forces(run: Run, at: Point) -> int:
    """Trial.res = M v̇ − Q + Cqᵀ λ, after the stages of position, velocity, feedback, reaction."""
    status = run_stage(run.stages.wrench, run, at)
    return max(status, run_stage(run.stages.force, run, at))


@unit
def residual(run: Run, at: Point) -> int:
    """Trial.res and C at a point; the status. The residual of kinetostatic modes is set to zero."""
    position_stage(run, at)
    run_stage(run.stages.force_velocity, run, at)
    feedback_stage(run, at)
    run_stage(run.stages.constraint, run, at)
    reaction_stage(run, at)
    status = forces(run, at)
    if run.settings.static_after_step == 1:
        run_stage(run.stages.static_hold, run, at)
    return status


# Least ratio of the sum of the two steps before to this one for integration by the cubic: with
# shorter steps before, the cubic would be extrapolated too far.
_MIN_STEP_RATIO = 0.3


@kernel
def work_of_step(method, st, k, power, h):
    """Work of a step [J]: integral of the cubic through the power at its ends and two steps before.

    The cubic gives order 4. If steps before are too short or unknown, the parabola through one
    point before is used, or the straight line. For drivers it is the straight line by methods of
    order 2: after a change of the step their multipliers alternate from step to step, and it
    averages them.
    """
    now, before, earlier = st.power[k], st.power_before[0, k], st.power_before[1, k]
    a, b = st.memory[0]["last_step"], st.memory[0]["earlier_step"]
    rise = (power - now) / h
    alternates = k == DRIVER_POWER and method.order < HIGH_ORDER
    if alternates or math.isnan(before) or not a > 0.0:
        return 0.5 * h * (now + power)
    slope = (power - before) / (a + h)
    bend = (slope - rise) / -a
    work = h * now + h * h * (0.5 * rise - bend * h / 6.0)
    if math.isnan(earlier) or not a + b > _MIN_STEP_RATIO * h:
        return work
    bend_before = ((before - earlier) / b - slope) / -(a + b + h)
    return work + (bend_before - bend) / (a + b) * h**3 * (h / 12.0 + a / 6.0)


@unit
def powers(run: Run, at: Point) -> int:
    """Work.powers of drivers, dampers and applied forces [W]; after all stages but forces."""
    total = run.work.powers
    for k in range(3):
        total[k] = 0.0
    return run_stage(run.stages.power, run, at)


@unit
def energies(run: Run, at: Point) -> int:
    """Work.energies: kinetic, strain, gravity, spring, bristles [J]; after a velocity stage."""
    total = run.work.energies
    zero(total)
    return run_stage(run.stages.energy, run, at)


@kernel
def put_energies(run, at, work_done, out):
    """One row (7) of the energy balance: kinetic, strain, gravity, spring, and three works [J].

    The power of friction includes the energy that its bristles store. That is not dissipated: it is
    added to the spring energy and to the work of dampers.
    """
    energies(run, at)
    total = run.work.energies
    for k in range(4):
        out[k] = total[k]
    for k in range(3):
        out[4 + k] = work_done[k]
    out[3] += total[4]
    out[5] += total[4]


@kernel
def update_energy_range(run, at):
    """Extend the range of energies (Output.extent) to those of the trial state."""
    extent = run.output.extent
    now = extent[2]
    put_energies(run, at, run.state.work_done, now)
    for k in range(now.shape[0]):
        low, high = extent[0, k], extent[1, k]
        extent[0, k] = now[k] if math.isnan(low) else min(low, now[k])
        extent[1, k] = now[k] if math.isnan(high) else max(high, now[k])


@kernel
def update_history(run, at, history):
    """Write the history of all elements at an accepted state, after its velocity stage."""
    if history.shape[0] > 0:
        now = run.work.now
        run_stage(run.stages.bias, run, at)
        run_stage(run.stages.update_history, run, at)
        history[0] = at.t[0]
        copy(history, now.history)
        now.span[0] = 0.0


@kernel
def begin_history(run, at, history):
    """First history, after position and velocity stages of the first state: bristles unloaded."""
    if history.shape[0] > 0:
        now = run.work.now
        zero(history)
        history[0] = at.t[0]
        copy(history, now.history)
        now.span[0] = 0.0
        run_stage(run.stages.begin, run, at)
        copy(history, now.history)
