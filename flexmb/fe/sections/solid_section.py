"""Sections of solids: their material and its directions.

In: a material, two directions. Out: a :class:`SolidSection`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from flexmb.errors import FlexmbWarning, Problem, ReductionError
from flexmb.flexbody.arrays import FloatArray
from flexmb.materials import AnyMaterial, Material

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
