"""Nonlinear spring–dampers, actuators and stops: forces by a characteristic of one measure.

The measure is the distance of two markers, a component of their separation, or a scalar coordinate.
With the gradient g (12) of a measure between markers and the resistance R of `characteristic` the
wrench pair is −R g, as for a constraint row whose multiplier is R.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexmb.engine.algebra.blocks import clear
from flexmb.engine.algebra.vector import copy
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair
from flexmb.engine.jit import kernel, unit
from flexmb.engine.joints.point_joint import (
    distance_gradient,
    distance_tangent,
    dot2_gradient,
    dot2_tangent,
)
from flexmb.engine.joints.row import rate, separation
from flexmb.engine.kernels.forces.characteristic import (
    COORDINATE_OF,
    DISTANCE_OF,
    FORCE_CHARACTERISTIC,
    dissipation,
    resistance,
    stored_energy,
)
from flexmb.engine.kernels.forces.damping_tangent import add_rate_arms, add_rates
from flexmb.engine.kernels.forces.unit_force import pull_back
from flexmb.engine.kernels.functions.function import FunctionTable
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE, ZERO_LENGTH
from flexmb.engine.records import Integers, Vector, array_of
from flexmb.engine.state import Point, Run

_Z = 2


class Scratch(NamedTuple):
    """Scratch of one force."""

    s: Vector  # (2,) its measure s and ṡ
    R: Vector  # (3,) resistance R, ∂R/∂s, ∂R/∂ṡ
    g: Vector  # (12,) gradient of a measure between markers


class ForceCharacteristics(NamedTuple):
    """Nonlinear spring–dampers, actuators and stops."""

    rows: array_of(FORCE_CHARACTERISTIC)
    programs: FunctionTable  # of springs and dampers, their variable in place of time
    stops: Integers  # rows that are stops
    first_event: int  # place of the first stop among the events, two for each
    scratch: Scratch = None  # of one run


def _scratch(forces: ForceCharacteristics) -> Scratch:
    return Scratch(*(np.full(n, np.nan) for n in (2, 3, 12)))


@kernel
def _function_value(row, fun):
    """Present value of its function of time."""
    return fun[row["fun"], 0] if row["fun"] >= 0 else 0.0


@kernel
def _between_markers(row):
    """Whether a force acts between two markers, not on a coordinate."""
    return row["measure"] != COORDINATE_OF


@unit
def _put_measure(run: Run, forces: ForceCharacteristics, at: Point, k: int) -> int:
    """s and ṡ of force k, and between markers the gradient, after a velocity stage.

    ZERO_LENGTH at the distance of one point, which has no direction.
    """
    row, s, g = forces.rows[k], forces.scratch.s, forces.scratch.g
    if not _between_markers(row):
        coordinate = run.system.parts.coordinates[row["coordinate"]]
        s[0], s[1] = at.q[coordinate["iq"]], at.v[coordinate["iv"]]
        return FINE
    mi, mj = run.work.now.marker[row["I"]], run.work.now.marker[row["J"]]
    hx, hy, hz = separation(mi, mj)
    if row["measure"] == DISTANCE_OF and not hx * hx + hy * hy + hz * hz > 0.0:
        s[0], s[1] = 0.0, math.nan
        for c in range(12):
            g[c] = 0.0
        return ZERO_LENGTH
    if row["measure"] == DISTANCE_OF:
        distance_gradient(run.work.row, 0, 0, row["I"], row["J"])
    else:
        dot2_gradient(run.work.row, _Z, 0, row["I"], row["J"])
    copy(run.work.row.g, g)
    s[0] = g[6] * hx + g[7] * hy + g[8] * hz  # along n or z_I
    s[1] = rate(g, mi, mj)
    return FINE


@unit
def _put_resistance(run: Run, forces: ForceCharacteristics, at: Point, k: int) -> int:
    """R of force k and its slopes, with its measure; the status of that."""
    row, s, R, stack = forces.rows[k], forces.scratch.s, forces.scratch.R, run.work.trial.stack
    status = _put_measure(run, forces, at, k)
    u = _function_value(row, run.work.con.fun)
    R[0], R[1], R[2] = resistance(row, forces.programs, stack, s[0], s[1], u)
    return status


@unit
def add_wrenches(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Wrenches on the markers; ZERO_LENGTH at the first force without a direction."""
    rows, markers, R, g = forces.rows, run.work.now.marker, forces.scratch.R, forces.scratch.g
    for k in range(rows.shape[0]):
        if _between_markers(rows[k]):
            status = _put_resistance(run, forces, at, k)
            if status != FINE:
                run.work.fault[0] = k
                return status
            wi, wj = markers[rows[k]["I"]]["W"], markers[rows[k]["J"]]["W"]
            for c in range(6):
                wi[c] -= R[0] * g[c]
                wj[c] -= R[0] * g[6 + c]
    return FINE


@unit
def add_coordinate_forces(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Resistance on scalar coordinates, into the residual."""
    rows, coordinates, res = forces.rows, run.system.parts.coordinates, run.work.trial.res
    for k in range(rows.shape[0]):
        if not _between_markers(rows[k]):
            _put_resistance(run, forces, at, k)
            res[coordinates[rows[k]["coordinate"]]["iv"]] += forces.scratch.R[0]
    return FINE


@unit
def add_energies(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Energy that the elastic parts store."""
    rows, stack, out = forces.rows, run.work.trial.stack, run.work.energies
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        out[3] += stored_energy(rows[k], forces.programs, stack, forces.scratch.s[0])
    return FINE


@unit
def add_powers(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Power of dissipation, and of functions of time."""
    rows, s, fun, out = forces.rows, forces.scratch.s, run.work.con.fun, run.work.powers
    stack = run.work.trial.stack
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        out[1] += dissipation(rows[k], forces.programs, stack, s[0], s[1])
        out[2] += _function_value(rows[k], fun) * s[1]
    return FINE


@unit
def put_events(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Penetration of both bounds of all stops, with its rate."""
    stops, out, s = forces.stops, run.work.events.now, forces.scratch.s
    for k in range(stops.shape[0]):
        _put_measure(run, forces, at, stops[k])
        row, o = forces.rows[stops[k]], forces.first_event + 2 * k
        out[o, 0], out[o, 1] = s[0] - row["upper"], s[1]
        out[o + 1, 0], out[o + 1, 1] = row["lower"] - s[0], -s[1]
    return FINE


@unit
def put_wrench(run: Run, forces: ForceCharacteristics, at: Point, c: int) -> float:
    """Wrench pair of the force between markers that channel c reads.

    On a coordinate it acts through the constraint rows that follow this.
    """
    k, R, g = run.system.sensors.channels[c]["first"], forces.scratch.R, forces.scratch.g
    w, pair = run.work.dense.g[1], run.work.dense.pair
    _put_resistance(run, forces, at, k)
    for r in range(12):
        w[r] = -R[0] * g[r] if R[0] != 0.0 else 0.0
    pair[0], pair[1] = forces.rows[k]["I"], forces.rows[k]["J"]
    return 0.0


@unit
def put_unit_force(run: Run, forces: ForceCharacteristics, at: Point, part: int) -> float:
    """Generalised force of a unit push apart on one marker, for feedback (`engine.kind`)."""
    k, on, w = part // 6, part // 3 % 2, run.work.dense.g[1]
    _put_measure(run, forces, at, k)
    copy(forces.scratch.g, w)
    if on == 0:
        pull_back(run, forces.rows[k]["J"], 6)
    else:
        pull_back(run, forces.rows[k]["I"], 0)
    return 0.0


@unit
def add_tangents(run: Run, forces: ForceCharacteristics, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all forces.

    At the acceleration level, cv = 0, nothing on coordinates: such a one has no mass.
    """
    if cv == 0.0 and cp == 0.0:
        return FINE
    rows, scratch = forces.rows, forces.scratch
    for k in range(rows.shape[0]):
        _put_resistance(run, forces, at, k)
        if not _between_markers(rows[k]):
            if cv != 0.0:
                _add_coordinate_tangent(run, rows[k], scratch.R, cv, cp)
            continue
        i, j, link = rows[k]["I"], rows[k]["J"], rows[k]["couple"]
        _put_tangent(run, rows[k], scratch, cv, cp)
        add_pair(run, i, j, link, 1.0)
        add_moment_arms(run, i, j, cp)
        if scratch.R[2] != 0.0 and cp != 0.0:
            copy(scratch.g, run.work.dense.U[0])
            add_rate_arms(run, at.v, i, j, link, 1, cp * scratch.R[2])
    return FINE


@kernel
def _add_coordinate_tangent(run, row, R, cv, cp):
    """cv ∂R/∂ṡ + cp ∂R/∂s of a force on a scalar coordinate, on the diagonal."""
    s = run.system.parts.coordinates[row["coordinate"]]
    place = run.system.kkt.panels[s["panel"]]["at"]
    run.work.factor.low[place] += cv * R[2] + cp * R[1]
    run.work.factor.up[place] += cv * R[2] + cp * R[1]


@kernel
def _put_tangent(run, row, scratch, cv, cp):
    """Put −(cp ∂w/∂position + cv ∂w/∂velocity) of a force between markers into dense.H (12, 12).

    With G = ∂g/∂position it is cp R G + g ∂R, where ∂ṡ/∂position = Gᵀ V at constant velocities V of
    the markers. g stays in dense.X[0], R g in dense.g[1].
    """
    mi, mj, d = run.work.now.marker[row["I"]], run.work.now.marker[row["J"]], run.work.dense
    H, R, g, slope, w = d.H, scratch.R, scratch.g, d.U[0], d.g[1]
    clear(H, 12, 12)
    if row["measure"] == DISTANCE_OF:
        distance_tangent(run.work.row, 0, 0, row["I"], row["J"], 1.0)
    else:
        dot2_tangent(run.work.row, _Z, 0, row["I"], row["J"], 1.0)
    for b in range(12):
        turn = 0.0
        for a in range(3):
            turn += mi["vx"][a] * H[a, b] + mi["om"][a] * H[3 + a, b]
            turn += mj["vx"][a] * H[6 + a, b] + mj["om"][a] * H[9 + a, b]
        slope[b] = (cp * R[1] + cv * R[2]) * g[b]
        if R[2] != 0.0:
            slope[b] += cp * R[2] * turn
        for a in range(12):
            H[a, b] *= cp * R[0]
        w[b] = R[0] * g[b]
    copy(g, d.X[0])
    add_rates(run, 1, 1.0)


FORCE_CHARACTERISTICS = Kind(
    "force_characteristics",
    ForceCharacteristics,
    {
        "wrench": add_wrenches,
        "force": add_coordinate_forces,
        "matrix": add_tangents,
        "energy": add_energies,
        "power": add_powers,
        "events": put_events,
        "wrenches": put_wrench,
        "unit_force": put_unit_force,
    },
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    works=True,
    stiff=True,
    scratch=_scratch,
)
