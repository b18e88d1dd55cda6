"""Inverse dynamics: the forces of drives along a motion, and all reactions, without integration.

In: a scene whose drivers determine the motion, or a model, a result and joints to drive. Out: a
result with the same rows, and all reactions.
"""

from __future__ import annotations

import copy
import shutil
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import FlexmbWarning, OutputError, Problem, SceneError, SolverError, nearest
from flexmb.folders import output_folder, writable_folder
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.progress import Progress, silent
from flexmb.workflow.flexible_bodies import flexible_bodies

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.workflow.run_report import RunReport


def inverse_dynamics(
    model: Model,
    motion: Result | str | Path,
    *,
    drives: Sequence[str] = (),
    output: str | Path | None = None,
    progress: Progress = silent,
) -> Result:
    """Compute the forces that move a model along a motion, and all reactions.

    Parameters
    ----------
    model : Model
        The model, with the forces that act besides the drives. Of its drivers only the places where
        they act are used, not the prescribed functions.
    motion : Result or path
        A run with the same bodies: of this model or of another one, for example one with torques
        instead of drives.
    drives : sequence of str
        Joints that get a driver in addition: ``"elbow"``, or ``"elbow.stroke"`` of a joint with
        two coordinates. Their forces are the reactions of ``drive_elbow``.
    output : path, optional
        Folder of the files; as in :func:`simulate`.
    progress : Progress
        Called for every phase.

    Returns
    -------
    Result
        The rows of the motion with reactions: ``result.reaction("drive_elbow")``.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message: motions that nothing drives, and what to drive.
    OutputError
        The folder is that of the motion, or cannot be written.
    """
    from flexmb.analysis.inverse_dynamics import prepare_inverse, run_inverse
    from flexmb.engine.compile import compile_system
    from flexmb.results import Result
    from flexmb.results.reader import TemporaryFolder
    from flexmb.results.writer import ResultWriter

    run = motion if isinstance(motion, Result) else Result(motion)
    driven = _with_drives(model, drives)
    if output is not None and (Path(output) / "result.h5").resolve() == run.path.resolve():
        what = f"{output} is the folder of the run whose motion is taken, which would be lost"
        raise OutputError(f"{what}: give another one")
    scratch = None if output is not None else TemporaryFolder()
    folder = writable_folder(scratch.path if scratch is not None else Path(output or "."))
    driven.validate()
    bodies, files, notes = flexible_bodies(driven, folder, progress=progress)
    compiled = compile_system(driven, bodies)
    prepared = prepare_inverse(compiled, driven, run, progress=progress)
    names = {name: file.name for name, file in files.items()}
    scene = driven.to_scene_dict(folder, names)
    with ResultWriter(
        folder / "result.h5", compiled.layout, len(run.time), scene=scene, flexbodies=names
    ) as writer:
        outcome = run_inverse(prepared, writer, progress=progress)
        writer.finish(outcome.statistics, outcome.status, outcome.message)
    if outcome.status == "failed":
        if scratch is not None:
            scratch.preserve()
        raise SolverError(f"{outcome.message}; {writer.path} keeps the outputs until then")
    for note in (*notes, *outcome.notes):
        warnings.warn(note, FlexmbWarning, stacklevel=2)
    return Result(writer.path)


def inverse_scene(
    path: str | Path,
    *,
    along: Result | str | Path | None = None,
    drives: Sequence[str] = (),
    output: str | Path | None = None,
    overrides: Mapping[str, str] | None = None,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Inverse dynamics of a scene file, with pictures and a table of the force of each driver.

    Parameters
    ----------
    path : path
        The scene. Its drivers determine the motion for the duration of [kinematics] or [dynamics].
    along : Result or path, optional
        A run with the same bodies, whose motion is used instead.
    drives : sequence of str
        With `along`: joints that get a driver in addition; see `inverse_dynamics`.
    output : path, optional
        Folder of what is written; ``out/<scene>/inverse`` by default, beside the run of the scene.
    overrides, pictures, progress
        As of `run_scene`.

    Raises
    ------
    FlexmbError
        Whatever is wrong, in one message: motions that nothing drives, singular poses.
    """
    from flexmb.model import load_scene
    from flexmb.results import Result
    from flexmb.workflow.run_report import RunReport, answers_of_another, draw_run
    from flexmb.workflow.simulate import run_model

    model = load_scene(Path(path), dict(overrides or {}))
    folder = _folder_beside_run(Path(path)) if output is None else Path(output)
    others: list[str] = []
    if along is None:
        if drives:
            what = "a drive without a function needs a motion: give a run of it (along)"
            raise SceneError.from_problems([Problem("drives", what)])
        if model.kinematics is None and model.dynamics is not None:
            outputs = {} if model.dynamics.outputs is None else {"outputs": model.dynamics.outputs}
            duration = model.units.outward(model.dynamics.duration, "s")
            model.set_kinematics(duration=duration, **outputs)
            if model.checks and _deforms(model):
                others = [answers_of_another(model, "undeformed bodies")]
                model.checks.clear()
        if model.kinematics is None:
            what = "is missing: say how long the drivers move it, or name a run to go along"
            raise SceneError.from_problems([Problem("kinematics.duration", what)])
        report = run_model(
            model, folder, analysis="kinematics", pictures=pictures, progress=progress
        )
        tables = (*report.tables, drive_table(Result(report.result)))
        return replace(report, notes=[*report.notes, *others], tables=tables)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        run = inverse_dynamics(model, along, drives=drives, output=folder, progress=progress)
    notes = [str(one.message) for one in caught if issubclass(one.category, FlexmbWarning)]
    drawn = draw_run(run, progress) if pictures else (None, None)
    return RunReport(
        folder, run.path, run.flexbodies, *drawn, dict(run.statistics), notes,
        resumable=False, tables=(drive_table(run),),
    )  # fmt: skip


def _deforms(model: Model) -> bool:
    """Whether a body of the scene deforms, which kinematics leaves out."""
    specs = [one for one in model.bodies.values() if isinstance(one, FlexibleBodySpec)]
    return any(spec.deformation != "rigid" for spec in specs)


def _folder_beside_run(scene: Path) -> Path:
    """The folder of inverse dynamics in the folder of a run, with copies of its reduced bodies."""
    run = output_folder(scene)
    folder = writable_folder(run / "inverse")
    for body in run.glob("*.flexbody.h5"):
        if not (folder / body.name).exists():
            shutil.copy2(body, folder)
    return folder


def drive_table(run: Result) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The force or torque of each driver: columns, and a row for each of its coordinates."""
    from flexmb.model.joints.joint import COORDINATES

    rows = []
    columns = {path: [k for k, row in enumerate(run.layout.rows) if row.startswith(f"{path}: ")]
               for path in run.layout.reactions if path.startswith("drivers.")}  # fmt: skip
    for path, own in columns.items():
        driver = path.removeprefix("drivers.")
        table = run.model["drivers"][driver]
        names = [word for word in COORDINATES if word in table]
        names += [word for word in ("x", "y", "z", "distance") if word in table]
        names += [f"position {k + 1}" for k in range(len(own) - len(names))]
        for k, name in zip(own, names, strict=True):
            unit = "N m" if name.endswith("angle") else "N"
            values = run.in_scene_units(-run.part("lam", [k])[:, 0], unit)  # on marker J
            at = int(np.abs(values).argmax())
            figures = (values[at], run.time[at], values.min(), values.max())
            rms = float(np.sqrt(np.mean(values**2)))
            rows.append(
                (driver, name, *(f"{x:.6g}" for x in (*figures, rms)), run.units.label(unit))
            )
    when = f"at t [{run.units.label('s')}]"
    return ("driver", "of", "largest", when, "least", "greatest", "rms", "unit"), rows


def _with_drives(model: Model, drives: Sequence[str]) -> Model:
    """A copy of a model with an additional driver on each of some joints."""
    from flexmb.model.joints.joint import JOINT_TYPES

    made = copy.copy(model)
    made.drivers = dict(model.drivers)
    problems = []
    for drive in drives:
        joint, _, coordinate = drive.partition(".")
        if joint not in model.joints:
            names = tuple(model.joints)
            problems.append(
                Problem(f'drives "{drive}"', "no such joint", names, nearest(joint, names))
            )
            continue
        coordinates = JOINT_TYPES[model.joints[joint].type].coordinates
        if not coordinates or coordinate not in ("", *coordinates):
            what = f"the joint has no coordinate {coordinate or 'to drive'}"
            problems.append(Problem(f'drives "{drive}"', what, tuple(coordinates)))
            continue
        made.add_driver(f"drive_{joint}", joint=joint, **{coordinate or coordinates[0]: 0.0})
    if problems:
        raise SceneError.from_problems(problems)
    return made
