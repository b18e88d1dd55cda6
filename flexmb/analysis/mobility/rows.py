"""Constraint rows of a system at any positions: values, gradients, Jacobian, markers.

The rows are those of the engine's units (`engine.constraint_rows`). Nothing is compiled for them:
where units are missing in the cache they run as plain Python, from the same source.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.motion import move
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import evaluate_rows
from flexmb.engine.row_kinds import ROW_KINDS
from flexmb.engine.state import Work, rows_between
from flexmb.engine.units import call_ready
from flexmb.engine.work import new_state, new_work

__all__ = ["ConstraintRows", "Rows", "dense_jacobian", "gradient"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """All rows in one pose.

    Values C (nc,), Jacobian Cq (nc, nv), and all markers: positions x (n, 3) and axes R (n, 3, 3)
    in global axes.
    """

    compiled: Compiled
    C: Array
    Cq: Array
    x: Array
    R: Array

    @cached_property
    def g(self) -> Array:
        """Gradients (nc, 12) for the motions (δx_I, δφ_I, δx_J, δφ_J) of both markers."""
        g = np.zeros((len(self.C), 12))
        for k, row in enumerate(self.compiled.system.rows):
            i, j = row["I"], row["J"]
            axes = int(row["kind"]), int(row["a"]), int(row["b"])
            g[k] = gradient(axes, self.x[i], self.R[i], self.x[j], self.R[j])
        return g


class ConstraintRows:
    """The rows of a system, pose by pose.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    """

    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        channels = len(compiled.layout.channels)
        self._state = new_state(compiled.system, channels)
        self.work = new_work(compiled.system, channels)

    def at(self, q: Array, t: float = 0.0) -> Rows:
        """The rows at the positions q (nq,) and the time t [s]."""
        self._state.t[0] = t
        self._state.q[:] = q
        evaluate_rows(self.compiled.system, self._state, self.work)
        markers = self.work.now.marker
        return Rows(
            self.compiled,
            self.work.con.C.copy(),
            dense_jacobian(self.compiled, self.work),
            markers["x"].copy(),
            markers["R"].copy(),
        )

    def moved(self, q: Array, d: Array) -> Array:
        """q ∘ exp(d) for a change d (nv,) of the velocity coordinates."""
        out = q.copy()
        call_ready(move, self.compiled.system.parts, q, d, out)
        return out


def gradient(axes: tuple[int, int, int], xi: Array, Ri: Array, xj: Array, Rj: Array) -> Array:
    """Gradient (12,) of a row (kind, a, b) for (δx_I, δφ_I, δx_J, δφ_J) in global axes.

    Not finite where the row has none, such as a distance of zero.
    """
    (kind, a, b), at = axes, rows_between(xi, Ri, xj, Rj)
    with np.errstate(all="ignore"):
        ROW_KINDS[kind].gradient(at, a, b, 0, 1)
    return np.asarray(at.g)


def dense_jacobian(compiled: Compiled, work: Work) -> Array:
    """Cq (nc, nv) from the rows on bodies (Dense.jac) and the markers, as units left them."""
    system, jac = compiled.system, work.dense.jac
    rows, parts = system.rows, system.parts
    Cq = np.zeros((compiled.layout.nc, compiled.layout.nv))
    for side in "IJ":
        places = rows[f"jac_{side}"]
        on_body = np.flatnonzero(places >= 0)
        bodies = parts.bodies[parts.markers["body"][rows[side][on_body]]]
        for m in np.unique(bodies["m"]):
            mine, count = bodies["m"] == m, np.arange(6 + m)
            k = on_body[mine, None]
            Cq[k, bodies["iv"][mine, None] + count] += jac[places[k] + count]
    for follow in system.follows:
        Cq[follow["row"], parts.coordinates[follow["coordinate"]]["iv"]] -= follow["factor"]
    _put_curve_columns(compiled, work, Cq)
    return Cq


def _put_curve_columns(compiled: Compiled, work: Work, Cq: Array) -> None:
    """What the rows on curve markers change with the places of these along their curves."""
    system, markers = compiled.system, work.now.marker
    for curve, now in zip(system.parts.curve_markers, work.now.curve_marker, strict=True):
        group, side = system.groups[curve["group"]], slice(6 * curve["side"], 6 * curve["side"] + 6)
        column = system.parts.coordinates[curve["coordinate"]]["iv"]
        for k in range(group["row"], group["row"] + group["n"]):
            row = system.rows[k]
            axes = int(row["kind"]), int(row["a"]), int(row["b"])
            mi, mj = markers[row["I"]], markers[row["J"]]
            Cq[k, column] = gradient(axes, mi["x"], mi["R"], mj["x"], mj["R"])[side] @ now["J"]
