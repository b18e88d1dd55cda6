"""Orientations between output times: evenly along the shorter arc.

In: Euler parameters of two rows (scalar part first, body to global). Out: those
between. Source: K. Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985
(spherical linear interpolation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["slerp"]

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
