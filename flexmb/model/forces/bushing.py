"""Bushing and beam: force elements between two markers, linear in their relative motion.

Deflections are the motion of marker J relative to marker I, in the axes of I: displacement, and
rotation vector with an angle below 180 degrees (for small angles the three angles about the axes).
Forces act on J, and the opposite on I at the same point. Options and laws are those of BUSHING and
BEAM of MSC Adams.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.materials import Material
from flexmb.model.lookup import Component, Scope
from flexmb.model.option_specs import MaterialField
from flexmb.model.quantities import Axis, Pair, Quantity, Size, plain
from flexmb.model.reading import NUMBER, Reader, fail, fail_if, list_form, quote

_PARALLEL = 1e-6  # sine of the angle between x and `orientation` below which y is not defined
_ROUND_OFF = 1e-12  # relative asymmetry up to which a matrix counts as symmetric
_SYMMETRIC = "must be symmetric: a force without a potential energy is not elastic"


def _block(rows: Any, units: tuple[tuple[str, ...], ...], info: ValidationInfo) -> Any:
    """A symmetric positive semidefinite matrix of numbers with these units."""
    size = len(units)
    shaped = isinstance(rows, list) and len(rows) == size
    if not shaped or any(not isinstance(row, list) or len(row) != size for row in rows):
        raise fail(Problem("", f"{size} x {size} numbers are expected, given {quote(rows)}"))
    matrix = np.array(
        [
            [Quantity(unit).read(x, info) for x, unit in zip(row, names, strict=True)]
            for row, names in zip(rows, units, strict=True)
        ]
    )
    _refuse_asymmetry(matrix)
    return tuple(tuple(float(x) for x in row) for row in matrix)


def _refuse_asymmetry(matrix: Any) -> None:
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale[scale == 0.0] = 1.0
    scaled = matrix / np.outer(scale, scale)
    if np.abs(scaled - scaled.T).max() > _ROUND_OFF * max(1.0, np.abs(scaled).max()):
        raise fail(Problem("", _SYMMETRIC))
    if np.linalg.eigvalsh(0.5 * (scaled + scaled.T)).min() < -_ROUND_OFF * len(matrix):
        raise fail(
            Problem("", "must not be negative in any direction (it has a negative eigenvalue)")
        )


def _three(unit: str) -> Reader:
    """Reader of one number for all three directions, of three numbers, or of a 3 x 3 matrix."""

    def read(value: Any, info: ValidationInfo) -> Any:
        value = plain(value)
        if not isinstance(value, list):
            return (Quantity(unit, "not negative").read(value, info),) * 3
        if len(value) == 3 and not any(isinstance(item, list) for item in value):
            return tuple(Quantity(unit, "not negative").read(item, info) for item in value)
        return _block(value, ((unit,) * 3,) * 3, info)

    def write(value: Any, info: SerializationInfo) -> Any:
        one = Quantity(unit)
        return [
            [one.write(x, info) for x in item] if isinstance(item, tuple) else one.write(item, info)
            for item in value
        ]

    vector = list_form(NUMBER, 3)
    forms = [NUMBER, vector, list_form(vector, 3)]
    return Reader(read, write, {"anyOf": forms, "description": f"[{unit}]"})


def _six_units(force: str, couple: str, moment: str) -> tuple[tuple[str, ...], ...]:
    top, bottom = (force,) * 3 + (couple,) * 3, (couple,) * 3 + (moment,) * 3
    return (top,) * 3 + (bottom,) * 3


def _six(units: tuple[tuple[str, ...], ...]) -> Reader:
    """Reader of a 6 x 6 matrix: forces and moments per displacement and angle."""

    def read(value: Any, info: ValidationInfo) -> Any:
        return _block(plain(value), units, info)

    def write(value: Any, info: SerializationInfo) -> Any:
        return [
            [Quantity(unit).write(x, info) for x, unit in zip(row, names, strict=True)]
            for row, names in zip(value, units, strict=True)
        ]

    names = ", ".join(dict.fromkeys(unit for row in units for unit in row))
    matrix = list_form(list_form(NUMBER, 6), 6)
    return Reader(read, write, {**matrix, "description": f"[{names}]"})


Stiffness3 = Annotated[Any, _three("N/m")]
Turning3 = Annotated[Any, _three("N m/rad")]
Damping3 = Annotated[Any, _three("N s/m")]
TurnDamping3 = Annotated[Any, _three("N m s/rad")]
Stiffness6 = Annotated[Any, _six(_six_units("N/m", "N/rad", "N m/rad"))]
Damping6 = Annotated[Any, _six(_six_units("N s/m", "N s/rad", "N m s/rad"))]


_Force = Annotated[float, Quantity("N")]
_Torque = Annotated[float, Quantity("N m")]
Forces = Annotated[tuple[_Force, _Force, _Force], BeforeValidator(plain)]
Torques = Annotated[tuple[_Torque, _Torque, _Torque], BeforeValidator(plain)]


class BushingSpec(Component):
    """Springs and dampers along and about the axes of marker I. Each is one number for all three
    directions, three numbers, or a 3 x 3 matrix; or all together are 6 x 6 as ``matrix`` and
    ``damping_matrix``. ``preload`` and ``preload_torque`` act on J at zero deflection. The
    deflection is zero in the placed pose, or with ``free = "together"`` where both markers
    coincide, axes included.
    """

    type: Literal["bushing"]
    between: Pair
    stiffness: Stiffness3 | None = None
    rotational_stiffness: Turning3 | None = None
    damping: Damping3 | None = None
    rotational_damping: TurnDamping3 | None = None
    matrix: Stiffness6 | None = None
    damping_matrix: Damping6 | None = None
    preload: Forces | None = None
    preload_torque: Torques | None = None
    free: Literal["placed", "together"] = "placed"

    @model_validator(mode="after")
    def _check_matrices(self) -> Self:
        pairs = (("matrix", "stiffness"), ("damping_matrix", "damping"))
        problems = [
            Problem(word, f'is in "{whole}" already; give one of them')
            for whole, part in pairs
            for word in (part, f"rotational_{part}")
            if getattr(self, whole) is not None and getattr(self, word) is not None
        ]
        words = [
            name for name in type(self).model_fields if name not in ("type", "between", "free")
        ]
        if all(getattr(self, word) is None for word in words):
            what = "needs stiffness, rotational_stiffness, damping, matrix or preload"
            problems.append(Problem("", what))
        fail_if(problems)
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a bushing")


_Modulus = Annotated[float, Quantity("Pa", "positive")]
_Area = Annotated[float, Quantity("m^2", "positive")]
_Moment = Annotated[float, Quantity("m^4", "positive")]
_Coefficient = Annotated[float, Quantity("", "positive")]


class BeamForceSpec(Component):
    """A massless beam from marker I to marker J, without forces in the placed pose and linear in
    the motion of J relative to I. x runs from I to J, ``orientation`` is the direction of y. Moduli
    are given by ``material`` or by E and G, the section by its area, second moments and torsion
    constant; without the shear coefficients ky, kz there is no shear deformation. The damping
    matrix is ``damping`` times the stiffness matrix.
    """

    type: Literal["beam"]
    between: Pair
    material: MaterialField | None = None
    E: _Modulus | None = None
    G: _Modulus | None = None
    A: _Area
    Iy: _Moment
    Iz: _Moment
    J: _Moment
    ky: _Coefficient | None = None
    kz: _Coefficient | None = None
    length: Size | None = None
    orientation: Axis | None = None
    damping: Annotated[float, Quantity("s", "not negative")] = 0.0

    @model_validator(mode="after")
    def _check_moduli(self) -> Self:
        problems = []
        if (self.material is None) == (self.E is None and self.G is None):
            problems.append(Problem("", "give either material, or E and G"))
        elif self.material is None and (self.E is None or self.G is None):
            problems.append(Problem("E" if self.E is None else "G", "is missing"))
        elif self.material is not None and not isinstance(self.material, Material):
            problems.append(Problem("material", "must be the same in all directions"))
        if self.orientation is None and self.Iy != self.Iz:
            what = "is missing: Iy and Iz differ, so give the direction of the section's y axis"
            problems.append(Problem("orientation", what))
        fail_if(problems)
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a beam")
        yield from scope.line_problems(where, self.between, "beam")
        line = scope.line(self.between)
        if line is not None and line.any() and self.orientation is not None:
            across = np.cross(line / np.linalg.norm(line), self.orientation)
            if np.linalg.norm(across) < _PARALLEL:
                what = "is parallel to the beam: give the direction of the section's y axis"
                yield Problem(f"{where}.orientation", what)

    @property
    def moduli(self) -> tuple[float, float]:
        """E and G [Pa]."""
        if isinstance(self.material, Material):
            return self.material.E, self.material.E / (2.0 * (1.0 + self.material.nu))
        assert self.E is not None and self.G is not None  # the validator has made sure of it
        return self.E, self.G
