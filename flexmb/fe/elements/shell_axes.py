"""Local axes of flat shells, and how far from flat their elements are.

In: corners (ne, k, 3) [m], body frame. Out: :class:`Flat`: a mean plane with axes 1, 2 and the
normal 3, the corners projected on it and their heights above it. The normal is that of the
triangle, or of the two diagonals of the quadrilateral, on the side from which the nodes run
counter-clockwise; the four heights of a quadrilateral are then equal and alternate in sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.errors import MeshError
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["WARP_LIMIT", "WARP_WARNING", "Flat", "crooked", "flatten", "warp"]

WARP_WARNING = 0.05
"""Warp from which a mesh is too coarse for its twist: the error is 2 % there (a twisted strip,
thick or thin), grows to 5 % at 0.1 and 20 % at 0.14, and falls with the size of the elements.
Splitting the quadrilaterals into triangles is no remedy: thin and twisted, those are too stiff."""
WARP_LIMIT = 0.15
"""Warp beyond which a quadrilateral should not be used at all."""

_STEEP = 0.9  # share of the normal along x from which the default axis 1 is y
_ALONG = 1e-6  # least share of an orientation in the plane of an element


@dataclass(frozen=True, eq=False)
class Flat:
    """Elements in their mean planes.

    Parameters
    ----------
    center : (ne, 3) float
        Mean of the corners [m].
    axes : (ne, 3, 3) float
        Columns are axes 1, 2 and the normal, body frame.
    xy : (ne, k, 2) float
        Corners in the plane, from the centre [m].
    height : (ne, k) float
        Corners above the plane [m].
    """

    center: FloatArray
    axes: FloatArray
    xy: FloatArray
    height: FloatArray


def flatten(x: FloatArray, orientation: tuple[float, float, float] | None = None) -> Flat:
    """Project elements on their mean planes; axis 1 is the projection of ``orientation``.

    Raises
    ------
    MeshError
        The orientation is normal to an element, or an element is warped beyond ``WARP_LIMIT``.
    """
    _refuse_warped(x)
    normal = _normal(x)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    if orientation is None:
        towards = np.where(np.abs(normal[:, :1]) > _STEEP, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    else:
        towards = np.broadcast_to(
            np.asarray(orientation) / np.linalg.norm(orientation), normal.shape
        )
    e1 = towards - np.sum(towards * normal, axis=1, keepdims=True) * normal
    size = np.linalg.norm(e1, axis=1, keepdims=True)
    if (size < _ALONG).any():
        what = f"section.orientation is normal to {np.count_nonzero(size < _ALONG)} shell elements"
        raise MeshError(f"{what}: it has no direction in their planes")
    e1 = e1 / size
    axes = np.stack([e1, np.cross(normal, e1), normal], axis=2)
    center = x.mean(axis=1)
    local = np.matmul(x - center[:, None], axes)
    return Flat(center, axes, local[..., :2], local[..., 2])


def _refuse_warped(x: FloatArray) -> None:
    far = warp(x)
    if (far > WARP_LIMIT).any():
        what = f"{np.count_nonzero(far > WARP_LIMIT)} quadrilaterals are warped: their corners are "
        what += f"off a plane by up to {far.max():.2g} of their size, more than {WARP_LIMIT:g}"
        raise MeshError(f"{what}; mesh the twisted surface finer")


def warp(x: FloatArray) -> FloatArray:
    """(ne,) largest distance of a corner from the mean plane, over the root of the area."""
    normal = _normal(x)
    size = np.linalg.norm(normal, axis=1)
    safe = np.where(size > 0, size, 1.0)
    height = np.einsum("eka,ea->ek", x - x.mean(axis=1, keepdims=True), normal) / safe[:, None]
    return np.abs(height).max(axis=1) / np.sqrt(0.5 * safe)


def crooked(x: FloatArray) -> IntArray:
    """Elements without area, folded, or with a corner of 180 degrees or more."""
    normal = _normal(x)
    before, after = np.roll(x, 1, axis=1), np.roll(x, -1, axis=1)
    corner = np.einsum("eka,ea->ek", np.cross(after - x, before - x), normal)
    longest = np.linalg.norm(after - x, axis=2).max(axis=1)
    size = np.linalg.norm(normal, axis=1)
    flat = size <= 1e-10 * longest**2
    return np.flatnonzero(flat | (corner <= 1e-6 * size[:, None] ** 2).any(axis=1))


def _normal(x: FloatArray) -> FloatArray:
    """(ne, 3) along the normal, as long as twice the area."""
    if x.shape[1] == 3:
        return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    return np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
