"""Axes of a beam's section in the body frame.

In: end coordinates of line elements and the section's orientation. Out: x along the element, y and
z across it.
"""

from __future__ import annotations

import numpy as np

from flexmb.flexbody.arrays import FloatArray

__all__ = ["local_axes"]


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
