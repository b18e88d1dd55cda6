"""The material of a mesh: resolved from what the user gives, and judged for unit slips.

In: a name in the library, a dictionary with E [Pa], nu [-] and density [kg/m^3], with G [Pa] and
three of each where it is orthotropic, or a material. Out: a :class:`Material` or
:class:`OrthotropicMaterial`, and sentences about values no engineering material has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexmb.errors import MaterialError
from flexmb.flexbody.mesh_options import MaterialOptions, OrthotropicOptions
from flexmb.flexbody.options import read_options
from flexmb.materials import AnyMaterial, Material, OrthotropicMaterial, material

MaterialLike = str | AnyMaterial | Mapping[str, Any]

_DENSITY = (500.0, 25e3)  # kg/m^3: light wood is below metals and polymers, osmium is 22.6e3
_MODULUS = (1e6, 1e12)  # Pa: soft rubber to diamond
_WAVE_SPEED = (100.0, 15e3)  # m/s: sqrt(E/rho) of rubber 50-100, of beryllium 13e3
_SLIPS = ((1e-12, "t/mm^3"), (1e-9, "kg/mm^3"), (1e-3, "g/cm^3"))
_MODULUS_SLIPS = ((1e-9, "GPa"), (1e-6, "MPa"))


def resolve(words: MaterialLike) -> AnyMaterial:
    """The material that was meant.

    Raises
    ------
    MaterialError
        Unknown name, missing or unknown key, or a value that cannot be; all at once.
    """
    if isinstance(words, OrthotropicMaterial):
        return words
    if not isinstance(words, Mapping):
        return material(words)
    directed = "G" in words or (
        hasattr(words.get("E"), "__len__") and not isinstance(words["E"], str)
    )
    options = read_options(
        OrthotropicOptions if directed else MaterialOptions, words, "material", MaterialError
    )
    values = {name: _as_floats(value) for name, value in vars(options).items()}
    return OrthotropicMaterial(**values) if directed else Material(**values)


def _as_floats(value: Any) -> Any:
    if isinstance(value, str):
        return value
    return tuple(map(float, value)) if isinstance(value, tuple) else float(value)


def plausibility(material_: AnyMaterial) -> list[str]:
    """Sentences about values out of the range of engineering materials; empty if none."""
    sentences = []
    E = material_.E if isinstance(material_, Material) else max(material_.E)
    if not _DENSITY[0] <= material_.density <= _DENSITY[1]:
        hint = _slip(material_.density, _DENSITY, _SLIPS, "kg/m^3")
        sentences.append(
            f"density {material_.density:g} kg/m^3 is not that of an engineering material{hint}"
        )
    if not _MODULUS[0] <= E <= _MODULUS[1]:
        hint = _slip(E, _MODULUS, _MODULUS_SLIPS, "Pa")
        sentences.append(f"Young's modulus {E:g} Pa is implausible{hint}")
    speed = math.sqrt(E / material_.density)
    if not _WAVE_SPEED[0] <= speed <= _WAVE_SPEED[1]:
        low, high = _WAVE_SPEED
        sentences.append(
            f"wave speed sqrt(E/density) = {speed:.4g} m/s is outside {low:g} to {high:g} m/s: "
            "E in Pa and density in kg/m^3 do not fit together"
        )
    return sentences


def _slip(
    value: float, range_: tuple[float, float], slips: tuple[tuple[float, str], ...], unit: str
) -> str:
    for factor, name in slips:
        if range_[0] <= value / factor <= range_[1]:
            return f"; given in {name}? Then it is {value / factor:.4g} {unit}"
    return ""
