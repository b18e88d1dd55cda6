"""One run of a sweep: values of the knobs in, scalars of channels out, nothing on disk.

In: a scene as plain data and the values of its knobs. Out: a row: status, reason, notes, scalars,
times. A run whose scalars only a result file can give (stress, motion of markers), or whose history
is to stay, writes one.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexmb.errors import SceneError, SolverError
from flexmb.folders import temporary_folder, writable_folder
from flexmb.model.scenes.study import override
from flexmb.progress import Progress, silent
from flexmb.studies.runner import REDUCTION_FIELDS
from flexmb.studies.scalars import Scalar, read_result, read_rows
from flexmb.studies.study_jobs import content_key

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import OutputBlock

Row = dict[str, Any]


class Job(NamedTuple):
    """One run: the key of its row, and the values of its knobs."""

    key: str
    values: dict[str, Any]


_REUSED = "reduction reused from"  # in the note of a run that says nothing of it
SECTIONS = ("check", "results", "view", "study", "sweep")
"""Sections of a scene that its runs in a sweep do without."""


@dataclass(frozen=True)
class SweepScene:
    """What all runs of a sweep have in common; plain data.

    Attributes
    ----------
    scene : dict
        The scene, the values changed for all runs included.
    folder : str
        What its paths are relative to.
    bodies : str
        Folder of its reduced bodies.
    scalars : tuple of Scalar
        What is read from each run.
    histories : str
        Folder in which each run has one for its result; empty: none are kept.
    """

    scene: dict[str, Any]
    folder: str
    bodies: str
    scalars: tuple[Scalar, ...] = field(default=())
    histories: str = ""

    def model(self, values: Mapping[str, Any]) -> Model:
        """The model with these values.

        Raises
        ------
        SceneError
            It refuses them.
        """
        from flexmb.model import Model

        scene, problems = override(self.scene, values)
        if problems:
            raise SceneError.from_problems(problems)
        return Model.from_scene_dict(scene, Path(self.folder))


def run_setting(scene: SweepScene, job: Job) -> Row:
    """Run a setting: its scalars, notes and times.

    Raises
    ------
    FlexmbError
        The model refuses its values, or the run fails.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    model = scene.model(job.values)
    in_memory = all(one.columns for one in scene.scalars) and not scene.histories
    auto = getattr(model.effects, "choice", "") == "auto"
    run = _run_in_memory if in_memory and not auto else _run_with_file
    row = run(scene, model, job.key)
    row["seconds"] = time.perf_counter() - wall
    row["cpu_seconds"] = time.process_time() - cpu
    return row


class _Rows:
    """Takes the rows of a run in memory."""

    def __init__(self) -> None:
        self.blocks: list[OutputBlock] = []

    def append(self, block: OutputBlock) -> None:
        self.blocks.append(block)

    def save_state(self, state: Any) -> None:
        """States are for runs that are continued."""

    def restart(self) -> None:
        self.blocks.clear()


def _run_in_memory(scene: SweepScene, model: Model, _: str) -> Row:
    from flexmb.engine.compile import compile_system
    from flexmb.model.scenes.effects import active_model
    from flexmb.workflow.run import prepare_task, select_analysis

    model = active_model(model)
    analysis = select_analysis(model, None)
    compiled = compile_system(model, flexible_bodies_of(scene, model))
    started = time.perf_counter()
    task = prepare_task(analysis, compiled, model, None, silent)
    rows = _Rows()
    outcome = task.run(rows)
    seconds = time.perf_counter() - started
    if outcome.status == "stopped":
        raise KeyboardInterrupt
    if outcome.status != "finished":
        raise SolverError(outcome.message)
    notes = "\n".join((*task.notes, *outcome.notes))
    return {
        **read_rows(scene.scalars, rows.blocks, model.units), "notes": notes, "seconds_run": seconds
    }  # fmt: skip


def _run_with_file(scene: SweepScene, model: Model, name: str) -> Row:
    from flexmb.results import Result
    from flexmb.workflow import run_model

    own_folder = Path(scene.histories) / name if scene.histories else None
    folder = own_folder or temporary_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if flexible_bodies_of(scene, model):
            shutil.copytree(_bodies_folder(scene, model), folder, dirs_exist_ok=True)
        report = run_model(model, folder, pictures=False)
        result = Result(report.result)
        if result.status == "stopped":
            raise KeyboardInterrupt
        row = {
            "notes": "\n".join(note for note in report.notes if _REUSED not in note),
            "folder": str(own_folder or ""),
        }
        return row | read_result(scene.scalars, result)
    finally:
        if own_folder is None:
            shutil.rmtree(folder, ignore_errors=True)


def _bodies_folder(scene: SweepScene, model: Model) -> Path:
    """Where the reduced bodies of a model are, with all of the same reductions."""
    from flexmb.model.mesh_body import MeshBodySpec

    tables = model.to_scene_dict(Path(scene.folder))["bodies"]
    meshes = [tables[k] for k, spec in model.bodies.items() if isinstance(spec, MeshBodySpec)]
    reductions = [{k: v for k, v in one.items() if k in REDUCTION_FIELDS} for one in meshes]
    return Path(scene.bodies) / content_key(reductions)


def flexible_bodies_of(
    scene: SweepScene, model: Model, progress: Progress = silent
) -> dict[str, FlexBody]:
    """The reduced bodies of a model: from the folder of bodies, or reduced there."""
    from flexmb.workflow.flexible_bodies import flexible_bodies

    if not any(spec.flexible for spec in model.bodies.values()):
        return {}
    return flexible_bodies(model, writable_folder(_bodies_folder(scene, model)), progress=progress)[
        0
    ]
