"""Going on with a run that was stopped, killed or has finished too early.

In: a result, or its folder. Out: the same result, gone on to its end as if nothing had happened.
The scene kept in the result and the flexible bodies beside it are the run; the scene file is only
asked whether it has changed since.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

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
from flexmb.workflow import origin
from flexmb.workflow.finish import finish
from flexmb.workflow.reports import RunReport

if TYPE_CHECKING:
    from flexmb.engine.compile import Compiled
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["resume", "resume_run"]

_WHOLE = 1e-9  # how far a duration may lie from a whole number of output intervals


def resume(
    result: Result | str | Path,
    *,
    duration: float | None = None,
    as_begun: bool = False,
    progress: Progress = silent,
) -> Result:
    """Go on with a run and open its result.

    The rest is what an uninterrupted run would have given, to the last bit.

    Parameters
    ----------
    result : Result or path
        The result, its file or the folder it is in.
    duration : float, optional
        A new duration of the run as a whole in the scene's units, a whole number of its output
        intervals; also a finished run goes on then.
    as_begun : bool
        Go on even if the scene file has changed since; the change has no effect.
    progress : Progress
        Told every phase.

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
    """Go on with a run to its pictures; see :func:`resume`."""
    from flexmb.analysis.dynamics.analysis import integrate
    from flexmb.analysis.dynamics.resume import prepare_rest
    from flexmb.engine.compile import compile_system
    from flexmb.model import Model
    from flexmb.results import Result, ResultWriter, extend_file

    run = result if isinstance(result, Result) else Result(result)
    if not as_begun:
        _refuse_a_changed_scene(run)
    bodies = _bodies(run)
    model = Model.from_scene_dict(run.model, run.path.parent)
    _set_duration(model, run, duration)
    if problems := model.problems():  # tables that end before the new duration
        raise SceneError.from_problems(problems)
    compiled = compile_system(model, bodies)
    notes = _check_system(run, compiled)
    prepared = prepare_rest(compiled, model, run, progress=progress)
    if duration is not None and model.dynamics is not None:
        spec = model.dynamics
        extend_file(run.path, model.units.written(spec.duration, "s"), spec.n_rows - 1)
    with ResultWriter.reopen(run.path) as writer:
        if writer.rows_written != prepared.rows_before:
            raise OutputError(f"{run.path}: another run has written it meanwhile; try again")
        began = float(prepared.run.state.t[0])
        outcome = integrate(prepared, writer, progress=progress)
        writer.finish(
            {**outcome.statistics, "resumed_at_s": began}, outcome.status, outcome.message
        )
    run.refresh()
    return finish(model, run, outcome, notes, pictures=pictures, progress=progress)


def _refuse_a_changed_scene(run: Result) -> None:
    found = origin.scene_changes(run)
    if found is None or not found[1]:
        return
    path, changes = found
    cure = (
        "a resumed run goes on with the scene it began with: undo the change, go on as begun "
        "(--as-begun), or run the changed scene anew or from this result's end (--from)"
    )
    if any(change.startswith("dynamics.duration ") for change in changes):
        cure += "; for a longer run give the new duration of the whole (--duration)"
    listed = "".join(f"\n  {change}" for change in changes)
    raise SceneError(f"{path}: has changed since {run.path} was begun; {cure}{listed}")


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
    interval, asked = spec.duration / spec.outputs, duration * units.scale("s")
    outputs = round(asked / interval) if math.isfinite(asked) else 0
    what = ""
    if outputs < 1 or abs(asked / interval - outputs) > _WHOLE * outputs:
        given, step = units.say(asked, "s"), units.say(interval, "s", 9)
        what = f"must be a whole number of output intervals of {step}, is {given}"
    elif outputs < spec.outputs:
        what = f"must not be shorter than it was, {whole}, is {units.say(asked, 's')}"
    elif run.status == "finished" and outputs == spec.outputs:
        what = f"is {whole} already, and the run is finished"
    if what:
        raise SceneError.from_problems([Problem("duration", what)])
    model.dynamics = spec.model_copy(update={"duration": outputs * interval, "outputs": outputs})


def _bodies(run: Result) -> dict[str, FlexBody]:
    """The flexible bodies of the run, unchanged."""
    from flexmb.flexbody import load

    known = origin.origin(run).get("bodies", {})
    bodies: dict[str, FlexBody] = {}
    problems: list[Problem] = []
    for name, file in run.flexbodies.items():
        where = f"bodies.{name}"
        try:
            bodies[name] = load(file)
        except FlexmbError as error:
            problems.append(Problem(where, str(error)))
            continue
        if name in known and known[name]["hash"] != origin.body_hash(bodies[name]):
            what = f"{file} has changed since the run began; put the old one back, or run again"
            problems.append(Problem(where, what))
    if problems:
        raise BodyFileError.from_problems(problems)
    return bodies


def _check_system(run: Result, compiled: Compiled) -> list[str]:
    """Refuse another system; a note where compiled code has changed since."""
    now, then = origin.made_by(), origin.origin(run)
    if run.layout.fingerprint != compiled.layout.fingerprint:
        raise ResultFileError(
            f"{run.path}: was begun by flexmb {then.get('flexmb', 'of another version')}; this "
            f"one, {now['flexmb']}, builds another system from its scene; run the scene again"
        )
    if then.get("engine", now["engine"]) != now["engine"]:
        return ["the run was begun by another flexmb: the rest may differ in the last bits"]
    return []
