"""Mass properties of rigid bodies, as given or from a shape, and whether they can be.

In: moments and products of inertia about the centre of mass, body axes, as three principal
moments, a 3x3 matrix, or a table. Out: a symmetric positive 3x3 matrix that some distribution of
mass can have: no principal moment exceeds the sum of the other two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.values.quantities import read_number
from flexmb.model.values.reading import Names, Reader, fail, given, names_of, units_of, unknown_key
from flexmb.units import UnitSystem

__all__ = ["Inertia", "MassProperties", "read_inertia"]

Rows = tuple[tuple[float, float, float], ...]
_DIAGONAL = ("xx", "yy", "zz")
_PRODUCTS = ("xy", "xz", "yz")
_UNIT = "kg m^2"
_ROUNDING = 1e-6  # relative; numbers typed with seven digits pass (a thin plate lies on the limit)


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass [kg], centre of mass (3,) in the body frame [m], inertia (3, 3) about it [kg m^2]."""

    mass: float
    center: NDArray[np.float64]
    inertia: NDArray[np.float64]


def read_inertia(value: Any, names: Names) -> Rows:
    """The inertia matrix as rows.

    Raises
    ------
    SceneError
        Not one of the three ways to say it, or an inertia that cannot be, with the numbers.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    matrix = _matrix(value, names)
    units = units_of(names)
    _check(matrix, units)
    matrix = matrix * units.scale(_UNIT)
    if not np.isfinite(matrix).all():
        raise SceneError(f"finite numbers are expected, given {given(value)}")
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


def _matrix(value: Any, names: Names) -> NDArray[np.float64]:
    if isinstance(value, Mapping):
        return _from_table(value, names)
    if isinstance(value, list | tuple) and len(value) == 3:
        if all(isinstance(row, list | tuple) and len(row) == 3 for row in value):
            return np.array([[read_number(item, names, _UNIT) for item in row] for row in value])
        if not any(isinstance(row, list | tuple) for row in value):
            return np.diag([read_number(item, names, _UNIT) for item in value])
    raise SceneError(
        "an inertia is [Ixx, Iyy, Izz], a 3x3 matrix or a table {xx, yy, zz, xy, xz, yz}, "
        f"given {given(value)}"
    )


def _from_table(table: Mapping[str, Any], names: Names) -> NDArray[np.float64]:
    keys = (*_DIAGONAL, *_PRODUCTS)
    problems = [unknown_key(key, keys) for key in table if key not in keys]
    problems += [Problem(key, "is missing") for key in _DIAGONAL if key not in table]
    matrix = np.zeros((3, 3))
    for key in keys:
        i, j = ("xyz".index(letter) for letter in key)
        try:
            matrix[i, j] = matrix[j, i] = read_number(table.get(key, 0.0), names, _UNIT)
        except SceneError as error:
            problems += [Problem(key, p.what, p.allowed, p.nearest) for p in error.problems]
    if problems:
        raise SceneError.from_problems(problems)
    return matrix


def _check(matrix: NDArray[np.float64], units: UnitSystem) -> None:
    scale = float(np.abs(matrix).max())
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(matrix[i, j] - matrix[j, i]) > _ROUNDING * scale:
            unit = units.label(_UNIT)
            a, b = f"I{'xyz'[i]}{'xyz'[j]}", f"I{'xyz'[j]}{'xyz'[i]}"
            raise SceneError(
                f"the inertia is not symmetric: {a} = {matrix[i, j]:g} {unit} "
                f"but {b} = {matrix[j, i]:g} {unit}"
            )
    moments = _principal(matrix)
    exceeds = moments[2] > (moments[0] + moments[1]) * (1 + _ROUNDING)
    if not (moments[0] <= 0 or exceeds):
        return
    shown, unit = ", ".join(f"{moment:g}" for moment in moments), units.label(_UNIT)
    if moments[0] <= 0:
        raise SceneError(
            f"the inertia is impossible: its principal moments {shown} {unit} must all be positive"
        )
    raise SceneError(
        f"the inertia is impossible: of its principal moments {shown} {unit} the largest, "
        f"{moments[2]:g}, exceeds the sum of the other two, {moments[0] + moments[1]:g}; "
        "no distribution of mass has it"
    )


def _principal(matrix: NDArray[np.float64]) -> list[float]:
    """Principal moments of inertia, ascending."""
    diagonal: list[float] = matrix.diagonal().tolist()
    if np.count_nonzero(matrix) == np.count_nonzero(diagonal):
        return sorted(diagonal)
    moments: list[float] = np.linalg.eigvalsh((matrix + matrix.T) / 2).tolist()
    return moments


def _inertia(value: Any, info: ValidationInfo) -> Rows:
    try:
        return read_inertia(value, names_of(info))
    except SceneError as error:
        raise fail(*error.problems) from None


def _write(value: Rows, info: SerializationInfo) -> list[list[float]]:
    units = units_of(names_of(info))
    return [[units.written(item, _UNIT) for item in row] for row in value]


Inertia = Annotated[Rows, Reader(_inertia, _write)]
