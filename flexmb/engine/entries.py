"""What Python asks of compiled code: single solves, chunks of the time loop."""

from __future__ import annotations

from flexmb.engine import initial_conditions, kinematics_loop, march
from flexmb.engine.initial_conditions import (
    ACCELERATIONS,
    BEGIN,
    POSITIONS,
    REMEMBER,
    RESIDUAL,
    VELOCITIES,
)
from flexmb.engine.jit import UNITS, Unit
from flexmb.engine.kinematics_loop import CORRECT, EVALUATE, POINTS
from flexmb.engine.kinematics_state import KinematicsSettings, Path
from flexmb.engine.method import Method
from flexmb.engine.records import units_in
from flexmb.engine.state import Run, State, Work
from flexmb.engine.tables import System
from flexmb.engine.units import call, prepare_units
from flexmb.engine.work import new_run, stages_of
from flexmb.progress import Progress, silent

__all__ = [
    "all_units",
    "ACCELERATIONS", "BEGIN", "CORRECT", "EVALUATE", "POINTS", "POSITIONS", "REMEMBER", "RESIDUAL",
    "VELOCITIES", "analyse_kinematics", "integrate", "prepare_integration", "prepare_kinematics",
    "solve_level",
]  # fmt: skip


def all_units() -> tuple[Unit, ...]:
    """All units there are, of all kinds and methods."""
    import flexmb.engine.integrators  # noqa: F401  the registry of methods imports their units

    return tuple(UNITS[name] for name in sorted(UNITS))


def solve_level(system: System, state: State, work: Work, level: int) -> float:
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
    units = [march.march, initial_conditions.solve_stage, *units_in(stages_of(system))]
    return prepare_units([*units, *units_in(method)], progress)


def integrate(run: Run, n_steps: int) -> int:
    """Run n_steps, or until the end or until `run.output` is full; returns the status."""
    return int(call(march.march, run, n_steps))


def prepare_kinematics(system: System, progress: Progress = silent) -> int:
    """Load all units of a kinematic analysis; as `prepare_integration`."""
    units = [kinematics_loop.kinematics_loop, *units_in(stages_of(system))]
    return prepare_units(units, progress)


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
    return float(call(kinematics_loop.kinematics_loop, run, path, settings, what, n))
