"""Redundant equations by the joints that share them, the exchange that cures, reactions in doubt.

In: the weighted rows of a pose. Out: groups of joints whose equations repeat each other; for each
the exchange of joints that removes them and frees nothing; and the components of reactions that the
redundancy leaves undetermined: those that the null vectors of the transposed Jacobian change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.mobility.dependence import dependence, null_space, together
from flexmb.analysis.mobility.exchange import (
    MACHINE_JOINTS,
    Weaker,
    exchanges,
    given_up_by,
    one_by_one,
    turned_axes,
    weaker_joints,
)
from flexmb.analysis.mobility.weighted import Weighted, element, elements, plain_name
from flexmb.engine.compile.joints.joint_rows import JOINT_ROWS
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes
from flexmb.model.values.names import GROUND

__all__ = [
    "Exchange",
    "Redundancy",
    "Undetermined",
    "choices_of",
    "in_words",
    "redundancies",
    "undetermined",
]

Array = NDArray[np.float64]
_CHANGED = 1e-6  # share of the largest change of a reaction that is round-off
_FEW = 2  # exchanges of any joints at most
_USUAL = 4  # exchanges of joints that machines have at most
_COMPONENTS = tuple(f"{what} {axis}" for what in ("force", "moment") for axis in "xyz")


@dataclass(frozen=True)
class Exchange:
    """One joint exchanged for a weaker one; no new type: leave it out.

    The axes are given, global in the placed pose, where they differ from those of the joint.
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
            f"{word} = [{', '.join(f'{c:.4g}' for c in given)}]"
            for word, given in (("axis", self.axis), ("second_axis", self.second_axis))
            if given is not None
        ]
        told = f" with {', '.join(axes)}" if axes else ""
        return f"{name}: {self.old} -> {self.new}{told}"


@dataclass(frozen=True)
class Redundancy:
    """Joints that share `count` redundant equations, and exchanges that remove these alone."""

    joints: tuple[str, ...]
    count: int
    cures: tuple[tuple[Exchange, ...], ...]


@dataclass(frozen=True)
class Undetermined:
    """Components of the reaction of a joint or driver, in the axes of marker J, in doubt."""

    path: str
    components: tuple[str, ...]


def redundancies(
    model: Model, found: Weighted, circuits: Array, others: Sequence[Weighted] = ()
) -> tuple[Redundancy, ...]:
    """The redundant equations of the joints, group by group, with their cures.

    Parameters
    ----------
    model : Model
        The model.
    found : Weighted
        Its rows in a pose that is not singular.
    circuits : (r, n) float
        Sets of dependent rows.
    others : sequence of Weighted
        Other poses, in which a cure must cure as well.
    """
    owners = np.array(found.owners)
    sets = [frozenset(np.flatnonzero(circuit).tolist()) for circuit in circuits]
    by_joint = [frozenset(_numbers(owners, members)) for members in sets]
    groups = []
    for indices in together(by_joint):
        mine = circuits[indices]
        names = tuple(dict.fromkeys(owners[np.abs(mine).max(axis=0) > 0].tolist()))
        cures = _cures(model, found, names, mine, others) or _without_couplers(model, found, mine)
        groups.append(Redundancy(elements(names), len(indices), cures))
    return tuple(groups)


def _numbers(owners: NDArray[np.str_], members: frozenset[int]) -> set[int]:
    """First row of the owner of each row: a number for the owner."""
    return {int(np.flatnonzero(owners == owners[k])[0]) for k in members}


def _cures(
    model: Model,
    found: Weighted,
    names: tuple[str, ...],
    circuits: Array,
    others: Sequence[Weighted],
) -> tuple[tuple[Exchange, ...], ...]:
    """The fewest exchanges of any joints, and the fewest of those that machines have."""
    choices = choices_of(model, found, names)
    if not choices:
        return ()
    N = {name: circuits[:, found.of(name)].T for name in choices}
    usual = {
        name: [weaker for weaker in known if weaker.type in MACHINE_JOINTS]
        for name, known in choices.items()
    }
    certain = {name: [weaker for weaker in known if weaker.type] for name, known in choices.items()}

    def fits(cure: tuple[Weaker, ...]) -> bool:
        return all(_cured(model, other, names, cure, len(circuits)) for other in others)

    drops = len(circuits)
    few, common = exchanges(certain, N, drops, _FEW, fits), exchanges(usual, N, drops, _USUAL, fits)
    cures = [cure for cure in (few, common) if cure is not None]
    if not cures:
        more = one_by_one(usual, N) or one_by_one(choices, N)
        cures = [more] if more is not None and fits(more) else []
    return tuple(dict.fromkeys(in_words(model, found, cure) for cure in cures))


def _without_couplers(
    model: Model, found: Weighted, circuits: Array
) -> tuple[tuple[Exchange, ...], ...]:
    """Couplers, the last ones first, that can be left out, one for each redundant equation."""
    whole = [element(owner) for owner in found.owners]
    left_out: list[Exchange] = []
    for name, spec in reversed(model.couplers.items()):
        path = f"couplers.{name}"
        kept = [k for k, owner in enumerate(whole) if owner == path]
        rank = dependence(circuits).rank
        if len(left_out) < rank and np.any(circuits[:, kept]):
            # of the combinations of circuits those that do without the coupler
            circuits = null_space(circuits[:, kept].T).T @ circuits
            left_out.append(Exchange(path, spec.type, ""))
        if not circuits.size:
            return (tuple(left_out),)
    return ()


def _cured(
    model: Model, found: Weighted, names: tuple[str, ...], cure: tuple[Weaker, ...], drops: int
) -> bool:
    """Whether exchanges free all redundant equations of the joints in another pose as well."""
    rows = np.isin(found.owners, names)
    N = dependence(found.A[rows]).circuits
    mine = [name for name, kept in zip(found.owners, rows, strict=True) if kept]
    freed = []
    for weaker in cure:
        g, ends = found.g[found.of(weaker.joint)], found.ends(weaker.joint)
        given_up = given_up_by(weaker.type, weaker.turns, g, ends, _used_motions(model))
        if given_up is None:
            return False
        freed.append(given_up @ N[:, [name == weaker.joint for name in mine]].T)
    return len(N) == drops and dependence(np.vstack(freed)).rank == drops


def choices_of(model: Model, found: Weighted, names: tuple[str, ...]) -> dict[str, list[Weaker]]:
    """What each of the joints can be exchanged for; drivers and springs keep their coordinates."""
    choices = {}
    for name in names:
        joint, rows = plain_name(name), found.of(name)
        if joint not in model.joints or np.any(found.A[np.ix_(rows, found.scalar)]):
            continue  # screws and curves have nothing weaker of their kind
        needed = _used_coordinates(model, joint)
        kept = [
            row.name
            for row in JOINT_TYPES.values()
            if row.name != model.joints[joint].type
            and len(JOINT_ROWS.get(row.name, ())) == row.equations  # primitives and nothing else
            and needed <= set(row.coordinates)
            and (model.plane is None or row.planar_equations is not None)
        ]
        g = found.g[rows]
        known = weaker_joints(name, kept, g, found.ends(name), _used_motions(model))
        on_ground = any(end.partition(".")[0] == GROUND for end in model.joints[joint].between)
        choices[name] = [
            replace(weaker, cost=weaker.cost + on_ground)  # bearings of the frame stay if they can
            for weaker in known
            if weaker.type or not needed
        ]
    return choices


def _used_coordinates(model: Model, joint: str) -> set[str]:
    """Coordinates of a joint that something else of the model uses."""
    specs = (*model.drivers.values(), *model.forces.values(), *model.sensors.values())
    using = [spec for spec in specs if getattr(spec, "joint", None) == joint]
    used = {str(getattr(spec, "coordinate", "angle")) for spec in using}
    coupled = [term for spec in model.couplers.values() for term in spec.coordinates]
    return used | {coordinate for name, coordinate in coupled if name == joint}


def _used_motions(model: Model) -> NDArray[np.bool_]:
    """(12,) the motions of two markers that there are."""
    if model.plane is None:
        return np.ones(12, bool)
    first, second, normal = plane_axes(model.plane)
    one = np.zeros(6, bool)
    one[[first, second, 3 + normal]] = True
    return np.tile(one, 2)


def in_words(model: Model, found: Weighted, cure: tuple[Weaker, ...]) -> tuple[Exchange, ...]:
    """Exchanges by the words of a scene."""
    told = []
    for weaker in cure:
        _, Ri, _, Rj = found.ends(weaker.joint)
        axes = (None if axis is None else _rounded(axis) for axis in turned_axes(weaker, Ri, Rj))
        old = model.joints[plain_name(weaker.joint)].type
        told.append(Exchange(weaker.joint, old, weaker.type, *axes))
    return tuple(told)


def _rounded(axis: Array) -> tuple[float, ...]:
    return tuple(round(float(c), 6) + 0.0 for c in axis)


def undetermined(found: Weighted, circuits: Array) -> tuple[Undetermined, ...]:
    """The reactions that the null vectors (r, n) of the transposed Jacobian change."""
    told = []
    for name in dict.fromkeys(found.owners):
        rows = found.of(name)
        if not len(circuits) or not np.any(circuits[:, rows]):
            continue
        turn = found.ends(name)[3]
        changes = (circuits[:, rows] @ found.on_J(name)).reshape(-1, 2, 3) @ turn
        size = np.abs(changes.reshape(-1, 6)).max(axis=0)
        components = np.array(_COMPONENTS)[size > _CHANGED * size.max()]
        told.append(Undetermined(name, tuple(components.tolist())))
    return tuple(told)
