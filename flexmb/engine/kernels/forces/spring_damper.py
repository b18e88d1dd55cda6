"""Linear spring–dampers: attraction f = k (d − d0) + c ḋ along the line between two markers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.row import separation
from flexmb.engine.kernels.forces.damping_tangent import add_rate_arms
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE, ZERO_LENGTH
from flexmb.engine.records import array_of
from flexmb.engine.state import Point, Run

SPRING = np.dtype(
    [
        ("I", "i8"),
        ("J", "i8"),
        ("k", "f8"),  # N/m
        ("c", "f8"),  # N s/m
        ("d0", "f8"),  # m
        ("couple", "i8"),
    ],
    align=True,
)


class Springs(NamedTuple):
    """Linear spring–dampers along lines."""

    rows: array_of(SPRING)


@kernel
def _direction(mi, mj):
    """Distance of two markers and the unit vector from I to J."""
    hx, hy, hz = separation(mi, mj)
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    return d, hx / d, hy / d, hz / d


@kernel
def _rate(mi, mj, nx, ny, nz):
    """ḋ of one spring."""
    u, v = mi["vx"], mj["vx"]
    return nx * (v[0] - u[0]) + ny * (v[1] - u[1]) + nz * (v[2] - u[2])


@kernel
def _attraction(spring, mi, mj, d, nx, ny, nz):
    """Attraction of one spring–damper, N."""
    f = spring["k"] * (d - spring["d0"])
    if spring["c"] != 0.0:
        f += spring["c"] * _rate(mi, mj, nx, ny, nz)
    return f


@kernel
def _add_forces(wi, wj, x, y, z):
    """Force (x, y, z) on marker I, the opposite on J."""
    wi[0] += x
    wi[1] += y
    wi[2] += z
    wj[0] -= x
    wj[1] -= y
    wj[2] -= z


@unit
def add_wrenches(run: Run, springs: Springs, at: Point) -> int:
    """Wrenches on the markers of all spring–dampers; ZERO_LENGTH at one that has no length."""
    rows, markers = springs.rows, run.work.now.marker
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        d, nx, ny, nz = _direction(mi, mj)
        if not d > 0.0:
            run.work.fault[0] = k
            return ZERO_LENGTH
        f = _attraction(rows[k], mi, mj, d, nx, ny, nz)
        _add_forces(mi["W"], mj["W"], f * nx, f * ny, f * nz)
    return FINE


@unit
def add_energies(run: Run, springs: Springs, at: Point) -> int:
    """Σ ½ k (d − d0)²."""
    rows, markers, out = springs.rows, run.work.now.marker, run.work.energies
    for k in range(rows.shape[0]):
        d, _, _, _ = _direction(markers[rows[k]["I"]], markers[rows[k]["J"]])
        out[3] += 0.5 * rows[k]["k"] * (d - rows[k]["d0"]) ** 2
    return FINE


@unit
def add_powers(run: Run, springs: Springs, at: Point) -> int:
    """−Σ c ḋ² of dampers."""
    rows, markers, out = springs.rows, run.work.now.marker, run.work.powers
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        _, nx, ny, nz = _direction(mi, mj)
        out[1] -= rows[k]["c"] * _rate(mi, mj, nx, ny, nz) ** 2
    return FINE


@unit
def put_wrench(run: Run, springs: Springs, at: Point, c: int) -> float:
    """Wrench pair of the spring–damper that channel c reads."""
    row, markers = springs.rows[run.system.sensors.channels[c]["first"]], run.work.now.marker
    w, pair = run.work.dense.g[1], run.work.dense.pair
    mi, mj = markers[row["I"]], markers[row["J"]]
    d, nx, ny, nz = _direction(mi, mj)
    f = _attraction(row, mi, mj, d, nx, ny, nz)
    for r in range(12):
        w[r] = 0.0
    _add_forces(w[0:6], w[6:12], f * nx, f * ny, f * nz)
    pair[0], pair[1] = row["I"], row["J"]
    return 0.0


@unit
def add_tangents(run: Run, springs: Springs, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all spring–dampers."""
    if cv == 0.0 and cp == 0.0:
        return FINE
    rows, markers, H, w = springs.rows, run.work.now.marker, run.work.dense.H, run.work.dense.g[1]
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j = row["I"], row["J"]
        mi, mj = markers[i], markers[j]
        d, nx, ny, nz = _direction(mi, mj)
        f = _attraction(row, mi, mj, d, nx, ny, nz)
        clear(H, 12, 12)
        _add_tangent(row, mi, mj, d, (nx, ny, nz), f, cv, cp, H)
        add_pair(run, i, j, row["couple"], 1.0)
        if row["c"] != 0.0:
            X, U = run.work.dense.X[0], run.work.dense.U[0]
            for c in range(12):
                X[c], U[c] = 0.0, 0.0
            _add_forces(X[0:6], X[6:12], row["c"] * nx, row["c"] * ny, row["c"] * nz)
            _add_forces(U[0:6], U[6:12], nx, ny, nz)
            add_rate_arms(run, at.v, i, j, row["couple"], 1, cp)
        for c in range(12):
            w[c] = 0.0
        _add_forces(w[0:6], w[6:12], -f * nx, -f * ny, -f * nz)
        add_moment_arms(run, i, j, cp)
    return FINE


@kernel
def _add_tangent(spring, mi, mj, d, n, f, cv, cp, H):
    """Add −(cp ∂w/∂position + cv ∂w/∂velocity) of one spring–damper to H (12, 12)."""
    r = _rate(mi, mj, n[0], n[1], n[2])
    along = cp * spring["k"] + cv * spring["c"]
    for a in range(3):
        for b in range(3):
            across = (1.0 if a == b else 0.0) - n[a] * n[b]
            # ∂ḋ/∂h = (u − ḋ n)/d
            slope = (mj["vx"][b] - mi["vx"][b] - r * n[b]) / d
            e = along * n[a] * n[b] + cp * (f * across / d + spring["c"] * n[a] * slope)
            H[a, b] += e
            H[6 + a, 6 + b] += e
            H[a, 6 + b] -= e
            H[6 + a, b] -= e


SPRINGS = Kind(
    "springs",
    Springs,
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
