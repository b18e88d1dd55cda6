"""Mobility of a mechanism: coordinates, equations, rank, redundant equations, free motions.

In: a compiled model. Out: :class:`Mobility`, from the rank of the constraint Jacobian in the
assembled pose and in others a short way along the free motions, which tell an equation that is
always redundant from a pose that is singular. Nothing is compiled for it. Degrees of freedom δ =
coordinates − rank (Hong & Liu 2011, sections 1.3, 2.3). Free motions are those of each body, and of
each pair of bodies that a joint connects, that leave all others at rest, then the rest. A body that
moves by itself between others is idle: nothing else feels it, such as the spin of a rod between two
spherical joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.gaps import assembly_notes, joint_gaps
from flexmb.analysis.assembly.jacobian import (
    ConstraintPose,
    ConstraintRows,
    element,
    joint_rows,
    null_space,
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
from flexmb.analysis.mobility.infinitesimal_motion import infinitesimal_motion
from flexmb.analysis.mobility.redundancy import (
    Redundancy,
    Undetermined,
    redundancies,
    undetermined_reactions,
)
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.engine.tables import BodyColumns
from flexmb.engine.work import new_state
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array
from flexmb.model.markers import rotation_matrix
from flexmb.model.model import Model
from flexmb.model.reading import GROUND, split_reference

_ZERO_TOLERANCE = 1e-7
_LINE_TOLERANCE = 1e-6  # pitch and distance of a line, over the model size, that are round-off


@dataclass(frozen=True)
class Equations:
    """A joint, coupler or driver: its scene path, its type, and the equations it brings.

    Those that define a scalar coordinate, such as the place along a curve, are not counted, and
    neither are such coordinates.
    """

    path: str
    type: str
    count: int


@dataclass(frozen=True)
class FreeMotion:
    """`count` motions of some bodies that leave the others at rest; `sentence` says what moves."""

    bodies: tuple[str, ...]
    count: int
    idle: bool
    sentence: str


@dataclass(frozen=True)
class Mobility:
    """What `flexmb check` reports of the motions of a model, with all its drivers.

    ``coordinates`` are those of the bodies, modes among them;
    ``rank`` that of all equations, ``joint_rank`` without drivers, both in the assembled pose;
    ``generic_rank`` the joints' in poses nearby. ``as_rigid`` is the number of redundant equations
    that there would be without modes. ``notes`` are sentences for the user; ``lock`` is that of
    rigid bodies that nothing but inexact axes or places keeps from moving.
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
        The compiled model, of `rank.MAX_COORDINATES` coordinates at most.
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
    """Joints and drivers whose reactions are not unique in a closed pose, and notes on that;
    `first` is the state there of a run that is to begin.

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
    """The closed pose, and what had to move for it; or the reason why there is none."""
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
    """Equations by what brings them; scalar coordinates of its own take one each."""
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
    """What the user should know of a mechanism that can be assembled."""
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


def free_motions(
    model: Model, pose: ConstraintPose, others: Sequence[ConstraintPose] = ()
) -> tuple[FreeMotion, ...]:
    """The free motions of a pose, those of single bodies and pairs apart, idle ones marked.

    Bodies move by themselves if they do so in the `others` as well: at a dead point all else is at
    rest for a moment.
    """
    motions: list[FreeMotion] = []
    alone = np.zeros((len(pose.jacobian.columns), 0))
    for bodies in _parts(model, pose):
        mine = _alone(pose, bodies)
        if any(_alone(other, bodies).shape[1] < mine.shape[1] for other in others):
            continue
        fresh = _outside(mine, alone)
        if fresh.shape[1]:
            alone = np.hstack([alone, fresh])
            motions.append(_motion(model, pose, bodies, fresh))
    left = pose.jacobian.decomposition.free.shape[1] - alone.shape[1]
    if left > 0:
        layout = pose.compiled.layout.bodies
        apart = [[body for body in layout if body.name in one.bodies] for one in motions]
        moving = {name for one in (pose, *others) for name in _moving(one, apart)}
        names = tuple(body.name for body in layout if body.name in moving)
        what = "motion moves" if left == 1 else "motions move"
        motions.append(FreeMotion(names, left, False, f"{left} {what} {', '.join(names)}"))
    return tuple(motions)


def _moving(pose: ConstraintPose, apart: list[list[BodyColumns]]) -> list[str]:
    """Bodies that move in a pose, apart from motions that some make by themselves."""
    alone = np.zeros((len(pose.jacobian.columns), 0))
    for bodies in apart:
        alone = np.hstack([alone, _outside(_alone(pose, bodies), alone)])
    rest = _outside(pose.jacobian.decomposition.free, alone)
    size = np.abs(rest).max(axis=1, initial=0.0)
    return [
        body.name
        for body in pose.compiled.layout.bodies
        if size[_columns(pose, body)].max(initial=0.0) > _ZERO_TOLERANCE
    ]


def _parts(model: Model, pose: ConstraintPose) -> Iterator[tuple[BodyColumns, ...]]:
    """Single bodies, then pairs that a joint connects and that lie between others."""
    bodies = {body.name: body for body in pose.compiled.layout.bodies}
    for body in bodies.values():
        yield (body,)
    for joint in model.joints.values():
        pair = tuple(dict.fromkeys(_ends(joint.between)))
        if len(pair) == 2 and all(name in bodies for name in pair) and _between(model, pair):
            yield tuple(bodies[name] for name in pair)


def _ends(between: tuple[str, str]) -> tuple[str, str]:
    first, second = (split_reference(reference)[0] for reference in between)
    return first, second


def _neighbours(model: Model, bodies: tuple[str, ...]) -> list[str]:
    """What these bodies have joints with, ground too, a name for each joint."""
    ends = [_ends(joint.between) for joint in model.joints.values()]
    pairs = [(a, b) if a in bodies else (b, a) for a, b in ends if (a in bodies) != (b in bodies)]
    return [other for _, other in pairs]


def _between(model: Model, bodies: tuple[str, ...]) -> bool:
    """Whether these bodies lie between two joints or more, not all of them on ground."""
    others = _neighbours(model, bodies)
    return len(others) > 1 and any(other != GROUND for other in others)


def _columns(pose: ConstraintPose, body: BodyColumns) -> NDArray[np.bool_]:
    columns = pose.jacobian.columns
    return np.asarray((columns >= body.iv) & (columns < body.iv + 6 + body.m))


def _alone(pose: ConstraintPose, bodies: Sequence[BodyColumns]) -> Array:
    """(columns, k) motions of these bodies that leave all else at rest, deformations too."""
    inside = np.any([_columns(pose, body) for body in bodies], axis=0) & ~pose.jacobian.modal
    inside |= pose.jacobian.scalar  # what follows them moves along
    mine = null_space(pose.jacobian.A[:, inside], pose.jacobian.norm)
    motions = np.zeros((len(inside), mine.shape[1]))
    motions[inside] = mine
    return motions


def _outside(motions: Array, basis: Array) -> Array:
    """(columns, k) orthonormal part of motions outside of an orthonormal basis."""
    rest = motions - basis @ (basis.T @ motions)
    U, size, _ = np.linalg.svd(rest, full_matrices=False)
    return np.asarray(U[:, size > 1e-6])


def _motion(
    model: Model, pose: ConstraintPose, bodies: tuple[BodyColumns, ...], motions: Array
) -> FreeMotion:
    names, count = tuple(body.name for body in bodies), motions.shape[1]
    who = " and ".join(names) + (" together" if len(names) > 1 else "")
    if not _neighbours(model, names):
        sentence = f"{who} has no joint"
    elif count == 1:
        sentence = f"{who} can {_screw(model, pose, bodies, motions[:, 0])}"
    else:
        turns = int(np.linalg.matrix_rank(_twists(pose, bodies[0], motions)[:, 3:], tol=1e-6))
        numbers = ((turns, "turn"), (count - turns, "slide"))
        ways = ", ".join(_number(n, word) for n, word in numbers if n)
        sentence = f"{who} can move by {'themselves' if len(names) > 1 else 'itself'}: {ways}"
    return FreeMotion(names, count, _between(model, names), sentence)


def _twists(pose: ConstraintPose, body: BodyColumns, motions: Array) -> Array:
    """(k, 6) velocity of the body origin over the model size, and angular velocity, global."""
    v = np.zeros((pose.compiled.layout.nv, motions.shape[1]))
    v[pose.jacobian.columns] = motions
    A = rotation_matrix(pose.q[body.iq + 3 : body.iq + 7])
    return np.vstack([v[body.iv : body.iv + 3], A @ v[body.iv + 3 : body.iv + 6]]).T


def _screw(
    model: Model, pose: ConstraintPose, bodies: tuple[BodyColumns, ...], motion: Array
) -> str:
    """One motion as a turn about a line, a slide, or a screw motion."""
    length, body = pose.compiled.length, bodies[0]
    twist = _twists(pose, body, motion[:, None])[0]
    v, w = twist[:3], twist[3:]
    spin = float(np.linalg.norm(w))
    if spin < _ZERO_TOLERANCE:
        return f"slide along {_direction(v)}"
    r = pose.q[body.iq : body.iq + 3]
    point = r + length * np.cross(w, v) / spin**2
    about = _line(model, pose, {body.name for body in bodies}, point, w / spin)
    if abs(float(v @ w)) > _LINE_TOLERANCE * spin**2:
        return f"move as a screw about {about}"
    return f"turn about {about}"


def _line(model: Model, pose: ConstraintPose, bodies: set[str], point: Array, axis: Array) -> str:
    """The line by the joints of the bodies that it passes through, else by point and direction."""
    through = []
    for name, joint in model.joints.items():
        path, inside = f"joints.{name}", [end in bodies for end in _ends(joint.between)]
        if inside[0] != inside[1] and path in pose.jacobian.owners:
            xi, _, xj, _ = pose.markers_of(path)
            x = (xi if inside[0] else xj) * pose.compiled.length
            if np.linalg.norm(np.cross(x - point, axis)) < _LINE_TOLERANCE * pose.compiled.length:
                through.append(name)
    if len(through) > 1:
        return f"the line through its joints {' and '.join(through)}"
    if through:
        return f"{_direction(axis)} through its joint {through[0]}"
    noise = _ZERO_TOLERANCE * pose.compiled.length
    rounded = (float(c) if abs(c) > noise else 0.0 for c in point)
    place = ", ".join(f"{model.units.outward(c, 'm'):.4g}" for c in rounded)
    return f"{_direction(axis)} through ({place}) {model.units.label('m')}"


def _direction(u: Array) -> str:
    """A direction by its global axis, or by its components."""
    u = u / np.linalg.norm(u)
    k = int(np.argmax(np.abs(u)))
    if abs(u[k]) > 1.0 - 1e-9:
        return "xyz"[k]
    shown = ", ".join(f"{float(c) + 0.0:.3g}" for c in np.round(u * np.sign(u[k]), 9))
    return f"({shown})"
