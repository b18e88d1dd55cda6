"""Drivers that joints or other drivers leave no freedom for, and mechanisms that are locked.

In: the weighted rows of a closed pose. Out: a problem, or a note, for each surplus driver, with the
drivers and joints that prescribe the same motion, and what to change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from flexmb.analysis.mobility.dependence import Dependence, circuits, dependence, null_space
from flexmb.analysis.mobility.exchange import MACHINE_JOINTS, Weaker, exchanges
from flexmb.analysis.mobility.poses import close, joint_rows, other_poses
from flexmb.analysis.mobility.rank import LARGEST, one_blas_thread
from flexmb.analysis.mobility.redundancy import Exchange, choices_of, in_words
from flexmb.analysis.mobility.rows import ConstraintRows
from flexmb.analysis.mobility.weighted import Weighted, plain_name, weighted
from flexmb.engine.compile import Compiled
from flexmb.errors import AssemblyError, Problem
from flexmb.model.model import Model

__all__ = ["driver_notes", "driver_problems", "is_locked", "locked_sentence"]

Array = NDArray[np.float64]
_NOTHING = 1e-7
_MOMENTS = (0.001, 0.01, 0.1, 0.3, 0.6, 1.0)  # of the duration, at which drivers must agree
_ALIGNED = 1e-2  # singular value over the largest, below which a locked mechanism is nearly not


@dataclass(frozen=True)
class _Surplus:
    """Drivers that prescribe one motion more than is free, and the joints in between."""

    drivers: tuple[str, ...]
    joints: tuple[str, ...]


def _surplus_drivers(found: Weighted) -> tuple[_Surplus, ...]:
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
        told.append(_Surplus(tuple(dict.fromkeys(names)), tuple(dict.fromkeys(between))))
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


def _surplus_problems(
    model: Model, found: Weighted, surplus: tuple[_Surplus, ...], moment: float | None = None
) -> tuple[list[Problem], list[str]]:
    """Problems of surplus drivers that contradict what holds them, notes on those that agree.

    `moment` [s] is one at which they are known to contradict each other.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    told = found.joint_dependence
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


@one_blas_thread()
def driver_problems(compiled: Compiled, model: Model, gaps: Sequence[Problem]) -> Sequence[Problem]:
    """Why a model cannot be assembled, if it is for its drivers; else the gaps that stay open.

    These as well for a model too large for dense decompositions.
    """
    if not model.drivers or compiled.layout.nv > LARGEST:
        return gaps
    joints = close(ConstraintRows(compiled), compiled.placed, joint_rows(compiled))
    if not joints.kept:
        return gaps
    found = weighted(compiled, joints)
    told, _ = _surplus_problems(model, found, _lasting_surplus(compiled, found), moment=0.0)
    if told:
        return told
    names = ", ".join(f"drivers.{name}" for name in model.drivers)
    what = "the joints close alone, but not in the pose asked for at t = 0: it is out of reach"
    return [Problem(names, what), *gaps]


def driver_notes(compiled: Compiled, model: Model, found: Weighted) -> list[str]:
    """What is worth knowing of drivers that share a freedom.

    Raises
    ------
    AssemblyError
        They contradict each other or the joints.
    """
    surplus = _lasting_surplus(compiled, found)
    problems, notes = _surplus_problems(model, found, surplus)
    if problems:
        raise AssemblyError.from_problems(problems)
    if not surplus:
        notes += [
            f"{' and '.join(one.drivers)} cannot lead the mechanism out of the assembled pose, a "
            "dead point; begin in another pose, or drive another joint"
            for one in _surplus_drivers(found)
        ]
    return notes


def _lasting_surplus(compiled: Compiled, found: Weighted) -> tuple[_Surplus, ...]:
    """Surplus drivers in a closed pose that are so nearby as well: it is no dead point."""
    surplus = _surplus_drivers(found)
    if not surplus:
        return ()
    nearby = other_poses(ConstraintRows(compiled), found.pose, joint_rows(compiled))
    lasts = all(_surplus_drivers(weighted(compiled, other)) for other in nearby)
    return surplus if lasts else ()


def _words(one: _Surplus) -> str:
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
    spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
    duration = max(spans, default=1.0)
    q, constraints = found.pose.q, ConstraintRows(found.compiled)
    for share in _MOMENTS:
        there = close(constraints, q, t=share * duration)
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
