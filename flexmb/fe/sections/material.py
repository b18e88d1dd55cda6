"""The material of a mesh: resolved and judged for unit slips; and the section of solids.

In: a name in the library, a dictionary with E [Pa], nu [-] and density [kg/m^3], with G [Pa] and
three of each where it is orthotropic, or a material. Out: a :class:`Material` or
:class:`OrthotropicMaterial`, and sentences about values no engineering material has. The section of
a solid is its material and the directions of its axes: a :class:`SolidSection`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexmb.errors import FlexmbWarning, MaterialError, Problem, ReductionError
from flexmb.flexbody.arrays import FloatArray
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


Vector = tuple[float, float, float]

_MAX_BULK_RATIO = 49.0  # bulk over shear modulus: nu = 0.49


@dataclass(frozen=True)
class SolidSection:
    """What solid elements are made of.

    Parameters
    ----------
    material : Material or OrthotropicMaterial, optional
        The body's if none is given.
    axis1, axis2 : (3,) float, optional
        Material axis 1, and a direction in the plane of axes 1 and 2, body frame; by default the
        axes of the body frame. Without meaning for isotropic materials.

    Raises
    ------
    ReductionError
        Directions that are no directions, or parallel ones.
    """

    material: AnyMaterial | None = None
    axis1: Vector | None = None
    axis2: Vector | None = None

    dimension = 3

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.{name}", f"must be three numbers, not all zero, given {axis!r}")
            for name, axis in (("axis1", self.axis1), ("axis2", self.axis2))
            if axis is not None and not _is_direction(axis)
        ]
        if problems:
            raise ReductionError.from_problems(problems)
        first, second = self._unit_axes()
        if np.linalg.norm(np.cross(first, second)) < 1e-6:
            what = f"is parallel to axis1, {tuple(first)}: give another direction of their plane"
            raise ReductionError.from_problems([Problem("section.axis2", what)])

    def with_material(self, default: AnyMaterial | None) -> SolidSection:
        """The section with its material known; warns if that can hardly be compressed."""
        section = self if self.material is not None else replace(self, material=default)
        ratio = 0.0 if section.material is None else _bulk_over_shear(section.material)
        if ratio > _MAX_BULK_RATIO:
            warnings.warn(
                f'material "{section.material.name}": its bulk modulus is {ratio:.3g} times its '
                "shear modulus; solid elements, which interpolate displacements alone, may be too "
                "stiff then: use first-order hexahedra, whose incompatible modes keep them soft, "
                "or second-order tetrahedra, and compare two meshes",
                FlexmbWarning,
                stacklevel=2,
            )
        return section

    def axes(self) -> FloatArray:
        """(3, 3) the material axes as columns, body frame."""
        first, second = self._unit_axes()
        third = np.cross(first, second)
        third /= np.linalg.norm(third)
        return np.stack([first, np.cross(third, first), third], axis=1)

    def stiffness(self) -> FloatArray:
        """(6, 6) stress per strain in body axes [Pa], order xx, yy, zz, yz, zx, xy."""
        C = self.material.stiffness()
        if isinstance(self.material, Material):
            return C
        T = _strain_turn(self.axes())
        C = T.T @ C @ T
        return 0.5 * (C + C.T)

    def _unit_axes(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors along axis1 and axis2."""
        first = np.array((1.0, 0.0, 0.0) if self.axis1 is None else self.axis1, dtype=float)
        second = np.array((0.0, 1.0, 0.0) if self.axis2 is None else self.axis2, dtype=float)
        return first / np.linalg.norm(first), second / np.linalg.norm(second)


def _is_direction(value: Vector) -> bool:
    try:
        values = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return values.shape == (3,) and bool(np.isfinite(values).all()) and bool(values.any())


def _bulk_over_shear(material: AnyMaterial) -> float:
    """Resistance to a change of volume under pressure, over the least shear modulus."""
    C = material.stiffness()
    return float(1 / np.linalg.inv(C[:3, :3]).sum() / np.diag(C)[3:].min())


def _strain_turn(axes: FloatArray) -> FloatArray:
    """(6, 6) from strains along the body's axes to strains along ``axes`` (columns)."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    T = np.empty((6, 6))
    for row, (p, q) in enumerate(pairs):
        for column, (a, b) in enumerate(pairs):
            both = axes[a, p] * axes[b, q] + axes[b, p] * axes[a, q]
            T[row, column] = both * (0.5 if p == q else 1.0)
    return T
