"""Triangles of simple shapes, for both ways of drawing.

In: sizes [m] and positions. Out: :class:`Triangles`, outward oriented, in the frame of the input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Triangles", "box", "cylinder", "joined", "plate", "sphere", "tube"]

Array = NDArray[np.float64]

_AROUND = 48  # corners of a drawn circle


@dataclass(frozen=True, eq=False)
class Triangles:
    """Points (n, 3) [m] and triangles (t, 3) as rows of indices into them."""

    points: Array
    faces: NDArray[np.int64]

    def moved(self, r: ArrayLike, A: ArrayLike) -> Triangles:
        """Turned by A (3, 3), then shifted by r (3,)."""
        return Triangles(self.points @ np.asarray(A).T + np.asarray(r), self.faces)


def joined(parts: list[Triangles]) -> Triangles:
    """Several shapes as one."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=False)]
    return Triangles(np.vstack([part.points for part in parts]), np.vstack(faces))


def box(size: ArrayLike) -> Triangles:
    """A box of edge lengths `size` (3,) about the origin, edges along the axes."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    points = 0.5 * corners * np.asarray(size, dtype=float)
    return Triangles(points, np.array(faces, dtype=np.int64))


def cylinder(radius: float, length: float, axis: ArrayLike = (0, 0, 1)) -> Triangles:
    """A closed cylinder about the origin along `axis` (3,)."""
    half = 0.5 * length * _unit(axis)
    return tube(-half, half, radius)


def plate(ring: ArrayLike, thickness: float) -> Triangles:
    """A plate across z with a closed contour `ring` (n, 3), seen whole from its middle."""
    points = np.asarray(ring, dtype=float)
    n, middle = len(points), points.mean(axis=0)
    after = np.roll(points, -1, axis=0)
    if np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]) < 0:
        points = points[::-1]
    up = np.array([0.0, 0.0, 0.5 * thickness])
    first, second = np.arange(n), np.roll(np.arange(n), -1)
    faces = [
        np.stack([np.full(n, 2 * n), second, first], axis=1),
        np.stack([np.full(n, 2 * n + 1), n + first, n + second], axis=1),
        np.stack([first, second, n + second], axis=1),
        np.stack([first, n + second, n + first], axis=1),
    ]
    return Triangles(np.vstack([points - up, points + up, middle - up, middle + up]),
                     np.vstack(faces))  # fmt: skip


def sphere(radius: float, center: ArrayLike = (0, 0, 0)) -> Triangles:
    """A ball of `radius` at `center` (3,)."""
    rings = _AROUND // 2
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    around = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(around), np.sin(around), np.zeros(_AROUND)], axis=1)
    layers = [np.sin(a) * ring + [0, 0, np.cos(a)] for a in polar]
    points = radius * np.vstack([*layers, [[0, 0, 1]], [[0, 0, -1]]])
    top, bottom = len(points) - 2, len(points) - 1
    first = np.arange(_AROUND)
    second = np.roll(first, -1)
    faces = [np.stack([np.full(_AROUND, top), first, second], axis=1)]
    for layer in range(len(layers) - 1):
        faces.append(_band(layer * _AROUND, (layer + 1) * _AROUND))
    last = (len(layers) - 1) * _AROUND
    faces.append(np.stack([np.full(_AROUND, bottom), last + second, last + first], axis=1))
    return Triangles(points + np.asarray(center, dtype=float), np.vstack(faces))


def tube(start: ArrayLike, stop: ArrayLike, radius: float) -> Triangles:
    """A closed cylinder from `start` (3,) to `stop` (3,)."""
    a, b = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    e1, e2 = _across(_unit(b - a))
    around = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = radius * (np.outer(np.cos(around), e1) + np.outer(np.sin(around), e2))
    points = np.vstack([a + ring, b + ring, [a], [b]])
    first = np.arange(_AROUND)
    second = np.roll(first, -1)
    low = np.stack([np.full(_AROUND, 2 * _AROUND), second, first], axis=1)
    high = np.stack([np.full(_AROUND, 2 * _AROUND + 1), _AROUND + first, _AROUND + second], axis=1)
    side = _band(_AROUND, 0)
    return Triangles(points, np.vstack([low, high, side]))


def _band(upper: int, lower: int) -> NDArray[np.int64]:
    """Triangles between two rings of points that start at these indices."""
    first = np.arange(_AROUND)
    second = np.roll(first, -1)
    one = np.stack([upper + first, lower + first, lower + second], axis=1)
    two = np.stack([upper + first, lower + second, upper + second], axis=1)
    return np.vstack([one, two])


def _unit(vector: ArrayLike) -> Array:
    values = np.asarray(vector, dtype=float)
    length = float(np.linalg.norm(values))
    return values / length if length > 0 else np.array([0.0, 0.0, 1.0])


def _across(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that form a right-handed frame with `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    e1 = _unit(np.cross(helper, axis))
    return e1, np.cross(axis, e1)
