"""Resuming a run that was stopped or killed, or extending one that has finished.

In: a result, or its folder. Out: the same result with the rows of the uninterrupted run. The scene
in the result and the flexible bodies in its folder define the run; the scene file is only compared.

The provenance of a result is a text of JSON in it: version of flexmb, hash of the compiled code,
the scene file with its overrides, a hash of every flexible body.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import (
    BodyFileError,
    FlexmbError,
    FlexmbWarning,
    OutputError,
    Problem,
    ResultFileError,
    SceneError,
)
from flexmb.progress import Progress, silent
from flexmb.workflow.run_report import RunReport, report_run

if TYPE_CHECKING:
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

PROVENANCE = "origin"  # name of the text in the result
_MAX_CHANGES = 8  # in a message: a scene rewritten from scratch has too many to read
_EXTENDED = ("dynamics.duration", "dynamics.outputs")
_WHOLE_TOLERANCE = 1e-9  # of the number of output intervals in a duration


def code_version() -> dict[str, str]:
    """This version of flexmb and the hash of its compiled code."""
    from flexmb import __version__
    from flexmb.engine.unit_cache import engine_hash

    return {"flexmb": __version__, "engine": engine_hash()}


def provenance_text(
    model: Model, folder: Path, bodies: Mapping[str, FlexBody], start_from: Path | None = None
) -> str:
    """The provenance of a result in `folder`."""
    data: dict[str, Any] = code_version()
    data["bodies"] = {
        name: {"hash": body_hash(body), "key": body.provenance.get("key", "")}
        for name, body in bodies.items()
    }
    if model.source is not None:
        data["scene_file"] = _relative(model.source.path, folder)
        data["overrides"] = dict(model.source.overrides)
    if start_from is not None:
        data["from"] = str(start_from)
    return json.dumps(data, default=str)


def provenance(result: Result) -> dict[str, Any]:
    """The provenance in a result; empty if there is none."""
    data: dict[str, Any] = json.loads(result.texts.get(PROVENANCE, "{}"))
    return data


def body_hash(body: FlexBody) -> str:
    """Hash of all data of a flexible body but its provenance."""
    from flexmb.flexbody.body_file import to_datasets

    digest = hashlib.sha256(repr((body.name, body.mass)).encode())
    for path, value in sorted(to_datasets(body).items()):
        if not path.startswith("provenance/"):
            digest.update(path.encode())
            data = repr(value).encode() if isinstance(value, list) else np.asarray(value).tobytes()
            digest.update(data)
    return digest.hexdigest()


def resume(
    result: Result | str | Path,
    *,
    duration: float | None = None,
    as_begun: bool = False,
    progress: Progress = silent,
) -> Result:
    """Resume a run and open its result, which is that of the uninterrupted run to the last bit.

    Parameters
    ----------
    result : Result or path
        The result, its file or the folder it is in.
    duration : float, optional
        A new duration of the run as a whole in the scene's units, a whole number of its output
        intervals; a finished run is extended.
    as_begun : bool
        Resume even if the scene file has changed since; the change has no effect.
    progress : Progress
        Called for every phase.

    Raises
    ------
    FlexmbError
        Nothing is left to do, or the scene, a flexible body or flexmb has changed since.
    """
    from flexmb.results import Result

    report = resume_run(
        result, duration=duration, as_begun=as_begun, pictures=False, progress=progress
    )
    for note in report.notes:
        warnings.warn(note, FlexmbWarning, stacklevel=2)
    return Result(report.result)


def resume_run(
    result: Result | str | Path,
    *,
    duration: float | None = None,
    as_begun: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Resume a run and draw it; see :func:`resume`."""
    from flexmb.analysis.dynamics.dynamics import run_dynamics
    from flexmb.analysis.dynamics.resume import prepare_resumed
    from flexmb.engine.compile import compile_system
    from flexmb.model import Model
    from flexmb.model.scenes.effects import active_model
    from flexmb.results import Result, ResultWriter, extend_file

    run = result if isinstance(result, Result) else Result(result)
    if not as_begun:
        _check_scene_file(run)
    bodies = _load_bodies(run)
    model = Model.from_scene_dict(run.model, run.path.parent)
    _set_duration(model, run, duration)
    if problems := model.problems():  # tables that end before the new duration
        raise SceneError.from_problems(problems)
    model = active_model(model)
    compiled = compile_system(model, bodies)
    notes = _check_system(run, compiled)
    prepared = prepare_resumed(compiled, model, run, progress=progress)
    if duration is not None and model.dynamics is not None:
        spec = model.dynamics
        extend_file(run.path, model.units.written(spec.duration, "s"), spec.n_rows - 1)
    with ResultWriter.reopen(run.path) as writer:
        if writer.rows_written != prepared.rows_before:
            raise OutputError(f"{run.path}: another run has written it meanwhile; try again")
        began = float(prepared.run.state.t[0])
        outcome = run_dynamics(prepared, writer, progress=progress)
        writer.finish(
            {**outcome.statistics, "resumed_at_s": began}, outcome.status, outcome.message
        )
    run.refresh()
    return report_run(model, run, outcome, notes, pictures=pictures, progress=progress)


def _check_scene_file(run: Result) -> None:
    """Refuse to resume if the scene file has changed since."""
    path = _scene_file(run)
    changes = [] if path is None else scene_changes(run, path)
    if not changes:
        return
    cure = (
        "a resumed run uses the scene it began with: undo the change, resume as begun "
        "(--as-begun), or run the changed scene again or from this result's end (--from)"
    )
    if any(change.startswith("dynamics.duration ") for change in changes):
        cure += "; for a longer run give the new duration of the whole (--duration)"
    listed = "".join(f"\n  {change}" for change in changes)
    raise SceneError(f"{path}: has changed since {run.path} was begun; {cure}{listed}")


def _scene_file(run: Result) -> Path | None:
    """The scene file of a result, if it is there."""
    name = provenance(run).get("scene_file")
    path = Path(os.path.normpath(run.path.parent / (name or "")))
    return path if name and path.is_file() else None


def scene_changes(run: Result, path: Path) -> list[str]:
    """The changes in the scene file at `path` since a result was begun."""
    from flexmb.model import load_scene

    names = {name: file.name for name, file in run.flexbodies.items()}
    try:
        model = load_scene(path, provenance(run).get("overrides", {}))
        now = model.to_scene_dict(run.path.parent, names)
    except FlexmbError as error:
        return [f"it has mistakes now: {str(error).splitlines()[0]}"]
    now = json.loads(json.dumps(now))
    changes = [
        change
        for where, change in _differences("", run.model, now)
        if not (run.extended and where in _EXTENDED)
    ]
    more = len(changes) - _MAX_CHANGES
    return changes[:_MAX_CHANGES] + ([f"and {more} more"] if more > 0 else [])


def _differences(where: str, old: Any, new: Any) -> Iterator[tuple[str, str]]:
    """Places in a scene, and their changes."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys((*old, *new)):
            place = f"{where}.{key}" if where else str(key)
            if key not in new:
                yield place, f"{place} is gone"
            elif key not in old:
                yield place, f"{place} is new"
            else:
                yield from _differences(place, old[key], new[key])
    elif old != new:
        yield where, f"{where} was {_short(old)}, is {_short(new)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()


def _set_duration(model: Model, run: Result, duration: float | None) -> None:
    """Give the model the new duration, with as many outputs as keep their interval."""
    spec = model.dynamics
    if spec is None:
        raise ResultFileError(
            f"{run.path}: its scene has no [dynamics]; there is nothing to resume"
        )
    units = model.units
    whole = units.say(spec.duration, "s")
    if duration is None:
        if run.status == "finished":
            raise ResultFileError(
                f"{run.path}: is finished at t = {whole}, nothing is left to do; for a longer run "
                "give a new duration of the whole (--duration)"
            )
        return
    if isinstance(spec.outputs, tuple):
        what = (
            "the output times of this run are listed one by one, and a longer run would record "
            "nothing more; begin another one where it ended (--from)"
        )
        raise SceneError.from_problems([Problem("duration", what)])
    interval, new = spec.duration / spec.outputs, duration * units.scale("s")
    outputs = round(new / interval) if math.isfinite(new) else 0
    what = ""
    if outputs < 1 or abs(new / interval - outputs) > _WHOLE_TOLERANCE * outputs:
        step = units.say(interval, "s", 9)
        what = f"must be a whole number of output intervals of {step}, is {units.say(new, 's')}"
    elif outputs < spec.outputs:
        what = f"must not be shorter than it was, {whole}, is {units.say(new, 's')}"
    elif run.status == "finished" and outputs == spec.outputs:
        what = f"is {whole} already, and the run is finished"
    if what:
        raise SceneError.from_problems([Problem("duration", what)])
    model.dynamics = spec.model_copy(update={"duration": outputs * interval, "outputs": outputs})


def _load_bodies(run: Result) -> dict[str, FlexBody]:
    """The flexible bodies of the run, unchanged."""
    from flexmb.flexbody import load

    stored = provenance(run).get("bodies", {})
    bodies: dict[str, FlexBody] = {}
    problems: list[Problem] = []
    for name, file in run.flexbodies.items():
        where = f"bodies.{name}"
        try:
            bodies[name] = load(file)
        except FlexmbError as error:
            problems.append(Problem(where, str(error)))
            continue
        if name in stored and stored[name]["hash"] != body_hash(bodies[name]):
            what = f"{file} has changed since the run began; put the old one back, or run again"
            problems.append(Problem(where, what))
    if problems:
        raise BodyFileError.from_problems(problems)
    return bodies


def _check_system(run: Result, compiled: Compiled) -> list[str]:
    """Refuse another system; a note where compiled code has changed since."""
    now, then = code_version(), provenance(run)
    if run.layout.fingerprint != compiled.layout.fingerprint:
        raise ResultFileError(
            f"{run.path}: was begun by flexmb {then.get('flexmb', 'of another version')}; this "
            f"one, {now['flexmb']}, builds another system from its scene; run the scene again"
        )
    if then.get("engine", now["engine"]) != now["engine"]:
        return ["the run was begun by another flexmb: the rest may differ in the last bits"]
    return []
