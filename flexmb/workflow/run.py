"""Running a scene or a model: bodies, system, integration, files, pictures."""

from __future__ import annotations

import copy
import math
import tempfile
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbWarning, OutputError, SceneError, SolverError
from flexmb.progress import Progress, silent
from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.place import output_folder
from flexmb.workflow.reports import CheckOutcome, RunReport

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["run_model", "run_scene", "simulate"]


def run_scene(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a scene file from mesh to picture.

    Parameters
    ----------
    path : path
        The scene.
    output : path, optional
        Folder of the results; `out/<name of the scene's folder>` by default.
    overrides : mapping of str to str, optional
        Parameters or knobs to change, such as `{"r": "0.1", "dynamics.step": "1e-4"}`.
    fresh : bool
        Reduce meshes anew even if an equal reduction is there.
    pictures : bool
        Whether to draw the picture and the history.
    progress : Progress
        Told every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; results until a failure are kept.
    """
    from flexmb.model import load_scene

    path = Path(path)
    model = load_scene(path, dict(overrides or {}))
    if output is None:
        output = output_folder(path)
    return run_model(model, output, fresh=fresh, pictures=pictures, progress=progress)


def run_model(
    model: Model,
    output: str | Path,
    *,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a model from mesh to picture; see :func:`run_scene`."""
    from flexmb.analysis.dynamics import integrate, prepare
    from flexmb.engine.compile import compile_system
    from flexmb.results import Result, ResultWriter

    model.validate()
    if model.dynamics is None:
        raise SceneError("the scene has no [dynamics]: give duration and step")
    folder = _writable(Path(output))
    started = time.perf_counter()
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    prepared = prepare(compiled, model, progress=progress)
    result = folder / "result.h5"
    scene = model.to_scene_dict(folder, {name: file.name for name, file in files.items()})
    texts = {"scene": model.source.text} if model.source else {}
    names = {name: file.name for name, file in files.items()}
    rows = model.dynamics.outputs + 1
    with ResultWriter(
        result, compiled.layout, rows, scene=scene, flexbodies=names, texts=texts
    ) as writer:
        outcome = integrate(prepared, writer, progress=progress)
        statistics = {**outcome.statistics, "seconds_flexible_bodies": reduced - started}
        writer.finish(statistics, outcome.status, outcome.message)
    notes += outcome.notes
    if outcome.message:
        notes.append(outcome.message)
    run = Result(result)
    picture, history = _draw(model, run, folder, progress) if pictures else (None, None)
    if outcome.status == "failed":
        kept = f"{result} keeps the {len(run.time)} outputs until then"
        raise SolverError(f"{outcome.message}; {kept}")
    return RunReport(
        folder,
        result,
        files,
        picture,
        history,
        statistics,
        notes,
        _checks(model, run),
    )


def simulate(
    model: Model,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **dynamics: Any,
) -> Result:
    """Run a model and open its result.

    Parameters
    ----------
    model : Model
        The model.
    output : path, optional
        Folder to keep the files in; a temporary one by default.
    progress : Progress
        Told every phase.
    **dynamics
        Fields of `[dynamics]`, such as `duration=0.1, step=1e-4`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.results import Result

    if dynamics:
        spec = model.dynamics
        given = {} if spec is None else spec.model_dump(context=model.terms)
        model = copy.copy(model)
        model.set_dynamics(**{**given, **dynamics})
    folder = Path(output) if output is not None else Path(tempfile.mkdtemp(prefix="flexmb-"))
    report = run_model(model, folder, pictures=False, progress=progress)
    unit = model.units.label("s")
    failed = [
        f"check of {c.sensor} at {c.time:g} {unit} failed: {c.value:.12g}, not {c.expected:.12g} "
        f"within {c.tolerance:g} ({c.source})"
        for c in report.checks
        if not c.passed
    ]
    for note in [*report.notes, *failed]:
        warnings.warn(note, FlexmbWarning, stacklevel=2)
    return Result(report.result)


def _writable(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        files = [path for path in (folder, *folder.parents) if path.is_file()]
        why = f"{files[0]} is a file" if files else error.strerror
        raise OutputError(f"cannot write to the output folder {folder}: {why}") from None


def _draw(
    model: Model, run: Result, folder: Path, progress: Progress
) -> tuple[Path | None, Path | None]:
    """Picture and history of a run that has at least one output."""
    from flexmb.view import plot_history, render

    if not len(run.time):
        return None, None
    progress("picture", 0.0)
    picture = render(run, output=folder / "picture.png")
    progress("picture", 1.0)
    history = None
    if model.channels():
        progress("history", 0.0)
        history = plot_history(run, output=folder / "history.png")
        progress("history", 1.0)
    return picture, history


def _checks(model: Model, run: Result) -> list[CheckOutcome]:
    """The scene's known answers at their times, by interpolation between outputs.

    A check after the end of a stopped run has the value NaN, and fails.
    """
    outcomes = []
    for check in model.checks:
        unit = model.channel_unit(check.sensor) or ""
        expected = model.units.written(check.value, unit)
        tolerance = model.units.written(check.tolerance, unit)
        time = model.units.written(check.time, "s")
        reached = len(run.time) and time <= run.time[-1] * (1 + 1e-9) + 1e-12
        value = float(np.interp(time, run.time, run[check.sensor])) if reached else math.nan
        outcomes.append(CheckOutcome(check.sensor, time, value, expected, tolerance, check.source))
    return outcomes
