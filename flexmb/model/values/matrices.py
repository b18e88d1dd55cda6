"""Stiffness and damping between two markers as a scene writes them: numbers, 3 x 3 and 6 x 6.

In: one number for all three directions, three numbers, or rows of a matrix, in the scene's units.
Out: tuples in SI; matrices symmetric and without a negative direction, or a mistake.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem
from flexmb.model.values.quantities import Quantity, plain
from flexmb.model.values.reading import Reader, fail, given

__all__ = [
    "BY_DIRECTION",
    "SIX_BY_SIX",
    "Damping3",
    "Damping6",
    "Stiffness3",
    "Stiffness6",
    "TurnDamping3",
    "Turning3",
]

_ROUND_OFF = 1e-12  # of the entries of a matrix that should be symmetric
_SYMMETRIC = "must be symmetric: a force that no energy belongs to is not elastic"


def _block(rows: Any, units: tuple[tuple[str, ...], ...], info: ValidationInfo) -> Any:
    """A matrix of numbers of these units, symmetric and without a negative direction."""
    size = len(units)
    shaped = isinstance(rows, list) and len(rows) == size
    if not shaped or any(not isinstance(row, list) or len(row) != size for row in rows):
        raise fail(Problem("", f"{size} x {size} numbers are expected, given {given(rows)}"))
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
    """Reader of one number for all three directions, three numbers, or a 3 x 3 matrix."""

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

    return Reader(read, write)


def _six_units(force: str, couple: str, moment: str) -> tuple[tuple[str, ...], ...]:
    top, bottom = (force,) * 3 + (couple,) * 3, (couple,) * 3 + (moment,) * 3
    return (top,) * 3 + (bottom,) * 3


def _six(units: tuple[tuple[str, ...], ...]) -> Reader:
    """Reader of a 6 x 6 matrix, forces and moments over displacements and angles."""

    def read(value: Any, info: ValidationInfo) -> Any:
        return _block(plain(value), units, info)

    def write(value: Any, info: SerializationInfo) -> Any:
        return [
            [Quantity(unit).write(x, info) for x, unit in zip(row, names, strict=True)]
            for row, names in zip(value, units, strict=True)
        ]

    return Reader(read, write)


Stiffness3 = Annotated[Any, _three("N/m")]
Turning3 = Annotated[Any, _three("N m/rad")]
Damping3 = Annotated[Any, _three("N s/m")]
TurnDamping3 = Annotated[Any, _three("N m s/rad")]
Stiffness6 = Annotated[Any, _six(_six_units("N/m", "N/rad", "N m/rad"))]
Damping6 = Annotated[Any, _six(_six_units("N s/m", "N s/rad", "N m s/rad"))]
BY_DIRECTION = {
    "N/m": Stiffness3,
    "N m/rad": Turning3,
    "N s/m": Damping3,
    "N m s/rad": TurnDamping3,
}
SIX_BY_SIX = {"N/m, N/rad, N m/rad": Stiffness6, "N s/m, N s/rad, N m s/rad": Damping6}
"""What is given for three directions, and in all six, by its units."""
