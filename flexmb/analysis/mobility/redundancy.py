"""Redundant equations by the joints that share them, cures, and reactions that are not unique.

In: the rows of a pose. Out: groups of joints whose equations depend on each other; for each group
exchanges of joints that remove the redundancy and free no motion; and the components of reactions
that the redundancy leaves undetermined, which are those that null vectors of Cqᵀ change.

A weaker joint constrains only a part of what a joint constrains: its rows are combinations T of the
rows of the joint. T is computed from the gradients, so no table of joint types is needed. N is the
left null space of the Jacobian, and K the combinations of the joint's rows that the weaker joint
releases. The redundancy falls by the rank of all K N together. No motion becomes free if the number
of released equations equals this rank.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice, product

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import (
    ConstraintPose,
    Decomposition,
    element,
    null_space,
    plain_name,
    row_gradient,
)
from flexmb.engine.joints.joint import JOINT_ROWS
from flexmb.flexbody.arrays import Array
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes
from flexmb.model.reading import GROUND

Turns = tuple[int, int]
_REACTION_ROUND_OFF = 1e-6  # change of a component that is none, over the largest change
_MAX_EXCHANGES = 2  # exchanges in one cure for joints of any type
_MAX_MACHINE_EXCHANGES = 4  # exchanges in one cure for `MACHINE_JOINTS`
_COMPONENTS = tuple(f"{what} {axis}" for what in ("force", "moment") for axis in "xyz")
_GRADIENT_TOLERANCE = 1e-9  # part of a gradient outside the span of other rows that is round-off
_RANK_TOLERANCE = 1e-6  # singular value that is zero, of released combinations of unit size
_MAX_TRIALS = 20_000  # combinations tried for one number of exchanges
_MAX_CANDIDATES = 300_000  # combinations for one number of exchanges; sorting takes about 0.1 s
_REMOVAL_COST = 50  # cost of leaving a joint out: more than any exchange, the last resort
MACHINE_JOINTS = ("spherical", "cylindrical", "universal", "revolute", "prismatic")
"""Joints that machines have as components; the other types are abstract constraints."""

_PREFERRED = (
    *MACHINE_JOINTS, "in-line", "planar", "revolute-spherical", "prismatic-spherical", "distance",
    "constant-velocity", "in-plane",
)  # fmt: skip
_X_FIRST = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # columns: the triad's y, z, x
_Y_FIRST = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # columns: the triad's z, x, y
_TRIADS = (np.eye(3), _X_FIRST, _Y_FIRST)  # z of the rotated triad is z, x or y of the triad


@dataclass(frozen=True)
class Weaker:
    """A weaker joint in place of another; type "": no joint.

    `turns` are the numbers in `_TRIADS` that lead from the joint's triads I and J to its own.
    `released` (d, rows of the joint) are the combinations of rows that it releases; `cost` is less
    for usual types.
    """

    joint: str
    type: str
    turns: Turns
    released: Array
    cost: int

    @property
    def drops(self) -> int:
        """Number of equations that are released."""
        return len(self.released)


@dataclass(frozen=True)
class Exchange:
    """One joint exchanged for a weaker one; `new` = "": leave it out.

    Axes, global in the placed pose, are given if they differ from those of the joint; else None.
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
    """Joints that share `count` redundant equations, and exchanges that remove only these."""

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
        A pose that is not singular.
    others : sequence of ConstraintPose
        Other poses in which a cure must also be one.
    """
    jacobian, row_dependencies = pose.jacobian, pose.jacobian.joint_circuits
    if not len(row_dependencies):
        return ()
    from scipy.sparse.csgraph import connected_components  # takes time, and is seldom needed

    names = tuple(dict.fromkeys(jacobian.owners))
    shares = np.array(
        [np.any(row_dependencies[:, jacobian.rows_of(name)], axis=1) for name in names]
    )
    groups = []
    n, label = connected_components(shares.T @ shares)  # of circuits that share a joint
    for k in range(n):
        mine = row_dependencies[label == k]
        joints = tuple(np.array(names)[shares[:, label == k].any(axis=1)].tolist())
        cures = _cures(model, pose, joints, mine, others) or _without_couplers(model, pose, mine)
        owners = tuple(dict.fromkeys(element(joint) for joint in joints))
        groups.append(Redundancy(owners, len(mine), cures))
    return tuple(groups)


def _cures(
    model: Model,
    pose: ConstraintPose,
    names: tuple[str, ...],
    row_dependencies: Array,
    others: Sequence[ConstraintPose],
) -> tuple[tuple[Exchange, ...], ...]:
    """The fewest exchanges for joints of any type, and the fewest for `MACHINE_JOINTS`."""
    choices = weaker_choices(model, pose, names)
    if not choices:
        return ()
    N = {name: row_dependencies[:, pose.jacobian.rows_of(name)].T for name in choices}
    usual = {
        name: [weaker for weaker in options if weaker.type in MACHINE_JOINTS]
        for name, options in choices.items()
    }
    typed = {name: [weaker for weaker in some if weaker.type] for name, some in choices.items()}

    def fits(cure: tuple[Weaker, ...]) -> bool:
        return all(_is_cured(model, other, names, cure, len(row_dependencies)) for other in others)

    drops = len(row_dependencies)
    few = fewest_exchanges(typed, N, drops, _MAX_EXCHANGES, fits)
    common = fewest_exchanges(usual, N, drops, _MAX_MACHINE_EXCHANGES, fits)
    cures = [cure for cure in (few, common) if cure is not None]
    if not cures:
        more = greedy_exchanges(usual, N) or greedy_exchanges(choices, N)
        cures = [more] if more is not None and fits(more) else []
    return tuple(dict.fromkeys(scene_exchanges(model, pose, cure) for cure in cures))


def _without_couplers(
    model: Model, pose: ConstraintPose, row_dependencies: Array
) -> tuple[tuple[Exchange, ...], ...]:
    """Couplers that can be left out, one for each redundant equation, the last couplers first."""
    whole = [element(owner) for owner in pose.jacobian.owners]
    removed: list[Exchange] = []
    for name, spec in reversed(model.couplers.items()):
        path = f"couplers.{name}"
        rows = [k for k, owner in enumerate(whole) if owner == path]
        rank = Decomposition.of(row_dependencies).rank
        if len(removed) < rank and np.any(row_dependencies[:, rows]):
            # keep the dependencies that do not involve the coupler
            row_dependencies = null_space(row_dependencies[:, rows].T).T @ row_dependencies
            removed.append(Exchange(path, spec.type, ""))
        if not row_dependencies.size:
            return (tuple(removed),)
    return ()


def _is_cured(
    model: Model, pose: ConstraintPose, names: tuple[str, ...], cure: tuple[Weaker, ...], drops: int
) -> bool:
    """Whether exchanges remove all redundant equations of the joints in another pose too."""
    jacobian = pose.jacobian
    rows = np.isin(jacobian.owners, names)
    N = Decomposition.of(jacobian.A[rows]).row_dependencies
    freed = []
    for weaker in cure:
        released = _released_rows(model, pose, weaker.joint, weaker.type, weaker.turns)
        if released is None:
            return False
        freed.append(released @ N[:, jacobian.rows_of(weaker.joint)[rows]].T)
    return len(N) == drops and Decomposition.of(np.vstack(freed)).rank == drops


def weaker_choices(
    model: Model, pose: ConstraintPose, names: tuple[str, ...]
) -> dict[str, list[Weaker]]:
    """The weaker joints for each of the joints, the most usual types first, removal last.

    Coordinates that drivers, forces, sensors or couplers use are kept.
    """
    choices, jacobian = {}, pose.jacobian
    for name in names:
        joint, rows = plain_name(name), jacobian.rows_of(name)
        if joint not in model.joints or np.any(jacobian.A[np.ix_(rows, jacobian.scalar)]):
            continue  # there is no weaker type for screws and joints on curves
        needed, spec = _used_coordinates(model, joint), model.joints[joint]
        on_ground = any(end.partition(".")[0] == GROUND for end in spec.between)
        options: list[Weaker] = []
        for row in JOINT_TYPES.values():
            primitive = len(JOINT_ROWS.get(row.name, ())) == row.equations
            in_plane = model.plane is None or row.planar_equations is not None
            if primitive and in_plane and row.name != spec.type and needed <= set(row.coordinates):
                _add_placements(model, pose, name, row.name, options)
        if not needed:
            options.append(Weaker(name, "", (0, 0), np.eye(int(rows.sum())), _REMOVAL_COST))
        # joints to ground are exchanged only if others do not serve
        options = [replace(weaker, cost=weaker.cost + on_ground) for weaker in options]
        choices[name] = sorted(options, key=lambda weaker: weaker.cost)
    return choices


def _add_placements(
    model: Model, pose: ConstraintPose, joint: str, kind: str, options: list[Weaker]
) -> None:
    """Add a joint type in all orientations in which it constrains a part of what the joint does."""
    cost = _PREFERRED.index(kind) if kind in _PREFERRED else len(_PREFERRED)
    for turns in _placements(kind):
        released = _released_rows(model, pose, joint, kind, turns)
        if released is not None and not any(
            _span_is_equal(released, one.released) for one in options
        ):
            extra = 3 * (turns[0] + (turns[1] != turns[0]))
            options.append(Weaker(joint, kind, turns, released, cost + extra))


def _placements(kind: str) -> tuple[Turns, ...]:
    """Rotations of the two triads to try for a joint type (`_TRIADS`)."""
    if kind in ("universal", "revolute-universal", "perpendicular"):
        return ((0, 1), (0, 2), (1, 0), (2, 0))
    return ((0, 0),) if kind in ("spherical", "distance", "fixed") else ((0, 0), (1, 1), (2, 2))


def _released_rows(
    model: Model, pose: ConstraintPose, joint: str, kind: str, turns: Turns
) -> Array | None:
    """Combinations (d, n) of the n rows of a joint that a type releases; all for type "".

    None if the rows of the type are not combinations of those of the joint.
    """
    g = pose.weighted_g[pose.jacobian.rows_of(joint)]
    if not kind:
        return np.eye(len(g))
    used, rows = _used_motions(model), JOINT_ROWS.get(kind, ())
    if used.all() and len(rows) >= len(g):
        return None
    xi, Ri, xj, Rj = pose.markers_of(joint)
    A, B = (R @ _TRIADS[k] for R, k in zip((Ri, Rj), turns, strict=True))
    other = np.array([row_gradient(row[:3], xi, A, xj, B)[used] for row in rows])
    if not other.size or not np.all(np.isfinite(other)):
        return None
    other, g = other[np.abs(other).max(axis=1) > _GRADIENT_TOLERANCE], g[:, used]
    if not 0 < len(other) < len(g):
        return None
    T = np.linalg.lstsq(g.T, other.T, rcond=None)[0].T
    left = np.abs(T @ g - other).max()
    _, size, Vt = np.linalg.svd(T)
    if left > _GRADIENT_TOLERANCE * np.abs(g).max() or size[-1] < _RANK_TOLERANCE * size[0]:
        return None
    return np.asarray(Vt[len(T) :])


def _span_is_equal(A: Array, B: Array) -> bool:
    """Whether two sets of orthonormal rows have the same span."""
    return len(A) == len(B) and bool(np.allclose(A.T @ A, B.T @ B, atol=1e-9))


Choices = Mapping[str, Sequence[Weaker]]
Fits = Callable[[tuple[Weaker, ...]], bool]


def fewest_exchanges(
    choices: Choices,
    N: Mapping[str, Array],
    drops: int,
    max_exchanges: int,
    fits: Fits | None = None,
) -> tuple[Weaker, ...] | None:
    """The fewest exchanges, of the most usual types, that release `drops` equations.

    None if there is no solution, or if there are too many combinations to try.

    Parameters
    ----------
    choices : mapping of str to sequence of Weaker
        The weaker joints for each joint.
    N : mapping of str to (rows, r) float
        Rows of the left null space by joint.
    drops : int
        Number of equations to release, including the r redundant ones.
    max_exchanges : int
        Largest number of exchanges.
    fits : callable, optional
        Whether a solution is acceptable.
    """
    r = next(iter(N.values())).shape[1]
    for n in range(1, min(len(choices), drops, max_exchanges) + 1):
        if _number_of_choices(choices, n) > _MAX_CANDIDATES:
            break
        for trial in islice(_by_cost(choices, n, drops), _MAX_TRIALS):
            if (not r or _freed_rank(trial, N) == r) and (fits is None or fits(trial)):
                return trial
    return None


def greedy_exchanges(choices: Choices, N: Mapping[str, Array]) -> tuple[Weaker, ...] | None:
    """Exchanges that remove the redundancy N, each time the one that removes most of it.

    No exchange frees a motion. For many joints; the result need not have the fewest exchanges.
    """
    r = next(iter(N.values())).shape[1]
    cure: tuple[Weaker, ...] = ()
    free = {joint: list(options) for joint, options in choices.items()}
    rank = 0
    while rank < r:
        useful = [
            (-weaker.drops, weaker.cost, k, (*cure, weaker))
            for k, weaker in enumerate(w for options in free.values() for w in options)
            if rank + weaker.drops <= r and _freed_rank((*cure, weaker), N) == rank + weaker.drops
        ]
        if not useful:
            return None
        cure = min(useful)[3]
        rank += cure[-1].drops
        del free[cure[-1].joint]
    return cure


def _freed_rank(cure: Sequence[Weaker], N: Mapping[str, Array]) -> int:
    """Number of redundant equations that the exchanges remove."""
    freed = np.vstack([weaker.released @ N[weaker.joint] for weaker in cure])
    return int(np.linalg.matrix_rank(freed, tol=_RANK_TOLERANCE))


def _number_of_choices(choices: Choices, n: int) -> int:
    """Number of ways to exchange n joints: an elementary symmetric polynomial."""
    counts = [1] + n * [0]
    for options in choices.values():
        for k in range(n, 0, -1):
            counts[k] += counts[k - 1] * len(options)
    return counts[n]


def _by_cost(choices: Choices, n: int, drops: int) -> Iterator[tuple[Weaker, ...]]:
    """Exchanges of n joints that release `drops` equations, the most usual ones first."""
    exchangeable = [joint for joint, options in choices.items() if options]
    trials = [
        picked
        for joints in combinations(exchangeable, n)
        for picked in product(*(choices[joint] for joint in joints))
        if sum(weaker.drops for weaker in picked) == drops
    ]
    return iter(sorted(trials, key=lambda picked: sum(weaker.cost for weaker in picked)))


def _used_coordinates(model: Model, joint: str) -> set[str]:
    """Coordinates of a joint that drivers, forces, sensors or couplers use."""
    specs = (*model.drivers.values(), *model.forces.values(), *model.sensors.values())
    using = [spec for spec in specs if getattr(spec, "joint", None) == joint]
    used = {str(getattr(spec, "coordinate", "angle")) for spec in using}
    coupled = [term for spec in model.couplers.values() for term in spec.coordinates]
    return used | {coordinate for name, coordinate in coupled if name == joint}


def _used_motions(model: Model) -> NDArray[np.bool_]:
    """(12,) whether each motion of two markers is possible; in a plane not all are."""
    if model.plane is None:
        return np.ones(12, bool)
    first, second, normal = plane_axes(model.plane)
    one = np.zeros(6, bool)
    one[[first, second, 3 + normal]] = True
    return np.tile(one, 2)


def scene_exchanges(
    model: Model, pose: ConstraintPose, cure: tuple[Weaker, ...]
) -> tuple[Exchange, ...]:
    """Exchanges in the terms of a scene: types and axes."""
    exchanges = []
    for weaker in cure:
        _, Ri, _, Rj = pose.markers_of(weaker.joint)
        i, j = weaker.turns
        first = _rounded_axis(Ri @ _TRIADS[i]) if i or j else None
        second = _rounded_axis(Rj @ _TRIADS[j]) if i != j else None
        old = model.joints[plain_name(weaker.joint)].type
        exchanges.append(Exchange(weaker.joint, old, weaker.type, first, second))
    return tuple(exchanges)


def _rounded_axis(R: Array) -> tuple[float, ...]:
    return tuple(round(float(c), 6) + 0.0 for c in R[:, 2])


def undetermined_reactions(pose: ConstraintPose) -> tuple[Undetermined, ...]:
    """Reactions of joints and drivers that null vectors of Cqᵀ change."""
    reactions, row_dependencies = [], pose.jacobian.decomposition.row_dependencies
    for name in dict.fromkeys(pose.jacobian.owners):
        rows = pose.jacobian.rows_of(name)
        if not len(row_dependencies) or not np.any(row_dependencies[:, rows]):
            continue
        turn = pose.markers_of(name)[3]
        changes = (row_dependencies[:, rows] @ pose.gradients_at_J(name)).reshape(-1, 2, 3) @ turn
        size = np.abs(changes.reshape(-1, 6)).max(axis=0)
        components = np.array(_COMPONENTS)[size > _REACTION_ROUND_OFF * size.max()]
        reactions.append(Undetermined(name, tuple(components.tolist())))
    return tuple(reactions)
