"""One run of a sweep: values of the knobs in, scalars of channels out, nothing on disk.

In: a scene as plain data, the values of its knobs, scalars such as ``slider.x:max``. Out: a row:
status, reason, notes, scalars in the scene's units, times. A vector without a component
(``crank_pin.rod.force``) stands for its length; means are integrals over time by the trapezoidal
rule between outputs; extremes are those at the outputs. A run writes a result file if its history
is to be kept, or if a scalar needs one (stress, motion of markers).
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.errors import Problem, SceneError, SolverError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.folders import temporary_folder, writable_folder
from flexmb.model.scenes.study import override
from flexmb.model.scenes.sweep import SCALARS, read_scalar
from flexmb.progress import Progress, silent
from flexmb.results.channels import Channel, Columns, all_channels
from flexmb.studies.accuracy.runner import REDUCTION_FIELDS
from flexmb.studies.study_jobs import content_key
from flexmb.workflow.flexible_bodies import REUSED

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.results.output_block import OutputBlock
    from flexmb.units import UnitSystem


Row = dict[str, Any]


SECTIONS = ("check", "results", "view", "study", "sweep")
_PARABOLA_ROWS = 5  # least number of rows between which an extreme is interpolated
_SAME_BEND = 2.0  # largest ratio of the curvatures at an extreme and beside it
_EXTREMES = ("min", "max")  # of channels for which no scalar is stated
_RECOVERED = {  # channels that need a result file, and their units in SI
    "von_mises": "Pa", "stress": "Pa", "section_force": "", "mode_energy": "J", "balance": "J",
    "position": "m", "velocity": "m/s", "acceleration": "m/s^2", "angular_velocity": "rad/s",
    "angular_acceleration": "rad/s^2", "angle": "rad", "angle_rate": "rad/s",
    "second_angle": "rad", "second_angle_rate": "rad/s", "stroke": "m", "stroke_rate": "m/s",
}  # fmt: skip
_FORM = re.compile(rf"\w+(?:\.\w+)?\.({'|'.join(_RECOVERED)})(?:\..+)?|energy\.(balance)")
_AXES = "xyz"


class Job(NamedTuple):
    """One run: the key of its row, and the values of its knobs."""

    key: str
    values: dict[str, Any]


"""Sections of a scene that runs of a sweep do not use."""


@dataclass(frozen=True)
class SweepScene:
    """What all runs of a sweep have in common; plain data.

    Attributes
    ----------
    scene : dict
        The scene, including values changed for all runs.
    folder : str
        Folder that its paths are relative to.
    bodies : str
        Folder of its reduced bodies.
    scalars : tuple of Scalar
        Scalars that are read from each run.
    histories : str
        Folder with a folder for the result of each run; empty: no results are kept.
    """

    scene: dict[str, Any]
    folder: str
    bodies: str
    scalars: tuple[Scalar, ...] = field(default=())
    histories: str = ""

    def model(self, values: Mapping[str, Any]) -> Model:
        """The model with these values of the knobs.

        Raises
        ------
        SceneError
            The model refuses them.
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
    from flexmb.analysis.chunked_run import one_thread

    wall, cpu = time.perf_counter(), time.thread_time()
    model = scene.model(job.values)
    in_memory = all(one.columns for one in scene.scalars) and not scene.histories
    auto = getattr(model.effects, "choice", "") == "auto"
    run = _run_in_memory if in_memory and not auto else _run_with_file
    with one_thread():
        row = run(scene, model, job.key)
    row["seconds"] = time.perf_counter() - wall
    row["cpu_seconds"] = time.thread_time() - cpu
    return row


class _Rows:
    """A sink that keeps the rows of a run in memory."""

    def __init__(self) -> None:
        self.blocks: list[OutputBlock] = []

    def append(self, block: OutputBlock) -> None:
        self.blocks.append(block)

    def save_state(self, state: Any) -> None:
        """Do nothing: states are only needed to continue a run."""

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
    from flexmb.workflow.simulate import run_model

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
            "notes": "\n".join(note for note in report.notes if REUSED not in note),
            "folder": str(own_folder or ""),
        }
        return row | read_result(scene.scalars, result)
    finally:
        if own_folder is None:
            shutil.rmtree(folder, ignore_errors=True)


def _bodies_folder(scene: SweepScene, model: Model) -> Path:
    """Folder of the reduced bodies of a model; models with equal reductions share it."""
    from flexmb.model.mesh_body import MeshBodySpec

    tables = model.to_scene_dict(Path(scene.folder))["bodies"]
    meshes = [tables[k] for k, spec in model.bodies.items() if isinstance(spec, MeshBodySpec)]
    reductions = [{k: v for k, v in one.items() if k in REDUCTION_FIELDS} for one in meshes]
    return Path(scene.bodies) / content_key(reductions)


def flexible_bodies_of(
    scene: SweepScene, model: Model, progress: Progress = silent
) -> dict[str, FlexBody]:
    """The reduced bodies of a model, from the folder of bodies or reduced into it."""
    from flexmb.workflow.flexible_bodies import flexible_bodies

    if not any(spec.flexible for spec in model.bodies.values()):
        return {}
    return flexible_bodies(model, writable_folder(_bodies_folder(scene, model)), progress=progress)[
        0
    ]


class Scalar(NamedTuple):
    """A scalar of a channel, and the columns it is computed from; without columns from a result
    file."""

    channel: str
    word: str  # one of SCALARS
    unit: str = ""  # that of SI
    columns: tuple[Channel, ...] = ()

    @property
    def name(self) -> str:
        """The scalar's notation, such as ``slider.x:max``."""
        return f"{self.channel}:{self.word}"


def find_scalars(
    columns: Columns, model: Model, names: Sequence[str]
) -> tuple[list[Scalar], list[Problem]]:
    """The scalars of these names, by default of all sensors, and problems of unknown names.

    Parameters
    ----------
    columns : Columns
        All columns of a run.
    model : Model
        Its model.
    names : sequence of str
        Such as ``slider.x:max``; a channel without a scalar stands for its minimum and maximum.
    """
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    by_name = all_channels(columns, scene)
    scalars: list[Scalar] = []
    problems: list[Problem] = []
    for i, text in enumerate(names or columns.channels):
        channel, word = read_scalar(text)
        owner = channel.partition(".")[0]
        matches = tuple(
            by_name[name]
            for name in ((channel,) if channel in by_name else (f"{channel}.{a}" for a in _AXES))
            if name in by_name and by_name[name].table != "balance"
        )
        form = _FORM.fullmatch(channel)
        owners = {*model.bodies, *model.joints, "energy"}
        recovered = form if form is not None and owner in owners else None
        if len(matches) not in (1, 3) and recovered is None:
            vectors = (name.removesuffix(".x") for name in by_name if name.endswith(".x"))
            allowed = tuple(dict.fromkeys((*by_name, *vectors)))
            what = f'there is no channel "{channel}"'
            problems.append(Problem(f"sensors[{i}]", what, allowed, nearest(channel, allowed)))
            continue
        kind = "" if recovered is None else recovered[1] or recovered[2]
        unit = matches[0].unit if matches else _RECOVERED[kind]
        scalars += [Scalar(channel, one, unit, matches) for one in ((word,) if word else _EXTREMES)]
    return list(dict.fromkeys(scalars)), problems


def _mean(t: Array, x: Array) -> float:
    if len(t) < 2:
        return float(x[-1])
    return float(0.5 * np.sum((x[1:] + x[:-1]) * np.diff(t)) / (t[-1] - t[0]))


def _largest(t: Array, x: Array) -> float:
    """The largest value, between rows by the parabola through the largest one and its neighbours.

    At an end, and where the curvature at the neighbours is not about the same, as at a kink or an
    impact, it is that of the rows.
    """
    k = int(x.argmax())
    if len(x) < _PARABOLA_ROWS or not 0 < k < len(x) - 1:
        return float(x[k])
    rows = slice(max(k - 2, 0), k + 3)
    slopes, middle = np.diff(x[rows]) / np.diff(t[rows]), k - rows.start
    bends = np.diff(slopes) / (t[rows][2:] - t[rows][:-2])
    own = float(bends[middle - 1])
    if not np.all(bends < own / _SAME_BEND) or not np.all(bends > own * _SAME_BEND):
        return float(x[k])
    before, after = t[k] - t[k - 1], t[k + 1] - t[k]
    slope = (slopes[middle - 1] * after + slopes[middle] * before) / (before + after)
    return float(x[k] - slope * slope / (4.0 * own))


def _smallest(t: Array, x: Array) -> float:
    return -_largest(t, -x)


_FUNCTIONS: dict[str, Callable[[Array, Array], float]] = {
    "min": _smallest,
    "max": _largest,
    "peak": lambda t, x: max(_largest(t, x), -_smallest(t, x)),
    "peak-to-peak": lambda t, x: _largest(t, x) - _smallest(t, x),
    "rms": lambda t, x: float(np.sqrt(_mean(t, x * x))),
    "mean": _mean,
    "final": lambda t, x: float(x[-1]),
}
assert tuple(_FUNCTIONS) == SCALARS


def scalar_value(word: str, t: Array, x: Array) -> float:
    """A scalar of values x (n,) at times t (n,)."""
    return _FUNCTIONS[word](t, x)


def read_rows(
    scalars: Sequence[Scalar], blocks: Sequence[OutputBlock], units: UnitSystem
) -> dict[str, float]:
    """The scalars by name, from the rows of a run."""
    t = np.concatenate([block.t for block in blocks])
    values: dict[str, Array] = {}
    for one in scalars:
        if one.channel not in values:
            parts = [
                np.concatenate([getattr(block, c.table)[:, c.column] for block in blocks])
                for c in one.columns
            ]
            x = parts[0] if len(parts) == 1 else np.sqrt(sum(part * part for part in parts))
            values[one.channel] = units.outward(x, one.unit) if one.unit else x
    return {one.name: scalar_value(one.word, t, values[one.channel]) for one in scalars}


def read_result(scalars: Sequence[Scalar], result: Result) -> dict[str, float]:
    """The scalars by name, from a result.

    Raises
    ------
    ResultFileError
        It has no such channel.
    """
    t, values = np.asarray(result.time), dict[str, Array]()
    for one in scalars:
        if one.channel not in values:
            vector = [f"{one.channel}.{axis}" for axis in _AXES]
            whole = one.channel not in result and all(name in result for name in vector)
            values[one.channel] = (
                np.sqrt(sum(result[name] ** 2 for name in vector)) if whole else result[one.channel]
            )
    return {one.name: scalar_value(one.word, t, values[one.channel]) for one in scalars}
