"""Running a scene or a model: bodies, system, analysis, files, pictures."""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import FlexmbWarning, SolverError
from flexmb.progress import Progress, silent
from flexmb.workflow.begin import beginning
from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.finish import finish
from flexmb.workflow.origin import ORIGIN, origin_text
from flexmb.workflow.place import output_folder, writable_folder
from flexmb.workflow.reports import RunReport
from flexmb.workflow.task import chosen_analysis, prepared_task

if TYPE_CHECKING:
    from flexmb.engine.compile import Compiled
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["kinematics", "run_model", "run_scene", "simulate"]


def run_scene(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    analysis: str | None = None,
    start_from: Result | str | Path | None = None,
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
    analysis : {"dynamics", "kinematics"}, optional
        Which one; that of the scene's section, if it has one of them only.
    start_from : Result or path, optional
        Another run whose last row this one begins with, bodies matched by name, at time 0.
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
    return run_model(
        model,
        output,
        analysis=analysis,
        start_from=start_from,
        fresh=fresh,
        pictures=pictures,
        progress=progress,
    )


def run_model(
    model: Model,
    output: str | Path,
    *,
    analysis: str | None = None,
    start_from: Result | str | Path | None = None,
    fresh: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a model from mesh to picture; see :func:`run_scene`."""
    from flexmb.engine.compile import compile_system
    from flexmb.results import Result, ResultWriter

    model.validate()
    chosen = chosen_analysis(model, analysis, start_from is not None)
    folder = writable_folder(Path(output))
    started = time.perf_counter()
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    names = {name: file.name for name, file in files.items()}
    scene = model.to_scene_dict(folder, names)
    notes += _stored_part(compiled, scene)
    other = beginning(model, compiled, bodies, start_from) if start_from is not None else None
    task = prepared_task(chosen, compiled, model, other, progress)
    texts = {"scene": model.source.text} if model.source is not None else {}
    texts[ORIGIN] = origin_text(model, folder, bodies, other.source if other is not None else None)
    with ResultWriter(
        folder / "result.h5",
        compiled.layout,
        task.rows,
        scene=task.scene(scene),
        flexbodies=names,
        texts=texts,
    ) as writer:
        outcome = task.run(writer)
        seconds = {"seconds_flexible_bodies": reduced - started} if bodies else {}
        writer.finish({**outcome.statistics, **seconds}, outcome.status, outcome.message)
    notes += task.notes
    report = finish(
        model, Result(writer.path), outcome, notes, pictures=pictures, progress=progress
    )
    return replace(report, resumable=chosen == "dynamics")


def _stored_part(compiled: Compiled, scene: Mapping[str, Any]) -> list[str]:
    """A note where a scene keeps part of the results; its mistakes before anything is run."""
    from flexmb.results import Columns, row_bytes, stored_columns

    if not scene.get("results", {}).get("keep"):
        return []
    columns = Columns.of(compiled.layout)
    stored, whole = (row_bytes(stored_columns(columns, s)) for s in (scene, {}))
    return [f"[results] keeps {stored} of {whole} bytes of each row"]


def simulate(
    model: Model,
    *,
    output: str | Path | None = None,
    start_from: Result | str | Path | None = None,
    progress: Progress = silent,
    **dynamics: Any,
) -> Result:
    """Run a model and open its result.

    Parameters
    ----------
    model : Model
        The model.
    output : path, optional
        Folder to keep the files in. By default a temporary one, which is removed with the last
        `Result` of it: `Result.save` keeps it.
    start_from : Result or path, optional
        Another run whose last row this one begins with, bodies matched by name, at time 0.
    progress : Progress
        Told every phase.
    **dynamics
        Fields of `[dynamics]`, such as `duration=0.1, step=1e-4`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.model.tasks.dynamics import INSTEAD, drop_idle_options

    if dynamics:
        spec = model.dynamics
        given = {} if spec is None else spec.model_dump(context=model.terms)
        for new in dynamics:
            given.pop(INSTEAD.get(new, ""), None)
        model = copy.copy(model)
        fields = {**given, **dynamics}
        drop_idle_options(fields, dynamics)
        model.set_dynamics(**fields)
    return _opened(model, "dynamics", output, start_from, progress)


def kinematics(
    model: Model,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **fields: Any,
) -> Result:
    """Find the motion that the joints and drivers of a model fix, and open its result.

    Positions, velocities, accelerations at each output, exact to round-off, and the reactions and
    driving forces of that motion (inverse dynamics). Flexible bodies are held undeformed.

    Parameters
    ----------
    model : Model
        The model.
    output : path, optional
        Folder to keep the files in; as in :func:`simulate`.
    progress : Progress
        Told every phase.
    **fields
        Fields of `[kinematics]`, such as `duration=1.0, outputs=400`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message: motions without driver, drivers that contradict each
        other, singular poses.
    """
    if fields:
        spec = model.kinematics
        given = {} if spec is None else spec.model_dump(context=model.terms)
        model = copy.copy(model)
        model.set_kinematics(**{**given, **fields})
    return _opened(model, "kinematics", output, None, progress)


def _opened(
    model: Model,
    analysis: str,
    output: str | Path | None,
    start_from: Result | str | Path | None,
    progress: Progress,
) -> Result:
    """Run a model without pictures and open its result; notes become warnings."""
    from flexmb.results import Result
    from flexmb.results.reader import TemporaryFolder

    scratch = None if output is not None else TemporaryFolder()
    folder = scratch.path if scratch is not None else Path(output or ".")
    try:
        report = run_model(
            model, folder, analysis=analysis, start_from=start_from, pictures=False,
            progress=progress,
        )  # fmt: skip
    except SolverError:  # its sentence says where the rows until then are
        if scratch is not None:
            scratch.preserve()
        raise
    unit = model.units.label("s")
    failed = [
        f"check of {c.place(unit)} failed: {c.value:.12g}, not {c.expected:.12g} "
        f"within {c.tolerance:g} ({c.source})"
        for c in report.checks
        if not c.passed
    ]
    for note in [*report.notes, *failed]:
        warnings.warn(note, FlexmbWarning, stacklevel=2)
    return Result(report.result)
