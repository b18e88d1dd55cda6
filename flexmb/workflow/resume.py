"""Continuing runs: resuming or extending one, and starting another from its end.

A run that was stopped or killed is resumed, one that has finished extended: the same result with
the rows of the uninterrupted run. The scene in the result and the flexible bodies in its folder
define the run; the scene file is only compared.

A run that starts from the end of another one matches bodies by their names. Time starts again at 0.
The joints and drivers of the new scene take precedence at that time; what they change of the other
run's end is reported afterwards.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
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
from flexmb.model.quantities import read_number
from flexmb.model.reading import under
from flexmb.progress import Progress, silent
from flexmb.results.run_summary import NOT_CONTAINED, notes_statistic
from flexmb.workflow.run_report import RunReport, body_hash, code_version, provenance, report_run

if TYPE_CHECKING:
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.engine.compile import Compiled
    from flexmb.engine.state import State
    from flexmb.engine.tables import BodyColumns
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.units import UnitSystem


_MAX_CHANGES = 8  # changes listed in a message
_EXTENDED = ("dynamics.duration", "dynamics.outputs")
# relative tolerance of a duration that must be a whole number of output intervals
_WHOLE_TOLERANCE = 1e-9


def resume(
    result: Result | str | Path,
    *,
    duration: float | str | None = None,
    as_begun: bool = False,
    progress: Progress = silent,
) -> Result:
    """Resume a run and open its result, which is that of the uninterrupted run to the last bit.

    Parameters
    ----------
    result : Result or path
        The result, its file or the folder it is in.
    duration : float or str, optional
        A new duration of the run as a whole in the scene's units or with its own, as ``"6 s"``, a
        whole number of its output intervals; a finished run is extended.
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
    duration: float | str | None = None,
    as_begun: bool = False,
    pictures: bool = True,
    progress: Progress = silent,
) -> RunReport:
    """Resume a run and draw it; see :func:`resume`."""
    from flexmb.analysis.dynamics.dynamics import run_dynamics
    from flexmb.analysis.dynamics.resumed_run import prepare_resumed
    from flexmb.engine.compile import compile_system
    from flexmb.model import Model
    from flexmb.model.scenes.effects import active_model
    from flexmb.results import Result
    from flexmb.results.writer import ResultWriter, extend_file

    run = result if isinstance(result, Result) else Result(result)
    if not as_begun:
        _check_scene_file(run)
    bodies = load_bodies(run)
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
        words = notes_statistic(dict.fromkeys([*run.notes, *outcome.notes]))
        words |= {NOT_CONTAINED: run.texts[NOT_CONTAINED]} if NOT_CONTAINED in run.texts else {}
        statistics = {**outcome.statistics, **words, "resumed_at_s": began}
        writer.finish(statistics, outcome.status, outcome.message)
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
    """The changes in the scene file at `path` since the run of a result was started."""
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
    """Paths of changed values in a scene, and their changes."""
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


def _set_duration(model: Model, run: Result, duration: float | str | None) -> None:
    """Set the new duration of a model, with as many outputs as keep the interval."""
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
    try:
        new = read_number(duration, model.context, "s") * units.scale("s")
    except SceneError as error:
        raise SceneError.from_problems(under("duration", error.problems)) from None
    interval = spec.duration / spec.outputs
    outputs = round(new / interval)
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


def load_bodies(run: Result) -> dict[str, FlexBody]:
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
    """Refuse another system; a note if compiled code has changed since."""
    now, then = code_version(), provenance(run)
    if run.layout.fingerprint != compiled.layout.fingerprint:
        raise ResultFileError(
            f"{run.path}: was begun by flexmb {then.get('flexmb', 'of another version')}; this "
            f"one, {now['flexmb']}, builds another system from its scene; run the scene again"
        )
    if then.get("engine", now["engine"]) != now["engine"]:
        return ["the run was begun by another flexmb: the rest may differ in the last bits"]
    return []


# smallest reported change of the start state, relative to the model's size, or to the speed
_MIN_CHANGE = 1e-6
_MIN_ROTATION = 1e-4  # rad; arccos near 1 has an error of 1e-8


@dataclass(frozen=True)
class StartState:
    """The end of another run as the start of this one."""

    source: Path
    begin: StartValues
    matched: tuple[BodyColumns, ...]
    notes: tuple[str, ...]

    def changes(self, compiled: Compiled, state: State, units: UnitSystem) -> list[str]:
        """The differences of the first state from the end of the other run, a sentence per body."""
        speed = max(float(np.abs(np.nan_to_num(self.begin.v)).max(initial=0.0)), 1e-12)
        changes = np.abs(state.v - self.begin.v)
        sentences = []
        for body in self.matched:
            q, p = self.begin.q[body.iq :], state.q[body.iq :]
            moved = float(np.linalg.norm(p[:3] - q[:3]))
            turned = 2.0 * float(np.arccos(min(abs(float(p[3:7] @ q[3:7])), 1.0)))
            change = changes[body.iv :]
            faster, spun = float(change[:3].max()), float(change[3:6].max())
            parts = (
                (moved > _MIN_CHANGE * compiled.length, f"moved by {units.say(moved, 'm', 3)}"),
                (turned > _MIN_ROTATION, f"turned by {turned:.3g} rad"),
                (faster > _MIN_CHANGE * speed, f"velocity by up to {units.say(faster, 'm/s', 3)}"),
                (
                    spun > _MIN_CHANGE * speed,
                    f"angular velocity by up to {units.say(spun, 'rad/s', 3)}",
                ),
            )
            changed = ", ".join(text for reported, text in parts if reported)
            if changed:
                where = f"bodies.{body.name}: joints and drivers at t = 0 change its start"
                sentences.append(f"{where}: {changed}")
        return sentences


def match_start(
    model: Model, compiled: Compiled, bodies: Mapping[str, FlexBody], source: Result | str | Path
) -> StartState:
    """Match the bodies, states and controllers of a model with those of a result by name.

    Parameters
    ----------
    model, compiled : Model, Compiled
        The model, and its compiled system.
    bodies : mapping of str to FlexBody
        Its flexible bodies.
    source : Result or path
        The other run; its last complete row is used.

    Raises
    ------
    ResultFileError
        The result cannot be read, holds no rows, has no body of a name of this model, or is not
        in the plane of a planar model.
    """
    from flexmb.analysis.assembly.initial_state import StartValues
    from flexmb.results import Result

    other = source if isinstance(source, Result) else Result(source)
    if not len(other.time):
        raise ResultFileError(f"{other.path}: holds no output rows to begin from")
    if model.plane not in (None, other.model.get("plane")):
        what = f"is no run in the plane {model.plane}, in which this scene moves"
        raise ResultFileError(f"{other.path}: {what}")
    theirs = {body.name: body for body in other.layout.bodies}
    matched = tuple(body for body in compiled.layout.bodies if body.name in theirs)
    if not matched:
        names = tuple(body.name for body in compiled.layout.bodies)
        what = f"has no body of this scene; it has {', '.join(theirs)}"
        raise ResultFileError.from_problems([Problem(str(other.path), what, names)])
    (q,), v = compiled.layout.of_frames(compiled.initial_q), np.full(compiled.layout.nv, np.nan)
    reductions = provenance(other).get("bodies", {})
    undeformed = []
    for body in matched:
        old = theirs[body.name]
        same = body.m > 0 and _same_modes(bodies[body.name], reductions.get(body.name, {}))
        m = body.m if same else 0
        q[body.iq : body.iq + 7 + m] = other.part("q", slice(old.iq, old.iq + 7 + m))[-1]
        v[body.iv : body.iv + 6 + body.m] = 0.0
        v[body.iv : body.iv + 6 + m] = other.part("v", slice(old.iv, old.iv + 6 + m))[-1]
        if body.m > 0 and not same:
            undeformed.append(body.name)
    count, old_count = len(compiled.layout.coordinates), len(other.layout.coordinates)
    places = other.layout.nq - old_count, other.layout.nv - old_count
    for k, name in enumerate(compiled.layout.coordinates):
        if name not in other.layout.coordinates:
            continue
        at = other.layout.coordinates.index(name)
        if name.startswith("states."):
            v[k - count] = other.part("v", [places[1] + at])[-1, 0]
        elif _is_same_joint(model, other, name):  # with its turns
            q[k - count] = other.part("q", [places[0] + at])[-1, 0]
    notes = [_matching_note(other, matched, compiled), *_turn_notes(other, compiled)]
    if undeformed:
        notes.append(
            f"begins without deformation, since its reduction differs: {', '.join(undeformed)}"
        )
    q, v = compiled.layout.of_equations(q, v)
    return StartState(other.path, StartValues(q, v), matched, tuple(notes))


def _turn_notes(other: Result, compiled: Compiled) -> Iterator[str]:
    """Notes on angle sensors of both runs whose turns nothing keeps."""
    rows = compiled.system.sensors.channels
    for name, row in zip(compiled.layout.channels, rows, strict=False):
        sensor = other.model.get("sensors", {}).get(name, {})
        counts = sensor.get("type") in ("angle", "second_angle") and not sensor.get("derivative")
        if not counts or row["kind"] >= 0 or name not in other.layout.channels:
            continue
        place = [other.layout.channels.index(name)]
        last = other.part("sensors", place)[-1, 0] if other.has_columns("sensors", place) else 0.0
        if abs(last) > np.pi:
            yield (
                f"sensors.{name}: begins within half a turn, where the other run ended at "
                f"{last:.4g} rad; in both scenes a rotational-spring-damper with value = 0 on its "
                "joint keeps the turns"
            )


def _is_same_joint(model: Model, other: Result, name: str) -> bool:
    """Whether a coordinate such as ``forces.spring`` is that of the same joint in both scenes."""
    section, entry, *rest = name.split(".")
    joint = entry if section == "joints" else rest[0] if rest else None
    theirs = joint
    if joint is None:
        joint = getattr(model.forces.get(entry), "joint", None)
        theirs = other.model.get("forces", {}).get(entry, {}).get("joint")
    old, new = other.model.get("joints", {}).get(joint or ""), model.joints.get(joint or "")
    if old is None or new is None or theirs != joint:
        return False
    return old["type"] == new.type and tuple(old["between"]) == new.between


def _same_modes(body: FlexBody, stored: Mapping[str, str]) -> bool:
    """Whether modal coordinates have the same meaning: the same reduction, or the same body.

    Two reductions of the same mesh with the same options differ by round-off only.
    """
    key = body.provenance.get("key", "")
    return bool(key and key == stored.get("key")) or body_hash(body) == stored.get("hash")


def _matching_note(other: Result, matched: tuple[BodyColumns, ...], compiled: Compiled) -> str:
    names = {body.name for body in matched}
    left = [body.name for body in compiled.layout.bodies if body.name not in names]
    gone = [body.name for body in other.layout.bodies if body.name not in names]
    unit = other.units.label("s")
    text = f"begins at t = 0 as {other.path} ended at t = {other.time[-1]:g} {unit}: "
    text += ", ".join(body.name for body in matched)
    if left:
        text += f"; as placed in the scene: {', '.join(left)}"
    if gone:
        text += f"; not in this scene: {', '.join(gone)}"
    return text
