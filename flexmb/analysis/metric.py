"""The metric in which the first state is changed least.

Corrections of positions and velocities minimise δᵀ M δ with two changes to M: modal coordinates weigh
1e8 times as much, so that gaps are closed by moving bodies and not by straining them, and bodies
whose velocity the user gave weigh as much more, so that the others adapt to them.
"""

from __future__ import annotations

import numpy as np

from flexmb.engine.tables import System
from flexmb.model.model import Model

_HEAVY = 1e8


def stiff_system(system: System) -> System:
    """The same system with heavy modal coordinates."""
    pool = system.parts.pool.copy()
    for body in system.parts.bodies:
        m = int(body["m"])
        at = int(body["flex"]) + 12 * m + 12 * m * m
        pool[at : at + m * m] *= _HEAVY
    return system._replace(parts=system.parts._replace(pool=pool))


def anchored_system(system: System, model: Model) -> System:
    """A stiff system in which bodies with a given velocity are heavy."""
    bodies = system.parts.bodies.copy()
    for row, spec in zip(bodies, model.bodies.values(), strict=True):
        if spec.velocity is not None or spec.angular_velocity is not None:
            for field in ("mass", "S1", "S0"):
                row[field] = np.asarray(row[field]) * _HEAVY
    return system._replace(parts=system.parts._replace(bodies=bodies))
