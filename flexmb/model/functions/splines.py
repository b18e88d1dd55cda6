"""Curves through points as piecewise polynomials: straight, cubic spline, Akima, monotone.

In: points (x, y) with increasing x. Out: a :class:`Piecewise`. Sources: de Boor, A Practical Guide
to Splines (2001), ch. IV, for the slopes of the cubic spline; Akima, J. ACM 17 (1970) 589; Fritsch
and Carlson, SIAM J. Numer. Anal. 17 (1980) 238, with the means of Fritsch and Butland, SIAM J. Sci.
Stat. Comput. 5 (1984) 300.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.model.functions.piecewise import Piecewise, shifted

__all__ = ["akima", "cubic", "hermite", "linear", "monotone", "straight_beyond"]

Array = NDArray[np.float64]
# Slopes that differ by less than this share of the largest difference count as equal.
_EQUAL = 1e-9


def linear(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Straight lines from point to point."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    pieces = np.column_stack([y[:-1], np.diff(y) / np.diff(x)])
    return Piecewise.between(x, pieces, beyond)


def cubic(x: ArrayLike, y: ArrayLike, ends: str, beyond: str) -> Piecewise:
    """Cubic spline; ``ends`` natural (no curvature), clamped (level), or periodic."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    return hermite(x, y, _slopes(x, y, ends), beyond)


def akima(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Akima's curve, which follows the points without overshooting next to a corner."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    m = np.diff(y) / np.diff(x)
    second = m[1] if len(m) > 1 else m[0]
    last = m[-2] if len(m) > 1 else m[-1]
    before = [3.0 * m[0] - 2.0 * second, 2.0 * m[0] - second]
    m = np.concatenate([before, m, [2.0 * m[-1] - last, 3.0 * m[-1] - 2.0 * last]])
    change = np.abs(np.diff(m))
    right, left = change[2:], change[:-2]
    both = right + left
    slopes = 0.5 * (m[3:] + m[:-3])
    differ = both > _EQUAL * both.max()
    inner = (right * m[1:-2] + left * m[2:-1])[differ]
    slopes[differ] = inner / both[differ]
    return hermite(x, y, slopes, beyond)


def monotone(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Cubics that rise and fall as the points do: no extreme between two of them."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    h, d = np.diff(x), np.diff(y) / np.diff(x)
    slopes = np.full(len(x), d[0])
    if len(d) > 1:
        before, after = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = (before + after) / (before / d[:-1] + after / d[1:])
        slopes[1:-1] = np.where(d[:-1] * d[1:] > 0.0, mean, 0.0)
        slopes[0] = _end_slope(h[0], h[1], d[0], d[1])
        slopes[-1] = _end_slope(h[-1], h[-2], d[-1], d[-2])
    return hermite(x, y, slopes, beyond)


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    """Slope of the parabola through three points, as far as it leaves no extreme."""
    slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0.0:
        return 0.0
    return 3.0 * d0 if d0 * d1 < 0.0 and abs(slope) > 3.0 * abs(d0) else slope


def straight_beyond(curve: Piecewise) -> Piecewise:
    """The same curve, going on straight with the slopes of its ends."""
    x, c, rows = curve.knots, curve.coefficients, curve.coefficients.copy()
    rows[0], rows[-1] = 0.0, 0.0
    rows[0, :2], rows[-1, :2] = c[1, :2], shifted(c[-2], x[-1] - x[-2])[:2]
    return Piecewise(x, rows)


def hermite(x: Array, y: Array, slopes: Array, beyond: str) -> Piecewise:
    """Cubics from point to point with given slopes at the points."""
    h = np.diff(x)
    m = np.diff(y) / h
    a, b = slopes[:-1], slopes[1:]
    pieces = np.column_stack([y[:-1], a, (3.0 * m - 2.0 * a - b) / h, (a + b - 2.0 * m) / (h * h)])
    return Piecewise.between(x, pieces, beyond)


def _slopes(x: Array, y: Array, ends: str) -> Array:
    """Slopes at the points with which the second derivative has no jumps."""
    h = np.diff(x)
    m = np.diff(y) / h
    n = len(x)
    low, middle, up, right = (np.zeros(n) for _ in range(4))
    low[1:-1], up[1:-1] = 1.0 / h[:-1], 1.0 / h[1:]
    middle[1:-1] = 2.0 * (low[1:-1] + up[1:-1])
    right[1:-1] = 3.0 * (m[:-1] / h[:-1] + m[1:] / h[1:])
    if ends == "periodic":
        return _periodic(h, m, low, middle, up, right)
    if ends == "clamped":
        middle[0] = middle[-1] = 1.0
    else:
        middle[0], up[0], right[0] = 2.0, 1.0, 3.0 * m[0]
        low[-1], middle[-1], right[-1] = 1.0, 2.0, 3.0 * m[-1]
    return _tridiagonal(low, middle, up, right)


def _periodic(h: Array, m: Array, low: Array, middle: Array, up: Array, right: Array) -> Array:
    """The first slope is the last: n - 1 unknowns, the corners taken out by Sherman-Morrison."""
    low, middle, up, right = (part[:-1].copy() for part in (low, middle, up, right))
    corner = 1.0 / h[-1]
    up[0] = 1.0 / h[0]
    middle[0] = 2.0 * (corner + up[0])
    right[0] = 3.0 * (m[-1] / h[-1] + m[0] / h[0])
    column = np.zeros_like(right)
    column[0] = column[-1] = corner
    middle[0] -= corner
    middle[-1] -= corner
    up[-1] = 0.0
    one, two = _tridiagonal(low, middle, up, right), _tridiagonal(low, middle, up, column)
    found = one - two * (one[0] + one[-1]) / (1.0 + two[0] + two[-1])
    return np.append(found, found[0])


def _tridiagonal(low: Array, middle: Array, up: Array, right: Array) -> Array:
    """Solution of a tridiagonal system whose diagonal outweighs the rest, without pivoting."""
    d, b = middle.copy(), right.copy()
    for k in range(1, len(b)):
        factor = low[k] / d[k - 1]
        d[k] -= factor * up[k - 1]
        b[k] -= factor * b[k - 1]
    b[-1] /= d[-1]
    for k in range(len(b) - 2, -1, -1):
        b[k] = (b[k] - up[k] * b[k + 1]) / d[k]
    return b
