"""Cross-sections of beams.

In: dimensions in metres. Out: a :class:`Section` with area, second moments, torsion constant and
shear coefficients, in its principal centroidal axes y and z (x runs along the beam from its first
to its second node). Iy = int z^2 dA bends in the xz plane, Iz = int y^2 dA in the xy plane.
Sources: torsion of a rectangle, Timoshenko and Goodier, Theory of Elasticity, 3rd ed., section
109; shear coefficients, Cowper (1966), J. Appl. Mech. 33, at nu = 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem, ReductionError, nearest
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import AnyMaterial

__all__ = ["Section", "circle", "rectangle", "section_from", "tube"]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Section:
    """A beam's cross-section in its principal axes.

    Parameters
    ----------
    A : float
        Area [m^2].
    Iy, Iz : float
        int z^2 dA and int y^2 dA [m^4].
    J : float
        Torsion constant [m^4].
    ky, kz : float
        Shear coefficients for forces along y and z; infinity means no shear deformation.
    orientation : (3,) float, optional
        Direction, body frame, whose part perpendicular to the beam is the section's y. By default
        y is perpendicular to the z axis of the body frame (and is its y axis for a beam along z).
    """

    A: float
    Iy: float
    Iz: float
    J: float
    ky: float = math.inf
    kz: float = math.inf
    orientation: Vector | None = None
    material: AnyMaterial | None = None

    dimension = 1

    def with_material(self, default: AnyMaterial | None) -> Section:
        """The section with its material known."""
        return self if self.material is not None else replace(self, material=default)

    def bind(self, points: FloatArray, lines: IntArray) -> list[tuple[IntArray, Section]]:
        """The section of each element with end coordinates (nb, 2, 3): the same for all.

        Raises
        ------
        MeshError
            An element is parallel to the orientation.
        """
        if self.orientation is not None:
            along = points[:, 1] - points[:, 0]
            y = np.asarray(self.orientation, dtype=float)
            across = np.linalg.norm(np.cross(along, y), axis=1)
            size = np.linalg.norm(along, axis=1) * np.linalg.norm(y)
            wrong = np.flatnonzero((across <= 1e-6 * size) & (size > 0))
            if len(wrong):
                a, b = lines[wrong[0]]
                what = f"the line element between nodes {a} and {b} is parallel to its "
                raise MeshError(f"{what}section.orientation")
        return [(np.arange(len(points)), self)]

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.{name}", f"must be positive, given {getattr(self, name)}")
            for name in ("A", "Iy", "Iz", "J", "ky", "kz")
            if not getattr(self, name) > 0
        ]
        if self.orientation is not None:
            direction = np.asarray(self.orientation, dtype=float)
            if direction.shape != (3,) or not np.linalg.norm(direction) > 0:
                what = f"must be three numbers, not all zero, given {self.orientation}"
                problems.append(Problem("section.orientation", what))
        if problems:
            raise ReductionError.from_problems(problems)


def rectangle(y: float, z: float, shear: bool = True, orientation: Vector | None = None) -> Section:
    """Solid rectangle, ``y`` by ``z`` [m]; ``shear=False`` gives an Euler-Bernoulli beam."""
    _positive(y=y, z=z)
    long, short = max(y, z), min(y, z)
    odd = np.arange(1, 40, 2)
    series = np.sum(np.tanh(odd * np.pi * long / (2 * short)) / odd**5.0)
    J = long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * series)
    k = 5 / 6 if shear else math.inf
    return Section(y * z, y * z**3 / 12, z * y**3 / 12, float(J), k, k, orientation)


def tube(radius: float, inner: float, shear: bool = True) -> Section:
    """Round tube with outer ``radius`` and ``inner`` radius [m]."""
    _positive(radius=radius)
    if not 0 <= inner < radius:
        what = f"must lie between 0 and the outer radius {radius:g} m, given {inner:g}"
        raise ReductionError.from_problems([Problem("section.inner", what)])
    I = math.pi / 4 * (radius**4 - inner**4)  # noqa: E741
    q = 1 + (inner / radius) ** 2
    k = 6 * q**2 / (7 * q**2 + 20 * (inner / radius) ** 2) if shear else math.inf
    return Section(math.pi * (radius**2 - inner**2), I, I, 2 * I, k, k)


def circle(radius: float, shear: bool = True) -> Section:
    """Solid round bar of that ``radius`` [m]."""
    return tube(radius, 0.0, shear)


_SHAPES = {"rectangle": rectangle, "circle": circle, "tube": tube, "general": Section}
_WORDS = {
    "rectangle": ("y", "z", "shear", "orientation"),
    "circle": ("radius", "shear"),
    "tube": ("radius", "inner", "shear"),
    "general": ("A", "Iy", "Iz", "J", "ky", "kz", "orientation"),
}


def section_from(given: Section | Mapping[str, Any], where: str = "section") -> Section:
    """The section that was meant: itself, or ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError
        Unknown type, missing or unknown key, or impossible values.
    """
    if isinstance(given, Section):
        return given
    words = dict(given)
    shape = words.pop("type", None)
    if shape not in _SHAPES:
        names = tuple(_SHAPES)
        problem = Problem(f"{where}.type", f'unknown "{shape}"', names, nearest(str(shape), names))
        raise ReductionError.from_problems([problem])
    unknown = [
        Problem(f"{where}.{key}", "unknown key", _WORDS[shape], nearest(key, _WORDS[shape]))
        for key in words
        if key not in _WORDS[shape]
    ]
    if unknown:
        raise ReductionError.from_problems(unknown)
    if words.get("orientation") is not None:
        words["orientation"] = tuple(words["orientation"])
    try:
        return _SHAPES[shape](**words)
    except TypeError as error:
        what = f"a {shape} needs numbers for {', '.join(_WORDS[shape])}: {error}"
        raise ReductionError.from_problems([Problem(where, what)]) from error


def _positive(**values: float) -> None:
    problems = [
        Problem(f"section.{name}", f"must be positive, given {value:g} m")
        for name, value in values.items()
        if not value > 0
    ]
    if problems:
        raise ReductionError.from_problems(problems)
