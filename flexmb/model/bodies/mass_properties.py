"""Mass properties of rigid bodies: inertia as given or from a shape, and whether it can be.

In: dimensions in m. Out: volume [m^3] and the inertia per unit mass about the shape's own centre
[m^2], in body axes, in closed form. Source: any table of moments of inertia of solids, e.g. Meriam
and Kraige, Engineering Mechanics: Dynamics, appendix D.

In: moments and products of inertia about the centre of mass, body axes, as three principal
moments, a 3x3 matrix, or a table. Out: a symmetric positive 3x3 matrix that some distribution of
mass can have: no principal moment exceeds the sum of the other two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.values.quantities import Size, Sizes, read_number
from flexmb.model.values.reading import (
    NUMBER,
    ReadContext,
    Reader,
    Spec,
    Variant,
    context_of,
    fail,
    list_form,
    quote,
    unknown_key,
)
from flexmb.units import UnitSystem

Diagonal = tuple[float, float, float]


class ShapeSpec(Spec):
    """Base of the shapes."""

    @property
    def volume(self) -> float:
        """m^3"""
        raise NotImplementedError

    @property
    def inertia_per_mass(self) -> Diagonal:
        """Principal moments about the centre over the mass, body axes [m^2]."""
        raise NotImplementedError


class BoxShape(ShapeSpec):
    """A box, its edges along the body axes."""

    type: Literal["box"] = "box"
    size: Sizes

    @property
    def volume(self) -> float:
        x, y, z = self.size
        return x * y * z

    @property
    def inertia_per_mass(self) -> Diagonal:
        x, y, z = self.size
        return ((y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12)


class CylinderShape(ShapeSpec):
    """A solid circular cylinder along a body axis."""

    type: Literal["cylinder"] = "cylinder"
    radius: Size
    length: Size
    axis: Literal["x", "y", "z"] = "z"

    @property
    def volume(self) -> float:
        return math.pi * self.radius**2 * self.length

    @property
    def inertia_per_mass(self) -> Diagonal:
        across = self.radius**2 / 4 + self.length**2 / 12
        moments = [across, across, across]
        moments["xyz".index(self.axis)] = self.radius**2 / 2
        return (moments[0], moments[1], moments[2])


class SphereShape(ShapeSpec):
    """A solid sphere."""

    type: Literal["sphere"] = "sphere"
    radius: Size

    @property
    def volume(self) -> float:
        return 4 / 3 * math.pi * self.radius**3

    @property
    def inertia_per_mass(self) -> Diagonal:
        moment = 0.4 * self.radius**2
        return (moment, moment, moment)


SHAPES: dict[str, type[ShapeSpec]] = {
    "box": BoxShape,
    "cylinder": CylinderShape,
    "sphere": SphereShape,
}

Shape = Annotated[Any, Variant("shape", lambda: SHAPES)]


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


def read_inertia(value: Any, names: ReadContext) -> Rows:
    """The inertia matrix as rows.

    Raises
    ------
    SceneError
        Not one of the three ways to say it, or an inertia that cannot be, with the numbers.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    matrix = _inertia_matrix(value, names)
    units = names.units
    _check_inertia(matrix, units)
    matrix = matrix * units.scale(_UNIT)
    if not np.isfinite(matrix).all():
        raise SceneError(f"finite numbers are expected, given {quote(value)}")
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)


def _inertia_matrix(value: Any, names: ReadContext) -> NDArray[np.float64]:
    if isinstance(value, Mapping):
        return _from_table(value, names)
    if isinstance(value, list | tuple) and len(value) == 3:
        if all(isinstance(row, list | tuple) and len(row) == 3 for row in value):
            return np.array([[read_number(item, names, _UNIT) for item in row] for row in value])
        if not any(isinstance(row, list | tuple) for row in value):
            return np.diag([read_number(item, names, _UNIT) for item in value])
    raise SceneError(
        "an inertia is [Ixx, Iyy, Izz], a 3x3 matrix or a table {xx, yy, zz, xy, xz, yz}, "
        f"given {quote(value)}"
    )


def _from_table(table: Mapping[str, Any], names: ReadContext) -> NDArray[np.float64]:
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


def _check_inertia(matrix: NDArray[np.float64], units: UnitSystem) -> None:
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


def _read_inertia_field(value: Any, info: ValidationInfo) -> Rows:
    try:
        return read_inertia(value, context_of(info))
    except SceneError as error:
        raise fail(*error.problems) from None


def _write_inertia(value: Rows, info: SerializationInfo) -> list[list[float]]:
    units = context_of(info).units
    return [[units.written(item, _UNIT) for item in row] for row in value]


_MOMENTS, _PRODUCTS = ("xx", "yy", "zz"), ("xy", "xz", "yz")
_INERTIA = {
    "anyOf": [
        list_form(NUMBER, 3),
        list_form(list_form(NUMBER, 3), 3),
        {
            "type": "object",
            "properties": {key: NUMBER for key in (*_MOMENTS, *_PRODUCTS)},
            "required": list(_MOMENTS),
            "additionalProperties": False,
        },
    ],
    "description": "[kg m^2]",
}
Inertia = Annotated[Rows, Reader(_read_inertia_field, _write_inertia, _INERTIA)]
