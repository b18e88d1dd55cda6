"""The end of every run: notes, pictures, known answers, one report."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import SolverError
from flexmb.progress import Progress
from flexmb.workflow.frequencies import frequency_outcomes
from flexmb.workflow.reports import CheckOutcome, RunReport

if TYPE_CHECKING:
    from flexmb.analysis.dynamics.analysis import Outcome
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["finish"]


def finish(
    model: Model,
    run: Result,
    outcome: Outcome,
    notes: list[str],
    *,
    pictures: bool,
    progress: Progress,
) -> RunReport:
    """Draw what there is of a run and compare it with the known answers of its scene.

    Raises
    ------
    SolverError
        The run failed; it is drawn all the same.
    """
    folder = run.path.parent
    told = [*notes, *outcome.notes, *([outcome.message] if outcome.message else [])]
    picture, history = _draw(run, folder, progress) if pictures else (None, None)
    if pictures and len(run.time) and not run.has_columns("q"):
        told.append('no picture: not all poses were kept (keep = ["poses"] in [results])')
    if outcome.status == "failed":
        kept = f"{run.path} keeps the {len(run.time)} outputs until then"
        raise SolverError(f"{outcome.message}; {kept}")
    return RunReport(
        folder,
        run.path,
        run.flexbodies,
        picture,
        history,
        dict(run.statistics),
        told,
        [*_checks(model, run), *frequency_outcomes(model, _bodies(model, run))],
    )


def _bodies(model: Model, run: Result) -> dict[str, FlexBody]:
    """The bodies whose natural frequencies are to be compared."""
    from flexmb.flexbody import load

    return {check.body: load(run.flexbodies[check.body]) for check in model.frequency_checks}


def _draw(run: Result, folder: Path, progress: Progress) -> tuple[Path | None, Path | None]:
    """Picture and history of a run that has at least one output, of what it kept."""
    from flexmb.view import plot_history, render

    if not len(run.time):
        return None, None
    picture = history = None
    if run.has_columns("q"):
        progress("picture", 0.0)
        picture = render(run, output=folder / "picture.png")
        progress("picture", 1.0)
    if run.channels():
        progress("history", 0.0)
        history = plot_history(run, output=folder / "history.png")
        progress("history", 1.0)
    return picture, history


def _checks(model: Model, run: Result) -> list[CheckOutcome]:
    """The scene's known answers at their times, by interpolation between outputs.

    A check that a run did not reach has the value NaN, and fails; of a run that the user stopped
    it is left out.
    """
    outcomes = []
    for check in model.checks:
        unit = model.channel_unit(check.sensor) or ""
        expected = model.units.written(check.value, unit)
        tolerance = model.units.written(check.tolerance, unit)
        time = model.units.written(check.time, "s")
        reached = len(run.time) and time <= run.time[-1] * (1 + 1e-9) + 1e-12
        if not reached and run.status == "stopped":
            continue
        value = float(np.interp(time, run.time, run[check.sensor])) if reached else math.nan
        outcomes.append(CheckOutcome(check.sensor, time, value, expected, tolerance, check.source))
    return outcomes
