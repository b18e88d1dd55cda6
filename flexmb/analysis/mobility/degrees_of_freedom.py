"""Mobility of a mechanism: coordinates, equations, rank, redundant equations.

In: a compiled model. Out: :class:`Mobility`, from the rank of the constraint Jacobian in the
assembled pose and in nearby poses along the free motions. An equation that is redundant in all of
them is always redundant; otherwise the assembled pose is singular. No code is compiled for this.
Degrees of freedom δ = coordinates − rank (Hong & Liu 2011, sections 1.3, 2.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexmb.analysis.assembly.gaps import assembly_notes, joint_gaps
from flexmb.analysis.assembly.initial_state import velocity_notes
from flexmb.analysis.assembly.jacobian import (
    ConstraintPose,
    ConstraintRows,
    element,
    joint_rows,
    one_blas_thread,
    plain_name,
)
from flexmb.analysis.assembly.positions import (
    assembly_weights,
    close_positions,
    length_corrector,
    nearby_poses,
)
from flexmb.analysis.mobility.driver_conflicts import (
    driver_notes,
    driver_reasons,
    lock_of_inexact_parts,
)
from flexmb.analysis.mobility.free_motions import FreeMotion, free_motions
from flexmb.analysis.mobility.infinitesimal_motion import infinitesimal_motion
from flexmb.analysis.mobility.redundancy import (
    Redundancy,
    Undetermined,
    redundancies,
    undetermined_reactions,
)
from flexmb.engine.allocation import new_state
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model


@dataclass(frozen=True)
class Equations:
    """A joint, coupler or driver: its scene path, its type, and its number of equations.

    An equation that defines a scalar coordinate, such as the position along a curve, is not
    counted, and neither is this coordinate.
    """

    path: str
    type: str
    count: int


@dataclass(frozen=True)
class Mobility:
    """Mobility of a model with all its drivers, as `flexmb check` reports it.

    ``coordinates`` is the number of those of the bodies, including modes. ``rank`` is that of all
    equations, ``joint_rank`` that without drivers, both in the assembled pose; ``generic_rank`` is
    that of the joints in nearby poses. ``as_rigid`` is the number of equations of joints that would
    be redundant without modes. ``notes`` are sentences for the user; ``lock`` is the sentence for
    rigid bodies that are locked only by inexact axes or places, or "".
    """

    bodies: int
    planar: bool
    coordinates: int
    modes: int
    equations: tuple[Equations, ...]
    rank: int
    joint_rank: int
    generic_rank: int
    redundancies: tuple[Redundancy, ...]
    undetermined: tuple[Undetermined, ...]
    motions: tuple[FreeMotion, ...]
    as_rigid: int
    notes: tuple[str, ...]
    lock: str = ""

    @property
    def count(self) -> int:
        """Number s of all equations."""
        return sum(row.count for row in self.equations)

    @property
    def drivers(self) -> int:
        """Number of the drivers' equations."""
        return sum(row.count for row in self.equations if row.path.startswith("drivers."))

    @property
    def delta(self) -> int:
        """Degrees of freedom that joints and drivers leave."""
        return self.coordinates - self.rank

    @property
    def delta_without_drivers(self) -> int:
        """Degrees of freedom that the joints leave."""
        return self.coordinates - self.joint_rank

    @property
    def redundant(self) -> int:
        """Equations of joints and drivers that repeat others."""
        return self.count - self.rank

    @property
    def singular(self) -> bool:
        """Whether more equations depend on each other in the assembled pose than nearby."""
        return self.joint_rank < self.generic_rank


@one_blas_thread()
def mobility_of(compiled: Compiled, model: Model) -> Mobility:
    """The mobility of a compiled model.

    Parameters
    ----------
    compiled : Compiled
        The compiled model, with at most `jacobian.MAX_COORDINATES` coordinates.
    model : Model
        The model.

    Raises
    ------
    AssemblyError
        It cannot be assembled, is on a wrong branch, or its drivers contradict each other or the
        joints.
    """
    pose, moves = _assembled_pose(compiled, model)
    jacobian = pose.jacobian
    constraints = ConstraintRows(compiled)
    taut = infinitesimal_motion(constraints, pose)
    notes = [*moves, *driver_notes(model, pose), *([] if taut is None else [taut.sentence])]
    notes += velocity_notes(compiled, model, pose.q) if model.dynamics is not None else []
    others = nearby_poses(constraints, pose, joint_rows(compiled))
    ranks = [one.jacobian.joint_decomposition.rank for one in (pose, *others)]
    regular, *elsewhere = [
        one for one, rank in zip((pose, *others), ranks, strict=True) if rank == max(ranks)
    ]
    n_scalars, n_joint_rows = int(np.sum(jacobian.scalar)), int(np.sum(~jacobian.driven))
    mobility = Mobility(
        bodies=len(model.bodies),
        planar=model.plane is not None,
        coordinates=jacobian.A.shape[1] - n_scalars,
        modes=int(np.sum(jacobian.modal)),
        equations=_equations(model, pose),
        rank=jacobian.decomposition.rank - n_scalars,
        joint_rank=ranks[0] - n_scalars,
        generic_rank=max(ranks) - n_scalars,
        redundancies=redundancies(model, regular, elsewhere),
        undetermined=undetermined_reactions((elsewhere or [regular])[0]),
        motions=free_motions(model, regular, elsewhere),
        as_rigid=n_joint_rows - jacobian.without_modes().joint_decomposition.rank,
        notes=(),
        lock=lock_of_inexact_parts(model, pose),
    )
    return replace(mobility, notes=(*notes, *_notes(model, pose, mobility)))


@one_blas_thread()
def redundant_reactions(
    compiled: Compiled, model: Model, q: Array, first: State | None = None
) -> tuple[tuple[str, ...], list[str]]:
    """Joints and drivers whose reactions are not unique in a closed pose, and notes about them.

    `first` is the initial state of a run from this pose.

    Raises
    ------
    AssemblyError
        Drivers contradict each other or the joints, nothing moves because axes or places are
        slightly off, or the state moves along motions that are infinitesimal.
    """
    constraints = ConstraintRows(compiled)
    pose = constraints.evaluate(q)
    notes = driver_notes(model, pose)
    if lock := lock_of_inexact_parts(model, pose):
        raise AssemblyError(lock)
    count = len(pose.C) - pose.jacobian.decomposition.rank
    if not count:
        return (), notes
    if (taut := infinitesimal_motion(constraints, pose)) is not None:
        if first is not None and taut.is_begun(pose, first):
            raise AssemblyError(f"at the start {taut.sentence}")
        notes.append(taut.sentence)
    joints = tuple(reaction.path for reaction in undetermined_reactions(pose))
    notes.append(redundancy_note(count, len(pose.C), [plain_name(path) for path in joints]))
    return joints, notes


def redundancy_note(count: int, equations: int, joints: Sequence[str] = ()) -> str:
    """The note on redundant constraint equations, at these joints if they are known."""
    where, cure = "those reactions", ""
    if joints:
        where = f"the reactions at {', '.join(joints)}"
        cure = "; flexmb check tells which exchange of joints cures it"
    return (
        f"{count} of {equations} constraint equations are redundant: the motion is unique, {where} "
        f"are not (the minimum-norm ones are reported){cure}"
    )


def _assembled_pose(compiled: Compiled, model: Model) -> tuple[ConstraintPose, list[str]]:
    """The closed pose, and notes on what moved to close it; an error with the reason if none."""
    state = new_state(compiled.system, len(compiled.layout.channels))
    state.q[:] = compiled.initial_q
    weights = assembly_weights(model)
    start = length_corrector(compiled, state, weights)
    start.evaluate()
    gaps = joint_gaps(compiled, start.work)
    with driver_reasons(compiled, model):
        moved = close_positions(
            compiled, model, state, lambda of, at: length_corrector(of, at, weights)
        )
    return ConstraintRows(compiled).evaluate(state.q), assembly_notes(gaps, moved, model.units)


def _equations(model: Model, pose: ConstraintPose) -> tuple[Equations, ...]:
    """Number of equations of each joint, coupler and driver, less its own scalar coordinates."""
    scalars = [element(name) for name in pose.compiled.layout.coordinates]
    rows = [element(path) for path in pose.jacobian.owners]
    equations = []
    for path in dict.fromkeys(rows):
        section, _, name = path.partition(".")
        spec = getattr(model, section)[name]
        kind = getattr(spec, "type", None) or ", ".join(m.coordinate for m in spec.motions())
        count = rows.count(path) - scalars.count(path)
        if count:
            equations.append(Equations(path, kind, count))
    return tuple(equations)


def _notes(model: Model, pose: ConstraintPose, mobility: Mobility) -> list[str]:
    """Notes on a singular pose, and on redundancy that flexibility removes."""
    notes = []
    if mobility.singular:
        more = mobility.generic_rank - mobility.joint_rank
        notes.append(
            f"the assembled pose is singular: {_number(more, 'equation')} of the joints "
            f"{'is' if more == 1 else 'are'} redundant here and not nearby, and the motion may "
            "branch; begin in another pose"
        )
    absorbed = mobility.as_rigid - (mobility.count - mobility.drivers - mobility.joint_rank)
    if mobility.modes and absorbed > 0:
        notes.append(
            f"with rigid bodies {_number(mobility.as_rigid, 'equation')} of the joints would be "
            f"redundant; modes of the flexible bodies take up {absorbed}, so that the reactions "
            "there follow from the elasticity"
        )
    return notes


def _number(count: int, thing: str) -> str:
    return f"{count} {thing}{'s' * (count != 1)}"
