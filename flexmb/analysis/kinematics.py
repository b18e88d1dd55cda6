"""Kinematic analysis: the motion that joints and drivers fix, at every output time.

Nothing is integrated, so there is no drift and every point is exact within round-off. Reactions and
driving forces follow from the equations of motion (inverse dynamics). Flexible bodies keep their
undeformed shape. If joints and drivers do not, or no longer, fix the motion, the analysis is
refused with one sentence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmb.analysis.assembly.gaps import moved_notes
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
from flexmb.analysis.assembly.positions import Corrector, assembly_weights, close_positions
from flexmb.analysis.chunked_run import (
    ChunkRows,
    Ending,
    Outcome,
    PhaseTimer,
    Sink,
    assemble_first_state,
    run_chunks,
)
from flexmb.analysis.mobility.degrees_of_freedom import redundancy_note, redundant_reactions
from flexmb.analysis.mobility.driver_conflicts import driver_reasons
from flexmb.analysis.monitors import (
    ContactLossMonitor,
    SingularOrientationMonitor,
    algebraic_loop_notes,
)
from flexmb.analysis.singular_poses import (
    KinematicPose,
    call_kinematics,
    free_motion_sentence,
    kinematics_failure_sentence,
    singular_pose_notes,
)
from flexmb.analysis.validity.linear_elasticity import LinearElasticityMonitor, flexible_columns
from flexmb.engine import method
from flexmb.engine.allocation import new_path, new_run, new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import analyse_kinematics, kinematics_units, stage_solver
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.kinematics_loop import CORRECT, EVALUATE, POINTS
from flexmb.engine.kinematics_point import KinematicsSettings
from flexmb.engine.state import State
from flexmb.errors import AssemblyError, Problem, SceneError
from flexmb.model.flexible_body import stretches
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results.output_block import OutputBlock
from flexmb.results.result import NOT_UNIQUE

_CHUNK_WORK = 200_000  # points of a chunk times velocity coordinates: 0.1 to 0.2 s
_DEFLECTION_ROWS = 100  # largest number of rows of a chunk at which deflections are estimated
_GAP_TOLERANCE = 1e-14  # weighted gap that is round-off, for a model near the origin


@dataclass(frozen=True)
class PreparedKinematics:
    """A kinematic analysis that is ready to run."""

    pose: KinematicPose
    settings: KinematicsSettings
    timer: PhaseTimer
    notes: tuple[str, ...]
    not_unique: tuple[str, ...]  # joints and drivers whose reactions are not unique

    @property
    def points(self) -> int:
        """Number of output points."""
        return self.settings.outputs + 1


def prepare_kinematics(
    compiled: Compiled, model: Model, *, progress: Progress = silent
) -> PreparedKinematics:
    """Load the compiled units, close the first pose and check that the motion is fixed.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.kinematics` must be there.
    progress : Progress
        Receives the phases `load` or `compile`, and `assemble`.

    Raises
    ------
    SceneError
        The model has no section `kinematics`.
    AssemblyError
        Joints that cannot be closed, motions that no driver fixes, or drivers that contradict each
        other or the joints.
    """
    spec = model.kinematics
    if spec is None:
        raise SceneError("the scene has no [kinematics]: give its duration")
    _refuse_states(model)

    def first_state() -> tuple[KinematicPose, int, tuple[str, ...], list[str]]:
        pose, moved = _first_pose(compiled, model)
        redundant, not_unique, notes = _check_motion(pose)
        return pose, redundant, not_unique, [*moved, *notes]

    units = kinematics_units(compiled.system)
    first, timer = assemble_first_state(compiled, units, first_state, progress)
    pose, redundant, not_unique, notes = first
    settings = KinematicsSettings(
        start=0.0,
        interval=spec.duration / spec.outputs,
        outputs=spec.outputs,
        gap=_GAP_TOLERANCE * max(1.0, float(np.abs(pose.state.q).max()) / compiled.length),
        redundant=redundant,
    )
    return PreparedKinematics(
        pose, settings, timer, (*notes, *algebraic_loop_notes(model)), not_unique
    )


def run_kinematics(
    prepared: PreparedKinematics, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Compute all output times of a prepared analysis.

    Parameters
    ----------
    prepared : PreparedKinematics
        From `prepare_kinematics`; used once.
    sink : Sink
        Takes the output rows.
    progress : Progress
        Receives the phase `kinematics`.
    """
    run = _Run(prepared, sink)
    ending = run_chunks(run, progress)
    prepared.timer.lap("kinematics")
    notes = (
        *prepared.notes,
        *singular_pose_notes(prepared.pose),
        *run.deflection.notes(),
        *run.contact_loss.notes(),
        *run.orientations.notes(),
    )
    statistics = run.statistics() | prepared.timer.seconds
    if prepared.not_unique:
        statistics[NOT_UNIQUE] = ", ".join(prepared.not_unique)
    return Outcome(ending.status, ending.message, statistics, notes)


def kinematics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Prepare and run; see :func:`prepare_kinematics` and :func:`run_kinematics`."""
    prepared = prepare_kinematics(compiled, model, progress=progress)
    return run_kinematics(prepared, sink, progress=progress)


def _refuse_states(model: Model) -> None:
    """Refuse scalar states: they depend on the past, which a kinematic analysis does not have."""
    what = (
        "is integrated, which a kinematic analysis does not do; leave it out, or run the scene "
        "with [dynamics]"
    )
    names = [f"states.{name}" for name in model.states]
    names += [f"controllers.{name}" for name in model.controllers]
    if names:
        raise SceneError.from_problems([Problem(name, what) for name in names])


def _first_pose(compiled: Compiled, model: Model) -> tuple[KinematicPose, list[str]]:
    """The closed first positions, with the least change in lengths and angles times body weights.

    Also returns notes on the bodies that had to move.
    """
    weights, channels = assembly_weights(model), len(compiled.layout.channels)
    state, work = new_state(compiled.system, channels), new_work(compiled.system, channels)
    state.q[:] = compiled.initial_q

    def make(of: Compiled, at: State) -> Corrector:
        system = of.system
        path = new_path(system)
        scratch = work if at is state else new_work(system, len(at.angles))
        for body, weight in zip(system.parts.bodies, weights, strict=True):
            path.metric[body["iv"] : body["iv"] + 6 + body["m"]] *= weight
        return Corrector(
            scratch,
            lambda: call_kinematics(system, at, scratch, path, CORRECT),
            lambda: call_kinematics(system, at, scratch, path, EVALUATE),
        )

    with driver_reasons(compiled, model):
        moved = close_positions(compiled, model, state, make)
    pose = KinematicPose(compiled, model, state, work, new_path(compiled.system))
    return pose, moved_notes(moved, model.units)


def _check_motion(pose: KinematicPose) -> tuple[int, tuple[str, ...], list[str]]:
    """Number of redundant rows, elements whose reactions are not unique, and notes.

    Raises
    ------
    AssemblyError
        Motions that no driver fixes, or drivers that contradict each other or the joints.
    """
    compiled, state, nc = pose.compiled, pose.state, pose.compiled.layout.nc
    state.angles[:] = np.nan  # the first ones are those nearest to zero
    call_kinematics(compiled.system, state, pose.work, pose.path, EVALUATE)
    if compiled.layout.nv > MAX_COORDINATES:
        return nc, (), []
    jacobian = pose.jacobian()
    if jacobian.decomposition.rank < jacobian.A.shape[1]:
        raise AssemblyError(free_motion_sentence(pose))
    count = nc - jacobian.decomposition.rank
    if not count:
        return 0, (), []
    not_unique, more = redundant_reactions(compiled, pose.model, state.q)
    if not not_unique:  # redundant rows whose reactions depend on deformation
        more.append(redundancy_note(count, nc))
    return count, not_unique, more


class _StaticDeflection:
    """Static deflection of flexible bodies by the forces that keep them undeformed.

    The forces are the residual r of the modal rows, with inertia, loads and reactions: η = −K⁻¹ r,
    less what membrane forces take of it.
    """

    def __init__(self, pose: KinematicPose) -> None:
        compiled, self._units = pose.compiled, pose.model.units
        self._bodies = [
            (columns, body, stretches(pose.model.bodies[columns.name]))
            for columns, body in flexible_columns(compiled)
        ]
        self._monitor = LinearElasticityMonitor(compiled, pose.model, pose.state.q)
        self._state = new_state(compiled.system, len(compiled.layout.channels))
        self._work = new_work(compiled.system, len(compiled.layout.channels))
        self._solve = stage_solver(compiled.system, self._state, self._work)

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows, or a uniform selection of at most `_DEFLECTION_ROWS`."""
        if not self._bodies or not len(rows.t):
            return
        rows = rows.rows(np.arange(len(rows.t)) % -(-len(rows.t) // _DEFLECTION_ROWS) == 0)
        q = rows.q.copy()
        for k, t in enumerate(rows.t):
            self._state.t[0] = t
            for name in ("q", "v", "vd", "lam"):
                getattr(self._state, name)[:] = getattr(rows, name)[k]
            self._solve(RESIDUAL)
            for columns, body, has_membrane_forces in self._bodies:
                first, place = columns.iv + 6, columns.iq + 7
                C = np.asarray(np.linalg.inv(body.K), float)
                eta = -C @ self._work.trial.res[first : first + body.m]
                membrane = body.membrane_stiffness if has_membrane_forces else None
                if membrane is not None and eta.any():
                    balanced = membrane.equilibrium(eta, C)
                    eta = eta if balanced is None else balanced
                q[k, place : place + body.m] = eta
        self._monitor.add(replace(rows, q=q))

    def notes(self) -> list[str]:
        """A sentence on each body, with its deflection if that is known."""
        notes = []
        for one in self._monitor.indicators():
            if one.quantity == "deflection":
                time = self._units.say(one.time, "s", 4)
                bends = (
                    ": its loads and its inertia would bend it by "
                    f"{one.value:.2g} of its length (statically, t = {time})"
                ) if one.value > 0.0 else ""  # fmt: skip
                notes.append(
                    f"kinematics keeps bodies.{one.body} undeformed{bends}; run the scene with "
                    "[dynamics] for the motion with deformation"
                )
        return notes


class _Run:
    """A kinematic analysis while it runs."""

    phase = "kinematics"

    def __init__(self, prepared: PreparedKinematics, sink: Sink) -> None:
        pose = prepared.pose
        self._prepared, self._sink, self._state = prepared, sink, pose.state
        n = min(prepared.points, max(1, _CHUNK_WORK // pose.compiled.layout.nv))
        self._rows = ChunkRows(pose.compiled, n)
        self._run = new_run(pose.compiled.system, pose.state, pose.work, output=self._rows.output)
        self.contact_loss = ContactLossMonitor(pose.compiled)
        self.deflection = _StaticDeflection(pose)
        self.orientations = SingularOrientationMonitor(pose.compiled.layout, pose.model)

    @property
    def time(self) -> float:
        return float(self._state.t[0])

    @property
    def share_done(self) -> float:
        return float(self._state.count[0]["outputs"] / self._prepared.points)

    def next_chunk(self) -> Ending | None:
        prepared, n = self._prepared, len(self._rows.output.t)
        self._rows.clear()
        path, settings = prepared.pose.path, prepared.settings
        status = analyse_kinematics(self._run, path, settings, POINTS, n)
        self.store_unread()
        if status == method.SUCCESS:
            return None
        return Ending("failed", kinematics_failure_sentence(int(status), prepared.pose, settings))

    def store_unread(self) -> None:
        if self._rows.unread:
            rows = self._rows.read()
            self.contact_loss.add(rows)
            self.deflection.add(rows)
            self.orientations.add(rows)
            self._sink.append(rows.in_global_frame(self._prepared.pose.compiled.layout))

    def statistics(self) -> dict[str, float | int | str]:
        """Numbers for the summary."""
        count, path = self._state.count[0], self._prepared.pose.path.count[0]
        return {
            "points": int(count["outputs"]),
            "increments": int(count["steps"]),
            "halved_increments": int(count["failed"]),
            "newton_iterations": int(path["iterations"]),
            "factorisations": int(path["factorisations"]),
            "singular_poses_passed": int(path["singular_poses"]),
            "largest_position_drift": float(self._rows.largest_drift[0]),
            "largest_velocity_drift": float(self._rows.largest_drift[1]),
            "largest_speed": float(self._rows.largest_drift[2]),
            "energy_balance_error": self._rows.balance.relative,
        }
