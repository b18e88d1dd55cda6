"""Where along its curves a joint begins in the placed pose, and on which side of them it acts.

The places are found among samples; assembly closes the rest. The side of a cam is the outer one of
a closed curve, that of the roller where there is one, else that of the follower's centre of mass.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.joints.curves import Laid, X, Y

__all__ = ["inside", "nearest_pair", "nearest_place", "side_of_follower", "tangent_place"]

Array = NDArray[np.float64]


def nearest_place(laid: Laid, point: Array, across: bool) -> float:
    """Place [m] nearest to a point; `across`: what lies across the curve's plane does not count."""
    s = laid.samples
    apart = point - laid.at(s)[0]
    if across:
        apart = apart @ laid.R[:, [X, Y]]
    return float(s[np.argmin(np.linalg.norm(apart, axis=1))])


def tangent_place(laid: Laid, point: Array, normal: Array) -> float:
    """Place [m] where the curve runs along a flat through a point, nearest to the flat."""
    s = laid.samples
    x, t, _ = laid.at(s)
    slope, height = t @ normal, np.abs((x - point) @ normal)
    after = np.roll(slope, -1)
    turning = slope * after <= 0.0
    if not laid.closed:
        turning[-1] = False
    if not turning.any():
        return float(s[np.argmin(np.abs(slope))])
    k = int(np.argmin(np.where(turning, height, np.inf)))
    step = laid.length / len(s)
    share = slope[k] / (slope[k] - after[k]) if slope[k] != after[k] else 0.5
    return float(s[k] + share * step)


def nearest_pair(first: Laid, second: Laid, start: float | None) -> tuple[float, float]:
    """Places [m] on two curves where they are nearest to touching; `start` fixes the first."""
    s = first.samples[::4] if start is None else np.array([start])
    u = second.samples[::4]
    (x, t, _), (y, _, n) = first.at(s), second.at(u)
    size = 0.5 * (first.length + second.length)
    apart = np.linalg.norm(x[:, None] - y[None], axis=2) / size
    i, j = np.unravel_index(np.argmin(apart + 0.1 * (t @ n.T) ** 2), apart.shape)
    return float(s[i]), float(u[j])


def inside(laid: Laid, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 3) lie within a closed curve, by the crossings of a ray."""
    ring = laid.pieces.at(laid.samples)[:, 0]
    local = (points - laid.x) @ laid.R
    a, b = ring, np.roll(ring, -1, axis=0)
    px, py = local[:, [X]], local[:, [Y]]
    spans = (a[:, Y] > py) != (b[:, Y] > py)
    rise = np.where(b[:, Y] == a[:, Y], 1.0, b[:, Y] - a[:, Y])
    crossing = a[:, X] + (py - a[:, Y]) * (b[:, X] - a[:, X]) / rise
    found: NDArray[np.bool_] = (spans & (px < crossing)).sum(axis=1) % 2 == 1
    return found


def side_of_follower(laid: Laid, s: float, center: Array) -> float:
    """1 if a point lies on the side of the normal at s, −1 on the other."""
    x, _, n = laid.at(np.array([s]))
    return 1.0 if n[0] @ (center - x[0]) >= 0.0 else -1.0
