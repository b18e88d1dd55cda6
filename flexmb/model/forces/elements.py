"""Bushing and beam: force elements between two markers, linear in their relative motion.

Deflections are the motion of marker J seen from marker I, in the axes of I: displacement, and
rotation vector below half a turn (at small angles the three angles about the axes). Forces act on
J, the opposite on I at the same point. Words and laws are those of BUSHING and BEAM of MSC Adams.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, model_validator

from flexmb.errors import Problem
from flexmb.materials import Material
from flexmb.model.bodies.option_specs import MaterialField
from flexmb.model.values.matrices import (
    Damping3,
    Damping6,
    Stiffness3,
    Stiffness6,
    TurnDamping3,
    Turning3,
)
from flexmb.model.values.quantities import Axis, Pair, Quantity, Size, plain
from flexmb.model.values.reading import Spec, fail

__all__ = ["BeamForceSpec", "BushingSpec"]

_Force = Annotated[float, Quantity("N")]
_Torque = Annotated[float, Quantity("N m")]
Forces = Annotated[tuple[_Force, _Force, _Force], BeforeValidator(plain)]
Torques = Annotated[tuple[_Torque, _Torque, _Torque], BeforeValidator(plain)]


class BushingSpec(Spec):
    """Springs and dampers along and about the axes of marker I: each one number for all three
    directions, three, or a 3 x 3 matrix; or 6 x 6 as ``matrix`` and ``damping_matrix``.

    ``preload`` and ``preload_torque`` act on J without any deflection. It is free in the placed
    pose, or with ``free = "together"`` where both markers coincide, axes and all.
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
    def _once(self) -> Self:
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
            what = "does nothing: give stiffness, rotational_stiffness, damping, matrix or preload"
            problems.append(Problem("", what))
        if problems:
            raise fail(*problems)
        return self


_Modulus = Annotated[float, Quantity("Pa", "positive")]
_Area = Annotated[float, Quantity("m^2", "positive")]
_Moment = Annotated[float, Quantity("m^4", "positive")]
_Coefficient = Annotated[float, Quantity("", "positive")]


class BeamForceSpec(Spec):
    """A massless beam from marker I to marker J, free in the placed pose and linear in the motion
    of J seen from I; x runs from I to J, ``orientation`` is the direction of y.

    Moduli by ``material`` or by E and G; area, second moments and torsion constant of the section;
    without the shear coefficients ky, kz no shear. The damping matrix is ``damping`` times that of
    the stiffness.
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
    def _has_moduli(self) -> Self:
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
        if problems:
            raise fail(*problems)
        return self

    @property
    def moduli(self) -> tuple[float, float]:
        """E and G [Pa]."""
        if isinstance(self.material, Material):
            return self.material.E, self.material.E / (2.0 * (1.0 + self.material.nu))
        assert self.E is not None and self.G is not None  # the validator knows
        return self.E, self.G
