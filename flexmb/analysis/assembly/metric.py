"""The metric in which the first state is changed least.

Corrections of positions and velocities minimise δᵀ M δ with a change to M: the modal mass becomes
M + b K, so that gaps are closed by moving bodies and hardly by straining them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import System

_STIFF = 1e-12  # a mode softer than this share of the stiffest has no stiffness at all


def stiff_system(system: System, b: float) -> System:
    """The same system with modal masses M + b K, b in s²."""
    pool = system.parts.pool.copy()
    for body in _flexible(system):
        mass, stiffness = modal_blocks(pool, body)
        mass += b * stiffness
    return system._replace(parts=system.parts._replace(pool=pool))


def weighted_system(system: System, weights: NDArray[np.float64]) -> System:
    """The same system with the inertia of each body times its weight; (bodies,) weights."""
    if np.all(weights == 1.0):
        return system
    bodies, pool = system.parts.bodies.copy(), system.parts.pool.copy()
    bodies["mass"] *= weights
    bodies["S1"] *= weights[:, None]
    bodies["S0"] *= weights[:, None, None]
    for body, weight in zip(_flexible(system), weights[bodies["m"] > 0], strict=True):
        m, at = int(body["m"]), int(body["flex"])
        pool[at : at + 12 * m + 13 * m * m] *= weight  # all but stiffness and damping
    return system._replace(parts=system.parts._replace(bodies=bodies, pool=pool))


def _flexible(system: System) -> NDArray[np.void]:
    """Rows of the bodies that have modes."""
    bodies = system.parts.bodies
    return np.asarray(bodies[bodies["m"] > 0])


def modal_blocks(
    pool: NDArray[np.float64], body: np.void
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Views (m, m) of the modal mass and stiffness of one body in the pool."""
    m = int(body["m"])
    at = int(body["flex"]) + 12 * m + 12 * m * m
    mass, stiffness = pool[at : at + 2 * m * m].reshape(2, m, m)
    return mass, stiffness


def slowest_period(system: System) -> float:
    """1/ω² of the softest mode of all bodies that has stiffness [s²]; 0 without flexible bodies."""
    slowest = 0.0
    for body in _flexible(system):
        mass, stiffness = modal_blocks(system.parts.pool, body)
        half = np.linalg.inv(np.linalg.cholesky(mass))
        values = np.linalg.eigvalsh(half @ stiffness @ half.T)
        values = values[values > _STIFF * values.max(initial=0.0)]
        slowest = max(slowest, 1.0 / float(values.min())) if values.size else slowest
    return slowest
