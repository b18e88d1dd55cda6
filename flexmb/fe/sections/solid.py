"""Sections of solids: their material and its directions.

In: a material, two directions. Out: a :class:`SolidSection`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexmb.materials import AnyMaterial

__all__ = ["SolidSection"]

Vector = tuple[float, float, float]


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
    """

    material: AnyMaterial | None = None
    axis1: Vector | None = None
    axis2: Vector | None = None

    dimension = 3

    def with_material(self, default: AnyMaterial | None) -> SolidSection:
        """The section with its material known."""
        return self if self.material is not None else replace(self, material=default)
