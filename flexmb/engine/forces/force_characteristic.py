"""Nonlinear spring-dampers, actuators and stops: force characteristics of one measure s.

The measure s is the distance of two markers, a component of their separation, or a scalar
coordinate. The force resists the growth of s with R(s, ṡ), see `spring_damper`. With the gradient
g (12) of a measure between markers the wrench pair is −R g, as for a constraint row with the
multiplier R.

Stops are bounds of s, see `stop`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import clear, copy, zero
from flexmb.engine.bodies.wrench import (
    add_moment_arms,
    add_pair_tangent,
    add_rate_arms,
    add_rate_tangent,
)
from flexmb.engine.forces.load import pull_back_unit_force
from flexmb.engine.forces.spring_damper import (
    COMPONENT_OF,
    COORDINATE_OF,
    DISTANCE_OF,
    FORCE_CHARACTERISTIC,
    damper_power,
    line_row,
    program_numbers,
    spring_energy,
    spring_resistance,
)
from flexmb.engine.forces.stop import (
    STOP_EVENTS,
    put_stop_events,
    stop_energy,
    stop_parameters,
    stop_power,
    stop_resistance,
)
from flexmb.engine.function import FunctionTable, lower, put_switches
from flexmb.engine.jit import Integers, array_of, kernel, unit
from flexmb.engine.joints.point_joint import (
    distance_gradient,
    distance_tangent,
    dot2_gradient,
    dot2_tangent,
)
from flexmb.engine.joints.row import rate, separation
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS, ZERO_LENGTH
from flexmb.engine.state import DAMPER_POWER, LOAD_POWER, SPRING_ENERGY, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.functions.expression import Expression


_Z = 2

# State of one such force.
CHARACTERISTIC_NOW = np.dtype(
    [
        ("s", "f8"),  # measure, m or rad
        ("rate", "f8"),  # ṡ
        ("R", "f8"),  # resistance, N or N m
        ("stiffness", "f8"),  # ∂R/∂s
        ("damping", "f8"),  # ∂R/∂ṡ
        ("g", "f8", (12,)),  # gradient of a measure between markers
    ],
    align=True,
)


class Scratch(NamedTuple):
    """Scratch of one force."""

    now: array_of(CHARACTERISTIC_NOW)  # (1,) the force that was evaluated last


class ForceCharacteristics(NamedTuple):
    """Nonlinear spring-dampers, actuators and stops."""

    rows: array_of(FORCE_CHARACTERISTIC)
    programs: FunctionTable  # characteristics of springs and dampers; their variable is x or ṡ
    stops: Integers  # rows that are stops
    # index of the first event function: `STOP_EVENTS` of each stop, then those of the programs
    first_event: int
    scratch: Scratch = None  # of one run


_TYPES = (
    "spring-damper", "rotational-spring-damper", "translational-spring-damper",
    "stop", "rotational-stop", "translational-stop",
)  # fmt: skip
_NONE = dict.fromkeys(("I", "J", "coordinate", "couple", "fun", "spring", "stored", "damper"), -1)


def lower_force_characteristics(lowering: Lowering, forces: Forces) -> ForceCharacteristics | None:
    """FORCE_CHARACTERISTIC rows with their programs; None if the model has none."""
    rows: list[dict[str, float]] = []
    expressions: list[Expression] = []
    for name, spec in forces:
        if spec.type.endswith("stop"):
            row = _stop_row(lowering, name, spec)
        elif spec.type == "spring-damper" and not spec.linear:
            row = line_row(lowering, spec) | program_numbers(spec, expressions)
        elif spec.type != "spring-damper" and (spec.spring_force or spec.damper_force):
            # the coordinate itself has the linear stiffness, the damping and the actuator's force
            k = lowering.coordinate(f"forces.{name}")
            row = {"measure": COORDINATE_OF, "coordinate": k, "free": spec.free}
            row |= program_numbers(spec, expressions)
        else:
            continue
        k, row = len(rows), _NONE | row
        lowering.add_element(name, "force_characteristics", k)
        for on, end in enumerate("JI" if row["fun"] >= 0 else ""):
            marker = int(row[end])
            lowering.add_action(int(row["fun"]), "force_characteristics", k, on, 0, marker)
        rows.append(row)
    if not rows:
        return None
    table = np.zeros(len(rows), FORCE_CHARACTERISTIC)
    for k, row in enumerate(rows):
        for field, value in row.items():
            table[field][k] = value
    programs, stops = lower(expressions, moves=True), np.flatnonzero(table["stop"])
    lowering.program_depth = max(lowering.program_depth, programs.depth)
    events = lowering.add_events(STOP_EVENTS * len(stops) + int(programs.switches.sum()))
    return ForceCharacteristics(table, programs, stops, events)


def _stop_row(lowering: Lowering, name: str, spec: Any) -> dict[str, float]:
    """Row of a stop between markers or on a joint."""
    unit = lowering.model.units.scale("m")
    if spec.type == "stop":
        i, j = (lowering.markers.add(m) for m in lowering.geometry.frames(spec.between, spec.axis))
        measure = DISTANCE_OF if spec.axis is None else COMPONENT_OF
        return {"measure": measure, "I": i, "J": j} | stop_parameters(spec, unit)
    k = lowering.coordinate(f"forces.{name}")
    unit = 1.0 if lowering.scalars[k].angular else unit
    return {"measure": COORDINATE_OF, "coordinate": k} | stop_parameters(spec, unit)


@kernel
def _function_value(row, fun):
    """Present value u(t) of the force's function of time; 0 if it has none."""
    return fun[row["fun"], 0] if row["fun"] >= 0 else 0.0


@kernel
def _between_markers(row):
    """Whether a force acts between two markers, not on a coordinate."""
    return row["measure"] != COORDINATE_OF


@unit
def _put_measure(run: Run, forces: ForceCharacteristics, at: Point, k: int) -> int:
    """s and ṡ of force k, and for a measure between markers g; after a velocity stage.

    Returns ZERO_LENGTH if s is the distance of two markers at the same place: it has no gradient.
    """
    row, now = forces.rows[k], forces.scratch.now[0]
    g = now["g"]
    if not _between_markers(row):
        coordinate = run.system.parts.coordinates[row["coordinate"]]
        now["s"], now["rate"] = at.q[coordinate["iq"]], at.v[coordinate["iv"]]
        return SUCCESS
    mi, mj = run.work.now.marker[row["I"]], run.work.now.marker[row["J"]]
    hx, hy, hz = separation(mi, mj)
    if row["measure"] == DISTANCE_OF and not hx * hx + hy * hy + hz * hz > 0.0:
        now["s"], now["rate"] = 0.0, math.nan
        zero(g)
        return ZERO_LENGTH
    if row["measure"] == DISTANCE_OF:
        distance_gradient(run.work.row, 0, 0, row["I"], row["J"])
    else:
        dot2_gradient(run.work.row, _Z, 0, row["I"], row["J"])
    copy(run.work.row.g, g)
    now["s"] = g[6] * hx + g[7] * hy + g[8] * hz  # along n or z_I
    now["rate"] = rate(g, mi, mj)
    return SUCCESS


@unit
def _put_resistance(run: Run, forces: ForceCharacteristics, at: Point, k: int) -> int:
    """s, ṡ, R, ∂R/∂s and ∂R/∂ṡ of force k; returns the status of `_put_measure`."""
    row, now, stack = forces.rows[k], forces.scratch.now[0], run.work.trial.stack
    status = _put_measure(run, forces, at, k)
    s, v, u = now["s"], now["rate"], _function_value(row, run.work.con.fun)
    if row["stop"] == 1:
        now["R"], now["stiffness"], now["damping"] = stop_resistance(row, s, v)
    else:
        f, stiffness, damping = spring_resistance(row, forces.programs, stack, s, v, u)
        now["R"], now["stiffness"], now["damping"] = f, stiffness, damping
    return status


@unit
def add_wrenches(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Add wrenches to the markers; return ZERO_LENGTH at the first force without a direction."""
    rows, markers, now = forces.rows, run.work.now.marker, forces.scratch.now[0]
    for k in range(rows.shape[0]):
        if _between_markers(rows[k]):
            status = _put_resistance(run, forces, at, k)
            if status != SUCCESS:
                run.work.failed_element[0] = k
                return status
            wi, wj = markers[rows[k]["I"]]["W"], markers[rows[k]["J"]]["W"]
            for c in range(6):
                wi[c] -= now["R"] * now["g"][c]
                wj[c] -= now["R"] * now["g"][6 + c]
    return SUCCESS


@unit
def add_coordinate_forces(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Add the resistance on scalar coordinates to the residual."""
    rows, coordinates, res = forces.rows, run.system.parts.coordinates, run.work.trial.res
    for k in range(rows.shape[0]):
        if not _between_markers(rows[k]):
            _put_resistance(run, forces, at, k)
            res[coordinates[rows[k]["coordinate"]]["iv"]] += forces.scratch.now[0]["R"]
    return SUCCESS


@unit
def add_energies(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Elastic energy of springs and stops."""
    rows, now, out = forces.rows, forces.scratch.now[0], run.work.energies
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        if rows[k]["stop"] == 1:
            out[SPRING_ENERGY] += stop_energy(rows[k], now["s"])
        else:
            out[SPRING_ENERGY] += spring_energy(
                rows[k], forces.programs, run.work.trial.stack, now["s"]
            )
    return SUCCESS


@unit
def add_powers(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Power of dampers and stops, and that of actuators, whose forces are functions of time."""
    rows, now, fun, out = forces.rows, forces.scratch.now[0], run.work.con.fun, run.work.powers
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        if rows[k]["stop"] == 1:
            out[DAMPER_POWER] += stop_power(rows[k], now["s"], now["rate"])
        else:
            out[DAMPER_POWER] += damper_power(
                rows[k], forces.programs, run.work.trial.stack, now["rate"]
            )
        out[LOAD_POWER] += _function_value(rows[k], fun) * now["rate"]
    return SUCCESS


@unit
def put_events(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Event functions of stops, springs and dampers: zero where their characteristics change."""
    stops, out, now = forces.stops, run.work.events.now, forces.scratch.now[0]
    for k in range(stops.shape[0]):
        _put_measure(run, forces, at, stops[k])
        row, o = forces.rows[stops[k]], forces.first_event + STOP_EVENTS * k
        put_stop_events(row, now["s"], now["rate"], out, o)
    rows, programs, stack = forces.rows, forces.programs, run.work.trial.stack
    n = forces.first_event + STOP_EVENTS * stops.shape[0]
    for k in range(rows.shape[0] if programs.ops.shape[0] > 0 else 0):
        row = rows[k]
        _put_measure(run, forces, at, k)
        if row["spring"] >= 0:
            n = put_switches(programs, row["spring"], now["s"] - row["free"], stack, stack, out, n)
        if row["damper"] >= 0:
            n = put_switches(programs, row["damper"], now["rate"], stack, stack, out, n)
    return SUCCESS


@unit
def put_wrench(run: Run, forces: ForceCharacteristics, at: Point, c: int) -> float:
    """Wrench pair of the force between markers that channel c reads.

    A force on a coordinate has no wrench pair of its own: it acts through the constraint rows that
    couple the coordinate.
    """
    k, now = run.system.sensors.channels[c]["first"], forces.scratch.now[0]
    w, pair = run.work.dense.g[1], run.work.dense.pair
    _put_resistance(run, forces, at, k)
    for r in range(12):
        w[r] = -now["R"] * now["g"][r] if now["R"] != 0.0 else 0.0
    pair[0], pair[1] = forces.rows[k]["I"], forces.rows[k]["J"]
    return 0.0


@unit
def put_unit_force(run: Run, forces: ForceCharacteristics, at: Point, part: int) -> float:
    """Generalised force on the body of one marker per unit of u(t), for feedback (`engine.kind`).

    A positive u drives s up, so for a distance it pushes the markers apart.
    """
    k, on, w = part // 6, part // 3 % 2, run.work.dense.g[1]
    _put_measure(run, forces, at, k)
    copy(forces.scratch.now[0]["g"], w)
    if on == 0:
        pull_back_unit_force(run, forces.rows[k]["J"], 6)
    else:
        pull_back_unit_force(run, forces.rows[k]["I"], 0)
    return 0.0


@unit
def add_tangents(run: Run, forces: ForceCharacteristics, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all forces.

    At the acceleration level, cv = 0, forces on coordinates add nothing, as these have no mass.
    """
    if cv == 0.0 and cp == 0.0:
        return SUCCESS
    rows, now = forces.rows, forces.scratch.now[0]
    for k in range(rows.shape[0]):
        _put_resistance(run, forces, at, k)
        if not _between_markers(rows[k]):
            if cv != 0.0:
                _add_coordinate_tangent(run, rows[k], now, cv, cp)
            continue
        i, j, link = rows[k]["I"], rows[k]["J"], rows[k]["couple"]
        _put_tangent(run, rows[k], now, cv, cp)
        add_pair_tangent(run, i, j, link, 1.0)
        add_moment_arms(run, i, j, cp)
        if now["damping"] != 0.0 and cp != 0.0:
            copy(now["g"], run.work.dense.U[0])
            add_rate_arms(run, at.v, i, j, link, 1, cp * now["damping"])
    return SUCCESS


@kernel
def _add_coordinate_tangent(run, row, now, cv, cp):
    """cv ∂R/∂ṡ + cp ∂R/∂s of a force on a scalar coordinate, on the diagonal."""
    s = run.system.parts.coordinates[row["coordinate"]]
    place = run.system.kkt.panels[s["panel"]]["at"]
    run.work.factor.low[place] += cv * now["damping"] + cp * now["stiffness"]
    run.work.factor.up[place] += cv * now["damping"] + cp * now["stiffness"]


@kernel
def _put_tangent(run, row, now, cv, cp):
    """Put −(cp ∂w/∂position + cv ∂w/∂velocity) of a force between markers into dense.H (12, 12).

    With G = ∂g/∂position it is cp R G + g ∂R, where ∂ṡ/∂position = Gᵀ V at constant velocities V of
    the markers. On return dense.X[0] is g, and dense.g[1] is R g.
    """
    mi, mj, d = run.work.now.marker[row["I"]], run.work.now.marker[row["J"]], run.work.dense
    H, g, slope, w = d.H, now["g"], d.U[0], d.g[1]
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
        slope[b] = (cp * now["stiffness"] + cv * now["damping"]) * g[b]
        if now["damping"] != 0.0:
            slope[b] += cp * now["damping"] * turn
        for a in range(12):
            H[a, b] *= cp * now["R"]
        w[b] = now["R"] * g[b]
    copy(g, d.X[0])
    add_rate_tangent(run, 1, 1.0)


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
    lower=lower_force_characteristics,
    types=_TYPES,
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    does_work=True,
    stiff=True,
    scratch=lambda forces: Scratch(np.zeros(1, CHARACTERISTIC_NOW)),
)
