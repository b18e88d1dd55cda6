"""Drivers that joints or other drivers leave no freedom for, and mechanisms that are locked.

In: the weighted rows of a closed pose. Out: a problem, or a note, for each surplus driver, with the
drivers and joints that prescribe the same motion, and what to change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from flexmb.analysis.dependence import Dependence, circuits, dependence, null_space
from flexmb.analysis.exchange import MACHINE_JOINTS, Weaker, exchanges
from flexmb.analysis.poses import close
from flexmb.analysis.redundancy import Exchange, choices_of, in_words, joint_dependence
from flexmb.analysis.weighted import Weighted, plain_name
from flexmb.errors import Problem
from flexmb.model.model import Model

__all__ = ["Surplus", "is_locked", "locked_sentence", "surplus_drivers", "surplus_problems"]

Array = NDArray[np.float64]
_NOTHING = 1e-7
_MOMENTS = (0.001, 0.01, 0.1, 0.3, 0.6, 1.0)  # of the duration, at which drivers must agree
_ALIGNED = 1e-2  # singular value over the largest, below which a locked mechanism is nearly not


@dataclass(frozen=True)
class Surplus:
    """Drivers that prescribe one motion more than is free, and the joints in between."""

    drivers: tuple[str, ...]
    joints: tuple[str, ...]


def surplus_drivers(found: Weighted) -> tuple[Surplus, ...]:
    """The drivers whose rows repeat those of joints or of each other."""
    joints, drivers = found.A[~found.driven], found.A[found.driven]
    if not len(drivers):
        return ()
    free = drivers @ null_space(joints)
    owners = np.array(found.owners)
    told = []
    for circuit in _null_circuits(free):
        y = _basic_solution(joints.T, -drivers.T @ circuit)
        names = owners[found.driven][circuit != 0.0]
        between = owners[~found.driven][np.abs(y) > _NOTHING * max(np.abs(y).max(), 1.0)]
        told.append(Surplus(tuple(dict.fromkeys(names)), tuple(dict.fromkeys(between))))
    return tuple(told)


def _null_circuits(A: Array) -> Array:
    """Circuits (k, n) of the rows of A (n, k), whose size is that of unit rows."""
    if not A.shape[1]:
        return np.eye(len(A))
    U, size, _ = np.linalg.svd(A)
    return circuits(U[:, int(np.sum(size > _NOTHING)) :].T)


def _basic_solution(A: Array, b: Array) -> Array:
    """A solution y of A y = b with at most as many numbers as A has rank."""
    y = np.zeros(A.shape[1])
    if not A.shape[1]:
        return y
    Q, R, order = qr(A, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > _NOTHING * diagonal[0]))
    y[order[:rank]] = np.linalg.solve(R[:rank, :rank], (Q.T @ b)[:rank])
    return y


def surplus_problems(
    model: Model, found: Weighted, surplus: tuple[Surplus, ...], moment: float | None = None
) -> tuple[list[Problem], list[str]]:
    """Problems of surplus drivers that contradict what holds them, notes on those that agree.

    `moment` [s] is one at which they are known to contradict each other.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    told = joint_dependence(found)
    if surplus and moment is None:
        moment = _disagreement(model, found)
    if surplus and is_locked(found, told):
        drivers = [name for one in surplus for name in one.drivers]
        what = f"has nothing to drive: {locked_sentence(model, found, told, drivers)}"
        if moment is None:
            return [], [f"{', '.join(drivers)}: {what}"]
        return [Problem(drivers[0], what)], []
    for one in surplus:
        who = _words(one)
        if moment is None:
            notes.append(f"{who}; they agree, but one driver is enough: its reaction is not unique")
        else:
            what = f"{who}, and contradict each other at t = {moment:.3g} s; take one driver out"
            problems.append(Problem(one.drivers[0], what))
    return problems, notes


def _words(one: Surplus) -> str:
    """Who prescribes one motion twice."""
    joints = ", ".join(plain_name(path) for path in one.joints)
    through = (
        f", through {'joint' if len(one.joints) == 1 else 'joints'} {joints}," if joints else ""
    )
    if len(one.drivers) == 1:
        return f"{one.drivers[0]} prescribes what the joints {joints} hold"
    return f"{' and '.join(one.drivers)}{through} prescribe the same motion"


def _disagreement(model: Model, found: Weighted) -> float | None:
    """A moment [s] at which no pose satisfies all drivers and joints; None if none was found."""
    duration = 1.0 if model.dynamics is None else model.dynamics.duration
    q = found.pose.q
    for share in _MOMENTS:
        there = close(found.compiled, q, t=share * duration)
        if not there.kept:
            return share * duration
        q = there.q
    return None


def is_locked(found: Weighted, told: Dependence) -> bool:
    """Whether the joints alone hold all coordinates."""
    return bool(told.rank == found.A.shape[1] > 0)


def locked_sentence(
    model: Model, found: Weighted, told: Dependence, drivers: list[str] | None = None
) -> str:
    """Which joints lock the mechanism, and what would free it; for `drivers`, so that they move."""
    joints = [plain_name(p) for p in dict.fromkeys(found.owners) if p.startswith("joints.")]
    sentence = f"the mechanism is locked, its joints {', '.join(joints)} hold every motion"
    cure = _freed(model, found, told, drivers or [])
    if told.almost < _ALIGNED:
        sentence += "; it is nearly free, so axes or places that should fit may be slightly off"
    if cure:
        sentence += f"; to free one motion exchange {' and '.join(str(e) for e in cure)}"
    return sentence


def _freed(
    model: Model, found: Weighted, told: Dependence, drivers: list[str]
) -> tuple[Exchange, ...]:
    """Exchanges that leave one motion and no redundant equation."""
    names = tuple(p for p in dict.fromkeys(found.owners) if p.startswith("joints."))
    choices = choices_of(model, found, names)
    choices = {joint: [w for w in known if w.type] for joint, known in choices.items()}
    if not choices:
        return ()
    N = {joint: told.circuits[:, found.of(joint)].T for joint in choices}
    needed = np.isin(found.owners, drivers)

    def fits(cure: tuple[Weaker, ...]) -> bool:
        kept, all_columns = _without(found, cure), found.A.shape[1]
        held = dependence(np.vstack([kept, found.A[needed]])).rank
        freed = dependence(kept).rank == all_columns - 1
        return bool(freed and held == all_columns - (not drivers))

    drops = len(told.circuits) + 1
    usual = {j: [w for w in known if w.type in MACHINE_JOINTS] for j, known in choices.items()}
    cure = exchanges(usual, N, drops, 2, fits) or exchanges(choices, N, drops, 2, fits)
    return in_words(model, found, cure) if cure is not None else ()


def _without(found: Weighted, cure: tuple[Weaker, ...]) -> Array:
    """The joints' rows after exchanges."""
    changed = {weaker.joint: weaker for weaker in cure}
    blocks = []
    for name in dict.fromkeys(found.owners):
        rows = found.A[found.of(name)]
        if name.startswith("drivers."):
            continue
        if name in changed:
            given_up = changed[name].given_up
            rows = np.linalg.svd(given_up)[2][len(given_up) :] @ rows
        blocks.append(rows)
    return np.vstack(blocks)
