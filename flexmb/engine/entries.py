"""What Python asks of compiled code: methods, single solves, chunks of the time loop; sentences."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import numpy as np

from flexmb.engine import initial_conditions, integrators, state_rows, time_loop
from flexmb.engine.compile import Compiled
from flexmb.engine.function import run_program
from flexmb.engine.jit import UNITS, CompiledUnit, Packed, units_in
from flexmb.engine.kinematics_point import KinematicsSettings, Path
from flexmb.engine.method import (
    CURVE_END,
    NO_CONVERGENCE,
    NO_LOOP_CONVERGENCE,
    NO_PARTITION,
    NOT_FINITE,
    SELF_LOCKING,
    STEP_TOO_SMALL,
    ZERO_LENGTH,
    Method,
)
from flexmb.engine.state import Run, Stage, Stages, State, Work
from flexmb.engine.tables import System
from flexmb.engine.units import call, caller_without_compiling, packed_record, prepare_units
from flexmb.engine.work import new_run, output_run, units_of
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec


def all_units() -> tuple[CompiledUnit, ...]:
    """All units there are, of all kinds and methods."""
    _makers()  # imports the methods
    return tuple(UNITS[name] for name in sorted(UNITS))


def solve_stage(system: System, state: State, work: Work, level: int) -> float:
    """Solve one level of the state in place with M as the metric.

    Parameters
    ----------
    system, state, work : System, State, Work
        The tables, the state, and scratch.
    level : int
        POSITIONS: one Gauss–Newton correction of q towards C = 0, returns its weighted size.
        VELOCITIES: v onto Cq v + C_t = 0; returns 0.
        ACCELERATIONS: v̇ and λ; returns the status.
        RESIDUAL: work.trial.res and work.con.C; returns the status.
        REMEMBER: history of the elements, at rest here. BEGIN: works and joint angles from here.
    """
    return float(call(initial_conditions.solve_stage, new_run(system, state, work), level))


def stage_solver(system: System, state: State, work: Work) -> Callable[[int], float]:
    """`solve_stage` for many calls: the tables are handed over once."""
    run = packed_record(new_run(system, state, work))
    return lambda level: float(call(initial_conditions.solve_stage, run, level))


def row_evaluator(system: System, state: State, work: Work) -> Callable[[], None]:
    """What puts markers, C and the rows of Cq (Dense.jac) at the positions of a state into its
    scratch. Nothing is compiled for that: units that are missing run as plain Python."""
    run, none = new_run(system, state, work), Stage((), ())
    stages = Stages(*(none for _ in Stages._fields))
    used = {name: getattr(run.stages, name) for name in initial_conditions.ROW_STAGES}
    run = run._replace(
        stages=stages._replace(**used),
        rows=run.rows._replace(curvature=(), tangent=()),
        sensors=run.sensors._replace(channel=(), measure=(), gradient=()),
    )
    return caller_without_compiling(initial_conditions.evaluate_rows, run)


def prepare_integration(system: System, method: Method, progress: Progress = silent) -> int:
    """Load all units of a run, and compile those that are missing; returns how many were compiled.

    Parameters
    ----------
    system : System
        The compiled model.
    method : Method
        The integrator.
    progress : Progress
        Told the phase `compile`, or `load` where all units are there.

    Raises
    ------
    CompilationError
        A unit does not compile on this machine.
    """
    return prepare_units(integration_units(system, method), progress)


def integration_units(system: System, method: Method) -> list[CompiledUnit]:
    """The units that a run calls, and those that stand in its tables."""
    units = [
        time_loop.integrate_steps,
        initial_conditions.solve_stage,
        initial_conditions.evaluate_rows,
    ]
    units.append(run_program)  # what few scenes do without
    return [*units, *units_of(system), *units_in(method)]


def integrate(run: Run | Packed, n_steps: int, aside: Run | Packed | None = None) -> int:
    """Run n_steps, or until the end or until `run.output` is full; returns the status.

    Parameters
    ----------
    run : Run
        The run.
    n_steps : int
        How many steps at most; 0 writes the outputs that are due.
    aside : Run, optional
        From `output_run`, to be made once for many calls.
    """
    if aside is None:
        aside = output_run(run.record if isinstance(run, Packed) else run)
    return int(call(time_loop.integrate_steps, run, aside, n_steps))


def statics_units(system: System) -> list[CompiledUnit]:
    """The units that equilibria call, and those that stand in its tables."""
    units = [initial_conditions.solve_stage, initial_conditions.evaluate_equations]
    return [*units, state_rows.write_equilibrium, *units_of(system)]


def kinematics_units(system: System) -> list[CompiledUnit]:
    """The units that a kinematic analysis calls, and those that stand in its tables."""
    units = [time_loop.kinematics_loop, initial_conditions.evaluate_rows]
    return [*units, *units_of(system)]


def analyse_kinematics(
    run: Run, path: Path, settings: KinematicsSettings, what: int, n: int = 0
) -> float:
    """Points of a kinematic analysis, or what its first pose needs.

    Parameters
    ----------
    run, path, settings : Run, Path, KinematicsSettings
        The run, the memory of the analysis, and what it is asked for.
    what : int
        POINTS: the next n output points, into `run.output`; returns the status. EVALUATE: C, Cq,
        markers and rates at the state, in place; returns 0. CORRECT: the same, and one
        Gauss–Newton correction of q with least change; returns its weighted size.
    n : int
        Number of points.
    """
    return float(call(time_loop.kinematics_loop, run, path, settings, what, n))


_WHAT = {
    NO_CONVERGENCE: "Newton's method does not converge",
    NOT_FINITE: "the solution is no longer finite",
    STEP_TOO_SMALL: "the step size fell below its minimum: the requested accuracy cannot be "
    "reached",
    ZERO_LENGTH: "a spring-damper (or a stop on a distance) has no length, so its direction is "
    "undefined",
    NO_LOOP_CONVERGENCE: "the algebraic loop between forces and accelerations or reactions does "
    "not converge",
    SELF_LOCKING: "the iteration between joint friction and joint reactions does not converge",
    NO_PARTITION: "no choice of independent coordinates determines the dependent ones",
}
_LOCKS = (
    "friction grows as fast as the forces against it, so that a joint locks itself: lower its "
    "coefficients or make its bearing longer"
)
_CURE = {
    NO_CONVERGENCE: "smaller steps were tried; check the named place for a locked or singular pose",
    NOT_FINITE: "smaller steps were tried; check functions of time, and force characteristics, at "
    "this moment",
    STEP_TOO_SMALL: "ask for less accuracy",
    ZERO_LENGTH: "keep its two markers apart, or use a joint",
    NO_LOOP_CONVERGENCE: "the loop amplifies; lower its gain, or let a state or a filter stand "
    "between",
    SELF_LOCKING: _LOCKS,
    NO_PARTITION: 'the pose is singular; method = "explicit-rk" or "radau" may pass it',
}
_JUMP = {
    NO_CONVERGENCE: ", or a jump in a force or driver",
    STEP_TOO_SMALL: ", or smooth a jump in a force or driver at this time",
}
_NAMELESS = (ZERO_LENGTH, SELF_LOCKING, NO_PARTITION)


def sentence(status: int, compiled: Compiled, work: Work, time: float, cause: str = "") -> str:
    """The message for a failed step.

    Parameters
    ----------
    status : int
        Code of the kernel, not `SUCCESS`.
    compiled, work : Compiled, Work
        The system and its scratch as the failed step left it.
    time : float
        Time at which the step began [s].
    cause : str
        What is known of it, in place of what may be.
    """
    if status == CURVE_END:
        return _curve_end(compiled, work, time)
    where = "" if status in _NAMELESS else f"; most at {worst_place(compiled, work)}"
    if cause:
        return f"at t = {time:.6g} s {_WHAT[status]}{where}: {cause}"
    cure = _CURE[status]
    if compiled.functions or compiled.elements:
        cure += _JUMP.get(status, "")
    if status == NO_CONVERGENCE and "joint_frictions" in compiled.system.kinds:
        cure += f"; or {_LOCKS}"
    return f"at t = {time:.6g} s {_WHAT[status]}{where}: {cure}"


def _curve_end(compiled: Compiled, work: Work, time: float) -> str:
    """Which joint leaves its curve, and where."""
    parts = compiled.system.parts
    names = compiled.layout.coordinates
    for marker in parts.curve_markers:
        s = work.trial.q[parts.coordinates[marker["coordinate"]]["iq"]]
        length = parts.pool[marker["at"] + marker["n"]]
        if not marker["closed"] and not 0.0 <= s <= length:
            joint = names[marker["coordinate"]].rpartition(".")[0]
            end = "beginning" if s < 0.0 else "end"
            return (
                f"at t = {time:.6g} s {joint} leaves its curve at the {end} of it: lengthen the "
                "curve there, set closed = true if it is a closed curve, or limit the motion to it"
            )
    return f"at t = {time:.6g} s a joint leaves its curve at an end"


def worst_place(compiled: Compiled, work: Work) -> str:
    """Name of the constraint row or the body with the largest remaining correction."""
    system, layout = compiled.system, compiled.layout
    size = np.abs(work.factor.sol[system.kkt.place[: layout.nv]]) * system.weights
    size = np.where(np.isfinite(size), size, np.inf)
    name = layout.bodies[0].name
    for body in layout.bodies:
        if body.iv <= int(np.argmax(size)) < body.iv + 6 + body.m:
            name = body.name
    if layout.nc and np.all(np.isfinite(work.con.C)):
        gap = np.abs(work.con.C)
        if gap.max() > 1e-6 * compiled.length:
            return f"{layout.rows[int(np.argmax(gap))]} and body {name}"
    return f"body {name}"


AUTO = "auto"
STIFF_METHOD = "radau"
"""What a run by "auto" goes over to where stiffness limits the steps."""
NONSTIFF_METHOD = "explicit-rk"
"""What reaches the smallest errors where nothing is stiff."""


@cache
def _makers() -> dict[str, Callable[[DynamicsSpec], Method]]:
    """What makes each method for a scene, by name: the tables `METHODS` of all files."""
    modules = [
        import_module(f"{integrators.__name__}.{file.name}")
        for file in iter_modules(integrators.__path__)
    ]
    return {
        name: maker for module in modules for name, maker in getattr(module, "METHODS", {}).items()
    }


def method_name(spec: DynamicsSpec, implicit: str = "") -> str:
    """The integrator that a run begins with; `implicit`: why explicit ones are none for it."""
    if spec.method != AUTO:
        return spec.method
    if spec.step is not None:
        return "generalized-alpha"
    return STIFF_METHOD if implicit else NONSTIFF_METHOD


def reason_of_method(spec: DynamicsSpec, name: str, implicit: str) -> str:
    """Why `method = "auto"` has chosen it; nothing where the scene names its method."""
    if spec.method != AUTO:
        return ""
    if spec.step is not None:
        return "fixed steps"
    if name != STIFF_METHOD:
        return "nothing stiff"
    return implicit or "stability limits the steps of explicit-rk"


def make_integrator(spec: DynamicsSpec, name: str | None = None) -> Method:
    """The integrator of a name, by default that of `dynamics.method`, for a scene."""
    return _makers()[name or method_name(spec)](spec)
