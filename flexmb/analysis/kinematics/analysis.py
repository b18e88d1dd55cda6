"""Kinematic analysis: the motion that joints and drivers fix, at every output time.

Nothing is integrated, so nothing drifts and every point is exact to round-off; reactions and
driving forces follow from the equations of motion (inverse dynamics). Flexible bodies keep their
undeformed shape. A motion that is not fixed, or no longer, is refused in one sentence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.closing import Closer, body_weights, close_positions
from flexmb.analysis.assembly.precheck import precheck
from flexmb.analysis.dynamics.analysis import Outcome, Sink
from flexmb.analysis.dynamics.contacts import Lifts
from flexmb.analysis.dynamics.run import Balance, Clock
from flexmb.analysis.dynamics.signal_notes import SingularPoses, loop_notes
from flexmb.analysis.kinematics.singular import LARGEST, decompose
from flexmb.analysis.kinematics.unfixed import Pose, enter, free_motions, passed_poses, sweep_reason
from flexmb.analysis.mobility.conflicts import driver_problems
from flexmb.analysis.mobility.report import redundant_reactions
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import (
    CORRECT,
    EVALUATE,
    POINTS,
    analyse_kinematics,
    kinematics_units,
    prepare_kinematics,
)
from flexmb.engine.kinematics_state import KinematicsSettings, Path
from flexmb.engine.state import State, Work
from flexmb.engine.work import new_output, new_path, new_run, new_state, new_work
from flexmb.errors import AssemblyError, FlexmbError, Problem, SceneError
from flexmb.model.model import Model
from flexmb.model.tasks.kinematics import KinematicsSpec
from flexmb.progress import Progress, silent
from flexmb.results import NOT_UNIQUE, OutputBlock

__all__ = ["PreparedSweep", "kinematics", "prepare_sweep", "run_sweep"]

# Points of a chunk times velocity coordinates: a tenth of a second or two.
_CHUNK_WORK = 200_000
_CLOSED = 1e-14  # weighted gap of round-off, of a model near the origin


@dataclass(frozen=True)
class PreparedSweep:
    """A kinematic analysis that is ready to go."""

    compiled: Compiled
    model: Model
    spec: KinematicsSpec
    settings: KinematicsSettings
    state: State
    work: Work
    path: Path
    clock: Clock
    notes: tuple[str, ...]
    doubtful: tuple[str, ...]  # joints and drivers whose reactions are not unique


def prepare_sweep(
    compiled: Compiled, model: Model, *, progress: Progress = silent
) -> PreparedSweep:
    """Load the compiled units, close the first pose and make sure that the motion is fixed.

    What is wrong with a small model is told before anything is compiled (`assembly.precheck`).

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.kinematics` must be given.
    progress : Progress
        Told the phases `load` or `compile`, and `assemble`.

    Raises
    ------
    SceneError
        The model says nothing about kinematics.
    AssemblyError
        Positions that cannot be closed, motions that no driver fixes, or drivers that contradict
        each other or the joints.
    """
    spec = model.kinematics
    if spec is None:
        raise SceneError("the scene has no [kinematics]: give its duration")
    _refuse_states(model)
    clock, units = Clock(), kinematics_units(compiled.system)
    precheck(compiled, units, lambda: _checked(_first_pose(compiled, model)), progress)
    made = prepare_kinematics(compiled.system, progress)
    clock.lap("compile" if made else "load")
    progress("assemble", 0.0)
    pose = _first_pose(compiled, model)
    redundant, doubtful, notes = _checked(pose)
    progress("assemble", 1.0)
    clock.lap("assemble")
    q = pose.state.q
    settings = KinematicsSettings(
        start=0.0,
        interval=spec.duration / spec.outputs,
        outputs=spec.outputs,
        gap=_CLOSED * max(1.0, float(np.abs(q).max()) / compiled.length),
        redundant=redundant,
    )
    return PreparedSweep(
        compiled, model, spec, settings, pose.state, pose.work, pose.path, clock,
        (*notes, *loop_notes(model)), doubtful,
    )  # fmt: skip


def run_sweep(prepared: PreparedSweep, sink: Sink, *, progress: Progress = silent) -> Outcome:
    """Go through all output times of a prepared analysis.

    Parameters
    ----------
    prepared : PreparedSweep
        From `prepare_sweep`; used once.
    sink : Sink
        Takes the output rows.
    progress : Progress
        Told the phase `kinematics`.
    """
    chunk = max(1, _CHUNK_WORK // prepared.compiled.layout.nv)
    n = min(prepared.settings.outputs + 1, chunk)
    rows = _Rows(prepared.compiled, prepared.model, n)
    status, message = _points(prepared, rows, sink, progress)
    prepared.clock.lap("kinematics")
    notes = (
        *prepared.notes,
        *passed_poses(prepared),
        *rows.lifts.notes(),
        *rows.poses.notes,
    )
    statistics = _statistics(prepared, rows)
    if prepared.doubtful:
        statistics[NOT_UNIQUE] = ", ".join(prepared.doubtful)
    return Outcome(status, message, statistics, notes)


def kinematics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Prepare and run the analysis; see :func:`prepare_sweep` and :func:`run_sweep`."""
    return run_sweep(prepare_sweep(compiled, model, progress=progress), sink, progress=progress)


def _first_pose(compiled: Compiled, model: Model) -> Pose:
    """The first positions, closed with least change in lengths and angles times body weights.

    Raises
    ------
    AssemblyError
        Positions that cannot be closed.
    """
    weights, channels = body_weights(model), len(compiled.layout.channels)
    state, work = new_state(compiled.system, channels), new_work(compiled.system, channels)
    state.q[:] = compiled.placed

    def make(of: Compiled, at: State) -> Closer:
        system = of.system
        path = new_path(system)
        used = work if at is state else new_work(system, len(at.angles))
        for body, weight in zip(system.parts.bodies, weights, strict=True):
            path.metric[body["iv"] : body["iv"] + 6 + body["m"]] *= weight
        return Closer(
            used,
            lambda: enter(system, at, used, path, CORRECT),
            lambda: enter(system, at, used, path, EVALUATE),
        )

    try:
        close_positions(compiled, model, state, make)
    except AssemblyError as error:
        reasons = driver_problems(compiled, model, error.problems)
        raise AssemblyError.from_problems(reasons) from None
    return Pose(compiled, model, state, work, new_path(compiled.system))


def _refuse_states(model: Model) -> None:
    """States follow from what was before, and a kinematic analysis has no before.

    Raises
    ------
    SceneError
        The model has states or controllers.
    """
    sections = ("states", "controllers")
    problems = [
        Problem(f"{section}.{name}", "is integrated, which a kinematic analysis does not do; leave "
                "it out, or run the scene with [dynamics]")
        for section in sections
        for name in getattr(model, section)
    ]  # fmt: skip
    if problems:
        raise SceneError.from_problems(problems)


def _checked(pose: Pose) -> tuple[int, tuple[str, ...], list[str]]:
    """Number of rows that repeat others, elements with reactions in doubt, and notes.

    Raises
    ------
    AssemblyError
        Motions that no driver fixes, or drivers that contradict each other or the joints.
    """
    compiled, model, state = pose.compiled, pose.model, pose.state
    held = [body.name for body in compiled.layout.bodies if body.m > 0]
    notes = [f"kinematics holds flexible bodies undeformed: {', '.join(held)}"] if held else []
    state.angles[:] = np.nan  # the first ones are those nearest to zero
    enter(compiled.system, state, pose.work, pose.path, EVALUATE)
    nc = compiled.layout.nc
    if compiled.layout.nv > LARGEST:
        return nc, (), notes
    found = decompose(compiled, pose.work)
    if found.rank < found.n:
        raise AssemblyError(free_motions(pose))
    if found.rank == nc:
        return 0, (), notes
    doubtful, told = redundant_reactions(compiled, model, state.q)
    if not doubtful:  # rows of which deformation would decide
        told.append(
            f"{nc - found.rank} of {nc} constraint equations repeat others: the motion is unique, "
            "the reactions there are not (the least ones are reported)"
        )
    return nc - found.rank, doubtful, [*notes, *told]


class _Rows:
    """Room for the rows of a chunk, and what they say of the quality of the whole."""

    def __init__(self, compiled: Compiled, model: Model, n: int) -> None:
        self.output = new_output(compiled.system, n, len(compiled.layout.channels))
        self.unread = False
        self.balance = Balance()
        self.drift = np.zeros(2)
        self.lifts = Lifts(compiled)
        self.poses = SingularPoses(compiled.layout, model)

    def block(self) -> OutputBlock:
        """The rows of the last chunk."""
        self.unread = False
        n = int(self.output.rows[0])
        rows = OutputBlock(*(np.array(table[:n]) for table in self.output[:-1]))
        if n:
            self.balance.add(rows.energy)
            self.lifts.see(rows)
            self.poses.add(rows)
            self.drift = np.maximum(self.drift, rows.drift.max(axis=0))
        return rows


def _points(
    prepared: PreparedSweep, rows: _Rows, sink: Sink, progress: Progress
) -> tuple[str, str]:
    """The loop over chunks; a failure or an interruption keeps everything until then."""
    settings, state = prepared.settings, prepared.state
    run = new_run(prepared.compiled.system, state, prepared.work, output=rows.output)
    points, status = settings.outputs + 1, float(method.FINE)
    try:
        while status == method.FINE and state.count[0]["outputs"] < points:
            rows.output.rows[0], rows.unread = 0, True
            n = len(rows.output.t)
            status = analyse_kinematics(run, prepared.path, settings, POINTS, n)
            sink.append(rows.block())
            done = float(state.count[0]["outputs"] / points)
            progress("kinematics", done, f"t = {state.t[0]:.4g} s")
    except KeyboardInterrupt:
        if rows.unread:
            sink.append(rows.block())
        return "stopped", f"stopped by the user at t = {state.t[0]:.6g} s"
    except FlexmbError as error:
        return "failed", str(error)
    if status != method.FINE:
        return "failed", sweep_reason(int(status), prepared)
    return "finished", ""


def _statistics(prepared: PreparedSweep, rows: _Rows) -> dict[str, float | int | str]:
    count, path = prepared.state.count[0], prepared.path.count[0]
    return {
        "points": int(count["outputs"]),
        "increments": int(count["steps"]),
        "halved_increments": int(count["failed"]),
        "newton_iterations": int(path["iterations"]),
        "factorisations": int(path["factorisations"]),
        "singular_poses_passed": int(path["singular_poses"]),
        "largest_position_drift": float(rows.drift[0]),
        "largest_velocity_drift": float(rows.drift[1]),
        "energy_balance_error": rows.balance.relative,
        **prepared.clock.seconds,
    }
