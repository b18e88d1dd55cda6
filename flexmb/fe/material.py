"""The material of a mesh: resolved from what the user gives, and judged for unit slips.

In: a name in the library, a dictionary with E [Pa], nu [-] and density [kg/m^3], with G [Pa] and
three of each where it is orthotropic, or a material. Out: a :class:`Material` or
:class:`OrthotropicMaterial`, and sentences about values no engineering material has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexmb.errors import MaterialError, Problem, nearest
from flexmb.fe.tables import is_number
from flexmb.materials import AnyMaterial, Material, OrthotropicMaterial, material

__all__ = ["MaterialLike", "plausibility", "resolve"]

MaterialLike = str | AnyMaterial | Mapping[str, Any]

_VALUES = ("E", "nu", "density")
_TEXTS = ("name", "source")
_DENSITY = (500.0, 25e3)  # kg/m^3: light wood is below metals and polymers, osmium is 22.6e3
_MODULUS = (1e6, 1e12)  # Pa: soft rubber to diamond
_WAVE_SPEED = (100.0, 15e3)  # m/s: sqrt(E/rho) of rubber 50-100, of beryllium 13e3
_SLIPS = ((1e-12, "t/mm^3"), (1e-9, "kg/mm^3"), (1e-3, "g/cm^3"))
_MODULUS_SLIPS = ((1e-9, "GPa"), (1e-6, "MPa"))


def resolve(given: MaterialLike) -> AnyMaterial:
    """The material that was meant.

    Raises
    ------
    MaterialError
        Unknown name, missing or unknown key, or a value that cannot be; all at once.
    """
    if isinstance(given, OrthotropicMaterial):
        return given
    if not isinstance(given, Mapping):
        return material(given)
    directed = "G" in given or _listed(given.get("E"))
    keys = _VALUES + (("G",) if directed else ())
    allowed = keys + _TEXTS
    problems = [
        Problem(f"material.{key}", f'unknown key "{key}"', allowed, nearest(str(key), allowed))
        for key in given
        if key not in allowed
    ]
    for key in keys:
        if key not in given:
            problems.append(Problem(f"material.{key}", "is missing"))
        elif directed and key != "density":
            problems += _three_problems(f"material.{key}", given[key])
        elif not is_number(given[key]):
            what = f"must be a number, given {given[key]!r}"
            problems.append(Problem(f"material.{key}", what))
    if problems:
        raise MaterialError.from_problems(problems)
    words = {"name": "custom", "source": "given by the user"}
    words |= {key: str(given[key]) for key in words if key in given}
    if not directed:
        return Material(**{key: float(given[key]) for key in keys}, **words)
    three = {key: tuple(float(v) for v in given[key]) for key in ("E", "nu", "G")}
    return OrthotropicMaterial(**three, density=float(given["density"]), **words)


def _listed(given: Any) -> bool:
    return hasattr(given, "__len__") and not isinstance(given, str)


def _three_problems(where: str, given: Any) -> list[Problem]:
    if _listed(given) and len(given) == 3 and all(is_number(value) for value in given):
        return []
    return [Problem(where, f"must be three numbers, given {given!r}")]


def plausibility(given: AnyMaterial) -> list[str]:
    """Sentences about values out of the range of engineering materials; empty if none."""
    found = []
    E = given.E if isinstance(given, Material) else max(given.E)
    if not _DENSITY[0] <= given.density <= _DENSITY[1]:
        hint = _slip(given.density, _DENSITY, _SLIPS, "kg/m^3")
        found.append(
            f"density {given.density:g} kg/m^3 is not that of an engineering material{hint}"
        )
    if not _MODULUS[0] <= E <= _MODULUS[1]:
        hint = _slip(E, _MODULUS, _MODULUS_SLIPS, "Pa")
        found.append(f"Young's modulus {E:g} Pa is implausible{hint}")
    speed = math.sqrt(E / given.density)
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
