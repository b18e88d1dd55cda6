"""Closed poses without compiled kernels: Gauss–Newton in numpy, and other poses of one assembly.

In: a compiled system and a pose. Out: the pose nearest to it that keeps the rows, and poses a short
way along the motions that the joints leave free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dependence import null_space
from flexmb.analysis.rows import Rows, moved, rows_at
from flexmb.engine.compile import Compiled

__all__ = ["Closed", "close", "column_scales", "other_poses"]

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


def close(compiled: Compiled, q: Array, which: Mask | None = None, t: float = 0.0) -> Closed:
    """The pose near q (nq,) that keeps the rows `which` (nc,), all by default, at time t [s].

    Bodies are moved with least change over the model size and in radians; modes hardly.
    """
    system = compiled.system
    weights = system.row_weights[:, None]
    asked = np.ones(compiled.layout.nc, bool) if which is None else which
    scales = column_scales(compiled)
    for body in compiled.layout.bodies:
        scales[body.iv + 6 : body.iv + 6 + body.m] *= _DEFORMED
    gap, best = np.inf, 0
    rows = rows_at(compiled, q, t)
    for n in range(_ROUNDS):
        C = (rows.C * system.row_weights)[asked]
        size = float(np.abs(C).max(initial=0.0))
        if not np.isfinite(size) or size <= _ROUND_OFF or (size <= _CLOSED and size > 0.5 * gap):
            break
        if size < 0.5 * gap:
            gap, best = size, n
        if n > best + _ROUNDS // 4:
            break
        A = (weights * rows.Cq * scales)[asked]
        step = np.linalg.lstsq(A, -C, rcond=_SMALL)[0]
        longest = float(np.abs(step).max(initial=0.0))
        step *= min(1.0, _LONGEST / longest) if longest > 0 else 0.0
        q = moved(compiled, q, scales * step)
        rows = rows_at(compiled, q, t)
    left = np.abs(rows.C * system.row_weights)[asked].max(initial=0.0)
    return Closed(q, rows, bool(left <= _CLOSED))


def other_poses(compiled: Compiled, start: Closed, which: Mask, seed: int = 0) -> list[Closed]:
    """Up to two poses of the same assembly, a short way along its free motions.

    Only the rows `which` are kept, such as those of the joints; at a pose from which the free
    motions do not lead to closed ones, none is found.
    """
    rng = np.random.default_rng(seed)
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
        other = close(compiled, moved(compiled, start.q, scales * step), which)
        if other.kept:
            found.append(other)
        if len(found) == 2:
            break
    return found
