"""The exchange of joints that removes redundant equations and no degree of freedom.

A weaker joint constrains a part of what the joint does: its rows are combinations T of the rows of
the joint, computed from their gradients, so nothing is tabulated. With the left null space N of the
Jacobian and K the combinations of the joint's rows that the weaker one releases, rows K N become
free: the redundancy that is left is that of N less the rank of all K N together, and the motion
stays as it is if as many equations are released as redundancy goes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, islice, product

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import JointMarkers, row_gradient
from flexmb.engine.compile.joints.joint_rows import JOINT_ROWS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_PART = 1e-9  # of a gradient that may be outside of the rows it is a part of
_RANK = 1e-6
_MAX_TRIALS = 20_000
_MAX_CANDIDATES = 300_000  # of one number of exchanges: a tenth of a second
_REMOVAL_COST = 50  # of a joint: the last resort
MACHINE_JOINTS = ("spherical", "cylindrical", "universal", "revolute", "prismatic")
"""Joints that are bought or made as such; the others are conditions."""

_PREFERRED = (
    *MACHINE_JOINTS, "in-line", "planar", "revolute-spherical", "prismatic-spherical", "distance",
    "constant-velocity", "in-plane",
)  # fmt: skip
_X_FIRST = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # columns: the triad's y, z, x
_Y_FIRST = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # columns: the triad's z, x, y
_TURNS = (np.eye(3), _X_FIRST, _Y_FIRST)  # z of the turned triad: z, x, y


@dataclass(frozen=True)
class Weaker:
    """A joint in place of another, no type: none; `turns` of the joint's triads lead to its own.

    `released` (d, rows of the joint) are the combinations of rows that go.
    """

    joint: str
    type: str
    turns: tuple[int, int]
    released: Array
    cost: int

    @property
    def drops(self) -> int:
        """Number of equations that go."""
        return len(self.released)


def weaker_joints(
    joint: str, types: Sequence[str], g: Array, markers: JointMarkers, used: Mask
) -> list[Weaker]:
    """All types that constrain a part of what a joint does, and its removal.

    Parameters
    ----------
    joint : str
        Its name.
    types : sequence of str
        Types to choose from.
    g : (n, 12) float
        Gradients of its rows.
    markers : x_I, R_I, x_J, R_J
        Its markers, lengths in the unit of g.
    used : (12,) bool
        Motions that there are; in a plane not all.
    """
    weaker: list[Weaker] = []
    for name in types:
        if used.all() and len(JOINT_ROWS.get(name, ())) >= len(g):
            continue  # no part of the joint
        cost = _PREFERRED.index(name) if name in _PREFERRED else len(_PREFERRED)
        for turns in _placements(name):
            released = released_rows(name, turns, g, markers, used)
            if released is None or any(_same(released, one.released) for one in weaker):
                continue
            extra = 3 * (turns[0] + (turns[1] != turns[0]))
            weaker.append(Weaker(joint, name, turns, released, cost + extra))
    weaker.sort(key=lambda one: one.cost)
    return [*weaker, Weaker(joint, "", (0, 0), np.eye(len(g)), _REMOVAL_COST)]


def turned_axes(weaker: Weaker, Ri: Array, Rj: Array) -> tuple[Array | None, Array | None]:
    """Axes that a weaker joint needs besides those of the joint, in the axes of Ri and Rj."""
    i, j = weaker.turns
    if i == j == 0:
        return None, None
    return (Ri @ _TURNS[i])[:, 2], (Rj @ _TURNS[j])[:, 2] if i != j else None


def _placements(name: str) -> tuple[tuple[int, int], ...]:
    """Which turns of the two triads to try."""
    if name in ("universal", "revolute-universal", "perpendicular"):
        return ((0, 1), (0, 2), (1, 0), (2, 0))
    return ((0, 0),) if name in ("spherical", "distance", "fixed") else ((0, 0), (1, 1), (2, 2))


def released_rows(
    name: str, turns: tuple[int, int], g: Array, markers: JointMarkers, used: Mask
) -> Array | None:
    """Combinations (d, n) of the rows g (n, 12) that a type releases; None if it is no part.

    Without a type, all.
    """
    if not name:
        return np.eye(len(g))
    xi, Ri, xj, Rj = markers
    A, B = (R @ _TURNS[k] for R, k in zip((Ri, Rj), turns, strict=True))
    rows = JOINT_ROWS.get(name, ())
    other = np.array([row_gradient(row[:3], xi, A, xj, B)[used] for row in rows])
    if not other.size or not np.all(np.isfinite(other)):
        return None
    other, g = other[np.abs(other).max(axis=1) > _PART], g[:, used]
    if not 0 < len(other) < len(g):
        return None
    T = np.linalg.lstsq(g.T, other.T, rcond=None)[0].T
    left = np.abs(T @ g - other).max()
    _, size, Vt = np.linalg.svd(T)
    if left > _PART * np.abs(g).max() or size[-1] < _RANK * size[0]:
        return None
    return np.asarray(Vt[len(T) :])


def _same(A: Array, B: Array) -> bool:
    """Whether two sets of orthonormal rows span the same."""
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
    """The fewest exchanges, of the most usual joints, that release `drops` equations.

    None as well where there are too many to go through.

    Parameters
    ----------
    choices : mapping of str to sequence of Weaker
        What each joint can be exchanged for.
    N : mapping of str to (rows, r) float
        Rows of the left null space by joint.
    drops : int
        Equations to release, the r redundant ones among them.
    max_exchanges : int
        Exchanges at most.
    fits : callable, optional
        Whether a solution will do.
    """
    r = next(iter(N.values())).shape[1]
    for n in range(1, min(len(choices), drops, max_exchanges) + 1):
        if _count(choices, n) > _MAX_CANDIDATES:
            break
        for trial in islice(_by_cost(choices, n, drops), _MAX_TRIALS):
            if (not r or _freed_rank(trial, N) == r) and (fits is None or fits(trial)):
                return trial
    return None


def greedy_exchanges(choices: Choices, N: Mapping[str, Array]) -> tuple[Weaker, ...] | None:
    """Exchanges that free the null space N, each the one that frees most and nothing else.

    For many joints; not always the fewest.
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
    """How much of the null space the exchanges free."""
    freed = np.vstack([weaker.released @ N[weaker.joint] for weaker in cure])
    return int(np.linalg.matrix_rank(freed, tol=_RANK))


def _count(choices: Choices, n: int) -> int:
    """In how many ways n joints can be exchanged: an elementary symmetric polynomial."""
    counts = [1] + n * [0]
    for options in choices.values():
        for k in range(n, 0, -1):
            counts[k] += counts[k - 1] * len(options)
    return counts[n]


def _by_cost(choices: Choices, n: int, drops: int) -> Iterator[tuple[Weaker, ...]]:
    """Exchanges of n joints that release so many equations, the most usual ones first."""
    exchangeable = [joint for joint, options in choices.items() if options]
    trials = [
        picked
        for joints in combinations(exchangeable, n)
        for picked in product(*(choices[joint] for joint in joints))
        if sum(weaker.drops for weaker in picked) == drops
    ]
    return iter(sorted(trials, key=lambda picked: sum(weaker.cost for weaker in picked)))
