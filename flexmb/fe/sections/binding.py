"""Which values each element of a group has: taper along the chain, releases at its ends.

In: a section, the ends of the group's line elements. Out: rows of elements with what they share.
The elements of a group with taper or releases form one chain. It starts at the end node that its
element runs away from; where that holds for both ends or for none, at the one with the lower node
number. Taper goes by arc length from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import MeshError, Problem, ReductionError, nearest
from flexmb.fe.sections.axes import local_axes
from flexmb.flexbody.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from flexmb.fe.sections.beam import BeamSection
    from flexmb.fe.sections.taper import TaperedSection
    from flexmb.materials import AnyMaterial

__all__ = ["MOTIONS", "BoundBeam", "Releases", "bind", "join_releases"]

MOTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
"""Motions of a node in the section's axes, x along the beam."""

_MOST = 100  # elements that share one bound section: no batch of the assembly is smaller
_LOOSE = 1e-9  # smallest over largest hold of a chain that cannot move


@dataclass(frozen=True)
class Releases:
    """Motions that the ends of a chain do not pass on, by their names in ``MOTIONS``.

    Raises
    ------
    ReductionError
        Unknown names.
    """

    start: tuple[str, ...] = ()
    end: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        problems = [
            Problem(f"section.releases.{end}", f'unknown "{name}"', MOTIONS, nearest(name, MOTIONS))
            for end in ("start", "end")
            for name in getattr(self, end)
            if name not in MOTIONS
        ]
        if problems:
            raise ReductionError.from_problems(problems)

    def __bool__(self) -> bool:
        return bool(self.start or self.end)


def join_releases(given: Releases | Mapping[str, Any] | None) -> Releases:
    """Releases from ``{start = ["ry", "rz"], end = ["rx"]}``.

    Raises
    ------
    ReductionError
        Unknown words.
    """
    if given is None:
        return Releases()
    if isinstance(given, Releases):
        return given
    words, names = dict(given), ("start", "end")
    problems = [
        Problem(f"section.releases.{key}", "unknown key", names, nearest(key, names))
        for key in words
        if key not in names
    ]
    if problems:
        raise ReductionError.from_problems(problems)
    return Releases(**{key: tuple(str(name) for name in value) for key, value in words.items()})


@dataclass(frozen=True, eq=False)
class BoundBeam:
    """A section as elements of its group have it.

    Parameters
    ----------
    section : BeamSection or TaperedSection
        The section.
    span : (ne, 2) float
        Fraction of the chain at the first and the second node of each element.
    released : tuple of int
        Numbers, of 12, of the element's motions in section axes that its nodes do not pass on.
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


def bind(
    section: BeamSection | TaperedSection, points: FloatArray, lines: IntArray
) -> list[tuple[IntArray, Any]]:
    """Rows of elements and the section they share; see :meth:`BeamSection.bind`."""
    _require_axes(section, points, lines)
    tapered = section.at(0.0) is not section
    if not tapered and not section.releases:
        return [(np.arange(len(lines)), section)]
    order, forward = _chain(lines)
    if section.releases:
        _require_held(section, points, lines, (order, forward))
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
    for start in range(0, len(others), _MOST):
        rows = others[start : start + _MOST]
        parts.append((rows, BoundBeam(section, span[rows])))
    return parts


def _require_axes(section: Any, points: FloatArray, lines: IntArray) -> None:
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


def _require_held(
    section: Any, points: FloatArray, lines: IntArray, chain: tuple[IntArray, IntArray]
) -> None:
    """Refuse releases that let the chain, taken as rigid, move without its two end nodes."""
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
    if len(hold) < 6 or hold[-1] < _LOOSE * hold[0]:
        told = [
            f"{', '.join(names)} at node {lines[row, side]}"
            for (row, side), names in zip(
                ends, (section.releases.start, section.releases.end), strict=True
            )
            if names
        ]
        what = f"section.releases: {' and '.join(told)} let the elements between move on their own"
        raise MeshError(f"{what}, a mechanism: release less")
