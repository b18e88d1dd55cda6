"""Calls of compiled code from Python: single solves, chunks of the time loop, kinematics."""

from __future__ import annotations

from collections.abc import Callable

from flexmb.engine import initial_conditions, state_rows, time_loop
from flexmb.engine.allocation import new_run, output_run
from flexmb.engine.compiled_units import (
    call,
    caller_without_compiling,
    packed_record,
    prepare_units,
)
from flexmb.engine.function import run_program
from flexmb.engine.jit import UNITS, CompiledUnit, Packed, units_in
from flexmb.engine.kinematics_loop import kinematics_loop
from flexmb.engine.kinematics_point import KinematicsSettings, Path
from flexmb.engine.method import Method
from flexmb.engine.method_selection import method_makers
from flexmb.engine.stage_tables import units_of
from flexmb.engine.state import Run, Stage, Stages, State, Work
from flexmb.engine.tables import System
from flexmb.progress import Progress, silent


def all_units() -> tuple[CompiledUnit, ...]:
    """All units of the engine, of all kinds and methods."""
    method_makers()  # imports the methods
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
        REMEMBER: the history of the elements begins at this state, taken as at rest. BEGIN: works
        and joint angles begin at this state.
    """
    return float(call(initial_conditions.solve_stage, new_run(system, state, work), level))


def stage_solver(system: System, state: State, work: Work) -> Callable[[int], float]:
    """`solve_stage` for many calls: the tables are packed once."""
    run = packed_record(new_run(system, state, work))
    return lambda level: float(call(initial_conditions.solve_stage, run, level))


def row_evaluator(system: System, state: State, work: Work) -> Callable[[], None]:
    """A function that puts markers, C and Cq (Dense.jac) at the positions of a state into `work`.

    Nothing is compiled for it: if units are missing, all run as plain Python.
    """
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
        Receives the phase `compile`, or `load` if all units are in the cache.

    Raises
    ------
    CompilationError
        A unit does not compile on this machine.
    """
    return prepare_units(integration_units(system, method), progress)


def integration_units(system: System, method: Method) -> list[CompiledUnit]:
    """The units that a run calls, by name or through its tables."""
    units = [
        time_loop.integrate_steps,
        initial_conditions.solve_stage,
        initial_conditions.evaluate_rows,
    ]
    units.append(run_program)  # nearly all scenes have functions
    return [*units, *units_of(system), *units_in(method)]


def integrate(run: Run | Packed, n_steps: int, aside: Run | Packed | None = None) -> int:
    """Run n_steps, or until the end or until `run.output` is full; returns the status.

    Parameters
    ----------
    run : Run
        The run.
    n_steps : int
        Largest number of steps; 0 writes the outputs that are due.
    aside : Run, optional
        The result of `output_run`, which should be made once for many calls.
    """
    if aside is None:
        aside = output_run(run.record if isinstance(run, Packed) else run)
    return int(call(time_loop.integrate_steps, run, aside, n_steps))


def statics_units(system: System) -> list[CompiledUnit]:
    """The units that a search for an equilibrium calls, by name or through its tables."""
    units = [initial_conditions.solve_stage, initial_conditions.evaluate_equations]
    return [*units, state_rows.write_equilibrium, *units_of(system)]


def kinematics_units(system: System) -> list[CompiledUnit]:
    """The units that a kinematic analysis calls, by name or through its tables."""
    units = [kinematics_loop, initial_conditions.evaluate_rows]
    return [*units, *units_of(system)]


def analyse_kinematics(
    run: Run, path: Path, settings: KinematicsSettings, what: int, n: int = 0
) -> float:
    """Compute points of a kinematic analysis, or evaluate and correct its first pose.

    Parameters
    ----------
    run, path, settings : Run, Path, KinematicsSettings
        The run, the memory of the analysis, and its settings.
    what : int
        POINTS: the next n output points, into `run.output`; returns the status. EVALUATE: C, Cq,
        markers and rates at the state, in place; returns 0. CORRECT: the same, and one
        Gauss–Newton correction of q with least change; returns its weighted size.
    n : int
        Number of points.
    """
    return float(call(kinematics_loop, run, path, settings, what, n))
