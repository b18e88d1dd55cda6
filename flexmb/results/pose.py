"""Between output times: the rows around a time, and orientations evenly along the shorter arc.

In: Euler parameters of two rows (scalar part first, body to global). Out: those
between. Source: K. Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985
(spherical linear interpolation).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError

__all__ = ["locate", "slerp"]

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


def locate(times: Array, time: float, path: Path, unit: str) -> tuple[int, float]:
    """Row before `time` and the share of the way to the next one.

    Raises
    ------
    ResultFileError
        There are no rows, or the time is outside of them.
    """
    if not len(times):
        raise ResultFileError(f"{path}: holds no output rows")
    slack = 1e-9 * max(abs(times[0]), abs(times[-1]))  # a time the user typed in decimals
    if not times[0] - slack <= time <= times[-1] + slack:
        span = f"{times[0]:g} to {times[-1]:g} {unit}"
        raise ResultFileError(f"t = {time:g} {unit} lies outside the run, which covers {span}")
    i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
    if i == len(times) - 1:
        return i, 0.0
    s = (time - times[i]) / (times[i + 1] - times[i])
    return i, float(np.clip(s, 0.0, 1.0))
