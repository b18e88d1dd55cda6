"""Sections from tables, ``{type = "rectangle", y = 0.02}``; solid and round sections of beams.

The words of a table are the parameters of the functions in ``SECTIONS``; ``material`` is a name, a
table or a material. Dimensions of beams are in metres, along the section's axes y and z; with the
default orientation z is up for a level beam. Words for all beams: ``shear`` (False: no shear
deformation), ``ky`` and ``kz`` (instead of the shape's own), ``orientation``, ``offset``,
``nonstructural``, ``material``, ``releases``, as in :class:`BeamSection`.
Sources: torsion of a rectangle, Timoshenko and Goodier, Theory of Elasticity, 3rd ed., section
109; shear coefficients of rectangle, circle and tube, Cowper (1966), J. Appl. Mech. 33, with
Poisson's ratio; thin walls in :mod:`flexmb.fe.sections.thin_walls`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError, MaterialError, Problem, ReductionError
from flexmb.fe.sections import thin_walls
from flexmb.fe.sections.beam_chain import TaperedSection, tapered
from flexmb.fe.sections.beam_section import (
    BeamSection,
    Place,
    Releases,
    StressPoint,
    general,
    polygon,
    positive,
    section_of,
)
from flexmb.fe.sections.material import SolidSection, resolve
from flexmb.fe.sections.shell_section import (
    Layer,
    ShellSection,
    layered,
    shell,
)
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.options import kind_of, option_values, read_options, rooted
from flexmb.flexbody.section_options import SECTIONS as OPTIONS
from flexmb.materials import AnyMaterial

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


Section = BeamSection | TaperedSection | ShellSection | SolidSection


SECTIONS: dict[str, Callable[..., Section]] = {
    "rectangle": rectangle,
    "tube": tube,
    "circle": circle,
    **thin_walls.SECTIONS,
    "general": general,
    "tapered": tapered,
    "shell": shell,
    "layered": layered,
    "solid": SolidSection,
}
"""What makes a section of each type."""

_VECTORS = ("orientation", "axis1", "axis2")


def sections_from(sections: Mapping[str, Any] | None) -> dict[str, Section]:
    """Sections by mesh group.

    Raises
    ------
    ReductionError, MaterialError
        What is wrong with all of them.
    """
    made: dict[str, Section] = {}
    errors: list[FlexmbError] = []
    for group, words in (sections or {}).items():
        try:
            made[group] = section_from(words, f"sections.{group}")
        except (ReductionError, MaterialError) as error:
            errors.append(error)
    if errors:
        problems = [problem for error in errors for problem in error.problems]
        raise type(errors[0]).from_problems(problems)
    return made


def section_from(words: Any, where: str = "section") -> Section:
    """The section itself, or that of ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError, MaterialError
        Unknown type, missing or unknown key, or impossible values; all at once.
    """
    if isinstance(words, Section):
        return words
    kind = kind_of("section", tuple(SECTIONS), words, where, ReductionError)
    values = option_values(read_options(OPTIONS[kind], words, where, ReductionError))
    problems: list[Problem] = []
    for name, value in values.items():
        place = f"{where}.{name}"
        try:
            values[name] = _value(name, value, place)
        except FlexmbError as error:
            problems += error.problems
    if problems:
        raise ReductionError.from_problems(problems)
    try:
        return SECTIONS[kind](**values)
    except FlexmbError as error:
        raise type(error).from_problems(rooted(where, error.problems)) from None
    except (TypeError, ValueError) as error:
        problem = Problem(where, f"cannot be understood: {error}")
        raise ReductionError.from_problems([problem]) from None


def _value(name: str, value: Any, where: str) -> Any:
    """An option as the function of a section takes it."""
    if name == "material":
        return _material(value, where)
    if name == "releases":
        return value if isinstance(value, Releases) else Releases(value.start, value.end)
    if name in ("start", "end"):
        return section_from(value if isinstance(value, Section) else _as_words(value), where)
    if name == "layers":
        return [_layer(layer, f"{where}[{k}]") for k, layer in enumerate(value)]
    return tuple(value) if name in _VECTORS and isinstance(value, list) else value


def _as_words(options: Any) -> dict[str, Any]:
    return {"type": options.type, **option_values(options)}


def _layer(options: Any, where: str) -> Layer:
    if isinstance(options, Layer):
        return options
    values = option_values(options)
    if "material" in values:
        values["material"] = _material(values["material"], f"{where}.material")
    return Layer(**values)


def _material(value: Any, where: str) -> AnyMaterial:
    try:
        return resolve(value)
    except MaterialError as error:
        raise MaterialError.from_problems(rooted(where, error.problems)) from None
