"""Inverse dynamics along a motion: forces of drives and all reactions, without integration.

In: positions, velocities and accelerations of all bodies over time, from any run, and a model with
a driver on every joint coordinate that is to be moved. Out: λ of Cqᵀ λ = Q − M v̇, row by row. The
functions of the drivers are not used; the motion is that of the run. The forces are those of joints
and drives; a residual shows that the motion needs other forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, joint_rows
from flexmb.analysis.chunked_run import ChunkRows, Ending, Outcome, PhaseTimer, Sink, run_chunks
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.analysis.singular_poses import (
    KinematicPose,
    call_kinematics,
    free_motion_sentence,
    holders,
)
from flexmb.engine import method
from flexmb.engine.allocation import new_path, new_run, new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import kinematics_units
from flexmb.engine.compiled_units import call, packed_record, prepare_units
from flexmb.engine.kinematics_loop import EVALUATE
from flexmb.engine.state_rows import write_reactions
from flexmb.engine.status_messages import status_message
from flexmb.errors import AssemblyError, ResultFileError
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results import Result
from flexmb.results.result import NOT_UNIQUE

_CHUNK = 200  # rows
_UNBALANCED_FORCE = 1e-6  # residual force over the largest force above which there is a note
_REPORTED_GAP = (
    1e-5  # gap of a joint over the size of the model that is larger than errors of a run
)
_SINGULAR = 1e-5  # least pivot of a row over that without other rows at a singular pose
# Least singular value over the next one near a singular pose; number of poses examined.
_NEARLY_SINGULAR, _JUDGED_ROWS = 0.02, 8


@dataclass(frozen=True)
class PreparedInverse:
    """Inverse dynamics that is ready to run."""

    pose: KinematicPose
    motion: tuple[np.ndarray, ...]  # t (n,), q (n, nq), v, vd (n, nv) of the model's coordinates
    timer: PhaseTimer
    notes: tuple[str, ...]
    not_unique: tuple[str, ...]


def prepare_inverse(
    compiled: Compiled, model: Model, motion: Result, *, progress: Progress = silent
) -> PreparedInverse:
    """Match a motion with a model and check that its drivers can produce it.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model with a driver on every coordinate that is moved.
    motion : Result
        A run with the same bodies and modes.
    progress : Progress
        Receives the phases `load` or `compile`.

    Raises
    ------
    ResultFileError
        The run has other bodies, or no accelerations.
    AssemblyError
        Motions that no driver moves.
    """
    timer = PhaseTimer()
    system = compiled.system
    units = [*kinematics_units(system), write_reactions]
    timer.lap("compile" if prepare_units(units, progress) else "load")
    rows = match_motion(compiled, motion)
    channels = len(compiled.layout.channels)
    state, work, path = new_state(system, channels), new_work(system, channels), new_path(system)
    pose = KinematicPose(compiled, model, state, work, path)
    _put_row(pose, rows, 0)
    state.angles[:] = np.nan
    call_kinematics(system, state, work, path, EVALUATE)
    jacobian = pose.jacobian()
    if jacobian.decomposition.rank < jacobian.A.shape[1]:
        raise AssemblyError(free_motion_sentence(pose, "inverse dynamics"))
    not_unique: tuple[str, ...] = ()
    notes: list[str] = []
    if jacobian.decomposition.rank < compiled.layout.nc:
        not_unique, notes = redundant_reactions(compiled, model, state.q)
    timer.lap("assemble")
    return PreparedInverse(pose, rows, timer, tuple(notes), not_unique)


def match_motion(compiled: Compiled, motion: Result) -> tuple[np.ndarray, ...]:
    """t (n,), q (n, nq), v and vd (n, nv) of a run, in the coordinates of a model.

    Raises
    ------
    ResultFileError
        Other bodies or modes, a coordinate that the run does not have, or no rows.
    """
    if not len(motion.time):
        raise ResultFileError(f"{motion.path}: holds no output rows")
    mine, theirs = compiled.layout, motion.layout
    of_model = [(body.name, body.m) for body in mine.bodies]
    of_run = [(body.name, body.m) for body in theirs.bodies]
    if of_model != of_run:
        words = [", ".join(f"{n} ({m} modes)" for n, m in each) for each in (of_model, of_run)]
        raise ResultFileError(
            f"{motion.path}: the run has other bodies than the model: {words[1]} in place of "
            f"{words[0]}"
        )
    missing = [name for name in mine.coordinates if name not in theirs.coordinates]
    if missing:
        what = f"the run has no {', '.join(missing)} of the model, whose turns and strokes are read"
        cure = "give its scene the same one; a spring with value = 0 alone does not act"
        raise ResultFileError(f"{motion.path}: {what}: {cure}")
    tables = []
    for table, width in ((motion.q, mine.nq), (motion.v, mine.nv), (motion.vd, mine.nv)):
        bodies = width - len(mine.coordinates)
        scalars = [bodies + theirs.coordinates.index(name) for name in mine.coordinates]
        tables.append(np.ascontiguousarray(table[:, [*range(bodies), *scalars]]))
    return motion.table("time"), *mine.of_equations(*tables)


def _put_row(pose: KinematicPose, rows: tuple[np.ndarray, ...], k: int) -> None:
    """Set the state to row k of a motion."""
    state = pose.state
    for values, table in zip((state.t, state.q, state.v, state.vd), rows, strict=True):
        values[:] = table[k]


def run_inverse(prepared: PreparedInverse, sink: Sink, *, progress: Progress = silent) -> Outcome:
    """Compute forces and reactions of all rows of a motion.

    Parameters
    ----------
    prepared : PreparedInverse
        From `prepare_inverse`; used once.
    sink : Sink
        Takes the output rows.
    progress : Progress
        Receives the phase `inverse dynamics`.
    """
    run = _Run(prepared, sink)
    ending = run_chunks(run, progress)
    prepared.timer.lap("inverse_dynamics")
    statistics: dict[str, float | int | str] = {
        "points": run.done,
        "largest_position_drift": float(run.rows.largest_drift[0]),
        **prepared.timer.seconds,
    }
    if prepared.not_unique:
        statistics[NOT_UNIQUE] = ", ".join(prepared.not_unique)
    return Outcome(ending.status, ending.message, statistics, (*prepared.notes, *run.notes()))


class _Run:
    """Inverse dynamics while it runs."""

    phase = "inverse dynamics"

    def __init__(self, prepared: PreparedInverse, sink: Sink) -> None:
        pose = prepared.pose
        self._prepared, self._sink = prepared, sink
        self.done = 0
        self._n = len(prepared.motion[0])
        self.rows = ChunkRows(pose.compiled, min(_CHUNK, self._n))
        self._run = packed_record(
            new_run(pose.compiled.system, pose.state, pose.work, output=self.rows.output)
        )
        self._quality, self._joints = np.zeros(3), joint_rows(pose.compiled)
        self._worst, self._pivots = (0.0, 0.0), np.full(self._n, np.inf)

    @property
    def time(self) -> float:
        return float(self._prepared.pose.state.t[0])

    @property
    def share_done(self) -> float:
        return self.done / self._n

    def next_chunk(self) -> Ending | None:
        prepared, pose = self._prepared, self._prepared.pose
        self.rows.clear()
        for _ in range(min(len(self.rows.output.t), self._n - self.done)):
            _put_row(pose, prepared.motion, self.done)
            status = call(write_reactions, self._run, pose.path.metric, self._quality)
            if status != method.SUCCESS:
                self.store_unread()
                return Ending("failed", status_message(status, pose.compiled, pose.work, self.time))
            # what drivers prescribe is not used
            gaps = pose.work.con.C[self._joints]
            self.rows.output.drift[self.rows.output.rows[0] - 1, 0] = np.abs(gaps).max(initial=0.0)
            left, largest, pivot = self._quality
            if left > self._worst[0] * max(largest, 1e-300) and pivot > _SINGULAR:
                self._worst = left / max(largest, 1e-300), self.time
            self._pivots[self.done] = pivot
            self.done += 1
        self.store_unread()
        return None

    def store_unread(self) -> None:
        if self.rows.unread:
            rows = self.rows.read()
            self._sink.append(rows.in_global_frame(self._prepared.pose.compiled.layout))

    def notes(self) -> list[str]:
        """Notes on the limits of the computed forces."""
        say, notes = self._prepared.pose.model.units.say, []
        gap, length = float(self.rows.largest_drift[0]), self._prepared.pose.compiled.length
        if gap > _REPORTED_GAP * length:
            notes.append(
                "the motion does not meet the joints of the model: they gape by "
                f"{say(gap, 'm', 3)} (or rad), and the forces are those of the bodies there"
            )
        if self._worst[0] > _UNBALANCED_FORCE:
            notes.append(
                f"joints and drives cannot give {100 * self._worst[0]:.2g} % of the forces that "
                f"the motion needs, most at t = {say(self._worst[1], 's')}: a force of the run is "
                "not in the model"
            )
        word, pose = self._singular_pose()
        if word:
            notes.append(
                f"the motion {word} a singular pose at t = {pose.text(pose.time)}{holders(pose)}, "
                "where drives lose hold of it and their forces grow without bound: those near it "
                "are not to be trusted; drive another coordinate"
            )
        return notes

    def _singular_pose(self) -> tuple[str, KinematicPose]:
        """Whether the motion passes or nearly passes a singular pose, and that pose."""
        pose, order = self._prepared.pose, np.argsort(self._pivots)
        ratios = {int(row): 1.0 for row in (*order[:_JUDGED_ROWS], order[-1])}
        for row in ratios if pose.compiled.layout.nv <= MAX_COORDINATES else ():
            _put_row(pose, self._prepared.motion, row)
            jacobian = pose.jacobian()
            S, n = jacobian.decomposition.S, jacobian.A.shape[1]
            ratios[row] = float(S[n - 1] / S[n - 2]) if n > 1 else 1.0
        worst = min(ratios, key=ratios.__getitem__)
        near = ratios[worst] < min(_NEARLY_SINGULAR, 0.1 * ratios[int(order[-1])])
        row = int(self._pivots.argmin())
        passes = self._pivots[row] < _SINGULAR
        _put_row(pose, self._prepared.motion, row if passes else worst)
        return "passes" if passes else "comes near" if near else "", pose
