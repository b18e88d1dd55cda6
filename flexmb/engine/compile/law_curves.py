"""Tabulated laws as pieces of cubics: what `kernels.law.curve` reads.

The slopes at the points decide: of Fritsch and Carlson (SIAM J. Numer. Anal. 17, 1980, 238; with
the harmonic means of Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984, 300), of Akima
(J. ACM 17, 1970, 589), or of the natural cubic spline. Beyond its ends a law goes on straight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["curve"]

Array = NDArray[np.float64]


def curve(points: tuple[tuple[float, float], ...], interpolation: str) -> Array:
    """The numbers of a law in the pool, its integral counted from 0.

    Parameters
    ----------
    points : tuple of (x, y)
        With x increasing, in SI.
    interpolation : {"monotone", "akima", "cubic", "linear"}
        How it goes from point to point.

    Returns
    -------
    (1 + n + 5 (n + 1),) float64
        n, x, then c0, c1, c2, c3 and the integral at its left end of every piece.
    """
    x, y = np.array(points, dtype=float).T
    h, d = np.diff(x), np.diff(y) / np.diff(x)
    pieces = np.zeros((len(x) + 1, 5))
    if interpolation == "linear":
        pieces[1:-1, 0], pieces[1:-1, 1] = y[:-1], d
        ends = d[0], d[-1]
    else:
        m = _SLOPES[interpolation](h, d)
        pieces[1:-1, 0], pieces[1:-1, 1] = y[:-1], m[:-1]
        pieces[1:-1, 2] = (3.0 * d - 2.0 * m[:-1] - m[1:]) / h
        pieces[1:-1, 3] = (m[:-1] + m[1:] - 2.0 * d) / h**2
        ends = m[0], m[-1]
    pieces[0, :2], pieces[-1, :2] = (y[0], ends[0]), (y[-1], ends[1])
    areas = pieces[1:-1, :4] * h[:, None] ** np.arange(1, 5) / np.arange(1, 5)
    pieces[2:, 4] = np.cumsum(areas.sum(axis=1))
    pieces[:, 4] -= _integral_to_zero(x, pieces)
    return np.concatenate([[len(x)], x, pieces.ravel()])


def _integral_to_zero(x: Array, pieces: Array) -> float:
    """Integral from the first point to 0."""
    k = int(np.searchsorted(x, 0.0, side="right"))
    t = -x[max(k - 1, 0)]
    return float(pieces[k, 4] + pieces[k, :4] @ (t ** np.arange(1, 5) / np.arange(1, 5)))


def _monotone(h: Array, d: Array) -> Array:
    m = np.empty(len(h) + 1)
    before, after = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    same = d[:-1] * d[1:] > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (before + after) / (before / d[:-1] + after / d[1:])
    m[1:-1] = np.where(same, mean, 0.0)
    if len(d) == 1:
        m[:] = d[0]
        return m
    m[0] = _end_slope(h[0], h[1], d[0], d[1])
    m[-1] = _end_slope(h[-1], h[-2], d[-1], d[-2])
    return m


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    """Slope of the parabola through three points, as far as it leaves no extreme."""
    m = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if m * d0 <= 0.0:
        return 0.0
    return 3.0 * d0 if d0 * d1 < 0.0 and abs(m) > 3.0 * abs(d0) else m


def _akima(h: Array, d: Array) -> Array:
    if len(d) == 1:
        return np.full(2, d[0])
    first, last = 2.0 * d[0] - d[1], 2.0 * d[-1] - d[-2]
    e = np.concatenate([[2.0 * first - d[0], first], d, [last, 2.0 * last - d[-1]]])
    change = np.abs(np.diff(e))
    left, right = change[2:], change[:-2]
    total = left + right
    level = total <= 1e-9 * total.max(initial=0.0)
    total[level] = 1.0
    m: Array = (left * e[1:-2] + right * e[2:-1]) / total
    m[level] = 0.5 * (e[1:-2] + e[2:-1])[level]
    return m


def _cubic(h: Array, d: Array) -> Array:
    """Slopes of the natural spline, by elimination of the tridiagonal equations."""
    n = len(h) + 1
    diagonal = np.zeros(n)
    diagonal[:-1] += 2.0 / h
    diagonal[1:] += 2.0 / h
    right = np.zeros(n)
    right[:-1] += 3.0 * d / h
    right[1:] += 3.0 * d / h
    for k in range(1, n):
        factor = 1.0 / (h[k - 1] * diagonal[k - 1])
        diagonal[k] -= factor / h[k - 1]
        right[k] -= factor * right[k - 1]
    m = right / diagonal
    for k in range(n - 2, -1, -1):
        m[k] = (right[k] - m[k + 1] / h[k]) / diagonal[k]
    return m


_SLOPES = {"monotone": _monotone, "akima": _akima, "cubic": _cubic}
