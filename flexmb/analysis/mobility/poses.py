"""Closed poses with nothing compiled: Gauss–Newton in numpy, and other poses of one assembly.

In: a compiled system and a pose. Out: the pose nearest to it that keeps the rows, and poses a short
way along the motions that the joints leave free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.closing import Closer
from flexmb.analysis.mobility.dependence import null_space
from flexmb.analysis.mobility.rows import ConstraintRows, Rows
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State

__all__ = ["Closed", "close", "closer_of", "column_scales", "joint_rows", "other_poses"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_ROUNDS = 60
_CLOSED = 1e-11  # gap over the model size, or radians
_ROUND_OFF = 1e-14
_LONGEST = 0.3  # correction in one round, over the model size or in radians
_DEFORMED = 1e-3  # how little modes move while bodies can
_SMALL = 1e-9  # singular values below this share of the largest are taken for zero
_AWAY = 0.05  # how far another pose is, over the model size or in radians
_TRIALS = 4


@dataclass(frozen=True)
class Closed:
    """A pose, its rows, and whether those that were asked for are kept."""

    q: Array
    rows: Rows
    kept: bool


def column_scales(compiled: Compiled) -> Array:
    """(nv,) how far one unit of each velocity coordinate moves: 0 for those left out of a plane."""
    scales: Array = np.where(compiled.system.kkt.column >= 0, 1.0 / compiled.system.weights, 0.0)
    scales[[start.iv for start in compiled.starts]] = 0.0  # states are no motion
    return scales


def joint_rows(compiled: Compiled) -> NDArray[np.bool_]:
    """(nc,) rows that are not drivers'."""
    driven = [path.startswith("drivers.") for path in compiled.layout.reactions]
    joints: NDArray[np.bool_] = ~np.repeat(driven, compiled.system.groups["n"]).astype(bool)
    return joints


def close(
    constraints: ConstraintRows, q: Array, which: Mask | None = None, t: float = 0.0
) -> Closed:
    """The pose near q (nq,) that keeps the rows `which` (nc,), all by default, at time t [s].

    Bodies are moved with least change over the model size and in radians; modes hardly.
    """
    compiled = constraints.compiled
    asked = np.ones(compiled.layout.nc, bool) if which is None else which
    weights = compiled.system.row_weights
    scales = _closing_scales(compiled, np.ones(len(compiled.layout.bodies)))
    gap, best = np.inf, 0
    rows = constraints.at(q, t)
    for n in range(_ROUNDS):
        size = float(np.abs(rows.C * weights)[asked].max(initial=0.0))
        if not np.isfinite(size) or size <= _ROUND_OFF or (size <= _CLOSED and size > 0.5 * gap):
            break
        if size < 0.5 * gap:
            gap, best = size, n
        if n > best + _ROUNDS // 4:
            break
        step = _correction(rows, asked, scales)
        if step is None:
            break
        q = constraints.moved(q, scales * step)
        rows = constraints.at(q, t)
    left = np.abs(rows.C * weights)[asked].max(initial=0.0)
    return Closed(q, rows, bool(left <= _CLOSED))


def _closing_scales(compiled: Compiled, weights: Array) -> Array:
    """(nv,) as `column_scales`, for bodies of different weights; modes hardly move."""
    scales = column_scales(compiled)
    for body, weight in zip(compiled.layout.bodies, weights, strict=True):
        scales[body.iv : body.iv + 6 + body.m] /= np.sqrt(weight)
        scales[body.iv + 6 : body.iv + 6 + body.m] *= _DEFORMED
    return scales


def _correction(rows: Rows, which: Mask, scales: Array) -> Array | None:
    """(nv,) Gauss–Newton correction over the scales, cut where it is long.

    None where a row has no gradient, such as a distance of zero.
    """
    weights = rows.compiled.system.row_weights
    A = (weights[:, None] * rows.Cq * scales)[which]
    if not np.all(np.isfinite(A)):
        return None
    step: Array = np.linalg.lstsq(A, -(rows.C * weights)[which], rcond=_SMALL)[0]
    longest = float(np.abs(step).max(initial=0.0))
    return step * min(1.0, _LONGEST / longest) if longest > 0 else step


def closer_of(compiled: Compiled, state: State, weights: Array) -> Closer:
    """Corrections of a state that are least over the model size, in radians, times body weights."""
    constraints, scales = ConstraintRows(compiled), _closing_scales(compiled, weights)
    asked = np.ones(compiled.layout.nc, bool)

    def correct() -> float:
        rows = constraints.at(state.q, float(state.t[0]))
        if np.abs(rows.C * compiled.system.row_weights).max(initial=0.0) <= _ROUND_OFF:
            return 0.0
        step = _correction(rows, asked, scales)
        if step is None:
            return float("nan")
        state.q[:] = constraints.moved(state.q, scales * step)
        return float(np.abs(step).max(initial=0.0))

    return Closer(constraints.work, correct, lambda: constraints.at(state.q, float(state.t[0])))


def other_poses(
    constraints: ConstraintRows, start: Closed, which: Mask, seed: int = 0
) -> list[Closed]:
    """Up to two poses of the same assembly, a short way along its free motions.

    Only the rows `which` are kept, such as those of the joints; at a pose from which the free
    motions do not lead to closed ones, none is found.
    """
    rng, compiled = np.random.default_rng(seed), constraints.compiled
    scales = column_scales(compiled)
    used = np.flatnonzero(scales > 0)
    A = (compiled.system.row_weights[:, None] * start.rows.Cq * scales)[which]
    motions = np.zeros((len(scales), 0))
    if len(used):
        free = null_space(A[:, used])
        motions = np.zeros((len(scales), free.shape[1]))
        motions[used] = free
    found: list[Closed] = []
    for _ in range(_TRIALS if motions.shape[1] else 0):
        step = motions @ rng.standard_normal(motions.shape[1])
        step *= _AWAY / np.abs(step).max()
        other = close(constraints, constraints.moved(start.q, scales * step), which)
        if other.kept:
            found.append(other)
        if len(found) == 2:
            break
    return found
