"""Redundant drivers, which have no degree of freedom to drive, and locked mechanisms.

In: the rows of a closed pose. Out: a problem, or a note, for each redundant driver. It names the
drivers and joints that prescribe the same motion, and what to change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    ConstraintPose,
    ConstraintRows,
    Decomposition,
    joint_rows,
    null_space,
    one_blas_thread,
    plain_name,
    row_dependencies,
)
from flexmb.analysis.assembly.positions import close_rows, nearby_poses
from flexmb.analysis.mobility.redundancy import (
    MACHINE_JOINTS,
    Exchange,
    Weaker,
    fewest_exchanges,
    scene_exchanges,
    weaker_choices,
)
from flexmb.engine.compile import Compiled
from flexmb.errors import AssemblyError, Problem
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model

_ZERO_TOLERANCE = 1e-7  # relative size of singular values and coefficients that are zero
_SHARES = (0.001, 0.01, 0.1, 0.3, 0.6, 1.0)  # fractions of the duration at which drivers must agree
# Bounds of the least singular value of a locked mechanism, over the largest one. Below the first it
# is nearly free. Below the second no method can run it: a four-bar whose pin is tilted by 2e-3 rad
# has 2.6e-4 and runs with all methods, one tilted by 1e-4 rad with none. Both only if there is a
# gap: some singular value is smaller than the third number times the one before. Equations that
# count as redundant, with a value below RANK_TOLERANCE, fit exactly below the fourth.
_NEARLY_FREE, _TOO_NEARLY_FREE, _SPECTRAL_GAP, _EXACT_FIT = 1e-2, 2e-4, 0.1, 3e-10


@dataclass(frozen=True)
class _RedundantDrivers:
    """Drivers that together prescribe one motion too many, and the joints between them."""

    drivers: tuple[str, ...]
    joints: tuple[str, ...]


def _redundant_drivers(pose: ConstraintPose) -> tuple[_RedundantDrivers, ...]:
    """Sets of drivers whose rows depend on those of joints or on each other."""
    jacobian = pose.jacobian
    joints, drivers = jacobian.A[~jacobian.driven], jacobian.A[jacobian.driven]
    if not len(drivers):
        return ()
    free = drivers @ null_space(joints)
    owners, redundant = np.array(jacobian.owners), []
    for circuit in _null_circuits(free):
        y = _basic_solution(joints.T, -drivers.T @ circuit)
        names = owners[jacobian.driven][circuit != 0.0]
        between = owners[~jacobian.driven][np.abs(y) > _ZERO_TOLERANCE * max(np.abs(y).max(), 1.0)]
        redundant.append(
            _RedundantDrivers(tuple(dict.fromkeys(names)), tuple(dict.fromkeys(between)))
        )
    return tuple(redundant)


def _null_circuits(A: Array) -> Array:
    """Dependencies (k, n) between the rows of A (n, k), which are of unit size."""
    if not A.shape[1]:
        return np.eye(len(A))
    U, size, _ = np.linalg.svd(A)
    return row_dependencies(U[:, int(np.sum(size > _ZERO_TOLERANCE)) :].T)


def _basic_solution(A: Array, b: Array) -> Array:
    """A solution y of A y = b with at most rank(A) entries other than zero."""
    y = np.zeros(A.shape[1])
    if not A.shape[1]:
        return y
    Q, R, order = qr(A, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > _ZERO_TOLERANCE * diagonal[0]))
    y[order[:rank]] = np.linalg.solve(R[:rank, :rank], (Q.T @ b)[:rank])
    return y


def _driver_findings(
    model: Model,
    pose: ConstraintPose,
    redundant: tuple[_RedundantDrivers, ...],
    moment: float | None = None,
) -> tuple[list[Problem], list[str]]:
    """Problems for redundant drivers that contradict others, notes for those that agree.

    `moment` [s] is a time at which they contradict each other, if it is already known.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    if redundant and moment is None:
        moment = _disagreement(model, pose)
    if redundant and is_locked(pose):
        drivers = [name for one in redundant for name in one.drivers]
        what = f"has nothing to drive: {locked_sentence(model, pose, drivers)}"
        if moment is None:
            return [], [f"{', '.join(drivers)}: {what}"]
        return [Problem(drivers[0], what)], []
    for one in redundant:
        who = _conflict_text(one)
        if moment is None:
            notes.append(f"{who}; they agree, but one driver is enough: its reaction is not unique")
        else:
            what = f"{who}, and contradict each other at t = {moment:.3g} s; take one driver out"
            problems.append(Problem(one.drivers[0], what))
    return problems, notes


@contextmanager
def driver_reasons(compiled: Compiled, model: Model) -> Iterator[None]:
    """Replace an error of the assembly by one that names the drivers that cause it, if any do.

    Raises
    ------
    AssemblyError
        Drivers contradict each other or the joints; else the original error.
    """
    try:
        yield
    except AssemblyError as error:
        problems = _driver_problems(compiled, model, error.problems)
        raise AssemblyError.from_problems(problems) from None


@one_blas_thread()
def _driver_problems(
    compiled: Compiled, model: Model, gaps: Sequence[Problem]
) -> Sequence[Problem]:
    """Problems with drivers that prevent the assembly of a model; without any, the open gaps.

    The gaps are also returned for a model that is too large for dense decompositions.
    """
    if not model.drivers or compiled.layout.nv > MAX_COORDINATES:
        return gaps
    pose = close_rows(ConstraintRows(compiled), compiled.initial_q, joint_rows(compiled))
    if pose is None:
        return gaps
    problems, _ = _driver_findings(model, pose, _always_redundant(pose), moment=0.0)
    # a gap at "assembly": the joints could be closed, but far from the placed pose
    if problems or not any(gap.where == "assembly" for gap in gaps):
        return problems or gaps
    names = ", ".join(f"drivers.{name}" for name in model.drivers)
    what = "the joints close alone, but not in the pose asked for at t = 0: it is out of reach"
    return [Problem(names, what), *gaps]


def driver_notes(model: Model, pose: ConstraintPose) -> list[str]:
    """Notes on drivers that share a degree of freedom, and on a mechanism without any.

    Raises
    ------
    AssemblyError
        They contradict each other or the joints.
    """
    redundant = _always_redundant(pose)
    problems, notes = _driver_findings(model, pose, redundant)
    if problems:
        raise AssemblyError.from_problems(problems)
    if not model.drivers and is_locked(pose) and not any(b.flexible for b in model.bodies.values()):
        notes.append(locked_sentence(model, pose))
    if not redundant:
        notes += [
            f"{' and '.join(one.drivers)} cannot lead the mechanism out of the assembled pose, a "
            "dead point; begin in another pose, or drive another joint"
            for one in _redundant_drivers(pose)
        ]
    return notes


def _always_redundant(pose: ConstraintPose) -> tuple[_RedundantDrivers, ...]:
    """Drivers that are redundant in a closed pose and in nearby poses, so not by a dead point."""
    redundant = _redundant_drivers(pose)
    if not redundant:
        return ()
    others = nearby_poses(ConstraintRows(pose.compiled), pose, joint_rows(pose.compiled))
    return redundant if all(_redundant_drivers(other) for other in others) else ()


def _conflict_text(one: _RedundantDrivers) -> str:
    """Words that name the drivers and joints that prescribe one motion twice."""
    joints = ", ".join(plain_name(path) for path in one.joints)
    through = (
        f", through {'joint' if len(one.joints) == 1 else 'joints'} {joints}," if joints else ""
    )
    if len(one.drivers) == 1:
        return f"{one.drivers[0]} prescribes a motion that the joints {joints} constrain"
    return f"{' and '.join(one.drivers)}{through} prescribe the same motion"


def _disagreement(model: Model, pose: ConstraintPose) -> float | None:
    """A time [s] at which no pose satisfies all drivers and joints; None if none was found."""
    spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
    duration = max(spans, default=1.0)
    q, constraints = pose.q, ConstraintRows(pose.compiled)
    for share in _SHARES:
        later = close_rows(constraints, q, t=share * duration)
        if later is None:
            return share * duration
        q = later.q
    return None


def is_locked(pose: ConstraintPose) -> bool:
    """Whether the joints alone constrain all coordinates."""
    return bool(pose.jacobian.joint_decomposition.rank == pose.jacobian.A.shape[1] > 0)


def lock_of_inexact_parts(model: Model, pose: ConstraintPose) -> str:
    """Sentence on rigid bodies that a slight misfit locks, if no method can run them; else ""."""
    if any(body.flexible for body in model.bodies.values()):
        return ""
    if is_locked(pose):
        return locked_sentence(model, pose) if _is_nearly_free(pose, _TOO_NEARLY_FREE) else ""
    joints = pose.jacobian.joint_decomposition
    share = joints.S[joints.rank :] / joints.S[0] if joints.rank else joints.S[:0]
    off = float(share[share > _EXACT_FIT].max(initial=0.0))
    if not off or off > _SPECTRAL_GAP * joints.condition:
        return ""
    names = [plain_name(p) for p in dict.fromkeys(pose.jacobian.owners) if p.startswith("joints.")]
    return (
        f"equations of the joints {', '.join(names)} are redundant to {off:.1g} only, too much for "
        "any method: axes or places that should fit are slightly off; make them exact, or exchange "
        "joints as flexmb check tells"
    )


def _is_nearly_free(pose: ConstraintPose, bound: float = _NEARLY_FREE) -> bool:
    """Whether a few motions are constrained much less than all others.

    The gap between singular values tells this case from a long chain, whose values fall gradually.
    """
    joints = pose.jacobian.joint_decomposition
    S = joints.S[: joints.rank]
    return joints.condition < bound and float((S[1:] / S[:-1]).min(initial=1.0)) < _SPECTRAL_GAP


def locked_sentence(model: Model, pose: ConstraintPose, drivers: Sequence[str] = ()) -> str:
    """Sentence that names the joints that lock the mechanism, and exchanges that free a motion.

    With `drivers`, the motion that these drive.
    """
    joints = [plain_name(p) for p in dict.fromkeys(pose.jacobian.owners) if p.startswith("joints.")]
    sentence = f"the mechanism is locked, its joints {', '.join(joints)} prevent every motion"
    cure = _freeing_exchanges(model, pose, drivers)
    if _is_nearly_free(pose):
        off = pose.jacobian.joint_decomposition.condition
        sentence += f"; it is nearly free (to {off:.1g}), so axes or places that should fit may be "
        sentence += "slightly off"
    if cure:
        sentence += f"; to free one motion exchange {' and '.join(str(e) for e in cure)}"
    return sentence


def _freeing_exchanges(
    model: Model, pose: ConstraintPose, drivers: Sequence[str]
) -> tuple[Exchange, ...]:
    """Exchanges after which there is one motion and no redundant equation."""
    jacobian = pose.jacobian
    n, circuits_of_joints = jacobian.A.shape[1], jacobian.joint_circuits
    names = tuple(p for p in dict.fromkeys(jacobian.owners) if p.startswith("joints."))
    choices = weaker_choices(model, pose, names)
    choices = {joint: [w for w in options if w.type] for joint, options in choices.items()}
    if not choices:
        return ()
    N = {joint: circuits_of_joints[:, jacobian.rows_of(joint)].T for joint in choices}
    driven = jacobian.A[np.isin(jacobian.owners, drivers)]

    def fits(cure: tuple[Weaker, ...]) -> bool:
        joints = _rows_after(pose, cure)
        with_drivers = Decomposition.of(np.vstack([joints, driven])).rank
        one_motion = Decomposition.of(joints).rank == n - 1
        return bool(one_motion and with_drivers == n - (not drivers))

    drops = len(circuits_of_joints) + 1
    usual = {j: [w for w in some if w.type in MACHINE_JOINTS] for j, some in choices.items()}
    cure = fewest_exchanges(usual, N, drops, 2, fits) or fewest_exchanges(
        choices, N, drops, 2, fits
    )
    return scene_exchanges(model, pose, cure) if cure is not None else ()


def _rows_after(pose: ConstraintPose, cure: tuple[Weaker, ...]) -> Array:
    """Rows of the joints after exchanges."""
    changed = {weaker.joint: weaker for weaker in cure}
    blocks = []
    for name in dict.fromkeys(pose.jacobian.owners):
        rows = pose.jacobian.A[pose.jacobian.rows_of(name)]
        if name.startswith("drivers."):
            continue
        if name in changed:
            released = changed[name].released
            rows = np.linalg.svd(released)[2][len(released) :] @ rows
        blocks.append(rows)
    return np.vstack(blocks)
