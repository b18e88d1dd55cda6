"""Nonlinear spring-dampers, actuators and stops: forces by a characteristic of one measure.

The measure s is the distance of two markers, a component of their separation, or a scalar
coordinate. A characteristic resists its growth with R(s, ṡ), see `spring_damper` and `stop`. With
the gradient g (12) of a measure between markers the wrench pair is −R g, as for a constraint row
whose multiplier is R.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.engine.forces.damping_tangent import add_rate_arms, add_rates
from flexmb.engine.forces.load import pull_back
from flexmb.engine.forces.spring_damper import (
    damper_power,
    line_ends,
    spring_energy,
    spring_resistance,
)
from flexmb.engine.forces.stop import (
    stop_energy,
    stop_parameters,
    stop_power,
    stop_resistance,
)
from flexmb.engine.functions.function import FunctionTable, lower
from flexmb.engine.jit import kernel, unit
from flexmb.engine.kernels.algebra.blocks import clear
from flexmb.engine.kernels.algebra.vector import copy
from flexmb.engine.kernels.bodies.pair_tangent import add_moment_arms, add_pair
from flexmb.engine.kernels.joints.dots import separation
from flexmb.engine.kernels.joints.point_rows import (
    distance_gradient,
    distance_tangent,
    dot2_gradient,
    dot2_tangent,
)
from flexmb.engine.kernels.joints.row import rate
from flexmb.engine.kind import Kind
from flexmb.engine.method import FINE, ZERO_LENGTH
from flexmb.engine.records import Integers, Vector, array_of
from flexmb.engine.state import Point, Run

if TYPE_CHECKING:
    from flexmb.engine.compile.lowering import Lowering
    from flexmb.model.forces.force import SpringDamperSpec
    from flexmb.model.functions.expression import Expression

# A force by a characteristic of one measure s and its rate: the distance of two markers, the
# component of their separation along z of I, or a scalar coordinate.
FORCE_CHARACTERISTIC = np.dtype(
    [
        ("measure", "i8"),  # DISTANCE_OF, COMPONENT_OF, COORDINATE_OF
        ("I", "i8"),
        ("J", "i8"),
        ("coordinate", "i8"),  # the scalar coordinate, or -1
        ("couple", "i8"),
        ("stop", "i8"),  # 1: a stop; then k, c are at full depth, free is not used
        ("k", "f8"),
        ("c", "f8"),
        ("free", "f8"),
        ("fun", "i8"),  # u(t), or -1
        ("spring", "i8"),  # program, or -1
        ("stored", "i8"),  # program of the integral of the spring, or -1: by Gauss's rule
        ("damper", "i8"),  # program, or -1
        ("exponent", "f8"),
        ("depth", "f8"),
        ("lower", "f8"),
        ("upper", "f8"),
    ],
    align=True,
)
# Measures; the first two are those of rows of joints.
DISTANCE_OF, COMPONENT_OF, COORDINATE_OF = 0, 1, 2

_Z = 2


class Scratch(NamedTuple):
    """Scratch of one force."""

    s: Vector  # (2,) its measure s and ṡ
    R: Vector  # (3,) resistance R, ∂R/∂s, ∂R/∂ṡ
    g: Vector  # (12,) gradient of a measure between markers


class ForceCharacteristics(NamedTuple):
    """Nonlinear spring-dampers, actuators and stops."""

    rows: array_of(FORCE_CHARACTERISTIC)
    programs: FunctionTable  # of springs and dampers, their variable in place of time
    stops: Integers  # rows that are stops
    first_event: int  # place of the first stop among the events, two for each
    scratch: Scratch = None  # of one run


def _scratch(forces: ForceCharacteristics) -> Scratch:
    return Scratch(*(np.full(n, np.nan) for n in (2, 3, 12)))


_TYPES = (
    "spring-damper", "rotational-spring-damper", "translational-spring-damper",
    "stop", "rotational-stop", "translational-stop",
)  # fmt: skip
_NONE = dict.fromkeys(("I", "J", "coordinate", "couple", "fun", "spring", "stored", "damper"), -1)


def lower_force_characteristics(lowering: Lowering) -> ForceCharacteristics | None:
    """FORCE_CHARACTERISTIC rows with their programs; None if the model has none."""
    rows: list[dict[str, float]] = []
    expressions: list[Expression] = []
    for name, spec in lowering.forces(*_TYPES):
        if spec.type.endswith("stop"):
            row = _stop_row(lowering, name, spec)
        elif spec.type == "spring-damper" and not spec.linear:
            row = _line_row(lowering, spec) | _program_numbers(spec, expressions)
        elif spec.type != "spring-damper" and (spec.spring_force or spec.damper_force):
            k = lowering.coordinate(f"forces.{name}")  # which has its stiffness, damping and value
            row = {"measure": COORDINATE_OF, "coordinate": k, "free": spec.free}
            row |= _program_numbers(spec, expressions)
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
    programs, stops = lower(expressions), np.flatnonzero(table["stop"])
    lowering.program_depth = max(lowering.program_depth, programs.depth)
    return ForceCharacteristics(table, programs, stops, lowering.watch(2 * len(stops)))


def _line_row(lowering: Lowering, spec: SpringDamperSpec) -> dict[str, float]:
    """Row of a nonlinear spring-damper, or of one with an actuator, along a line."""
    i, j, length = line_ends(lowering, spec)
    row: dict[str, float] = {"measure": DISTANCE_OF, "I": i, "J": j, "free": length}
    if spec.value is not None:
        row["fun"] = lowering.functions.add(spec.value.expression)
    return row | {"k": spec.stiffness, "c": spec.damping}


def _stop_row(lowering: Lowering, name: str, spec: Any) -> dict[str, float]:
    """Row of a stop between markers or on a joint."""
    unit = lowering.model.units.scale("m")
    if spec.type == "stop":
        i, j = (lowering.markers.add(m) for m in lowering.frames(spec.between, spec.axis))
        measure = DISTANCE_OF if spec.axis is None else COMPONENT_OF
        return {"measure": measure, "I": i, "J": j} | stop_parameters(spec, unit)
    k = lowering.coordinate(f"forces.{name}")
    unit = 1.0 if lowering.scalars[k].angular else unit
    return {"measure": COORDINATE_OF, "coordinate": k} | stop_parameters(spec, unit)


def _program_numbers(spec: Any, expressions: list[Expression]) -> dict[str, float]:
    """Numbers of the programs of a force, which are appended to the expressions."""
    spring, damper = spec.spring_force, spec.damper_force
    programs = {
        "spring": spring and spring.expression,
        "stored": spring and spring.stored,
        "damper": damper and damper.expression,
    }
    numbers: dict[str, float] = {}
    for word, expression in programs.items():
        if expression is not None:
            numbers[word] = len(expressions)
            expressions.append(expression)
    return numbers


@kernel
def _resistance(row, programs, stack, s, v, u):
    """R, ∂R/∂s, ∂R/∂ṡ; u the present value of its function of time."""
    if row["stop"] == 1:
        return stop_resistance(row, s, v)
    return spring_resistance(row, programs, stack, s, v, u)


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
    R[0], R[1], R[2] = _resistance(row, forces.programs, stack, s[0], s[1], u)
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
    rows, s, out = forces.rows, forces.scratch.s, run.work.energies
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        if rows[k]["stop"] == 1:
            out[3] += stop_energy(rows[k], s[0])
        else:
            out[3] += spring_energy(rows[k], forces.programs, run.work.trial.stack, s[0])
    return FINE


@unit
def add_powers(run: Run, forces: ForceCharacteristics, at: Point) -> int:
    """Power of dissipation, and of functions of time."""
    rows, s, fun, out = forces.rows, forces.scratch.s, run.work.con.fun, run.work.powers
    for k in range(rows.shape[0]):
        _put_measure(run, forces, at, k)
        if rows[k]["stop"] == 1:
            out[1] += stop_power(rows[k], s[0], s[1])
        else:
            out[1] += damper_power(rows[k], forces.programs, run.work.trial.stack, s[1])
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
    lower=lower_force_characteristics,
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    works=True,
    stiff=True,
    scratch=_scratch,
)
