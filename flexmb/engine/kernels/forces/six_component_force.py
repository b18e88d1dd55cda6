"""Bushing and beam: six forces and moments between two markers, linear in their relative motion.

With the deflection x = (u − u0, φ) of `relative_motion` the potential is V = p0·x + ½ xᵀ K x, the
dissipation ẋᵀ C ẋ. The pull of J to I is f = ∂V/∂u + (C ẋ)_u and m = Gᵀ (∂V/∂φ + (C ẋ)_φ),
φ̇ = G ω, so that its power is exactly −dV/dt − ẋᵀ C ẋ, also at large angles (below half a turn). At
small angles it is the bushing and the beam of MSC Adams (BUSHING, BEAM), K of the latter that of
Timoshenko's cantilever (Przemieniecki, Theory of Matrix Structural Analysis, 1968, sec. 5.6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.algebra.vector import put
from flexmb.engine.kernels.bodies.pair_tangent import add_moment_arms, add_pair
from flexmb.engine.kernels.forces import relative_motion
from flexmb.engine.kernels.forces.damping_tangent import add_damping_moment_arms
from flexmb.engine.kernels.forces.relative_motion import (
    RelativeMotion,
    inverse_tangent,
    inverse_tangent_slope,
    put_relative_motion,
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
    scratch: RelativeMotion


@unit
def _put_deflection(run: Run, forces: SixComponentForces, k: int) -> int:
    """scratch.x = deflection; the rate as in `relative_motion`."""
    force, pool, x, markers = forces.rows[k], forces.pool, forces.scratch.x, run.work.now.marker
    put_relative_motion(markers[force["I"]], markers[force["J"]], forces.scratch)
    for a in range(3):
        x[a] -= pool[force["at"] + a]
    return FINE


@kernel
def _rotation_rate(s):
    """φ̇ = G ω."""
    return inverse_tangent(s.x, 3, 1.0, s.rate[3], s.rate[4], s.rate[5])


@unit
def _put_pull(run: Run, forces: SixComponentForces, k: int) -> int:
    """scratch.f, the pull of J to I in axes of I, with x, rate and p."""
    force, pool, s = forces.rows[k], forces.pool, forces.scratch
    at, x, p, rate, f = force["at"], s.x, s.p, s.rate, s.f
    _put_deflection(run, forces, k)
    for r in range(6):
        p[r] = pool[at + P0 + r]
        for c in range(6):
            p[r] += pool[at + STIFFNESS + 6 * r + c] * x[c]
    if force["damped"] == 1:
        ax, ay, az = _rotation_rate(s)
        for r in range(6):
            o = at + DAMPING + 6 * r
            for c in range(3):
                p[r] += pool[o + c] * rate[c]
            p[r] += pool[o + 3] * ax + pool[o + 4] * ay + pool[o + 5] * az
    put(f, 0, p[0], p[1], p[2])
    ax, ay, az = inverse_tangent(x, 3, -1.0, p[3], p[4], p[5])
    put(f, 3, ax, ay, az)
    return FINE


@kernel
def _times(pool, k, x, y, z):
    """Three numbers of the pool times (x, y, z)."""
    return pool[k] * x + pool[k + 1] * y + pool[k + 2] * z


@unit
def _linearise(forces: SixComponentForces, k: int) -> int:
    """K and C of the scratch, after `_put_pull`.

    Change of f per (δu, δθ) at constant (u̇, ω), and per (u̇, ω).
    """
    force, pool, s = forces.rows[k], forces.pool, forces.scratch
    at, w, p, phi, K, C = force["at"], s.rate, s.p, s.x, s.K, s.C
    for j in range(6):
        b = 0 if j < 3 else 3
        dx, dy, dz = 1.0 * (j == b), 1.0 * (j == b + 1), 1.0 * (j == b + 2)
        gx, gy, gz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if b == 3:
            dx, dy, dz = inverse_tangent(phi, 3, 1.0, dx, dy, dz)
            gx, gy, gz = inverse_tangent_slope(phi, 3, 1.0, w[3], w[4], w[5], dx, dy, dz)
            tx, ty, tz = inverse_tangent_slope(phi, 3, -1.0, p[3], p[4], p[5], dx, dy, dz)
        for r in range(6):
            k, c = at + STIFFNESS + 6 * r, at + DAMPING + 6 * r
            K[r, j] = _times(pool, k + b, dx, dy, dz)
            C[r, j] = _times(pool, c + b, dx, dy, dz)
            if force["damped"] == 1:
                K[r, j] += _times(pool, c + 3, gx, gy, gz)
        x, y, z = inverse_tangent(phi, 3, -1.0, K[3, j], K[4, j], K[5, j])
        K[3, j], K[4, j], K[5, j] = x + tx, y + ty, z + tz
        x, y, z = inverse_tangent(phi, 3, -1.0, C[3, j], C[4, j], C[5, j])
        C[3, j], C[4, j], C[5, j] = x, y, z
    return FINE


@unit
def add_wrenches(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Wrenches on the markers of all bushings and beams."""
    rows, markers, f = forces.rows, run.work.now.marker, forces.scratch.f
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        _put_pull(run, forces, k)
        relative_motion.add_wrenches(mi, mj, f, mi["W"], mj["W"])
    return FINE


@unit
def add_energies(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Σ p0·x + ½ xᵀ K x."""
    rows, pool, x, e = forces.rows, forces.pool, forces.scratch.x, 0.0
    for k in range(rows.shape[0]):
        o = rows[k]["at"]
        _put_deflection(run, forces, k)
        for r in range(6):
            e += pool[o + P0 + r] * x[r]
            for c in range(6):
                e += 0.5 * x[r] * pool[o + STIFFNESS + 6 * r + c] * x[c]
    run.work.energies[3] += e
    return FINE


@unit
def add_powers(run: Run, forces: SixComponentForces, at: Point) -> int:
    """−Σ ẋᵀ C ẋ."""
    rows, pool, rate, p = forces.rows, forces.pool, forces.scratch.rate, 0.0
    for k in range(rows.shape[0]):
        if rows[k]["damped"] == 0:
            continue
        o = rows[k]["at"]
        _put_deflection(run, forces, k)
        x, y, z = _rotation_rate(forces.scratch)
        put(rate, 3, x, y, z)
        for r in range(6):
            for c in range(6):
                p -= rate[r] * pool[o + DAMPING + 6 * r + c] * rate[c]
    run.work.powers[1] += p
    return FINE


@unit
def put_wrench(run: Run, forces: SixComponentForces, at: Point, c: int) -> float:
    """Wrench pair of the bushing or beam that channel c reads."""
    k, d, markers = run.system.sensors.channels[c]["first"], run.work.dense, run.work.now.marker
    w, pair, i, j = d.g[1], d.pair, forces.rows[k]["I"], forces.rows[k]["J"]
    for r in range(12):
        w[r] = 0.0
    _put_pull(run, forces, k)
    relative_motion.add_wrenches(markers[i], markers[j], forces.scratch.f, w[0:6], w[6:12])
    pair[0], pair[1] = i, j
    return 0.0


@unit
def _put_tangent(run: Run, forces: SixComponentForces, k: int, cv: float, cp: float) -> int:
    """dense.H = −(cp ∂w/∂position + cv ∂w/∂velocity), after `_linearise`; W of the scratch."""
    row, markers, H = forces.rows[k], run.work.now.marker, run.work.dense.H
    mi, mj = markers[row["I"]], markers[row["J"]]
    clear(H, 12, 12)
    relative_motion.add_tangent(mi, mj, forces.scratch, row["damped"], cv, cp, H)
    return FINE


@unit
def add_tangents(run: Run, forces: SixComponentForces, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all bushings and beams."""
    if cv == 0.0 and cp == 0.0:
        return FINE
    rows, markers, d, s = forces.rows, run.work.now.marker, run.work.dense, forces.scratch
    w, f = d.g[1], s.f
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j, link = row["I"], row["J"], row["couple"]
        _put_pull(run, forces, k)
        _linearise(forces, k)
        _put_tangent(run, forces, k, cv, cp)
        add_pair(run, i, j, link, 1.0)
        if row["damped"] == 1 and cp != 0.0:
            add_damping_moment_arms(run, at, i, j, link, cp, s.W, s.N)
        for c in range(12):
            w[c] = 0.0
        for c in range(6):
            f[c] = -f[c]
        relative_motion.add_wrenches(markers[i], markers[j], f, w[0:6], w[6:12])
        add_moment_arms(run, i, j, cp)
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
)
