"""Cross-sections of beams by their dimensions.

In: dimensions in metres, along the section's axes y and z; with the default orientation z is up
for a level beam. Out: a :class:`BeamSection`. Words for all of them: ``shear`` (False: no shear
deformation), ``ky`` and ``kz`` (instead of the shape's own), ``orientation``, ``offset``,
``nonstructural``, ``material``, ``releases``, as in :class:`BeamSection`.
Sources: torsion of a rectangle, Timoshenko and Goodier, Theory of Elasticity, 3rd ed., section
109; shear coefficients of rectangle, circle and tube, Cowper (1966), J. Appl. Mech. 33, with
Poisson's ratio; thin walls in :mod:`flexmb.fe.sections.thin_walls`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError
from flexmb.fe.sections.beam_section import (
    BeamSection,
    Place,
    StressPoint,
    polygon,
    positive,
    section_of,
)
from flexmb.flexbody.arrays import FloatArray

_AROUND = 16  # corners of a drawn circle
_ODD = np.arange(1, 40, 2)


@dataclass(frozen=True)
class Rectangle:
    """Solid rectangle, ``y`` by ``z`` [m]."""

    y: float
    z: float

    def __post_init__(self) -> None:
        positive(**vars(self))

    def values(self) -> tuple[float, float, float, float]:
        long, short = max(self.y, self.z), min(self.y, self.z)
        series = np.sum(np.tanh(_ODD * np.pi * long / (2 * short)) / _ODD**5.0)
        J = long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * series)
        return self.y * self.z, self.y * self.z**3 / 12, self.z * self.y**3 / 12, float(J)

    def shear(self, nu: float) -> tuple[float, float]:
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return k, k

    def points(self) -> tuple[StressPoint, ...]:
        A, _, _, J = self.values()
        y, z = self.y / 2, self.z / 2
        corners = [
            StressPoint(f"{a}y{b}z", i * y, j * z)
            for a, i in (("+", 1), ("-", -1))
            for b, j in (("+", 1), ("-", -1))
        ]
        long, short = max(self.y, self.z), min(self.y, self.z)
        at = np.pi * long / (2 * short)
        far = 1 - 8 / np.pi**2 * np.sum(1 / (_ODD**2 * np.cosh(np.minimum(_ODD * at, 300.0))))
        signs = (-1.0) ** ((_ODD - 1) // 2)
        near = 8 / np.pi**2 * np.sum(signs * np.tanh(_ODD * at) / _ODD**2)
        # stress in the middle of the long sides (far) and of the short ones (near)
        at_y, at_z = (near, far) if self.y >= self.z else (far, near)
        by_y, by_z = float(short / J * at_y), float(short / J * at_z)
        sides = [
            StressPoint(f"{a}y", i * y, 0.0, xz=(i * by_y, 0.0, 1.5 / A))
            for a, i in (("+", 1), ("-", -1))
        ]
        sides += [
            StressPoint(f"{a}z", 0.0, i * z, xy=(-i * by_z, 1.5 / A, 0.0))
            for a, i in (("+", 1), ("-", -1))
        ]
        return (*corners, *sides)

    def outline(self) -> list[FloatArray]:
        return [polygon(-self.y / 2, -self.z / 2, self.y, self.z)]

    def tilt(self) -> tuple[float, Place]:
        return 0.0, (0.0, 0.0)


@dataclass(frozen=True)
class Tube:
    """Round tube with outer ``radius`` and ``inner`` radius [m]; a solid bar with 0."""

    radius: float
    inner: float

    def __post_init__(self) -> None:
        positive(radius=self.radius)
        if not 0 <= self.inner < self.radius:
            what = f"must lie between 0 and the outer radius {self.radius:g} m, given {self.inner}"
            raise ReductionError.from_problems([Problem("section.inner", what)])

    def values(self) -> tuple[float, float, float, float]:
        I = math.pi / 4 * (self.radius**4 - self.inner**4)  # noqa: E741
        return math.pi * (self.radius**2 - self.inner**2), I, I, 2 * I

    def shear(self, nu: float) -> tuple[float, float]:
        m2 = (self.inner / self.radius) ** 2
        q = (1 + m2) ** 2
        k = 6 * (1 + nu) * q / ((7 + 6 * nu) * q + (20 + 12 * nu) * m2)
        return k, k

    def points(self) -> tuple[StressPoint, ...]:
        r, (_, I, _, J) = self.radius, self.values()  # noqa: E741
        # shear stress V Q/(I b) across the middle, Q of half the section
        by_force = (r**2 + r * self.inner + self.inner**2) / (3 * I)
        by_torque = r / J
        return (
            StressPoint("+y", r, 0.0, xz=(by_torque, 0.0, by_force)),
            StressPoint("-y", -r, 0.0, xz=(-by_torque, 0.0, by_force)),
            StressPoint("+z", 0.0, r, xy=(-by_torque, by_force, 0.0)),
            StressPoint("-z", 0.0, -r, xy=(by_torque, by_force, 0.0)),
        )

    def outline(self) -> list[FloatArray]:
        angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
        return [self.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)]

    def tilt(self) -> tuple[float, Place]:
        return 0.0, (0.0, 0.0)


def rectangle(y: float, z: float, **common: Any) -> BeamSection:
    """Solid rectangle, ``y`` by ``z`` [m]; ``common`` words as the module says."""
    return section_of(Rectangle(y, z), **common)


def tube(radius: float, inner: float, **common: Any) -> BeamSection:
    """Round tube with outer ``radius`` and ``inner`` radius [m]."""
    return section_of(Tube(radius, inner), **common)


def circle(radius: float, **common: Any) -> BeamSection:
    """Solid round bar of that ``radius`` [m]."""
    return section_of(Tube(radius, 0.0), **common)


SECTIONS = {"rectangle": rectangle, "tube": tube, "circle": circle}
"""Solid and round sections by type."""
