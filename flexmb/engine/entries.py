"""What Python asks of compiled code: single solves, chunks of the time loop."""

from __future__ import annotations

from flexmb.engine import initial_conditions, march
from flexmb.engine.initial_conditions import (
    ACCELERATIONS,
    BEGIN,
    POSITIONS,
    REMEMBER,
    RESIDUAL,
    VELOCITIES,
)
from flexmb.engine.state import Run, State, Work
from flexmb.engine.tables import System
from flexmb.engine.units import call
from flexmb.engine.work import new_run

__all__ = [
    "ACCELERATIONS", "BEGIN", "POSITIONS", "REMEMBER", "RESIDUAL", "VELOCITIES",
    "integrate", "solve_level",
]  # fmt: skip


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


def integrate(run: Run, n_steps: int) -> int:
    """Run n_steps, or until the end or until `run.output` is full; returns the status."""
    return int(call(march.march, run, n_steps))
