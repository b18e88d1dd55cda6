"""Inverse dynamics: the forces of drives along a motion, from a model and a run.

In: a model, a result, joints to drive. Out: a result with the same rows, and all reactions.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import FlexmbWarning, Problem, SceneError, SolverError, nearest
from flexmb.folders import writable_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.flexible_bodies import flexible_bodies

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result


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
        The model, with the forces that act in addition to the drives. What its drivers prescribe is
        not used, only where they act.
    motion : Result or path
        A run with the same bodies: of this model or of another one, such as one with torques in
        place of drives.
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
    """
    from flexmb.analysis.inverse_dynamics import prepare_inverse, run_inverse
    from flexmb.engine.compile import compile_system
    from flexmb.results import Result, ResultWriter
    from flexmb.results.reader import TemporaryFolder

    run = motion if isinstance(motion, Result) else Result(motion)
    driven = _with_drives(model, drives)
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


def _with_drives(model: Model, drives: Sequence[str]) -> Model:
    """A copy of a model with a driver on each of some joints."""
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
        known = JOINT_TYPES[model.joints[joint].type].coordinates
        if not known or coordinate not in ("", *known):
            what = f"the joint has no coordinate {coordinate or 'to drive'}"
            problems.append(Problem(f'drives "{drive}"', what, tuple(known)))
            continue
        made.add_driver(f"drive_{joint}", joint=joint, **{coordinate or known[0]: 0.0})
    if problems:
        raise SceneError.from_problems(problems)
    return made
