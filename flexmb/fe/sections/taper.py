"""Beams whose section changes along their group.

In: the section at the start and at the end of a chain of elements. Out: the section in between, by
arc length: from the interpolated dimensions where both ends have the same shape, else with area,
second moments, torsion constant, shear coefficients and stress points interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError
from flexmb.fe.sections.beam import BeamSection, Vector
from flexmb.fe.sections.beam_shapes import section_of
from flexmb.fe.sections.binding import BoundBeam, Releases, bind, join_releases
from flexmb.fe.sections.stress_points import StressPoint
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import AnyMaterial

__all__ = ["TaperedSection", "tapered"]


@dataclass(frozen=True)
class TaperedSection:
    """Section that goes from one to another along a chain of elements.

    Parameters
    ----------
    start, end : BeamSection
        At the two ends; the chain's start as :mod:`flexmb.fe.sections.binding` defines it.
        Orientation, material and the angle of the principal axes are the same.
    releases : Releases
        Motions that the ends of the chain do not pass on.

    Raises
    ------
    ReductionError
        Ends that do not fit together.
    """

    start: BeamSection
    end: BeamSection
    releases: Releases = field(default_factory=Releases)

    dimension = 1

    def __post_init__(self) -> None:
        problems = []
        for name in ("orientation", "material"):
            if getattr(self.start, name) != getattr(self.end, name):
                problems.append(Problem(f"section.{name}", "must be the same at both ends"))
        if abs(self.start.angle - self.end.angle) > 1e-9:
            angles = f"{self.start.angle:.4g} and {self.end.angle:.4g} rad"
            what = f"the principal axes must not turn along the beam; they are at {angles}"
            problems.append(Problem("section", what))
        if self.start.releases or self.end.releases:
            what = "belong to the tapered section as a whole, not to its start or end"
            problems.append(Problem("section.releases", what))
        if problems:
            raise ReductionError.from_problems(problems)

    @property
    def material(self) -> AnyMaterial | None:
        """The material of both ends."""
        return self.start.material

    @property
    def orientation(self) -> Vector | None:
        """The orientation of both ends."""
        return self.start.orientation

    def with_material(self, default: AnyMaterial | None) -> TaperedSection:
        """The section with its material known."""
        start, end = (part.with_material(default) for part in (self.start, self.end))
        return replace(self, start=start, end=end)

    def bind(self, points: FloatArray, lines: IntArray) -> list[tuple[IntArray, BoundBeam]]:
        """The section of each element with end coordinates (nb, 2, 3) and nodes (nb, 2).

        Raises
        ------
        MeshError
            As :meth:`BeamSection.bind`; also elements that form no chain.
        """
        return bind(self, points, lines)

    def at(self, fraction: float) -> BeamSection:
        """The section at that fraction of the chain's length, 0 at its start."""
        start, end = self.start, self.end
        mixed = {
            name: _mix(getattr(start, name), getattr(end, name), fraction)
            for name in ("offset", "nonstructural")
        }
        if start.shape is not None and type(start.shape) is type(end.shape):
            dimensions = {
                name: _mix(value, vars(end.shape)[name], fraction)
                for name, value in vars(start.shape).items()
            }
            found = section_of(type(start.shape)(**dimensions), shear=start.by_shape, **mixed)
            if start.by_shape and end.by_shape:
                return replace(found.with_material(self.material), orientation=start.orientation)
            ky, kz = (_mix(getattr(start, k), getattr(end, k), fraction) for k in ("ky", "kz"))
            same = {"orientation": start.orientation, "material": self.material}
            return replace(found, ky=ky, kz=kz, by_shape=False, **same)
        mixed |= {
            name: _mix(getattr(start, name), getattr(end, name), fraction)
            for name in ("A", "Iy", "Iz", "J", "ky", "kz", "shear_center")
        }
        points = _mixed_points(start, end, fraction)
        return replace(start, **mixed, points=points, shape=None, by_shape=False)


def tapered(
    start: BeamSection,
    end: BeamSection,
    *,
    orientation: Vector | None = None,
    material: AnyMaterial | None = None,
    releases: Releases | Mapping[str, Any] | None = None,
) -> TaperedSection:
    """Section from ``start`` to ``end`` along a chain of elements.

    Parameters
    ----------
    start, end : BeamSection
        At the ends of the chain.
    orientation, material, releases
        Of the whole, as in :class:`BeamSection`.

    Raises
    ------
    ReductionError
        Ends that do not fit together.
    """
    given: dict[str, Any] = {"orientation": orientation, "material": material}
    common = {name: value for name, value in given.items() if value is not None}
    start, end = (replace(part, **common) for part in (start, end))
    return TaperedSection(start, end, join_releases(releases))


def _mix(start: Any, end: Any, fraction: float) -> Any:
    if isinstance(start, tuple):
        return tuple(_mix(a, b, fraction) for a, b in zip(start, end, strict=True))
    if math.isinf(start) or math.isinf(end):
        return math.inf
    return float((1 - fraction) * start + fraction * end)


def _mixed_points(start: BeamSection, end: BeamSection, fraction: float) -> tuple[StressPoint, ...]:
    """Stress points that both ends name."""
    others = {point.name: point for point in end.points}
    return tuple(
        StressPoint(
            point.name,
            *(
                _mix(getattr(point, name), getattr(others[point.name], name), fraction)
                for name in ("y", "z", "xy", "xz")
            ),
        )
        for point in start.points
        if point.name in others
    )


def spread(section: Any, fractions: FloatArray, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Values of a section by name at fractions of its chain, each in their shape."""
    found = [[getattr(part, name) for name in names] for part in map(section.at, fractions.flat)]
    columns = np.array(found, dtype=float).T
    return {
        name: column.reshape(fractions.shape) for name, column in zip(names, columns, strict=True)
    }
