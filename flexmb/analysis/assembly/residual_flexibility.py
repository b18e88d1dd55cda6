"""Quasi-static modes in a pose: where they stay as they are within a step, where they move.

In: a compiled model and a closed pose. Out: the model whose bodies are kinetostatic
(`engine.bodies.static_modes`) only where the joints do not need their compliance: with these modes
still, bodies and dynamic modes must be able to do what all coordinates can, or drivers would lock
the machine, and reactions that only elasticity decides would be anyone's. Nor beside bodies with
other modes: what closes a joint there would strain these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    WeightedJacobian,
    dense_jacobian,
    n_free,
    numerical_rank,
    one_blas_thread,
)
from flexmb.engine.bodies.static_modes import STATIC_MODES, StaticModes
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import evaluate_rows
from flexmb.engine.tables import System
from flexmb.engine.work import new_state, new_work

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_NO_MASS = 1e-11  # of the largest


def static_bodies(compiled: Compiled) -> tuple[list[int], list[int]]:
    """Numbers of the bodies with quasi-static modes, and of the kinetostatic ones."""
    static = compiled.system.kinds.get(STATIC_MODES.name)
    if static is None:
        return [], []
    return static.rows.tolist(), static.rows[static.kinetostatic == 1].tolist()


def static_coordinates(compiled: Compiled, *, kinetostatic: bool = False) -> Integers:
    """(k,) places in v of the quasi-static modes: of all, or of kinetostatic bodies."""
    static = compiled.system.kinds.get(STATIC_MODES.name)
    if static is None:
        return np.zeros(0, np.int64)
    begins = np.array([body.iv + 6 for body in compiled.layout.bodies])
    count = np.diff(static.first)
    places = np.asarray(np.repeat(begins[static.rows], count) + static.modes, np.int64)
    return places[np.repeat(static.kinetostatic == 1, count)] if kinetostatic else places


@one_blas_thread()
def choose_static_modes(compiled: Compiled, q: Array) -> Compiled:
    """The model with kinetostatic bodies only if its joints allow them, at q (nq,)."""
    modes = static_coordinates(compiled, kinetostatic=True)
    if not len(modes) or n_free(compiled) > MAX_COORDINATES:
        return compiled
    if sum(body.m for body in compiled.layout.bodies) > len(modes):
        return replace(compiled, system=free_static_modes(compiled.system))
    state, work = new_state(compiled.system), new_work(compiled.system)
    state.q[:] = q
    evaluate_rows(compiled.system, state, work)
    rows = WeightedJacobian.of(compiled, dense_jacobian(compiled, work))
    ranks = [
        numerical_rank(np.asarray(np.linalg.svd(A, compute_uv=False)), 1.0)
        for A in (rows.A, rows.A[:, ~np.isin(rows.columns, modes)])
    ]
    if ranks[0] == ranks[1]:
        return compiled
    return replace(compiled, system=free_static_modes(compiled.system))


def free_static_modes(system: System) -> System:
    """The system with all quasi-static modes moving without mass."""
    static: StaticModes | None = system.kinds.get(STATIC_MODES.name)
    if static is None or not static.kinetostatic.any():
        return system
    free = static._replace(kinetostatic=np.zeros_like(static.kinetostatic))
    return system._replace(kinds={**system.kinds, STATIC_MODES.name: free})


def condensation(M: Array, K: Array) -> tuple[Array, Array, Integers]:
    """Static equilibrium of motions without mass (Guyan).

    M (n, n) is symmetric, K (n, n) need not be. Returns T and L (n, k) with the condensed matrices
    Lᵀ M T and Lᵀ K T, and the places (k,) of the coordinates that remain.
    """
    n = len(M)
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    free = vectors[:, values <= _NO_MASS * values.max(initial=0.0)]
    if not free.size:
        return np.eye(n), np.eye(n), np.arange(n)
    _, _, order = qr(free.T, pivoting=True, mode="economic")
    remaining = np.sort(order[free.shape[1] :])
    keep = np.eye(n)[:, remaining]
    stiffness = free.T @ K @ free
    T = keep - free @ np.linalg.solve(stiffness, free.T @ K @ keep)
    L = keep - free @ np.linalg.solve(stiffness.T, free.T @ K.T @ keep)
    return T, L, remaining
