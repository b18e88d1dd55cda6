"""Angle sections (L), with their principal axes and their shear centre.

In: dimensions in metres. Out: a :class:`BeamSection`. Sources as in
:mod:`flexmb.fe.sections.thin_walls`; shear coefficients along the principal axes by the energy of
the shear flow, the small coupling between the two left out. Stress points on the legs know the
torque's shear stress, not that of shear forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flexmb.errors import Problem, ReductionError
from flexmb.fe.sections.beam import BeamSection, principal
from flexmb.fe.sections.beam_shapes import positive, section_of
from flexmb.fe.sections.stress_points import Place, StressPoint, rotated
from flexmb.fe.sections.thin_walls import GAUSS, Four, end_wall

__all__ = ["angle_section"]


@dataclass(frozen=True)
class Angle:
    """Angle with its heel at -y, -z: a leg ``y`` long along y and a leg ``z`` long along z.

    ``flange`` is the thickness of the leg along y, ``web`` of the leg along z. The shear centre is
    where the middle lines meet.
    """

    y: float
    z: float
    web: float
    flange: float

    def __post_init__(self) -> None:
        positive(**vars(self))
        problems = [
            Problem(f"section.{name}", f"must be less than {size:g} m, given {thick:g}")
            for name, thick, size in (("web", self.web, self.y), ("flange", self.flange, self.z))
            if thick >= size
        ]
        if problems:
            raise ReductionError.from_problems(problems)

    def _centroid(self) -> Place:
        upright = self.web * (self.z - self.flange)
        flat = self.y * self.flange
        y = (flat * self.y / 2 + upright * self.web / 2) / (flat + upright)
        z = (flat * self.flange / 2 + upright * (self.z + self.flange) / 2) / (flat + upright)
        return y, z

    def _second(self) -> tuple[float, float, float]:
        (cy, cz), clear = self._centroid(), self.z - self.flange
        Iy = Iz = Iyz = 0.0
        for b, h, y, z in (
            (self.y, self.flange, self.y / 2, self.flange / 2),
            (self.web, clear, self.web / 2, self.flange + clear / 2),
        ):
            Iy += b * h**3 / 12 + b * h * (z - cz) ** 2
            Iz += h * b**3 / 12 + b * h * (y - cy) ** 2
            Iyz += b * h * (y - cy) * (z - cz)
        return Iy, Iz, Iyz

    def values(self) -> Four:
        A = self.y * self.flange + self.web * (self.z - self.flange)
        Iy, Iz, _ = principal(*self._second())
        thick, thin = max(self.web, self.flange), min(self.web, self.flange)
        full, rest = (self.y, self.z - self.flange) if self.flange >= self.web else (
            self.z, self.y - self.web
        )  # fmt: skip
        circle = 2 * (thick + thin - math.sqrt(2 * thick * thin))
        J = end_wall(full, thick) + 0.07 * thin / thick * circle**4
        J += rest * thin**3 * (1 / 3 - 0.105 * thin / rest * (1 - thin**4 / (192 * rest**4)))
        return A, Iy, Iz, J

    def shear(self, nu: float) -> tuple[float, float]:
        turn = self.tilt()[0]
        (cy, cz), s = self._centroid(), 0.5 * (GAUSS[0] + 1)
        heel = rotated((self.web / 2 - cy, self.flange / 2 - cz), turn)
        tips = (
            (
                rotated((self.y - cy, self.flange / 2 - cz), turn),
                self.y - self.web / 2,
                self.flange,
            ),
            (rotated((self.web / 2 - cy, self.z - cz), turn), self.z - self.flange / 2, self.web),
        )
        A = sum(length * thick for _, length, thick in tips)
        found = []
        for axis in (0, 1):
            middle = sum(0.5 * (tip[axis] + heel[axis]) * b * t for tip, b, t in tips) / A
            bend = energy = 0.0
            for tip, length, thick in tips:
                start, end = tip[axis] - middle, heel[axis] - middle
                bend += thick * length * (start**2 + start * end + end**2) / 3
                Q = thick * length * (start * s + 0.5 * (end - start) * s**2)
                energy += float(GAUSS[1] @ Q**2) * 0.5 * length / thick
            found.append(bend**2 / (A * energy))
        return found[0], found[1]

    def points(self) -> tuple[StressPoint, ...]:
        turn, (cy, cz), J = self.tilt()[0], self._centroid(), self.values()[3]
        places = {
            "heel": (0.0, 0.0),
            "toe y": (self.y, 0.0),
            "toe y inside": (self.y, self.flange),
            "toe z": (0.0, self.z),
            "toe z inside": (self.web, self.z),
        }
        found = [
            StressPoint(name, *rotated((y - cy, z - cz), turn)) for name, (y, z) in places.items()
        ]
        for name, place, along in (
            ("leg y", (self.y / 2, 0.0), (self.flange / J, 0.0)),
            ("leg z", (0.0, self.z / 2), (0.0, -self.web / J)),
        ):
            (y, z), (xy, xz) = rotated((place[0] - cy, place[1] - cz), turn), rotated(along, turn)
            found.append(StressPoint(name, y, z, xy=(xy, 0.0, 0.0), xz=(xz, 0.0, 0.0)))
        return tuple(found)

    def tilt(self) -> tuple[float, Place]:
        turn, (cy, cz) = principal(*self._second())[2], self._centroid()
        return turn, rotated((self.web / 2 - cy, self.flange / 2 - cz), turn)


def angle_section(
    y: float, z: float, web: float, flange: float | None = None, **common: Any
) -> BeamSection:
    """Angle (L) with legs ``y`` and ``z`` outside, thickness ``flange`` along y, ``web`` along z.

    Bending is about its principal axes, twist about its shear centre where the legs' middle lines
    meet; ``offset`` places its centroid.
    """
    return section_of(Angle(y, z, web, web if flange is None else flange), **common)
