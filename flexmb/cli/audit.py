"""`flexmb audit`: what each effect contributes to the sensors of a run."""

from __future__ import annotations

from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import FAILED_CHECK, RunFile, command


@command()
def audit(
    result: RunFile,
    budget: Annotated[
        float | None,
        typer.Option(
            help="Largest share of a sensor's peak-to-peak that an effect which is left out may "
            "contribute; that of the scene, or 0.01, by default.",
            min=0.0,
            show_default=False,
        ),
    ] = None,
) -> None:
    """Show what each effect contributes to the sensors of a finished run, on or left out.

    Deformation, vibration, geometric stiffening, further modes, damping, gravity, friction: the
    scene with the effect switched is linearised about the computed motion and driven by what that
    motion leaves out of balance in it. The table is kept in the result. Exit code 3 if an effect
    that is left out contributes more than the budget.

    Example: flexmb audit out/slider_crank --budget 0.001
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        made = workflow.audit(result, budget=budget, progress=progress)
    show_audit(made)
    if not made.passed:
        raise typer.Exit(FAILED_CHECK)


def show_audit(made: object) -> None:
    """Show the table of an audit, its notes and its outcome."""
    from flexmb.workflow.audit import Audit

    assert isinstance(made, Audit)
    screen.heading(f"{made.title}: effects")
    columns, rows = made.table()
    screen.table(columns, rows, right=(4, 7), whole=True)
    for note in made.notes:
        screen.line(f"note: {note}")
    screen.line(made.sentence())
