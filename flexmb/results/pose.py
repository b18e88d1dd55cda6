"""Poses between output times: linear in position and modes, spherical in orientation.

In: two rows of Euler parameters or a row of them (scalar part first, body to global). Out: unit
quaternions and direction-cosine matrices A. Source: K. Shoemake, Animating rotation with quaternion
curves, SIGGRAPH 1985 (spherical linear interpolation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["rotation_matrix", "slerp"]

Array = NDArray[np.float64]

_NEARLY_EQUAL = 1.0 - 1e-9  # cosine above which the arc is straight to round-off


def slerp(first: Array, second: Array, s: float) -> Array:
    """Unit quaternion (4,) at the share s of the shorter arc from `first` to `second` (4,)."""
    cosine = float(first @ second)
    if cosine < 0.0:  # q and -q are the same orientation: take the nearer one
        second, cosine = -second, -cosine
    if cosine > _NEARLY_EQUAL:
        mixed = (1.0 - s) * first + s * second
    else:
        angle = np.arccos(cosine)
        mixed = (np.sin((1.0 - s) * angle) * first + np.sin(s * angle) * second) / np.sin(angle)
    return np.asarray(mixed / np.linalg.norm(mixed))


def rotation_matrix(p: Array) -> Array:
    """Direction-cosine matrix (3, 3), body to global, of Euler parameters p (4,)."""
    w, x, y, z = p / np.linalg.norm(p)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
