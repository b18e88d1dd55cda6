"""Bushing and beam: six forces and moments between two markers, linear in their relative motion.

With the deflection x = (u − u0, φ) of `relative_motion` the potential is V = p0·x + ½ xᵀ K x, the
dissipation ẋᵀ C ẋ. The wrench pair on the markers is −Eᵀ p with p = p0 + K x + C ẋ and the gradient
E of x, so that its power is exactly −dV/dt − ẋᵀ C ẋ, also at large angles (below half a turn). At
small angles it is the bushing and the beam of MSC Adams (BUSHING, BEAM), K of the latter that of
Timoshenko's cantilever (Przemieniecki, Theory of Matrix Structural Analysis, 1968, sec. 5.6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.algebra.vector import copy, inner, part
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.forces import relative_motion
from flexmb.engine.kernels.forces.damping_tangent import add_rate_arms, add_rates
from flexmb.engine.kernels.forces.relative_motion import (
    RelativeMotion,
    new_relative_motion,
    put_gradient_of,
    put_pull_tangent,
    put_rate_change,
    put_rates,
    put_relative_motion,
    put_wrench_pair,
)
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import Vector, array_of
from flexmb.engine.state import Point, Run

# `at` is the offset in the pool of u0 (3), p0 (6), K (6, 6), C (6, 6).
SIX_COMPONENT_FORCE = np.dtype(
    [("I", "i8"), ("J", "i8"), ("couple", "i8"), ("at", "i8"), ("damped", "i8")],
    align=True,
)
P0, STIFFNESS, DAMPING = 3, 9, 45  # where they begin in a row of the pool


class SixComponentForces(NamedTuple):
    """Bushings and beams."""

    rows: array_of(SIX_COMPONENT_FORCE)
    pool: Vector
    scratch: RelativeMotion = None  # of one run


def _scratch(forces: SixComponentForces) -> RelativeMotion:
    return new_relative_motion()


@kernel
def _times(pool, o, x):
    """Six numbers of the pool times x (6)."""
    return inner(part(pool, o), part(x, 0)) + inner(part(pool, o + 3), part(x, 3))


@unit
def _put_forces(run: Run, forces: SixComponentForces, k: int) -> int:
    """Deflection of force k, its rate if damped, and forces conjugate to it."""
    row, pool, s = forces.rows[k], forces.pool, forces.scratch
    at = row["at"]
    put_relative_motion(run, row["I"], row["J"], s)
    if row["damped"] == 1:
        put_rates(run, row["I"], row["J"], s)
    for r in range(3):
        s.x[r] -= pool[at + r]
    for r in range(6):
        elastic = pool[at + P0 + r] + _times(pool, at + STIFFNESS + 6 * r, s.x)
        viscous = _times(pool, at + DAMPING + 6 * r, s.rate) if row["damped"] == 1 else 0.0
        s.elastic[r], s.viscous[r], s.p[r] = elastic, viscous, elastic + viscous
    return FINE


@unit
def add_wrenches(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Wrenches on the markers of all bushings and beams."""
    rows, markers, s = forces.rows, run.work.now.marker, forces.scratch
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        _put_forces(run, forces, k)
        relative_motion.add_wrenches(mi, mj, s, mi["W"], mj["W"])
    return FINE


@unit
def add_energies(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Σ p0·x + ½ xᵀ K x."""
    rows, pool, s, out = forces.rows, forces.pool, forces.scratch, run.work.energies
    for k in range(rows.shape[0]):
        _put_forces(run, forces, k)
        for r in range(6):
            out[3] += 0.5 * s.x[r] * (pool[rows[k]["at"] + P0 + r] + s.elastic[r])
    return FINE


@unit
def add_powers(run: Run, forces: SixComponentForces, at: Point) -> int:
    """−Σ ẋᵀ C ẋ."""
    rows, s, out = forces.rows, forces.scratch, run.work.powers
    for k in range(rows.shape[0]):
        if rows[k]["damped"] == 1:
            _put_forces(run, forces, k)
            for r in range(6):
                out[1] -= s.rate[r] * s.viscous[r]
    return FINE


@unit
def put_wrench(run: Run, forces: SixComponentForces, at: Point, c: int) -> float:
    """Wrench pair of the bushing or beam that channel c reads."""
    k, pair = run.system.sensors.channels[c]["first"], run.work.dense.pair
    pair[0], pair[1] = forces.rows[k]["I"], forces.rows[k]["J"]
    _put_forces(run, forces, k)
    put_wrench_pair(run, pair[0], pair[1], forces.scratch)
    return 0.0


@kernel
def _add_product(pool, o, f, E, U):
    """U += f A E, A (6, 6) at o in the pool."""
    for r in range(6):
        for k in range(6):
            x = f * pool[o + 6 * r + k]
            if x != 0.0:
                for c in range(12):
                    U[r, c] += x * E[k, c]


@unit
def add_tangents(run: Run, forces: SixComponentForces, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all bushings and beams."""
    if cv == 0.0 and cp == 0.0:
        return FINE
    rows, pool, s, U = forces.rows, forces.pool, forces.scratch, run.work.dense.U
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j, link, o, damped = row["I"], row["J"], row["couple"], row["at"], row["damped"] == 1
        _put_forces(run, forces, k)
        put_gradient_of(run, i, j, s)
        put_pull_tangent(run, i, j, s, cp)
        clear(U, 6, 12)
        _add_product(pool, o + STIFFNESS, cp, s.E, U)
        if damped:
            put_rate_change(run, i, j, s)
            _add_product(pool, o + DAMPING, cv, s.E, U)
            _add_product(pool, o + DAMPING, cp, s.D, U)
        for r in range(6):
            copy(s.E[r], run.work.dense.X[r])
        add_rates(run, 6, 1.0)
        add_pair(run, i, j, link, 1.0)
        add_moment_arms(run, i, j, cp)
        if damped and cp != 0.0:
            clear(U, 6, 12)
            _add_product(pool, o + DAMPING, cp, s.E, U)
            add_rate_arms(run, at.v, i, j, link, 6, 1.0)
    return FINE


SIX_COMPONENT_FORCES = Kind(
    "six_component_forces",
    SixComponentForces,
    {
        "wrench": add_wrenches,
        "matrix": add_tangents,
        "energy": add_energies,
        "power": add_powers,
        "wrenches": put_wrench,
    },
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    works=True,
    stiff=True,
    scratch=_scratch,
)
