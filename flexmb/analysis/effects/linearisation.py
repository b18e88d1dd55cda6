"""The equations of motion of a model state by state, as dense arrays.

All is evaluated by the units of the time loop (`engine.small_motions`). Rotations are increments in
body axes, so that δω' = δθ̇ + ω' × δθ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.motion import move
from flexmb.engine.compile import Compiled
from flexmb.engine.small_motions import evaluate_equations, matrix_at_state
from flexmb.engine.units import call, hand_over, prepare_units
from flexmb.engine.work import new_run, new_state, new_work, units_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Row(NamedTuple):
    """A state of a motion: t, and SI arrays q (nq,), v, vd (nv,), lam (nc,)."""

    t: float
    q: Array
    v: Array
    vd: Array
    lam: Array


class Matrices(NamedTuple):
    """M, ∂F/∂v and ∂F/∂q (nv, nv), Cq (nc, nv); rows and columns left out of a plane are zero."""

    M: Array
    D: Array
    K: Array
    Cq: Array


class Linearisation:
    """Residual, channels and matrices of a compiled model, state by state.

    Parameters
    ----------
    compiled : Compiled
        The compiled model; its units are loaded, and compiled if need be.
    """

    def __init__(self, compiled: Compiled) -> None:
        system, n = compiled.system, len(compiled.layout.channels)
        prepare_units([evaluate_equations, matrix_at_state, move, *units_of(system)])
        self.compiled = compiled
        self._state, self._work = new_state(system, n), new_work(system, n)
        self._run = hand_over(new_run(system, self._state, self._work))
        self._channels = np.zeros(n)
        self._entries = _entries(compiled)
        self._state.angles[:] = np.nan

    def evaluate(self, row: Row) -> tuple[Array, Array, Array]:
        """F (nv,), C (nc,) and channels (k,) at a state.

        Angles that count turns go on from those of the state that was evaluated before.
        """
        state = self._state
        state.t[0] = row.t
        for name in ("q", "v", "vd", "lam"):
            getattr(state, name)[:] = getattr(row, name)
        call(evaluate_equations, self._run, self._channels)
        return self._work.trial.res.copy(), self._work.con.C.copy(), self._channels.copy()

    def matrices(self) -> Matrices:
        """The matrices of small motions about the state that was evaluated last."""
        nv = self.compiled.layout.nv
        A = [self._matrix(cv, cp) for cv, cp in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
        M = A[0][:nv, :nv]
        return Matrices(M, A[1][:nv, :nv] - M, A[2][:nv, :nv] - M, A[0][nv:, :nv])

    def moved(self, row: Row, dq: Array, dv: Array, dvd: Array, dlam: Array) -> Row:
        """The state displaced by a small motion (nv,), and its changes of v, v̇ and λ."""
        q = row.q.copy()
        call(move, self.compiled.system.parts, row.q, np.ascontiguousarray(dq), q)
        return Row(row.t, q, row.v + dv, row.vd + dvd, row.lam + dlam)

    @property
    def angles(self) -> Array:
        """(k,) angles that count turns, of the last state; set them to go on from another one."""
        angles: Array = self._state.angles
        return angles

    def blank(self) -> Row:
        """The placed pose at rest."""
        layout = self.compiled.layout
        zero = np.zeros(layout.nv)
        return Row(0.0, self.compiled.initial_q.copy(), zero, zero, np.zeros(layout.nc))

    def assemble(self, cv: float, cp: float) -> None:
        """M + cv ∂F/∂v + cp ∂F/∂q about the state that was evaluated last, in the panels."""
        call(matrix_at_state, self._run, cv, cp)

    def _matrix(self, cv: float, cp: float) -> Array:
        self.assemble(cv, cp)
        factor, place = self._work.factor, self.compiled.system.kkt.place
        n = len(place) + 1
        A = np.zeros((n, n))  # in elimination order; the last row and column are left out
        entries, rows, columns = self._entries
        A[columns, rows] = factor.up[entries]
        A[rows, columns] = factor.low[entries]
        A[-1], A[:, -1] = 0.0, 0.0
        where = np.where(place < n - 1, place, n - 1)
        B: Array = A[np.ix_(where, where)]
        return B


def _entries(compiled: Compiled) -> tuple[Indices, Indices, Indices]:
    """Numbers of the panels that are in use, with their row and column in elimination order."""
    kkt = compiled.system.kkt
    size = sum(int((p["nc"] + p["nr"]) * p["nc"]) for p in kkt.panels)
    rows, columns = np.zeros(size, np.int64), np.zeros(size, np.int64)
    for p in kkt.panels:
        at, nc, nr, col = (int(p[key]) for key in ("at", "nc", "nr", "col"))
        below = kkt.rows[int(p["rows"]) : int(p["rows"]) + nr]
        own = slice(at, at + (nc + nr) * nc)
        rows[own] = np.repeat(np.append(np.arange(col, col + nc), below), nc)
        columns[own] = np.tile(np.arange(col, col + nc), nc + nr)
    entries = np.flatnonzero(rows >= columns)
    return entries, rows[entries], columns[entries]
