"""Running a scene or a model: flexible bodies, system, analysis, files, pictures.

An analysis of a scene is a section of it that says how to run it: ``[dynamics]``, ``[kinematics]``.
"""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import FlexmbWarning, SceneError, SolverError
from flexmb.folders import output_folder, writable_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.flexible_bodies import flexible_bodies
from flexmb.workflow.resume import StartState, match_start
from flexmb.workflow.run_report import PROVENANCE, RunReport, provenance_text, report_run

if TYPE_CHECKING:
    from flexmb.analysis.procedure import Outcome, Sink
    from flexmb.engine.compile import Compiled
    from flexmb.model import Model
    from flexmb.results import Result

ANALYSES = ("dynamics", "kinematics")


@dataclass(frozen=True)
class Task:
    """An analysis that is ready to run into a sink of rows."""

    analysis: str
    rows: int
    run: Callable[[Sink], Outcome]
    notes: tuple[str, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)  # for the result

    def scene(self, scene: dict[str, Any]) -> dict[str, Any]:
        """The scene for the result: without the sections of other analyses."""
        return {k: v for k, v in scene.items() if k == self.analysis or k not in ANALYSES}


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
        Reduce meshes again even if an equal reduction is there.
    pictures : bool
        Whether to draw the picture and the history.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message; results until a failure are kept.
    """
    from flexmb.model import load_scene

    return run_model(
        load_scene(Path(path), dict(overrides or {})),
        output_folder(path) if output is None else output,
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
    from flexmb.model.scenes.effects import active_model
    from flexmb.results import Result, ResultWriter

    model.validate()
    scene_model, model = model, active_model(model)
    analysis = select_analysis(model, analysis, start_from is not None)
    folder = writable_folder(Path(output))
    started = time.perf_counter()
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    names = {name: file.name for name, file in files.items()}
    scene = scene_model.to_scene_dict(folder, names)
    notes += _row_size_note(compiled, scene)
    start = match_start(model, compiled, bodies, start_from) if start_from is not None else None
    task = prepare_task(analysis, compiled, model, start, progress)
    texts = {"scene": model.source.text} if model.source is not None else {}
    texts |= task.texts
    texts[PROVENANCE] = provenance_text(model, folder, bodies, start.source if start else None)
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
    report = report_run(
        model, Result(writer.path), outcome, notes, pictures=pictures, progress=progress
    )
    return replace(report, resumable=analysis == "dynamics")


def select_analysis(model: Model, name: str | None, starts_from_result: bool = False) -> str:
    """The analysis of this name, or that of the only section of the scene.

    Raises
    ------
    SceneError
        Unknown, not in the scene, or without a name though the scene has both.
    """
    available = [section for section in ANALYSES if getattr(model, section) is not None]
    if name is not None and name not in ANALYSES:
        raise SceneError.unknown_name("analysis", name, ANALYSES)
    if not available and name is None:
        raise SceneError("the scene has no [dynamics] and no [kinematics]: give its duration")
    if name is not None and name not in available:
        raise SceneError(f"the scene has no [{name}]: give its duration")
    if name is None and len(available) > 1:
        raise SceneError(
            "the scene has [dynamics] and [kinematics]: say which one to run (--analysis dynamics "
            "or --analysis kinematics)"
        )
    selected = name or available[0]
    if selected == "kinematics" and starts_from_result:
        raise SceneError(
            "a kinematic analysis begins where its drivers say, not where another run ended: "
            "remove --from, or guess joint coordinates (assembly.guess)"
        )
    return selected


def prepare_task(
    analysis: str, compiled: Compiled, model: Model, start: StartState | None, progress: Progress
) -> Task:
    """Load compiled units and find the first state of an analysis.

    Parameters
    ----------
    analysis : str
        From `select_analysis`.
    compiled, model : Compiled, Model
        The model and its compiled system.
    start : StartState, optional
        The end of another run, to begin there.
    progress : Progress
        Called for every phase.
    """
    from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
    from flexmb.analysis.kinematics import prepare_kinematics, run_kinematics
    from flexmb.results import DAMPING, damping_text

    if analysis == "kinematics":
        ready = prepare_kinematics(compiled, model, progress=progress)
        return Task(
            analysis, ready.points, lambda sink: run_kinematics(ready, sink, progress=progress)
        )
    begin = start.begin if start is not None else None
    prepared = prepare_dynamics(compiled, model, begin=begin, progress=progress)
    notes: tuple[str, ...] = ()
    if start is not None:
        notes = (*start.notes, *start.changes(compiled, prepared.run.state, model.units))
    assert model.dynamics is not None  # it is prepared
    return Task(
        analysis,
        model.dynamics.n_rows,
        lambda sink: run_dynamics(prepared, sink, progress=progress),
        notes,
        {DAMPING: damping_text(prepared.dampings)} if prepared.dampings else {},
    )


def _row_size_note(compiled: Compiled, scene: Mapping[str, Any]) -> list[str]:
    """A note where a scene stores part of the results; its mistakes before anything is run."""
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
        Folder of the files. By default a temporary one, which is removed with the last `Result` of
        it: `Result.save` copies it.
    start_from : Result or path, optional
        Another run whose last row this one begins with, bodies matched by name, at time 0.
    progress : Progress
        Called for every phase.
    **dynamics
        Fields of `[dynamics]`, such as `duration=0.1, step=1e-4`, in the model's units.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message.
    """
    from flexmb.model.scenes.dynamics import INSTEAD, drop_idle_options

    if dynamics:
        spec = model.dynamics
        fields = {} if spec is None else spec.model_dump(context=model.context)
        for new in dynamics:
            fields.pop(INSTEAD.get(new, ""), None)
        model = copy.copy(model)
        fields |= dynamics
        drop_idle_options(fields, dynamics)
        model.set_dynamics(**fields)
    return _run_and_open(model, "dynamics", output, start_from, progress)


def kinematics(
    model: Model,
    *,
    output: str | Path | None = None,
    progress: Progress = silent,
    **fields: Any,
) -> Result:
    """Find the motion that the joints and drivers of a model fix, and open its result.

    Positions, velocities, accelerations at each output, exact to round-off, and the reactions and
    driving forces of that motion (inverse dynamics). Flexible bodies stay undeformed.

    Parameters
    ----------
    model : Model
        The model.
    output : path, optional
        Folder of the files; as in :func:`simulate`.
    progress : Progress
        Called for every phase.
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
        present = {} if spec is None else spec.model_dump(context=model.context)
        model = copy.copy(model)
        model.set_kinematics(**{**present, **fields})
    return _run_and_open(model, "kinematics", output, None, progress)


def _run_and_open(
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
