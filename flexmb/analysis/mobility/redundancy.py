"""Redundant equations by the joints that share them, cures, and reactions that are not unique.

In: the weighted rows of a pose. Out: groups of joints whose equations repeat each other; for each
the exchange of joints that removes them and frees no motion; and the components of reactions that
the redundancy leaves undetermined: those that the null vectors of the transposed Jacobian change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintPose, element, elements, plain_name
from flexmb.analysis.assembly.rank import Decomposition, connected_sets, null_space
from flexmb.analysis.mobility.joint_exchange import (
    MACHINE_JOINTS,
    Weaker,
    fewest_exchanges,
    greedy_exchanges,
    released_rows,
    turned_axes,
    weaker_joints,
)
from flexmb.engine.compile.joints.joint_rows import JOINT_ROWS
from flexmb.model.joints.gearing import terms_of
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes
from flexmb.model.values.names import GROUND

Array = NDArray[np.float64]
_CHANGED = 1e-6  # share of the largest change of a reaction that is round-off
_MAX_EXCHANGES = 2  # of any joints
_MAX_MACHINE_EXCHANGES = 4  # of joints that machines have
_COMPONENTS = tuple(f"{what} {axis}" for what in ("force", "moment") for axis in "xyz")


@dataclass(frozen=True)
class Exchange:
    """One joint exchanged for a weaker one; no new type: leave it out.

    Axes, global in the placed pose, where they differ from those of the joint; else None.
    """

    joint: str
    old: str
    new: str
    axis: tuple[float, ...] | None = None
    second_axis: tuple[float, ...] | None = None

    def __str__(self) -> str:
        name = plain_name(self.joint)
        if not self.new:
            return f"leave out {name} ({self.old})"
        axes = [
            f"{word} = [{', '.join(f'{c:.4g}' for c in axis)}]"
            for word, axis in (("axis", self.axis), ("second_axis", self.second_axis))
            if axis is not None
        ]
        return f"{name}: {self.old} -> {self.new}" + (f" with {', '.join(axes)}" if axes else "")


@dataclass(frozen=True)
class Redundancy:
    """Joints that share `count` redundant equations, and exchanges that remove these alone."""

    joints: tuple[str, ...]
    count: int
    cures: tuple[tuple[Exchange, ...], ...]


@dataclass(frozen=True)
class Undetermined:
    """Components of the reaction of a joint or driver that are not unique, in axes of marker J."""

    path: str
    components: tuple[str, ...]


def redundancies(
    model: Model, pose: ConstraintPose, others: Sequence[ConstraintPose] = ()
) -> tuple[Redundancy, ...]:
    """The redundant equations of the joints, group by group, with their cures.

    Parameters
    ----------
    model : Model
        The model.
    pose : ConstraintPose
        One that is not singular.
    others : sequence of ConstraintPose
        Other poses, in which a cure must cure as well.
    """
    owners, circuits = np.array(pose.jacobian.owners), pose.jacobian.joint_circuits
    sets = [frozenset(np.flatnonzero(circuit).tolist()) for circuit in circuits]
    by_joint = [frozenset(_numbers(owners, members)) for members in sets]
    groups = []
    for indices in connected_sets(by_joint):
        mine = circuits[indices]
        names = tuple(dict.fromkeys(owners[np.abs(mine).max(axis=0) > 0].tolist()))
        cures = _cures(model, pose, names, mine, others) or _without_couplers(model, pose, mine)
        groups.append(Redundancy(elements(names), len(indices), cures))
    return tuple(groups)


def _numbers(owners: NDArray[np.str_], members: frozenset[int]) -> set[int]:
    """First row of the owner of each row: a number for the owner."""
    return {int(np.flatnonzero(owners == owners[k])[0]) for k in members}


def _cures(
    model: Model,
    pose: ConstraintPose,
    names: tuple[str, ...],
    circuits: Array,
    others: Sequence[ConstraintPose],
) -> tuple[tuple[Exchange, ...], ...]:
    """The fewest exchanges of any joints, and the fewest of those that machines have."""
    choices = weaker_choices(model, pose, names)
    if not choices:
        return ()
    N = {name: circuits[:, pose.jacobian.rows_of(name)].T for name in choices}
    usual = {
        name: [weaker for weaker in options if weaker.type in MACHINE_JOINTS]
        for name, options in choices.items()
    }
    typed = {name: [weaker for weaker in some if weaker.type] for name, some in choices.items()}

    def fits(cure: tuple[Weaker, ...]) -> bool:
        return all(_cured(model, other, names, cure, len(circuits)) for other in others)

    drops = len(circuits)
    few = fewest_exchanges(typed, N, drops, _MAX_EXCHANGES, fits)
    common = fewest_exchanges(usual, N, drops, _MAX_MACHINE_EXCHANGES, fits)
    cures = [cure for cure in (few, common) if cure is not None]
    if not cures:
        more = greedy_exchanges(usual, N) or greedy_exchanges(choices, N)
        cures = [more] if more is not None and fits(more) else []
    return tuple(dict.fromkeys(scene_exchanges(model, pose, cure) for cure in cures))


def _without_couplers(
    model: Model, pose: ConstraintPose, circuits: Array
) -> tuple[tuple[Exchange, ...], ...]:
    """Couplers, the last ones first, that can be left out, one for each redundant equation."""
    whole = [element(owner) for owner in pose.jacobian.owners]
    removed: list[Exchange] = []
    for name, spec in reversed(model.couplers.items()):
        path = f"couplers.{name}"
        rows = [k for k, owner in enumerate(whole) if owner == path]
        rank = Decomposition.of(circuits).rank
        if len(removed) < rank and np.any(circuits[:, rows]):
            # of the combinations of circuits those that do without the coupler
            circuits = null_space(circuits[:, rows].T).T @ circuits
            removed.append(Exchange(path, spec.type, ""))
        if not circuits.size:
            return (tuple(removed),)
    return ()


def _cured(
    model: Model, pose: ConstraintPose, names: tuple[str, ...], cure: tuple[Weaker, ...], drops: int
) -> bool:
    """Whether exchanges free all redundant equations of the joints in another pose as well."""
    jacobian = pose.jacobian
    rows = np.isin(jacobian.owners, names)
    N = Decomposition.of(jacobian.A[rows]).circuits
    freed = []
    for weaker in cure:
        mine, markers = jacobian.rows_of(weaker.joint), pose.markers_of(weaker.joint)
        g = pose.weighted_g[mine]
        released = released_rows(weaker.type, weaker.turns, g, markers, _used_motions(model))
        if released is None:
            return False
        freed.append(released @ N[:, mine[rows]].T)
    return len(N) == drops and Decomposition.of(np.vstack(freed)).rank == drops


def weaker_choices(
    model: Model, pose: ConstraintPose, names: tuple[str, ...]
) -> dict[str, list[Weaker]]:
    """What each of the joints can be exchanged for; drivers and springs keep their coordinates."""
    choices, jacobian = {}, pose.jacobian
    for name in names:
        joint, rows = plain_name(name), jacobian.rows_of(name)
        if joint not in model.joints or np.any(jacobian.A[np.ix_(rows, jacobian.scalar)]):
            continue  # screws and curves have nothing weaker of their kind
        needed = _used_coordinates(model, joint)
        types = [
            row.name
            for row in JOINT_TYPES.values()
            if row.name != model.joints[joint].type
            and len(JOINT_ROWS.get(row.name, ())) == row.equations  # primitives and nothing else
            and needed <= set(row.coordinates)
            and (model.plane is None or row.planar_equations is not None)
        ]
        g, markers = pose.weighted_g[rows], pose.markers_of(name)
        options = weaker_joints(name, types, g, markers, _used_motions(model))
        on_ground = any(end.partition(".")[0] == GROUND for end in model.joints[joint].between)
        choices[name] = [
            replace(weaker, cost=weaker.cost + on_ground)  # bearings of the frame stay if they can
            for weaker in options
            if weaker.type or not needed
        ]
    return choices


def _used_coordinates(model: Model, joint: str) -> set[str]:
    """Coordinates of a joint that something else of the model uses."""
    specs = (*model.drivers.values(), *model.forces.values(), *model.sensors.values())
    using = [spec for spec in specs if getattr(spec, "joint", None) == joint]
    used = {str(getattr(spec, "coordinate", "angle")) for spec in using}
    coupled = [term for spec in model.couplers.values() for term in terms_of(spec)]
    return used | {coordinate for name, coordinate in coupled if name == joint}


def _used_motions(model: Model) -> NDArray[np.bool_]:
    """(12,) the motions of two markers that there are."""
    if model.plane is None:
        return np.ones(12, bool)
    first, second, normal = plane_axes(model.plane)
    one = np.zeros(6, bool)
    one[[first, second, 3 + normal]] = True
    return np.tile(one, 2)


def scene_exchanges(
    model: Model, pose: ConstraintPose, cure: tuple[Weaker, ...]
) -> tuple[Exchange, ...]:
    """Exchanges by the words of a scene."""
    exchanges = []
    for weaker in cure:
        _, Ri, _, Rj = pose.markers_of(weaker.joint)
        axes = (None if axis is None else _rounded(axis) for axis in turned_axes(weaker, Ri, Rj))
        old = model.joints[plain_name(weaker.joint)].type
        exchanges.append(Exchange(weaker.joint, old, weaker.type, *axes))
    return tuple(exchanges)


def _rounded(axis: Array) -> tuple[float, ...]:
    return tuple(round(float(c), 6) + 0.0 for c in axis)


def undetermined_reactions(pose: ConstraintPose) -> tuple[Undetermined, ...]:
    """The reactions, drivers' too, that the null vectors of the transposed Jacobian change."""
    reactions, circuits = [], pose.jacobian.decomposition.circuits
    for name in dict.fromkeys(pose.jacobian.owners):
        rows = pose.jacobian.rows_of(name)
        if not len(circuits) or not np.any(circuits[:, rows]):
            continue
        turn = pose.markers_of(name)[3]
        changes = (circuits[:, rows] @ pose.gradients_at_J(name)).reshape(-1, 2, 3) @ turn
        size = np.abs(changes.reshape(-1, 6)).max(axis=0)
        components = np.array(_COMPONENTS)[size > _CHANGED * size.max()]
        reactions.append(Undetermined(name, tuple(components.tolist())))
    return tuple(reactions)
