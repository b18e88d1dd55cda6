"""Running a scene or a model: flexible bodies, system, analysis, files, pictures.

The analysis of a scene is one of its sections ``[dynamics]``, ``[kinematics]``, ``[statics]``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import SceneError
from flexmb.folders import scratch_folder, writable_folder
from flexmb.progress import Progress, silent
from flexmb.results.run_summary import NOT_CONTAINED, notes_statistic
from flexmb.workflow.flexible_bodies import flexible_bodies
from flexmb.workflow.resume import StartState, match_start
from flexmb.workflow.run_report import (
    PROVENANCE,
    RunReport,
    not_contained,
    provenance_text,
    report_run,
)

if TYPE_CHECKING:
    from flexmb.analysis.chunked_run import Outcome, Sink
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

ANALYSES = ("dynamics", "kinematics", "statics")


@dataclass(frozen=True)
class Task:
    """An analysis that is ready to run, with its number of rows."""

    analysis: str
    rows: int
    run: Callable[[Sink], Outcome]
    notes: tuple[str, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)  # texts stored with the result

    def scene(self, scene: dict[str, Any]) -> dict[str, Any]:
        """The scene to be stored with the result: without the sections of other analyses."""
        return {k: v for k, v in scene.items() if k == self.analysis or k not in ANALYSES}


def run_single(
    model: Model,
    output: str | Path,
    *,
    analysis: str | None = None,
    start_from: Result | str | Path | None = None,
    fresh: bool = False,
    pictures: bool = True,
    is_judged: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Run a model with the effects that it states, from mesh to picture; see `run_scene`.

    Without `is_judged` nobody examines whether its motion is valid, and no bound ends it.
    """
    from flexmb.engine.compile import compile_system
    from flexmb.model.scenes.effects import active_model
    from flexmb.results import Result
    from flexmb.results.writer import ResultWriter

    model.validate()
    scene_model, model = model, active_model(model)
    analysis = select_analysis(model, analysis, start_from is not None)
    folder = writable_folder(Path(output))
    started = time.perf_counter()
    band_notes: list[str] = []
    if analysis == "dynamics" and start_from is None:
        scene_model, band_notes = _with_motion_band(scene_model, progress)
        model = active_model(scene_model)
    bodies, files, notes = flexible_bodies(model, folder, fresh=fresh, progress=progress)
    notes += band_notes + _effect_notes(model, bodies)
    reduced = time.perf_counter()
    compiled = compile_system(model, bodies)
    names = {name: file.name for name, file in files.items()}
    scene = scene_model.to_scene_dict(folder, names)
    notes += _row_size_note(compiled, scene)
    start = match_start(model, compiled, bodies, start_from) if start_from is not None else None
    task = prepare_task(analysis, compiled, model, start, progress, is_judged=is_judged)
    texts = {"scene": model.source.text} if model.source is not None else {}
    texts |= task.texts
    missing = {NOT_CONTAINED: lack} if (lack := not_contained(model, bodies)) else {}
    texts |= missing
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
        words = notes_statistic([*notes, *task.notes, *outcome.notes]) | missing
        writer.finish({**outcome.statistics, **seconds, **words}, outcome.status, outcome.message)
    notes += task.notes
    result = Result(writer.path)
    report = report_run(
        model, result, outcome, notes, pictures=pictures, progress=progress, analysis=analysis
    )
    if model.mode_checks and model.source is not None:
        from flexmb.workflow.linearize import check_modes

        report = replace(report, checks=[*report.checks, *check_modes(model, folder)])
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
    if not available and name is None and model.part is not None:
        raise SceneError("the scene has a part by itself and no motion: flexmb part solves it")
    if not available and name is None:
        raise SceneError(
            "the scene has no [dynamics] and no [kinematics]: give its duration, or [statics] for "
            "an equilibrium"
        )
    if name not in (None, "statics", *available):
        raise SceneError(f"the scene has no [{name}]: give its duration")
    if name is None and len(available) > 1:
        sections, words = (
            " and ".join(f"[{one}]" for one in available),
            " or ".join(f"--analysis {one}" for one in available),
        )
        raise SceneError(f"the scene has {sections}: say which one to run ({words})")
    selected = name or available[0]
    if selected == "statics" and starts_from_result:
        raise SceneError("statics begins where the scene places the bodies: remove --from")
    if selected == "kinematics" and starts_from_result:
        raise SceneError(
            "a kinematic analysis begins where its drivers say, not where another run ended: "
            "remove --from, or guess joint coordinates (assembly.guess)"
        )
    return selected


def prepare_task(
    analysis: str, compiled: Compiled, model: Model, start: StartState | None, progress: Progress,
    *, is_judged: bool = True,
) -> Task:  # fmt: skip
    """Load the compiled units and compute the initial state of an analysis.

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
    if analysis == "kinematics":
        from flexmb.analysis.kinematics import prepare_kinematics, run_kinematics

        ready = prepare_kinematics(compiled, model, progress=progress)
        return Task(
            analysis, ready.points, lambda sink: run_kinematics(ready, sink, progress=progress)
        )
    if analysis == "statics":
        from flexmb.analysis.statics import prepare_statics, run_statics

        at_rest = prepare_statics(compiled, model, progress=progress)
        return Task(
            analysis, len(at_rest.times), lambda sink: run_statics(at_rest, sink, progress=progress)
        )
    from flexmb.analysis.dynamics.dynamics import prepare_dynamics, run_dynamics
    from flexmb.results.reader import DAMPING, damping_text

    begin = start.begin if start is not None else None
    prepared = prepare_dynamics(compiled, model, begin=begin, progress=progress)
    notes: tuple[str, ...] = ()
    if start is not None:
        notes = (*start.notes, *start.changes(compiled, prepared.run.state, model.units))
    assert model.dynamics is not None  # it is prepared
    return Task(
        analysis,
        model.dynamics.n_rows,
        lambda sink: run_dynamics(prepared, sink, progress=progress, is_judged=is_judged),
        notes,
        {DAMPING: damping_text(prepared.dampings)} if prepared.dampings else {},
    )


def _with_motion_band(model: Model, progress: Progress) -> tuple[Model, list[str]]:
    """Replace "automatic" deformation by bands of modes from the frequencies of a rigid run."""
    if all(getattr(spec, "deformation", "") != "automatic" for spec in model.bodies.values()):
        return model, []

    from flexmb.results import Result
    from flexmb.workflow.motion_band import with_motion_band

    with scratch_folder() as folder:
        return with_motion_band(model, lambda rigid: Result(
            run_single(rigid, folder, pictures=False, progress=progress).result
        ))  # fmt: skip


def _effect_notes(model: Model, bodies: Mapping[str, FlexBody]) -> list[str]:
    """Notes on flexible bodies without modes, and on stated effects of the others."""
    from flexmb.model.excitation import cutoff_frequency
    from flexmb.model.flexible_body import EFFECT_WORDS, FlexibleBodySpec

    notes = []
    for name, body in bodies.items():
        spec = model.bodies[name]
        if not isinstance(spec, FlexibleBodySpec) or spec.deformation == "rigid":
            continue
        if not body.m:
            least = ""
            if body.omitted_modes is not None and len(body.omitted_modes.frequency):
                lowest = model.units.say(body.omitted_modes.frequency.min(), "Hz", 4)
                least = f", though it vibrates from {lowest} on"
            notes.append(
                f"bodies.{name}: has no modal coordinates and moves as a rigid body{least}: give "
                'it modes, or say deformation = "rigid"'
            )
        elif EFFECT_WORDS & spec.model_fields_set:
            cutoff = cutoff_frequency(model) if spec.deformation == "automatic" else float("inf")
            notes.append(f"bodies.{name}: effects {spec.effects_in_words(body, cutoff)}")
    return notes


def _row_size_note(compiled: Compiled, scene: Mapping[str, Any]) -> list[str]:
    """A note if a scene stores only part of the results; raises mistakes in the request."""
    from flexmb.results.channels import Columns, row_bytes, stored_columns

    if not scene.get("results", {}).get("keep"):
        return []
    columns = Columns.of(compiled.layout)
    stored, whole = (row_bytes(stored_columns(columns, s)) for s in (scene, {}))
    return [f"[results] keeps {stored} of {whole} bytes of each row"]
