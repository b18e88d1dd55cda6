"""Mobility of a mechanism: coordinates, equations, rank, what repeats, what is free, what is wrong.

In: a compiled model. Out: :class:`Mobility`, from the rank of the constraint Jacobian in the
assembled pose and in others a short way along the free motions, which tell an equation that is
always redundant from a pose that is singular. Nothing is compiled for it. Degrees of freedom δ =
coordinates − rank (Hong & Liu 2011, sections 1.3, 2.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.closing import body_weights, close_positions
from flexmb.analysis.assembly.gaps import gaps, opened
from flexmb.analysis.mobility.conflicts import (
    driver_notes,
    driver_problems,
    is_locked,
    locked_sentence,
)
from flexmb.analysis.mobility.dependence import Dependence, dependence
from flexmb.analysis.mobility.freedoms import FreeMotion, free_motions_of
from flexmb.analysis.mobility.poses import Closed, closer_of, joint_rows, other_poses
from flexmb.analysis.mobility.rank import LARGEST, one_blas_thread
from flexmb.analysis.mobility.redundancy import (
    Redundancy,
    Undetermined,
    redundancies,
    undetermined,
)
from flexmb.analysis.mobility.rows import ConstraintRows
from flexmb.analysis.mobility.weighted import Weighted, element, plain_name, weighted
from flexmb.engine.compile import Compiled
from flexmb.engine.work import new_state
from flexmb.errors import AssemblyError
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.model import Model

__all__ = ["LARGEST", "Equations", "Mobility", "examine", "redundant_reactions"]


@dataclass(frozen=True)
class Equations:
    """A joint, coupler or driver: its scene path, its type, and the equations it brings.

    Those that say what a scalar coordinate beside the bodies is, such as the place along a curve,
    are not counted, and neither are such coordinates.
    """

    path: str
    type: str
    count: int


@dataclass(frozen=True)
class Mobility:
    """What `flexmb check` tells of the motions of a model, with all its drivers.

    ``coordinates`` are those of the bodies, modes among them;
    ``rank`` that of all equations, ``joint_rank`` without drivers, both in the assembled pose;
    ``generic_rank`` the joints' in poses nearby. ``as_rigid`` is the number of redundant equations
    that there would be without modes. ``notes`` are sentences for the user.
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
def examine(compiled: Compiled, model: Model) -> Mobility:
    """The mobility of a compiled model.

    Parameters
    ----------
    compiled : Compiled
        The compiled model, of `LARGEST` coordinates at most.
    model : Model
        The model.

    Raises
    ------
    AssemblyError
        It cannot be assembled, is on a wrong branch, or its drivers contradict each other or the
        joints.
    """
    pose, moved = _assembled(compiled, model)
    found = weighted(compiled, pose)
    here = found.joint_dependence
    notes = driver_notes(compiled, model, found)
    joints = joint_rows(compiled)
    others = other_poses(ConstraintRows(compiled), pose, joints)
    nearby = [weighted(compiled, other) for other in others]
    poses = [(found, here), *((other, other.joint_dependence) for other in nearby)]
    generic = max(told.rank for _, told in poses)
    (chosen, told), *rest = [pair for pair in poses if pair[1].rank == generic]
    elsewhere = [other for other, _ in rest]
    own = int(np.sum(found.scalar))
    mobility = Mobility(
        bodies=len(model.bodies),
        planar=model.plane is not None,
        coordinates=found.A.shape[1] - own,
        modes=int(np.sum(found.modal)),
        equations=_equations(model, found),
        rank=found.dependence.rank - own,
        joint_rank=here.rank - own,
        generic_rank=generic - own,
        redundancies=redundancies(model, chosen, told.circuits, elsewhere),
        undetermined=_reactions_in_doubt((elsewhere or [chosen])[0]),
        motions=free_motions_of(model, chosen, elsewhere),
        as_rigid=_redundant_if_rigid(found, here),
        notes=(),
    )
    return replace(mobility, notes=(*moved, *notes, *_notes(model, found, here, mobility)))


def _reactions_in_doubt(found: Weighted) -> tuple[Undetermined, ...]:
    """The reactions, drivers' too, that redundant equations leave undetermined in a pose."""
    return undetermined(found, found.dependence.circuits)


@one_blas_thread()
def redundant_reactions(
    compiled: Compiled, model: Model, q: NDArray[np.float64]
) -> tuple[tuple[str, ...], list[str]]:
    """Joints and drivers whose reactions are not unique in a closed pose, and notes on that.

    Raises
    ------
    AssemblyError
        Drivers contradict each other or the joints.
    """
    rows = ConstraintRows(compiled).at(q)
    found = weighted(compiled, Closed(q, rows, True))
    notes = driver_notes(compiled, model, found)
    doubtful = tuple(told.path for told in _reactions_in_doubt(found))
    redundant = len(found.A) - found.dependence.rank
    if not redundant:
        return (), notes
    names = ", ".join(plain_name(path) for path in doubtful)
    notes.append(
        f"{redundant} of {len(found.A)} equations repeat others: the motion is unique, the "
        f"reactions are not at {names} (the least ones are reported); flexmb check tells which "
        "exchange of joints cures it"
    )
    return doubtful, notes


def _assembled(compiled: Compiled, model: Model) -> tuple[Closed, list[str]]:
    """The closed pose, and what had to move for it; or the reason why there is none."""
    state = new_state(compiled.system, len(compiled.layout.channels))
    state.q[:] = compiled.placed
    weights = body_weights(model)
    placed = closer_of(compiled, state, weights)
    placed.evaluate()
    open_as_placed = tuple(gaps(compiled, placed.work))
    try:
        moved = close_positions(compiled, model, state, lambda of, at: closer_of(of, at, weights))
    except AssemblyError as error:
        problems = driver_problems(compiled, model, error.problems)
        raise AssemblyError.from_problems(problems) from None
    told = opened(open_as_placed, moved, model.units)
    return Closed(state.q.copy(), ConstraintRows(compiled).at(state.q), True), told


def _equations(model: Model, found: Weighted) -> tuple[Equations, ...]:
    """Equations by what brings them; scalar coordinates of its own take one each."""
    own = [element(name) for name in found.compiled.layout.coordinates]
    rows = [element(path) for path in found.owners]
    told = []
    for path in dict.fromkeys(rows):
        section, _, name = path.partition(".")
        spec = getattr(model, section)[name]
        kind = getattr(spec, "type", None) or _driven(spec)
        count = rows.count(path) - own.count(path)
        if count:
            told.append(Equations(path, kind, count))
    return tuple(told)


def _driven(spec: DriverSpec) -> str:
    """The coordinates a driver prescribes."""
    return ", ".join(motion.coordinate for motion in spec.motions())


def _redundant_if_rigid(found: Weighted, here: Dependence) -> int:
    """Redundant equations of the joints if no body could deform."""
    A = found.A[~found.driven]
    rank = dependence(A[:, ~found.modal]).rank if np.any(found.modal) else here.rank
    return len(A) - rank


def _notes(model: Model, found: Weighted, here: Dependence, told: Mobility) -> list[str]:
    """What the user should know of a mechanism that can be assembled."""
    notes = []
    flexible = any(spec.flexible for spec in model.bodies.values())
    if is_locked(found, here) and not told.drivers and not flexible:
        notes.append(locked_sentence(model, found, here))
    if told.singular:
        more = told.generic_rank - told.joint_rank
        notes.append(
            f"the assembled pose is singular: {_number(more, 'equation')} of the joints repeat "
            "others here and not nearby, and the motion may branch; begin in another pose"
        )
    taken = told.as_rigid - (told.count - told.drivers - told.joint_rank)
    if told.modes and taken > 0:
        notes.append(
            f"with rigid bodies {_number(told.as_rigid, 'equation')} of the joints would be "
            f"redundant; modes of the flexible bodies take up {taken}, so that the reactions there "
            "follow from the elasticity"
        )
    return notes


def _number(count: int, thing: str) -> str:
    return f"{count} {thing}{'s' * (count != 1)}"
