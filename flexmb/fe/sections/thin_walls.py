"""Cross-sections of thin walls: I, box and angle.

Area and second moments are those of the rectangles the section is made of. Shear coefficients:
Cowper (1966), J. Appl. Mech. 33, with Poisson's ratio, for forces along the web of an I with equal
flanges and for a box; else the energy of the shear flow along the middle lines, V^2/(k G A) = int
q^2/(G t) ds, which is Cowper's at Poisson's ratio 0 (of an angle along the principal axes, their
small coupling left out). Torsion constants: Roark's Formulas for Stress and Strain, 7th ed., table
10.1, without fillets. Torque stress is T t/J on the face of an open wall and T/(2 A_m t) in a box.
Stress points of an angle have the shear stress of the torque, but not that of shear forces.
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
    principal,
    rotated,
    section_of,
)
from flexmb.flexbody.arrays import FloatArray
from flexmb.units import say_length

GAUSS = np.polynomial.legendre.leggauss(3)
"""Points and weights, exact for the square of a parabola."""
Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class ISection:
    """Web along z of thickness ``web``; a flange on top (+z) and one at the bottom, along y."""

    height: float
    width: float
    web: float
    flange: float
    bottom_width: float
    bottom_flange: float

    def __post_init__(self) -> None:
        positive(**vars(self))
        problems = []
        if self.flange + self.bottom_flange >= self.height:
            what = f"the flanges must leave room for the web within {say_length(self.height)}"
            problems.append(Problem("section.flange", what))
        if self.web > min(self.width, self.bottom_width):
            what = f"must not exceed the width of a flange, given {say_length(self.web)}"
            problems.append(Problem("section.web", what))
        if problems:
            raise ReductionError.from_problems(problems)

    def _parts(self) -> list[tuple[float, float, float]]:
        """Size along y, size along z and height of the centre of the top flange, the web, the
        bottom flange."""
        clear = self.height - self.flange - self.bottom_flange
        return [
            (self.width, self.flange, self.height - self.flange / 2),
            (self.web, clear, self.bottom_flange + clear / 2),
            (self.bottom_width, self.bottom_flange, self.bottom_flange / 2),
        ]

    def _centroid(self) -> float:
        parts = self._parts()
        return sum(b * h * z for b, h, z in parts) / sum(b * h for b, h, _ in parts)

    def values(self) -> Four:
        parts, middle = self._parts(), self._centroid()
        A = sum(b * h for b, h, _ in parts)
        Iy = sum(b * h**3 / 12 + b * h * (z - middle) ** 2 for b, h, z in parts)
        Iz = sum(h * b**3 / 12 for b, h, _ in parts)
        return A, Iy, Iz, self._torsion()

    def _torsion(self) -> float:
        clear = self._parts()[1][1]
        J = clear * self.web**3 / 3
        flanges = ((self.width, self.flange), (self.bottom_width, self.bottom_flange))
        for width, thick in flanges:
            J += end_wall(width, thick)
            thin, other = min(thick, self.web), max(thick, self.web)
            circle = (thick**2 + self.web**2 / 4) / thick
            J += 0.15 * thin / other * circle**4
        return J

    def shear(self, nu: float) -> tuple[float, float]:
        top, web, bottom = self._parts()
        upper, lower = top[2] - self._centroid(), bottom[2] - self._centroid()
        widths = [(b, h) for b, h, _ in (top, bottom)]
        sides = sum(h * b**3 / 12 for b, h in widths)
        A = top[0] * top[1] + bottom[0] * bottom[1] + self.web * (upper - lower)
        ky = sides**2 / (A * sum(h * b**5 / 120 for b, h in widths))
        ky *= 1.2 * 10 * (1 + nu) / (12 + 11 * nu)  # each flange is a rectangle
        if self.width == self.bottom_width and self.flange == self.bottom_flange:
            m = 2 * self.width * self.flange / ((upper - lower) * self.web)
            n = self.width / (upper - lower)
            return ky, _cowper(nu, m, 30 * (m + m**2) * n**2 + 5 * nu * n**2 * (8 * m + 9 * m**2))
        energy, first, bend = 0.0, 0.0, 0.0
        for (b, h), z in zip(widths, (upper, lower), strict=True):
            energy += h * z**2 * b**3 / 12
            bend += b * h * z**2
        first = top[0] * top[1] * upper
        bend += self.web * (upper**3 - lower**3) / 3
        s, weights = GAUSS
        z = 0.5 * (upper + lower) + 0.5 * (upper - lower) * s
        Q = first + self.web * (upper**2 - z**2) / 2
        energy += float(weights @ Q**2) * 0.5 * (upper - lower) / self.web
        return ky, bend**2 / (A * energy)

    def points(self) -> tuple[StressPoint, ...]:
        _, Iy, Iz, J = self.values()
        middle = self._centroid()
        top, bottom = self.height - middle, -middle
        points = []
        for end, z, width, thick in (
            ("top", top, self.width, self.flange),
            ("bottom", bottom, self.bottom_width, self.bottom_flange),
        ):
            points += [
                StressPoint(f"{end} +y", width / 2, z),
                StressPoint(f"{end} -y", -width / 2, z),
                StressPoint(
                    end, 0.0, z, xy=(-math.copysign(thick / J, z), width**2 / (8 * Iz), 0.0)
                ),
            ]
        clear = top - self.flange
        Q = self.width * self.flange * (top - self.flange / 2) + self.web * clear**2 / 2
        by_force = Q / (Iy * self.web)
        points += [
            StressPoint(f"web {a}y", i * self.web / 2, 0.0, xz=(i * self.web / J, 0.0, by_force))
            for a, i in (("+", 1), ("-", -1))
        ]
        return tuple(points)

    def outline(self) -> list[FloatArray]:
        clear = self.height - self.flange - self.bottom_flange
        lower, top = self.bottom_flange, self.height - self.flange
        return [
            polygon(-self.bottom_width / 2, 0.0, self.bottom_width, lower),
            polygon(-self.web / 2, lower, self.web, clear),
            polygon(-self.width / 2, top, self.width, self.flange),
        ]

    def tilt(self) -> tuple[float, Place]:
        top, _, bottom = self._parts()
        middle = self._centroid()
        sides = [(h * b**3, z - middle) for b, h, z in (top, bottom)]
        center = sum(stiff * z for stiff, z in sides) / sum(stiff for stiff, _ in sides)
        return 0.0, (0.0, center)


@dataclass(frozen=True)
class Box:
    """Closed box ``y`` by ``z``; ``web`` is the wall along z, ``flange`` the wall along y."""

    y: float
    z: float
    web: float
    flange: float

    def __post_init__(self) -> None:
        positive(**vars(self))
        problems = [
            Problem(
                f"section.{name}",
                f"must be less than half of {say_length(size)}, given {say_length(thick)}",
            )
            for name, thick, size in (("web", self.web, self.y), ("flange", self.flange, self.z))
            if 2 * thick >= size
        ]
        if problems:
            raise ReductionError.from_problems(problems)

    def values(self) -> Four:
        y, z, inner_y, inner_z = self.y, self.z, self.y - 2 * self.web, self.z - 2 * self.flange
        A = y * z - inner_y * inner_z
        Iy, Iz = (y * z**3 - inner_y * inner_z**3) / 12, (z * y**3 - inner_z * inner_y**3) / 12
        b, h = y - self.web, z - self.flange
        return A, Iy, Iz, 2 * (b * h) ** 2 / (b / self.flange + h / self.web)

    def shear(self, nu: float) -> tuple[float, float]:
        b, h = self.y - self.web, self.z - self.flange
        coefficients = []
        for along, across, wall, cap in (
            (b, h, self.flange, self.web),
            (h, b, self.web, self.flange),
        ):
            m, n = across * cap / (along * wall), across / along
            coefficients.append(_cowper(nu, m, 10 * n**2 * ((3 + nu) * m + 3 * m**2)))
        return coefficients[0], coefficients[1]

    def points(self) -> tuple[StressPoint, ...]:
        y, z, (_, Iy, Iz, _) = self.y / 2, self.z / 2, self.values()
        cell = 2 * (self.y - self.web) * (self.z - self.flange)
        inner_y, inner_z = y - self.web, z - self.flange
        by_z = (y * z**2 - inner_y * inner_z**2) / (Iy * 2 * self.web)
        by_y = (z * y**2 - inner_z * inner_y**2) / (Iz * 2 * self.flange)
        points = [
            StressPoint(f"{a}y{b}z", i * y, j * z)
            for a, i in (("+", 1), ("-", -1))
            for b, j in (("+", 1), ("-", -1))
        ]
        for a, i in (("+", 1), ("-", -1)):
            torque = (i / (cell * self.web), -i / (cell * self.flange))
            points.append(StressPoint(f"{a}y", i * y, 0.0, xz=(torque[0], 0.0, by_z)))
            points.append(StressPoint(f"{a}z", 0.0, i * z, xy=(torque[1], by_y, 0.0)))
        return tuple(points)

    def outline(self) -> list[FloatArray]:
        inner = self.z - 2 * self.flange
        return [
            polygon(0.0, 0.0, self.y, self.flange),
            polygon(0.0, self.z - self.flange, self.y, self.flange),
            polygon(0.0, self.flange, self.web, inner),
            polygon(self.y - self.web, self.flange, self.web, inner),
        ]

    def tilt(self) -> tuple[float, Place]:
        return 0.0, (0.0, 0.0)


def end_wall(length: float, thick: float) -> float:
    """Roark's K1: torsion constant of a flange."""
    return length * thick**3 * (1 / 3 - 0.21 * thick / length * (1 - thick**4 / (12 * length**4)))


def _cowper(nu: float, m: float, wide: float) -> float:
    """Cowper's shear coefficient of I and box; ``wide`` is the contribution of the flange width."""
    return (
        10 * (1 + nu) * (1 + 3 * m) ** 2
        / (
            12 + 72 * m + 150 * m**2 + 90 * m**3
            + nu * (11 + 66 * m + 135 * m**2 + 90 * m**3)
            + wide
        )
    )  # fmt: skip


def i_section(
    height: float,
    width: float,
    web: float,
    flange: float,
    bottom_width: float | None = None,
    bottom_flange: float | None = None,
    **common: Any,
) -> BeamSection:
    """I-section ``height`` along z, flanges ``width`` along y; thicknesses ``web``, ``flange`` [m].

    The flange at the bottom (-z) is as the one on top unless given. ``common`` words as in
    :mod:`flexmb.fe.sections.section_tables`.
    """
    lower = width if bottom_width is None else bottom_width
    thick = flange if bottom_flange is None else bottom_flange
    return section_of(ISection(height, width, web, flange, lower, thick), **common)


def box_section(
    y: float, z: float, web: float, flange: float | None = None, **common: Any
) -> BeamSection:
    """Closed box ``y`` by ``z`` outside, walls ``web`` along z and ``flange`` along y [m]."""
    return section_of(Box(y, z, web, web if flange is None else flange), **common)


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
            Problem(
                f"section.{name}",
                f"must be less than {say_length(size)}, given {say_length(thick)}",
            )
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
        coefficients = []
        for axis in (0, 1):
            middle = sum(0.5 * (tip[axis] + heel[axis]) * b * t for tip, b, t in tips) / A
            bend = energy = 0.0
            for tip, length, thick in tips:
                start, end = tip[axis] - middle, heel[axis] - middle
                bend += thick * length * (start**2 + start * end + end**2) / 3
                Q = thick * length * (start * s + 0.5 * (end - start) * s**2)
                energy += float(GAUSS[1] @ Q**2) * 0.5 * length / thick
            coefficients.append(bend**2 / (A * energy))
        return coefficients[0], coefficients[1]

    def points(self) -> tuple[StressPoint, ...]:
        turn, (cy, cz), J = self.tilt()[0], self._centroid(), self.values()[3]
        places = {
            "heel": (0.0, 0.0),
            "toe y": (self.y, 0.0),
            "toe y inside": (self.y, self.flange),
            "toe z": (0.0, self.z),
            "toe z inside": (self.web, self.z),
        }
        points = [
            StressPoint(name, *rotated((y - cy, z - cz), turn)) for name, (y, z) in places.items()
        ]
        for name, place, along in (
            ("leg y", (self.y / 2, 0.0), (self.flange / J, 0.0)),
            ("leg z", (0.0, self.z / 2), (0.0, -self.web / J)),
        ):
            (y, z), (xy, xz) = rotated((place[0] - cy, place[1] - cz), turn), rotated(along, turn)
            points.append(StressPoint(name, y, z, xy=(xy, 0.0, 0.0), xz=(xz, 0.0, 0.0)))
        return tuple(points)

    def outline(self) -> list[FloatArray]:
        upright = polygon(0.0, self.flange, self.web, self.z - self.flange)
        return [polygon(0.0, 0.0, self.y, self.flange), upright]

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


SECTIONS = {"I": i_section, "box": box_section, "L": angle_section}
"""Thin-walled sections by type."""
