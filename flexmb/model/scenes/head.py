"""The keys at the top of a scene: unit system and gravity."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from flexmb.errors import FlexmbError, Problem
from flexmb.model.values.quantities import Acceleration, read_axis
from flexmb.model.values.reading import Names, Spec, read_entry
from flexmb.units import SI, UnitSystem, unit_system

__all__ = ["gravity_in_words", "read_gravity", "read_units"]


_STANDARD = 9.80665  # m/s^2, exact: 3rd General Conference on Weights and Measures, 1901
_EARTH = re.compile(r"earth\s+(?P<down>[+-]?[xyz])\Z")


class _Gravity(Spec):
    gravity: Acceleration


def read_units(value: Any) -> tuple[UnitSystem, list[Problem]]:
    """The unit system of a scene; SI and the problem where it is none."""
    try:
        return unit_system(value), []
    except FlexmbError as error:
        return SI, list(error.problems)


def read_gravity(
    value: Any, names: Names
) -> tuple[tuple[float, float, float] | None, list[Problem]]:
    """Acceleration of gravity in global axes [m/s^2]; None for none.

    ``"earth -z"`` is the standard one along a global direction.
    """
    if value is None or value == "none":
        return None, []
    if isinstance(value, str):
        found = _EARTH.match(value)
        if found:
            x, y, z = (_STANDARD * c for c in read_axis(found["down"], names))
            return (x, y, z), []
        allowed = ("none", "[gx, gy, gz]", "earth -z", "earth -y")
        return None, [Problem("gravity", f'unknown gravity "{value}"', allowed)]
    spec, problems = read_entry(_Gravity, {"gravity": value}, names)
    return (spec.gravity if spec else None), problems


def gravity_in_words(gravity: Iterable[float] | str | None, units: UnitSystem) -> str:
    """What is said of gravity, given in the units of a scene: its components, or that it is none.

    >>> gravity_in_words([0, 0, -9810], unit_system("mm-t-s"))
    'gravity: (0, 0, -9810) mm/s²'
    """
    if gravity is None or isinstance(gravity, str):
        return "gravity: none"
    parts = ", ".join(f"{g:g}" for g in gravity)
    return f"gravity: ({parts}) {units.label('m/s^2', raised=True)}"
