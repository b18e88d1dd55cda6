"""Bushings and beams: six forces and moments between two markers, linear in their relative motion.

With the deflection x = (u − u0, φ) of `relative_motion` the potential is V = p0·x + ½ xᵀ K x, and
the dissipated power is ẋᵀ C ẋ. The wrench pair on the markers is −Eᵀ p, with p = p0 + K x + C ẋ and
E the gradient of x. So its power is exactly −dV/dt − ẋᵀ C ẋ, also at large angles (less than half a
turn). At small angles these are the bushing and the beam of MSC Adams (BUSHING, BEAM); K of the
beam is that of Timoshenko's cantilever (Przemieniecki, Theory of Matrix Structural Analysis, 1968,
sec. 5.6).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.engine.algebra.vector import clear, copy, inner, part
from flexmb.engine.bodies.wrench import (
    add_moment_arms,
    add_pair_tangent,
    add_rate_arms,
    add_rate_tangent,
)
from flexmb.engine.forces import relative_motion
from flexmb.engine.forces.relative_motion import (
    RelativeMotion,
    new_relative_motion,
    put_geometric_tangent,
    put_gradient,
    put_rate_change,
    put_rates,
    put_relative_motion,
    put_wrench_pair,
)
from flexmb.engine.jit import array_of, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import DAMPER_POWER, SPRING_ENERGY, Point, Run

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexmb.engine.lowering import Forces, Lowering
    from flexmb.model.forces.bushing import BeamForceSpec, BushingSpec
    from flexmb.model.markers import PlacedMarker

    Array = NDArray[np.float64]
    Parameters = tuple[tuple[PlacedMarker, PlacedMarker], Array, Array, Array, Array]

SIX_COMPONENT_FORCE = np.dtype(
    [
        ("I", "i8"),
        ("J", "i8"),
        ("couple", "i8"),
        ("damped", "i8"),  # 1: C is not zero
        ("u0", "f8", (3,)),  # separation at x = 0, axes of I, m
        ("p0", "f8", (6,)),  # force and moment p at x = 0, N and N m
        ("K", "f8", (6, 6)),
        ("C", "f8", (6, 6)),
    ],
    align=True,
)


class SixComponentForces(NamedTuple):
    """Bushings and beams."""

    rows: array_of(SIX_COMPONENT_FORCE)
    scratch: RelativeMotion = None  # of one run; set when its arrays are allocated


def lower_six_component_forces(lowering: Lowering, forces: Forces) -> SixComponentForces:
    """SIX_COMPONENT_FORCE rows of all bushings and beams; their links are filled in later."""
    rows: list[tuple[object, ...]] = []
    for name, spec in forces:
        parameters = _bushing if spec.type == "bushing" else _beam
        ends, u0, p0, K, C = parameters(lowering, spec)
        i, j = (lowering.markers.add(marker) for marker in ends)
        lowering.add_element(name, "six_component_forces", len(rows))
        rows.append((i, j, -1, C.any(), u0, p0, K, C))
    return SixComponentForces(np.array(rows, SIX_COMPONENT_FORCE))


def _bushing(lowering: Lowering, spec: BushingSpec) -> Parameters:
    """Markers, u0, p0, K and C of a bushing."""
    I, J = (lowering.geometry.marker(reference) for reference in spec.between)  # noqa: E741
    u0 = np.zeros(3)
    if spec.free == "placed":
        R = lowering.geometry.axes(I)
        u0 = R.T @ (lowering.geometry.position(J) - lowering.geometry.position(I))
        J = lowering.geometry.turned(J, R)
    K = _six(spec.matrix, spec.stiffness, spec.rotational_stiffness)
    C = _six(spec.damping_matrix, spec.damping, spec.rotational_damping)
    p0 = -np.concatenate([spec.preload or (0.0,) * 3, spec.preload_torque or (0.0,) * 3])
    return (I, J), u0, p0, K, C


def _beam(lowering: Lowering, spec: BeamForceSpec) -> Parameters:
    """Markers turned to the axes of the cross-section, u0, p0, K and C of a beam."""
    I, J = (lowering.geometry.marker(reference) for reference in spec.between)  # noqa: E741
    line = lowering.geometry.position(J) - lowering.geometry.position(I)
    distance = float(np.linalg.norm(line))
    x = line / distance
    y = lowering.geometry.normal_to(x) if spec.orientation is None else np.array(spec.orientation)
    y = y - (y @ x) * x
    y /= np.linalg.norm(y)
    R = np.column_stack([x, y, np.cross(x, y)])
    length = distance if spec.length is None else spec.length
    K = beam_matrix(spec, length)
    ends = lowering.geometry.turned(I, R), lowering.geometry.turned(J, R)
    return ends, np.array([length, 0.0, 0.0]), np.zeros(6), K, spec.damping * K


def beam_matrix(spec: BeamForceSpec, length: float) -> Array:
    """Stiffness matrix K (6, 6) of the end J of a beam clamped at I, x along its axis.

    Parameters
    ----------
    spec : BeamForceSpec
        Moduli and section.
    length : float
        Length of the beam [m].

    Returns
    -------
    (6, 6) float64
        Forces and moments [N, N m] at J over its displacement and rotation [m, rad]; Przemieniecki,
        Theory of Matrix Structural Analysis, 1968, sec. 5.6.
    """
    E, G = spec.moduli
    L = length
    K = np.zeros((6, 6))
    K[0, 0], K[3, 3] = E * spec.A / L, G * spec.J / L
    for w, turn, sign, I, k in ((1, 5, -1.0, spec.Iz, spec.ky), (2, 4, 1.0, spec.Iy, spec.kz)):  # noqa: E741
        shear = 0.0 if k is None else 12.0 * E * I / (k * G * spec.A * L**2)
        b = E * I / (1.0 + shear)
        K[w, w] = 12.0 * b / L**3
        K[w, turn] = K[turn, w] = sign * 6.0 * b / L**2
        K[turn, turn] = (4.0 + shear) * b / L
    return K


def _six(whole: ArrayLike | None, forces: ArrayLike | None, moments: ArrayLike | None) -> Array:
    """6 x 6 matrix, given whole or as two diagonal blocks (three diagonal numbers or 3 x 3)."""
    if whole is not None:
        return np.array(whole, dtype=float)
    matrix = np.zeros((6, 6))
    for at, block in ((0, forces), (3, moments)):
        if block is not None:
            values = np.array(block, dtype=float)
            matrix[at : at + 3, at : at + 3] = values if values.ndim == 2 else np.diag(values)
    return matrix


@kernel
def _product(A, r, x):
    """Row r of A (6, 6) times x (6)."""
    row = A[r]
    return inner(part(row, 0), part(x, 0)) + inner(part(row, 3), part(x, 3))


@unit
def _put_forces(run: Run, forces: SixComponentForces, k: int) -> int:
    """Deflection x of force k, its rate if damped, and p = p0 + K x + C ẋ, into the scratch."""
    row, s = forces.rows[k], forces.scratch
    put_relative_motion(run, row["I"], row["J"], s)
    if row["damped"] == 1:
        put_rates(run, row["I"], row["J"], s)
    for r in range(3):
        s.x[r] -= row["u0"][r]
    for r in range(6):
        elastic = row["p0"][r] + _product(row["K"], r, s.x)
        viscous = _product(row["C"], r, s.rate) if row["damped"] == 1 else 0.0
        s.elastic[r], s.viscous[r], s.p[r] = elastic, viscous, elastic + viscous
    return SUCCESS


@unit
def add_wrenches(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Wrenches on the markers of all bushings and beams."""
    rows, markers, s = forces.rows, run.work.now.marker, forces.scratch
    for k in range(rows.shape[0]):
        mi, mj = markers[rows[k]["I"]], markers[rows[k]["J"]]
        _put_forces(run, forces, k)
        relative_motion.add_wrenches(mi, mj, s, mi["W"], mj["W"])
    return SUCCESS


@unit
def add_energies(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Elastic energy Σ p0·x + ½ xᵀ K x."""
    rows, s, out = forces.rows, forces.scratch, run.work.energies
    for k in range(rows.shape[0]):
        _put_forces(run, forces, k)
        for r in range(6):
            out[SPRING_ENERGY] += 0.5 * s.x[r] * (rows[k]["p0"][r] + s.elastic[r])
    return SUCCESS


@unit
def add_powers(run: Run, forces: SixComponentForces, at: Point) -> int:
    """Power of damping −Σ ẋᵀ C ẋ."""
    rows, s, out = forces.rows, forces.scratch, run.work.powers
    for k in range(rows.shape[0]):
        if rows[k]["damped"] == 1:
            _put_forces(run, forces, k)
            for r in range(6):
                out[DAMPER_POWER] -= s.rate[r] * s.viscous[r]
    return SUCCESS


@unit
def put_wrench(run: Run, forces: SixComponentForces, at: Point, c: int) -> float:
    """Wrench pair of the bushing or beam that channel c reads."""
    k, pair = run.system.sensors.channels[c]["first"], run.work.dense.pair
    pair[0], pair[1] = forces.rows[k]["I"], forces.rows[k]["J"]
    _put_forces(run, forces, k)
    put_wrench_pair(run, pair[0], pair[1], forces.scratch)
    return 0.0


@kernel
def _add_product(A, f, E, U):
    """U += f A E, A (6, 6)."""
    for r in range(6):
        for k in range(6):
            x = f * A[r, k]
            if x != 0.0:
                for c in range(12):
                    U[r, c] += x * E[k, c]


@unit
def add_tangents(run: Run, forces: SixComponentForces, at: Point, cv: float, cp: float) -> int:
    """−(cv ∂Q/∂v + cp ∂Q/∂q) of all bushings and beams."""
    if cv == 0.0 and cp == 0.0:
        return SUCCESS
    rows, s, U = forces.rows, forces.scratch, run.work.dense.U
    for k in range(rows.shape[0]):
        row = rows[k]
        i, j, link, damped = row["I"], row["J"], row["couple"], row["damped"] == 1
        _put_forces(run, forces, k)
        put_gradient(run, i, j, s)
        put_geometric_tangent(run, i, j, s, cp)
        clear(U, 6, 12)
        _add_product(row["K"], cp, s.E, U)
        if damped:
            put_rate_change(run, i, j, s)
            _add_product(row["C"], cv, s.E, U)
            _add_product(row["C"], cp, s.D, U)
        for r in range(6):
            copy(s.E[r], run.work.dense.X[r])
        add_rate_tangent(run, 6, 1.0)
        add_pair_tangent(run, i, j, link, 1.0)
        add_moment_arms(run, i, j, cp)
        if damped and cp != 0.0:
            clear(U, 6, 12)
            _add_product(row["C"], cp, s.E, U)
            add_rate_arms(run, at.v, i, j, link, 6, 1.0)
    return SUCCESS


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
    lower=lower_six_component_forces,
    types=("bushing", "beam"),
    couples=(("couple", "I", "J"),),
    uses_velocity=True,
    does_work=True,
    stiff=True,
    scratch=lambda forces: new_relative_motion(),
)
