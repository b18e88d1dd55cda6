"""The material of a mesh: resolved from what the user gives, and judged for unit slips.

In: a name in the library, a dictionary with E [Pa], nu [-] and density [kg/m^3], or a Material.
Out: a :class:`Material`, and sentences about values no engineering material has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexmb.errors import MaterialError, Problem, nearest
from flexmb.materials import Material, material

__all__ = ["MaterialLike", "plausibility", "resolve"]

MaterialLike = str | Material | Mapping[str, Any]

_KEYS = ("E", "nu", "density", "name", "source")
_DENSITY = (500.0, 25e3)  # kg/m^3: light wood is below metals and polymers, osmium is 22.6e3
_MODULUS = (1e6, 1e12)  # Pa: soft rubber to diamond
_WAVE_SPEED = (100.0, 15e3)  # m/s: sqrt(E/rho) of rubber 50-100, of beryllium 13e3
_SLIPS = ((1e-12, "t/mm^3"), (1e-9, "kg/mm^3"), (1e-3, "g/cm^3"))
_MODULUS_SLIPS = ((1e-9, "GPa"), (1e-6, "MPa"))


def resolve(given: MaterialLike) -> Material:
    """The material that was meant.

    Raises
    ------
    MaterialError
        Unknown name, missing or unknown key, or a value that cannot be; all at once.
    """
    if not isinstance(given, Mapping):
        return material(given)
    problems = [
        Problem("material", f'unknown key "{key}"', _KEYS, nearest(str(key), _KEYS))
        for key in given
        if key not in _KEYS
    ]
    for key in ("E", "nu", "density"):
        if key not in given:
            problems.append(Problem(f"material.{key}", "is missing"))
        elif isinstance(given[key], bool) or not isinstance(given[key], int | float):
            problems.append(Problem(f"material.{key}", f"must be a number, given {given[key]!r}"))
    if problems:
        raise MaterialError.from_problems(problems)
    words = {"name": "custom", "source": "given by the user"}
    words |= {key: str(given[key]) for key in words if key in given}
    values = {key: float(given[key]) for key in ("E", "nu", "density")}
    return Material(**values, **words)


def plausibility(given: Material) -> list[str]:
    """Sentences about values out of the range of engineering materials; empty if none."""
    found = []
    if not _DENSITY[0] <= given.density <= _DENSITY[1]:
        hint = _slip(given.density, _DENSITY, _SLIPS, "kg/m^3")
        found.append(
            f"density {given.density:g} kg/m^3 is not that of an engineering material{hint}"
        )
    if not _MODULUS[0] <= given.E <= _MODULUS[1]:
        hint = _slip(given.E, _MODULUS, _MODULUS_SLIPS, "Pa")
        found.append(f"Young's modulus {given.E:g} Pa is implausible{hint}")
    speed = math.sqrt(given.E / given.density)
    if not _WAVE_SPEED[0] <= speed <= _WAVE_SPEED[1]:
        low, high = _WAVE_SPEED
        found.append(
            f"wave speed sqrt(E/density) = {speed:.4g} m/s is outside {low:g} to {high:g} m/s: "
            "E in Pa and density in kg/m^3 do not fit together"
        )
    return found


def _slip(
    value: float, range_: tuple[float, float], slips: tuple[tuple[float, str], ...], unit: str
) -> str:
    for factor, name in slips:
        if range_[0] <= value / factor <= range_[1]:
            return f"; given in {name}? Then it is {value / factor:.4g} {unit}"
    return ""
