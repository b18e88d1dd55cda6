"""Tables of bushings and beams: ends with their axes, free separation, preload, K and C.

A row for the pool is u0 (3), p0 (6), K (6, 6), C (6, 6), forces before moments.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.engine.kernels.forces.six_component_force import (
    SIX_COMPONENT_FORCE,
    SIX_COMPONENT_FORCES,
    SixComponentForces,
)
from flexmb.engine.lowering import Element, Lowering
from flexmb.engine.tables import Pool
from flexmb.model import lookup
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.forces.bushing import BeamForceSpec, BushingSpec
from flexmb.model.model import Model
from flexmb.model.values.names import GROUND
from flexmb.model.values.orientation import rotation_matrix, triad

__all__ = ["beam_matrix", "lower_six_component_forces"]

Array = NDArray[np.float64]
Numbers = tuple[tuple[PlacedMarker, PlacedMarker], Array, bool]


def lower_six_component_forces(lowering: Lowering) -> SixComponentForces | None:
    """SIX_COMPONENT_FORCE rows and their pool; None if the model has none."""
    rows: list[tuple[object, ...]] = []
    pool = Pool()
    for name, spec in lowering.model.forces.items():
        if isinstance(spec, BeamForceSpec):
            ends, numbers, damped = _beam_numbers(lowering, spec)
        elif isinstance(spec, BushingSpec):
            ends, numbers, damped = _bushing_numbers(lowering, spec)
        else:
            continue
        i, j = (lowering.markers.add(marker) for marker in ends)
        lowering.elements[f"forces.{name}"] = Element(SIX_COMPONENT_FORCES.name, len(rows))
        rows.append((i, j, -1, pool.add(numbers), damped))
    if not rows:
        return None
    return SixComponentForces(np.array(rows, SIX_COMPONENT_FORCE), pool.array())


def _bushing_numbers(lowering: Lowering, spec: BushingSpec) -> Numbers:
    """Markers, pool row and whether there is damping, of a bushing."""
    model, flexbodies = lowering.model, lowering.flexbodies
    I, J = (lookup.place_marker(model, reference, flexbodies) for reference in spec.between)  # noqa: E741
    free = np.zeros(3)
    if spec.free == "placed":
        R = _axes(model, I)
        free = R.T @ (lookup.global_position(model, J) - lookup.global_position(model, I))
        J = _turned(model, J, R)
    K = _six(spec.matrix, spec.stiffness, spec.rotational_stiffness)
    C = _six(spec.damping_matrix, spec.damping, spec.rotational_damping)
    preload = -np.concatenate([spec.preload or (0.0,) * 3, spec.preload_torque or (0.0,) * 3])
    return (I, J), np.concatenate([free, preload, K.ravel(), C.ravel()]), bool(C.any())


def _beam_numbers(lowering: Lowering, spec: BeamForceSpec) -> Numbers:
    """Markers with their axes along the section's, pool row and whether there is damping."""
    model, flexbodies = lowering.model, lowering.flexbodies
    I, J = (lookup.place_marker(model, reference, flexbodies) for reference in spec.between)  # noqa: E741
    line = lookup.global_position(model, J) - lookup.global_position(model, I)
    distance = float(np.linalg.norm(line))
    x = line / distance
    y = triad(tuple(x))[:, 0] if spec.orientation is None else np.array(spec.orientation)
    y = y - (y @ x) * x
    y /= np.linalg.norm(y)
    R = np.column_stack([x, y, np.cross(x, y)])
    length = distance if spec.length is None else spec.length
    K = beam_matrix(spec, length)
    numbers = [np.array([length, 0.0, 0.0]), np.zeros(6), K.ravel(), spec.damping * K.ravel()]
    ends = _turned(model, I, R), _turned(model, J, R)
    return ends, np.concatenate(numbers), spec.damping > 0.0


def beam_matrix(spec: BeamForceSpec, length: float) -> Array:
    """K (6, 6) of the end J of a beam whose end I is held, x along it.

    Parameters
    ----------
    spec : BeamForceSpec
        Moduli and section.
    length : float
        Its length [m].

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
    """6 x 6 from a whole matrix, or from its two diagonal blocks (three numbers or 3 x 3)."""
    if whole is not None:
        return np.array(whole, dtype=float)
    matrix = np.zeros((6, 6))
    for at, block in ((0, forces), (3, moments)):
        if block is not None:
            given = np.array(block, dtype=float)
            matrix[at : at + 3, at : at + 3] = given if given.ndim == 2 else np.diag(given)
    return matrix


def _orientation(model: Model, marker: PlacedMarker) -> Array:
    if marker.body == GROUND:
        return np.eye(3)
    return rotation_matrix(model.bodies[marker.body].orientation)


def _axes(model: Model, marker: PlacedMarker) -> Array:
    """Axes (3, 3) of a marker in the placed pose, global."""
    turned: Array = _orientation(model, marker) @ marker.R
    return turned


def _turned(model: Model, marker: PlacedMarker, R: Array) -> PlacedMarker:
    """The marker with axes R (3, 3), global in the placed pose."""
    return replace(marker, R=_orientation(model, marker).T @ R)
