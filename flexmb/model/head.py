"""The keys at the top of a scene: title and gravity."""

from __future__ import annotations

from typing import Any

from flexmb.errors import Problem
from flexmb.model.quantities import Vector
from flexmb.model.reading import Names, Spec, read_entry

__all__ = ["read_gravity"]


class _Gravity(Spec):
    gravity: Vector


def read_gravity(
    value: Any, names: Names
) -> tuple[tuple[float, float, float] | None, list[Problem]]:
    """Acceleration of gravity in global axes [m/s^2]; None for none."""
    if value is None or value == "none":
        return None, []
    if isinstance(value, str):
        allowed = ("none", "[gx, gy, gz]")
        return None, [Problem("gravity", f'unknown gravity "{value}"', allowed)]
    spec, problems = read_entry(_Gravity, {"gravity": value}, names)
    return (spec.gravity if spec else None), problems
