"""Loads: a force or a torque on one marker, in global axes or in those of its marker.

Its components are three functions of time or of measured channels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.blocks import add_skew, clear
from flexmb.engine.algebra.rotation import transform
from flexmb.engine.algebra.vector import put
from flexmb.engine.bodies.wrench import add_moment_arms, add_own
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.forces.unit_force import pull_back
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE
from flexmb.engine.records import array_of
from flexmb.engine.state import Point, Run

# `follower` = 1: components in the axes of the marker.
LOAD = np.dtype(
    [("marker", "i8"), ("torque", "i8"), ("follower", "i8"), ("fun", "i8", (3,))],
    align=True,
)


class Loads(NamedTuple):
    """Forces and torques on one marker each."""

    rows: array_of(LOAD)


@kernel
def _vector(load, markers, fun):
    """Force or torque of one load, global axes."""
    f = load["fun"]
    x, y, z = fun[f[0], 0], fun[f[1], 0], fun[f[2], 0]
    if load["follower"] == 1:
        return transform(markers[load["marker"]]["R"], x, y, z)
    return x, y, z


@unit
def add_wrenches(run: Run, loads: Loads, at: Point) -> int:
    """Forces and torques on their markers."""
    rows, markers, fun = loads.rows, run.work.now.marker, run.work.con.fun
    for k in range(rows.shape[0]):
        W, o = markers[rows[k]["marker"]]["W"], 3 * rows[k]["torque"]
        x, y, z = _vector(rows[k], markers, fun)
        W[o] += x
        W[o + 1] += y
        W[o + 2] += z
    return FINE


@unit
def add_powers(run: Run, loads: Loads, at: Point) -> int:
    """Power of all forces and torques."""
    rows, markers, fun, out = loads.rows, run.work.now.marker, run.work.con.fun, run.work.powers
    for k in range(rows.shape[0]):
        mn = markers[rows[k]["marker"]]
        x, y, z = _vector(rows[k], markers, fun)
        u = mn["om"] if rows[k]["torque"] == 1 else mn["vx"]
        out[2] += x * u[0] + y * u[1] + z * u[2]
    return FINE


@unit
def add_tangents(run: Run, loads: Loads, at: Point, cv: float, cp: float) -> int:
    """−cp ∂Q/∂q of all loads: a follower turns with its marker, and moment arms change."""
    if cv == 0.0 and cp == 0.0:
        return FINE
    rows, markers, fun, d = loads.rows, run.work.now.marker, run.work.con.fun, run.work.dense
    H, w = d.H, d.g[1]
    for k in range(rows.shape[0]):
        i, o = rows[k]["marker"], 3 * rows[k]["torque"]
        x, y, z = _vector(rows[k], markers, fun)
        if rows[k]["follower"] == 1:
            clear(H, 12, 12)
            add_skew(H, o, 3, 1.0, (x, y, z))  # δF = δφ × F, so −∂F/∂φ = F~
            add_own(run, i, 0, cp)
        for c in range(6):
            w[c] = 0.0
        put(w, o, -x, -y, -z)
        add_moment_arms(run, i, -1, cp)
    return FINE


@unit
def put_wrench(run: Run, loads: Loads, at: Point, c: int) -> float:
    """Wrench of the load that channel c reads, on J of a pair."""
    row, d = loads.rows[run.system.sensors.channels[c]["first"]], run.work.dense
    w, pair = d.g[1], d.pair
    for r in range(12):
        w[r] = 0.0
    x, y, z = _vector(row, run.work.now.marker, run.work.con.fun)
    put(w, 6 + 3 * row["torque"], x, y, z)
    pair[0], pair[1] = row["marker"], row["marker"]
    return 0.0


@unit
def put_unit_force(run: Run, loads: Loads, at: Point, part: int) -> float:
    """Generalised force per unit of one component of a load, for feedback (`engine.kind`)."""
    row, a, w = loads.rows[part // 6], part % 3, run.work.dense.g[1]
    k, o = row["marker"], 3 * row["torque"]
    for c in range(6):
        w[c] = 0.0
    if row["follower"] == 1:
        R = run.work.now.marker[k]["R"]
        put(w, o, R[0, a], R[1, a], R[2, a])
    else:
        w[o + a] = 1.0
    pull_back(run, k, 0)
    return 0.0


LOADS = Kind(
    "loads",
    Loads,
    {
        "wrench": add_wrenches,
        "matrix": add_tangents,
        "power": add_powers,
        "wrenches": put_wrench,
        "unit_force": put_unit_force,
    },
    works=True,
)
