"""Running a scene or a model: bodies, system, integration, files, pictures."""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import FlexmbWarning, SceneError, SolverError
from flexmb.progress import Progress, silent
from flexmb.workflow.begin import beginning
from flexmb.workflow.bodies import flexible_bodies
from flexmb.workflow.finish import finish
from flexmb.workflow.origin import ORIGIN, origin_text
from flexmb.workflow.place import output_folder, writable_folder
from flexmb.workflow.reports import RunReport

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["run_model", "run_scene", "simulate"]


def run_scene(
    path: str | Path,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
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
        start_from=start_from,
        fresh=fresh,
        pictures=pictures,
        progress=progress,
    )


def run_model(
    model: Model,
    output: str | Path,
    *,
    start_from: Result | str | Path | None = None,
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
        raise SceneError("the scene has no [dynamics]: give its duration")
    folder = writable_folder(Path(output))
    started = time.perf_counter()
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    other = beginning(model, compiled, bodies, start_from) if start_from is not None else None
    prepared = prepare(
        compiled, model, begin=other.begin if other is not None else None, progress=progress
    )
    if other is not None:
        notes += [*other.notes, *other.changes(compiled, prepared.run.state, model.units)]
    names = {name: file.name for name, file in files.items()}
    texts = {"scene": model.source.text} if model.source is not None else {}
    texts[ORIGIN] = origin_text(model, folder, bodies, other.source if other is not None else None)
    with ResultWriter(
        folder / "result.h5",
        compiled.layout,
        model.dynamics.outputs + 1,
        scene=model.to_scene_dict(folder, names),
        flexbodies=names,
        texts=texts,
    ) as writer:
        outcome = integrate(prepared, writer, progress=progress)
        seconds = {"seconds_flexible_bodies": reduced - started} if bodies else {}
        writer.finish({**outcome.statistics, **seconds}, outcome.status, outcome.message)
    return finish(model, Result(writer.path), outcome, notes, pictures=pictures, progress=progress)


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
    from flexmb.model.dynamics import INSTEAD
    from flexmb.results import Result
    from flexmb.results.scratch import Scratch

    if dynamics:
        spec = model.dynamics
        given = {} if spec is None else spec.model_dump(context=model.terms)
        for new in dynamics:
            given.pop(INSTEAD.get(new, ""), None)
        model = copy.copy(model)
        model.set_dynamics(**{**given, **dynamics})
    scratch = None if output is not None else Scratch()
    folder = scratch.path if scratch is not None else Path(output or ".")
    try:
        report = run_model(model, folder, start_from=start_from, pictures=False, progress=progress)
    except SolverError:  # its sentence says where the rows until then are
        if scratch is not None:
            scratch.keep_until_the_end()
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
