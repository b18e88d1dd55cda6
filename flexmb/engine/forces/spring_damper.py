"""Spring-dampers: linear ones along lines, and the characteristics of all others.

A linear spring-damper along the line between two markers attracts them with f = k (d − d0) + c ḋ,
d the distance. One that is nonlinear, acts on a joint or has an actuator is a row of
`force_characteristic`: with x = s − free it resists with R = k x + c ṡ + S(x) + D(ṡ) − u(t). The
functions S and D are programs (`engine.function`), u is the actuator's force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import clear, zero
from flexmb.engine.bodies.wrench import add_moment_arms, add_pair_tangent, add_rate_arms
from flexmb.engine.function import FunctionTable, evaluate, run_program
from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.joints.row import separation
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS, ZERO_LENGTH
from flexmb.engine.state import DAMPER_POWER, SPRING_ENERGY, Point, Run

if TYPE_CHECKING:
    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.forces.spring_damper import SpringDamperSpec
    from flexmb.model.functions.expression import Expression

SPRING = np.dtype(
    [
        ("I", "i8"),
        ("J", "i8"),
        ("k", "f8"),  # N/m
        ("c", "f8"),  # N s/m
        ("d0", "f8"),  # free length, m
        ("couple", "i8"),  # LINK (block of the matrix) between the bodies of I and J
    ],
    align=True,
)


class Springs(NamedTuple):
    """Linear spring-dampers along lines."""

    rows: array_of(SPRING)


def lower_springs(lowering: Lowering, forces: Forces) -> Springs | None:
    """SPRING rows of all linear spring-dampers; None if the model has none."""
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        if spec.linear:
            lowering.add_element(name, "springs", len(rows))
            i, j, length = line_ends(lowering, spec)
            rows.append((i, j, spec.stiffness, spec.damping, length, -1))
    return Springs(np.array(rows, SPRING)) if rows else None


def line_ends(lowering: Lowering, spec: SpringDamperSpec) -> tuple[int, int, float]:
    """Markers and free length [m] of a spring-damper along a line."""
    ends = [lowering.geometry.marker(reference) for reference in spec.between]
    length = spec.free_length
    if length == "placed":
        length = np.linalg.norm(
            lowering.geometry.position(ends[1]) - lowering.geometry.position(ends[0])
        )
    i, j = (lowering.markers.add(marker) for marker in ends)
    return i, j, float(length)


@kernel
def _direction(mi, mj):
    """Distance of two markers and the unit vector from I to J."""
    hx, hy, hz = separation(mi, mj)
    d = math.sqrt(hx * hx + hy * hy + hz * hz)
    return d, hx / d, hy / d, hz / d


@kernel
def _rate(mi, mj, nx, ny, nz):
    """ḋ of one spring, m/s; (nx, ny, nz): unit vector from I to J."""
    u, v = mi["vx"], mj["vx"]
    return nx * (v[0] - u[0]) + ny * (v[1] - u[1]) + nz * (v[2] - u[2])


@kernel
def _attraction(spring, mi, mj, d, nx, ny, nz):
    """Force with which one spring-damper attracts its markers, N."""
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
    """Add the wrenches of all spring-dampers; return ZERO_LENGTH at the first without a length."""
    rows, markers = springs.rows, run.work.now.marker
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        d, nx, ny, nz = _direction(mi, mj)
        if not d > 0.0:
            run.work.failed_element[0] = k
            return ZERO_LENGTH
        f = _attraction(rows[k], mi, mj, d, nx, ny, nz)
        _add_forces(mi["W"], mj["W"], f * nx, f * ny, f * nz)
    return SUCCESS


@unit
def add_energies(run: Run, springs: Springs, at: Point) -> int:
    """Elastic energy Σ ½ k (d − d0)²."""
    rows, markers, out = springs.rows, run.work.now.marker, run.work.energies
    for k in range(rows.shape[0]):
        d, _, _, _ = _direction(markers[rows[k]["I"]], markers[rows[k]["J"]])
        out[SPRING_ENERGY] += 0.5 * rows[k]["k"] * (d - rows[k]["d0"]) ** 2
    return SUCCESS


@unit
def add_powers(run: Run, springs: Springs, at: Point) -> int:
    """Power of damping −Σ c ḋ²."""
    rows, markers, out = springs.rows, run.work.now.marker, run.work.powers
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        _, nx, ny, nz = _direction(mi, mj)
        out[DAMPER_POWER] -= rows[k]["c"] * _rate(mi, mj, nx, ny, nz) ** 2
    return SUCCESS


@unit
def put_wrench(run: Run, springs: Springs, at: Point, c: int) -> float:
    """Wrench pair of the spring-damper that channel c reads."""
    row, markers = springs.rows[run.system.sensors.channels[c]["first"]], run.work.now.marker
    w, pair = run.work.dense.g[1], run.work.dense.pair
    mi, mj = markers[row["I"]], markers[row["J"]]
    d, nx, ny, nz = _direction(mi, mj)
    f = _attraction(row, mi, mj, d, nx, ny, nz)
    zero(w)
    _add_forces(w[0:6], w[6:12], f * nx, f * ny, f * nz)
    pair[0], pair[1] = row["I"], row["J"]
    return 0.0


@unit
def add_tangents(run: Run, springs: Springs, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all spring-dampers."""
    if cv == 0.0 and cp == 0.0:
        return SUCCESS
    rows, markers, H, w = springs.rows, run.work.now.marker, run.work.dense.H, run.work.dense.g[1]
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j = row["I"], row["J"]
        mi, mj = markers[i], markers[j]
        d, nx, ny, nz = _direction(mi, mj)
        f = _attraction(row, mi, mj, d, nx, ny, nz)
        clear(H, 12, 12)
        _add_tangent(row, mi, mj, d, (nx, ny, nz), f, cv, cp, H)
        add_pair_tangent(run, i, j, row["couple"], 1.0)
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
    return SUCCESS


@kernel
def _add_tangent(spring, mi, mj, d, n, f, cv, cp, H):
    """Add −(cp ∂w/∂position + cv ∂w/∂velocity) of one spring-damper to H (12, 12)."""
    r = _rate(mi, mj, n[0], n[1], n[2])
    along = cp * spring["k"] + cv * spring["c"]
    for a in range(3):
        for b in range(3):
            across = (1.0 if a == b else 0.0) - n[a] * n[b]
            # ∂ḋ/∂h = (u − ḋ n)/d, u = v_J − v_I
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
    lower=lower_springs,
    types=("spring-damper",),
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    does_work=True,
    stiff=True,
)


# A force that is a function of one measure s and its rate (`force_characteristic`). The measure is
# the distance of two markers, the component of their separation along z of I, or a scalar
# coordinate.
FORCE_CHARACTERISTIC = np.dtype(
    [
        ("measure", "i8"),  # DISTANCE_OF, COMPONENT_OF, COORDINATE_OF
        ("I", "i8"),
        ("J", "i8"),
        ("coordinate", "i8"),  # the scalar coordinate, or -1
        ("couple", "i8"),  # LINK between the bodies of I and J, or -1
        ("stop", "i8"),  # 1: a stop
        ("k", "f8"),  # stiffness, N/m or N m/rad; of a stop N/m^exponent
        ("c", "f8"),  # damping, N s/m or N m s/rad; of a stop at its full depth and beyond
        ("free", "f8"),  # s at which the spring is free; not used by stops
        ("fun", "i8"),  # function of time u(t) of the actuator, or -1
        ("spring", "i8"),  # program of S(x), or -1
        ("stored", "i8"),  # program of ∫ S dx, or -1: by Gauss quadrature
        ("damper", "i8"),  # program of D(ṡ), or -1
        # of stops only: exponent of the penetration, depth of full damping, bounds of s
        ("exponent", "f8"),
        ("depth", "f8"),
        ("lower", "f8"),
        ("upper", "f8"),
    ],
    align=True,
)
# Kinds of measures; the first two are also those of constraint rows of joints.
DISTANCE_OF, COMPONENT_OF, COORDINATE_OF = 0, 1, 2


def line_row(lowering: Lowering, spec: SpringDamperSpec) -> dict[str, float]:
    """Fields of a spring-damper along a line that is nonlinear or has an actuator."""
    i, j, length = line_ends(lowering, spec)
    row: dict[str, float] = {"measure": DISTANCE_OF, "I": i, "J": j, "free": length}
    if spec.value is not None:
        row["fun"] = lowering.functions.add(spec.value.expression)
    return row | {"k": spec.stiffness, "c": spec.damping}


def program_numbers(spec: Any, expressions: list[Expression]) -> dict[str, float]:
    """Append the expressions of a force's programs to `expressions`; return their indices there."""
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


_PANELS = 16  # equal parts of an interval of integration, each with eight Gauss points
# Gauss–Legendre rule of eight points on (0, 1): the lower four points with their weights. The
# others lie symmetrically.
_GAUSS = (
    (0.019855071751231884, 0.05061426814518813),
    (0.10166676129318664, 0.11119051722668724),
    (0.2372337950418355, 0.15685332293894364),
    (0.4082826787521751, 0.18134189168918100),
)


@kernel
def spring_resistance(row, programs, stack, s, v, u):
    """R, ∂R/∂s, ∂R/∂ṡ of a FORCE_CHARACTERISTIC row; u: present force of its actuator."""
    x = s - row["free"]
    f, k, c = row["k"] * x - u, row["k"], 0.0
    if row["spring"] >= 0:
        a, b, _ = evaluate(programs, row["spring"], x, stack, stack)
        f, k = f + a, k + b
    if row["c"] != 0.0:
        f, c = f + row["c"] * v, row["c"]
    if row["damper"] >= 0:
        a, b, _ = evaluate(programs, row["damper"], v, stack, stack)
        f, c = f + a, c + b
    return f, k, c


@kernel
def spring_energy(row, programs, stack, s):
    """Elastic energy of the spring, J; zero at x = 0."""
    x = s - row["free"]
    stored = 0.5 * row["k"] * x * x
    if row["stored"] >= 0:
        stored += run_program(programs, row["stored"], x, stack, stack)
    elif row["spring"] >= 0:
        stored += integral(programs, row["spring"], stack, x)
    return stored


@unit
def integral(programs: FunctionTable, k: int, stack: Matrix, x: float) -> float:
    """Integral of program k from 0 to x by Gauss quadrature; exact for polynomials of degree 15."""
    total = 0.0
    h = x / _PANELS
    for n in range(_PANELS):
        for place, weight in _GAUSS:
            f = run_program(programs, k, h * (n + place), stack, stack)
            g = run_program(programs, k, h * (n + 1.0 - place), stack, stack)
            total += weight * (f + g)
    return h * total


@kernel
def damper_power(row, programs, stack, v):
    """Power of the damper on the system, W."""
    f = row["c"] * v if row["c"] != 0.0 else 0.0
    if row["damper"] >= 0:
        f += run_program(programs, row["damper"], v, stack, stack)
    return -f * v
