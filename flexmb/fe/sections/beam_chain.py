"""Sections along a chain of beam elements: taper, and releases at its ends.

The elements of a group with taper or releases form one chain. It starts at that of its two end
nodes from which the element there runs away; if that holds for both or for none, at the one with
the lower node number. Between the two ends a taper interpolates, by arc length, the dimensions if
both ends have the same shape, else area, second moments, torsion constant, shear coefficients and
stress points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem, ReductionError
from flexmb.fe.sections.beam_section import (
    MOTIONS,
    BeamSection,
    Releases,
    StressPoint,
    Vector,
    join_releases,
    section_of,
)
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero
from flexmb.materials import AnyMaterial


def local_axes(
    ends: FloatArray, orientation: tuple[float, float, float] | FloatArray | None
) -> FloatArray:
    """(ne, 3, 3) local axes as columns; y is the part of the orientation normal to x.

    Without one, y is z x x (perpendicular to the body z axis), or the body y axis for a beam along
    z. Elements are not parallel to their orientation: the section has refused them.
    """
    x = ends[:, 1] - ends[:, 0]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    if orientation is None:
        y = np.cross([0.0, 0.0, 1.0], x)
        upright = np.linalg.norm(y, axis=1) < 1e-6
        y[upright] = [0.0, 1.0, 0.0]
    else:
        y = np.broadcast_to(np.asarray(orientation, dtype=float), x.shape)
    y = y - np.sum(x * y, axis=1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=2)


_MAX_BATCH = 100  # most elements that share one bound section; each batch of the assembly is larger
# smallest over largest singular value of the constraints below which a chain is a mechanism
_MECHANISM = 1e-9


@dataclass(frozen=True, eq=False)
class BoundBeam:
    """A section together with the places on its chain and the releases of a set of elements.

    Parameters
    ----------
    section : BeamSection or TaperedSection
        The section.
    span : (ne, 2) float
        Fraction of the chain at the first and the second node of each element.
    released : tuple of int
        Which of the element's 12 end motions in section axes are released.
    """

    section: BeamSection | TaperedSection
    span: FloatArray
    released: tuple[int, ...] = ()

    dimension = 1

    @property
    def material(self) -> AnyMaterial | None:
        """The section's material."""
        return self.section.material

    @property
    def orientation(self) -> tuple[float, float, float] | None:
        """The section's orientation."""
        return self.section.orientation


def bind_section(
    section: BeamSection | TaperedSection, points: FloatArray, lines: IntArray
) -> list[tuple[IntArray, Any]]:
    """Rows of elements and the section they share; see :meth:`BeamSection.bind`."""
    _check_orientation(section, points, lines)
    tapered = section.at(0.0) is not section
    if not tapered and not section.releases:
        return [(np.arange(len(lines)), section)]
    order, forward = _chain(lines)
    if section.releases:
        _check_mechanism(section, points, lines, (order, forward))
    span = _fractions(points, order, forward)
    released: dict[int, list[int]] = {}
    for row, names, ahead in (
        (order[0], section.releases.start, forward[0]),
        (order[-1], section.releases.end, not forward[-1]),
    ):
        first = 0 if ahead else 6
        released.setdefault(int(row), []).extend(first + MOTIONS.index(name) for name in names)
    ends = [row for row, numbers in released.items() if numbers]
    parts: list[tuple[IntArray, Any]] = [
        (np.array([row]), BoundBeam(section, span[[row]], tuple(sorted(released[row]))))
        for row in ends
    ]
    others = np.setdiff1d(np.arange(len(lines)), ends)
    if not tapered:
        return [*parts, (others, section)] if len(others) else parts
    for start in range(0, len(others), _MAX_BATCH):
        rows = others[start : start + _MAX_BATCH]
        parts.append((rows, BoundBeam(section, span[rows])))
    return parts


def _check_orientation(section: Any, points: FloatArray, lines: IntArray) -> None:
    if section.orientation is None:
        return
    along = points[:, 1] - points[:, 0]
    y = np.asarray(section.orientation, dtype=float)
    across = np.linalg.norm(np.cross(along, y), axis=1)
    size = np.linalg.norm(along, axis=1) * np.linalg.norm(y)
    wrong = np.flatnonzero((across <= 1e-6 * size) & (size > 0))
    if len(wrong):
        a, b = lines[wrong[0]]
        what = f"the line element between nodes {a} and {b} is parallel to its "
        raise MeshError(f"{what}section.orientation")


def _chain(lines: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of the elements from start to end, and whether each runs that way."""
    nodes, count = np.unique(lines, return_counts=True)
    ends, branches = nodes[count == 1], nodes[count > 2]
    why = "they form a ring or several" if not len(ends) else ""
    why = f"they have {len(ends)} ends" if len(ends) > 2 else why
    why = f"they branch at node {branches[0]}" if len(branches) else why
    if not why:
        order, forward = _walk(lines, _start(lines, ends))
        if len(order) == len(lines):
            return order, forward
        why = f"only {len(order)} of {len(lines)} are connected to node {_start(lines, ends)}"
    what = "a taper or releases need line elements that form one chain from end to end, but"
    raise MeshError(f"{what} {why}: give each chain a group of its own")


def _start(lines: IntArray, ends: IntArray) -> int:
    away = [int(node) for node in ends if node in lines[:, 0]]
    return away[0] if len(away) == 1 else int(ends.min())


def _walk(lines: IntArray, node: int) -> tuple[IntArray, IntArray]:
    at: dict[int, list[int]] = {}
    for row, pair in enumerate(lines):
        for end in pair:
            at.setdefault(int(end), []).append(row)
    order: list[int] = []
    forward: list[bool] = []
    while True:
        ahead = [row for row in at[node] if not order or row != order[-1]]
        if not ahead:
            return np.array(order), np.array(forward)
        order.append(ahead[0])
        forward.append(bool(lines[ahead[0], 0] == node))
        node = int(lines[ahead[0], 1 if forward[-1] else 0])


def _fractions(points: FloatArray, order: IntArray, forward: IntArray) -> FloatArray:
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)[order]
    along = np.concatenate([[0.0], np.cumsum(length)])
    along = along / along[-1] if along[-1] > 0 else along
    span = np.zeros((len(order), 2))
    ahead = np.stack([along[:-1], along[1:]], axis=1)
    span[order] = np.where(forward[:, None], ahead, ahead[:, ::-1])
    return span


def _check_mechanism(
    section: Any, points: FloatArray, lines: IntArray, chain: tuple[IntArray, IntArray]
) -> None:
    """Refuse releases with which the chain, taken as rigid, could move while its end nodes are
    fixed."""
    order, forward = chain
    axes = local_axes(points, section.orientation)
    ends = ((order[0], 0 if forward[0] else 1), (order[-1], 1 if forward[-1] else 0))
    places = [points[row, side] for row, side in ends]
    size = np.linalg.norm(places[1] - places[0]) or 1.0
    middle = 0.5 * (places[0] + places[1])
    rows = []
    for (row, _), place, names in zip(
        ends, places, (section.releases.start, section.releases.end), strict=True
    ):
        arm = (place - middle) / size
        for number, name in enumerate(MOTIONS):
            if name in names:
                continue
            direction = axes[row][:, number % 3]
            turn = np.cross(arm, direction) if number < 3 else direction
            rows.append(np.concatenate([direction if number < 3 else np.zeros(3), turn]))
    hold = np.linalg.svd(np.array(rows).reshape(-1, 6), compute_uv=False)
    if len(hold) < 6 or not is_nonzero(hold, _MECHANISM)[-1]:
        ends_text = [
            f"{', '.join(names)} at node {lines[row, side]}"
            for (row, side), names in zip(
                ends, (section.releases.start, section.releases.end), strict=True
            )
            if names
        ]
        what = f"section.releases: {' and '.join(ends_text)} let the elements between move "
        raise MeshError(f"{what}on their own, a mechanism: release less")


@dataclass(frozen=True)
class TaperedSection:
    """Section that goes from one to another along a chain of elements.

    Parameters
    ----------
    start, end : BeamSection
        At the two ends; the chain's start as :mod:`flexmb.fe.sections.beam_chain` defines it.
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

    def at(self, fraction: float) -> BeamSection:
        """The section at that fraction of the chain's length, 0 at its start."""
        start, end = self.start, self.end
        mixed = {
            name: _interpolate(getattr(start, name), getattr(end, name), fraction)
            for name in ("offset", "nonstructural")
        }
        if start.shape is not None and type(start.shape) is type(end.shape):
            dimensions = {
                name: _interpolate(value, vars(end.shape)[name], fraction)
                for name, value in vars(start.shape).items()
            }
            section = section_of(type(start.shape)(**dimensions), shear=start.by_shape, **mixed)
            if start.by_shape and end.by_shape:
                return replace(section.with_material(self.material), orientation=start.orientation)
            ky, kz = (
                _interpolate(getattr(start, k), getattr(end, k), fraction) for k in ("ky", "kz")
            )
            same = {"orientation": start.orientation, "material": self.material}
            return replace(section, ky=ky, kz=kz, by_shape=False, **same)
        mixed |= {
            name: _interpolate(getattr(start, name), getattr(end, name), fraction)
            for name in ("A", "Iy", "Iz", "J", "ky", "kz", "shear_center")
        }
        points = _interpolated_points(start, end, fraction)
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
    values: dict[str, Any] = {"orientation": orientation, "material": material}
    common = {name: value for name, value in values.items() if value is not None}
    start, end = (replace(part, **common) for part in (start, end))
    return TaperedSection(start, end, join_releases(releases))


def _interpolate(start: Any, end: Any, fraction: float) -> Any:
    if isinstance(start, tuple):
        return tuple(_interpolate(a, b, fraction) for a, b in zip(start, end, strict=True))
    if math.isinf(start) or math.isinf(end):
        return math.inf
    return float((1 - fraction) * start + fraction * end)


def _interpolated_points(
    start: BeamSection, end: BeamSection, fraction: float
) -> tuple[StressPoint, ...]:
    """Stress points that both ends name."""
    others = {point.name: point for point in end.points}
    return tuple(
        StressPoint(
            point.name,
            *(
                _interpolate(getattr(point, name), getattr(others[point.name], name), fraction)
                for name in ("y", "z", "xy", "xz")
            ),
        )
        for point in start.points
        if point.name in others
    )


def section_values(
    section: Any, fractions: FloatArray, names: tuple[str, ...]
) -> dict[str, FloatArray]:
    """Values of a section by name at fractions of its chain, each in their shape."""
    rows = [[getattr(part, name) for name in names] for part in map(section.at, fractions.flat)]
    columns = np.array(rows, dtype=float).T
    return {
        name: column.reshape(fractions.shape) for name, column in zip(names, columns, strict=True)
    }
