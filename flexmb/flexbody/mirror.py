"""The mirror image of a vector field that is known at points only.

In: points and the motion of each. Out: what the reflected motion would be at them, interpolated
where the mirror image of a point is no point of the body itself: exact for symmetric meshes, by a
quadratic fit through the nearest points for others.
"""

from __future__ import annotations

import numpy as np

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["fit_weights", "mirrored"]

_MOST = 2000  # points that are compared; more would tell the same
_NEIGHBOURS = 24  # of a fit with ten coefficients
_WILD = 3.0  # sum of weights from which on a fit extrapolates: then the nearest point is taken
_SAME = 1e-6  # of the extent: closer points are the same


def mirrored(
    points: FloatArray, motion: FloatArray, normal: FloatArray, center: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Reflect a motion at the plane through a point.

    Parameters
    ----------
    points : (k, 3) float
        Where the motion is known.
    motion : (k, 3, m) float
        The motion of each point.
    normal, center : (3,) float
        Unit normal of the plane and a point of it.

    Returns
    -------
    rows : (r,) int
        Points that were looked at, evenly spread over the list.
    reflected : (r, 3, m) float
        The reflected motion at them.
    """
    R = np.eye(3) - 2 * np.outer(normal, normal)
    rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MOST)).astype(int))
    images = center + (points[rows] - center) @ R
    return rows, np.einsum("ab,kbm->kam", R, _interpolated(points, motion, images))


def _interpolated(points: FloatArray, motion: FloatArray, at: FloatArray) -> FloatArray:
    """(r, 3, m) the motion at other places (r, 3)."""
    from scipy.spatial import cKDTree  # loaded in 0.05 s, only where a body is mirrored

    count = min(_NEIGHBOURS, len(points))
    distance, near = cKDTree(points).query(at, count)
    distance, near = distance.reshape(len(at), count), near.reshape(len(at), count)
    weights = np.zeros((len(at), count))
    weights[:, 0] = 1.0
    apart = np.flatnonzero(distance[:, 0] > _SAME * np.ptp(points, axis=0).max())
    if len(apart):
        fitted = fit_weights(points[near[apart]], at[apart])
        inside = np.abs(fitted).sum(axis=1) < _WILD
        weights[apart[inside]] = fitted[inside]
    return np.asarray(np.einsum("rk,rkam->ram", weights, motion[near]))


def fit_weights(near: FloatArray, at: FloatArray) -> FloatArray:
    """(r, k) weights of the neighbours (r, k, 3) in the value at a place of a quadratic fit."""
    arms = near - at[:, None]
    size = np.linalg.norm(arms, axis=2).max(axis=1)
    x = arms / size[:, None, None]
    pairs = [x[..., a] * x[..., b] for a in range(3) for b in range(a, 3)]
    A = np.stack([np.ones(x.shape[:2]), *(x[..., a] for a in range(3)), *pairs], axis=2)
    return np.asarray(np.linalg.pinv(A, rcond=1e-6)[:, 0])  # the constant is the value at x = 0
