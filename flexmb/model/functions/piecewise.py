"""Piecewise polynomials of one variable: what splines, tables and trapezoidal profiles are.

In: knots and the coefficients of every piece. Out: a :class:`Piecewise`, which gives value, first
and second derivative, its antiderivative, the knots where one of them jumps, and the data for the
compiled kernel. Beyond the knots the function is one polynomial on each side, or it is periodic.

Curves through points are such polynomials: straight lines, cubic spline, Akima, monotone. SciPy,
which is imported when first needed, computes their slopes: de Boor, A Practical Guide to Splines
(2001), ch. IV, for the cubic spline; Akima, J. ACM 17 (1970) 589; Fritsch and Carlson, SIAM J.
Numer. Anal. 17 (1980) 238, with the means of Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5
(1984) 300.

SciPy's PPoly is not used for more: it has no separate polynomials outside the knots and no mean of
a periodic curve, and it loses digits of long integrals, whose sums are in long double here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexmb.flexbody.arrays import Array

# Jumps of a derivative below this share of its size are round-off of the construction.
_ROUND_OFF = 1e-7
# Of the third derivative, less than that of a cubic spline with 125 points per period of a sine is
# left to steps, which are as short.
_LEAST_JUMP = 0.05
_FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0])


@dataclass(frozen=True, eq=False)
class Piecewise:
    """A piecewise polynomial; a knot belongs to the piece that begins there.

    Parameters
    ----------
    knots : (n + 1,) array
        Increasing; piece k lies between knots k and k + 1.
    coefficients : (n + 2, p) array
        Row 0 holds before the first knot, row k between knots k - 1 and k, the last row after the
        last knot. Powers of the distance from the knot to the left (row 0: from the first knot),
        lowest power first. Rows of NaN: the function has no value there.
    period : float
        Period of the function; 0 if it is not periodic.
    """

    knots: Array
    coefficients: Array
    period: float = 0.0

    @classmethod
    def between(cls, knots: ArrayLike, coefficients: ArrayLike, beyond: str) -> Piecewise:
        """From the n pieces between n + 1 knots; `beyond` selects the continuation outside.

        ``"hold"``: constant values of both ends; ``"extrapolate"``: the polynomials of the end
        pieces; ``"repeat"``: periodic; ``"error"``: no value.
        """
        x, c = np.asarray(knots, dtype=float), np.asarray(coefficients, dtype=float)
        before, after = c[0].copy(), shifted(c[-1], x[-1] - x[-2])
        if beyond == "error":
            # A time may exceed an end by round-off: the polynomials extend slightly beyond it.
            slack = 1e-9 * (x[-1] - x[0])
            nothing = np.full_like(before, np.nan)
            rows = np.vstack([nothing, shifted(before, -slack), c, after, nothing])
            return cls(np.concatenate([[x[0] - slack], x, [x[-1] + slack]]), rows)
        if beyond == "hold":
            before[1:], after[1:] = 0.0, 0.0
        period = float(x[-1] - x[0]) if beyond == "repeat" else 0.0
        return cls(x, np.vstack([before, c, after]), period)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Piecewise) and self.data.tobytes() == other.data.tobytes()

    def __hash__(self) -> int:
        return hash(self.data.tobytes())

    @cached_property
    def data(self) -> Array:
        """Number of pieces, coefficients per piece, period, knots and coefficients in one row."""
        n, p = len(self.knots) - 1, self.coefficients.shape[1]
        return np.concatenate([[n, p, self.period], self.knots, self.coefficients.ravel()])

    def jet(self, x: float) -> tuple[float, float, float]:
        """Value, first and second derivative at x."""
        if self.period > 0.0:
            x = x - np.floor((x - self.knots[0]) / self.period) * self.period
        row = int(np.searchsorted(self.knots, x, side="right")) if x == x else 0
        u = x - self.knots[max(row - 1, 0)]
        f = f1 = f2 = np.float64(0.0)
        for c in self.coefficients[row][::-1]:
            f, f1, f2 = f * u + c, f1 * u + f, f2 * u + f1
        return f, f1, 2.0 * f2

    def values(self, x: Array) -> Array:
        """Values (n,) at x (n,)."""
        if self.period > 0.0:
            x = self.knots[0] + (x - self.knots[0]) % self.period
        rows = np.searchsorted(self.knots, x, side="right")
        u, f = x - self.knots[np.maximum(rows - 1, 0)], np.zeros(len(x))
        for c in self.coefficients[rows].T[::-1]:
            f = f * u + c
        return f

    def antiderivative(self) -> Piecewise:
        """The antiderivative that is zero at the first knot; not for periodic functions."""
        assert self.period == 0.0  # periodic functions: see `without_mean`
        x, c = self.knots, self.coefficients
        rows = np.hstack([np.zeros((len(c), 1)), c / np.arange(1, c.shape[1] + 1)])
        widths = np.diff(x).astype(np.longdouble)  # so that a long sum keeps its digits
        parts = np.zeros(len(widths), dtype=np.longdouble)
        for coefficient in rows[1:-1].T[::-1]:
            parts = parts * widths + coefficient
        rows[1:, 0] = np.concatenate([[0.0], np.cumsum(parts)])
        return Piecewise(x, rows)

    def without_mean(self) -> tuple[float, Piecewise]:
        """The mean of a periodic function, and the (periodic) function minus its mean."""
        once = Piecewise(self.knots, self.coefficients).antiderivative()
        mean = float(once.coefficients[-1, 0]) / self.period
        rows = self.coefficients.copy()
        rows[:, 0] -= mean
        return mean, Piecewise(self.knots, rows, self.period)

    def repeated_antiderivative(self) -> Piecewise:
        """The periodic antiderivative, of mean zero, of a periodic function of mean zero."""
        once = Piecewise(self.knots, self.coefficients).antiderivative()
        return Piecewise(once.knots, once.coefficients, self.period).without_mean()[1]

    def jumps(self, derivatives: int = 2, least_change: float = 0.0, span: float = 0.0) -> Array:
        """The knots where the value or one of the first two or three derivatives jumps.

        A jump of the third one counts if it changes the value, over the distance of the next knot,
        by more than `least_change` times the range of the values at the knots; without one if it is
        more than a small share of the largest third derivative. With a `span` the change of the
        integral counts, over that of the range over the span.
        """
        n = derivatives + 1
        c, p = self.coefficients, min(n, self.coefficients.shape[1])
        right = np.zeros((len(self.knots), n))
        right[:, :p] = c[1:, :p] * _FACTORIALS[:p]
        u = np.append(0.0, np.diff(self.knots))[:, None]
        left = np.zeros((len(self.knots), n))
        for coefficient in c[:-1].T[::-1]:  # Horner's scheme with derivatives
            left[:, 1:] = left[:, 1:] * u + left[:, :-1]
            left[:, :1] = left[:, :1] * u + coefficient[:, None]
        left *= _FACTORIALS[:n]
        if self.period > 0.0:  # the last knot is the first one again
            left[0], right[-1] = left[-1], right[0]
        inside = np.isfinite(left) & np.isfinite(right)
        size = np.max(np.abs(np.where(inside, right, 0.0)), axis=0)
        for k in range(1, n):  # what a change over the whole length would be
            size[k] = max(size[k], size[k - 1] / (self.knots[-1] - self.knots[0]))
        apart = np.abs(np.where(inside, right - left, 0.0))
        jump = apart > _ROUND_OFF * size
        if least_change == 0.0:
            jump[:, 3:] &= apart[:, 3:] > _LEAST_JUMP * size[3:]
        else:
            widths = np.diff(self.knots)
            nearest = np.minimum(np.append(widths[:1], widths), np.append(widths, widths[-1:]))
            change = apart[:, 3:] * nearest[:, None] ** 3 / 6.0
            change *= nearest[:, None] / span if span > 0.0 else 1.0
            values = np.where(np.isfinite(right[:, 0]), right[:, 0], left[:, 0])
            jump[:, 3:] &= change > least_change * np.ptp(values)
        knots: Array = self.knots[jump.any(axis=1)]
        return knots


def shifted(coefficients: ArrayLike, u: float) -> Array:
    """Coefficients of the same polynomial about the point u (Taylor shift)."""
    c = np.array(coefficients, dtype=float)
    for i in range(len(c) - 1):
        for k in range(len(c) - 2, i - 1, -1):
            c[k] += u * c[k + 1]
    return c


def linear_curve(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Straight lines from point to point."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    pieces = np.column_stack([y[:-1], np.diff(y) / np.diff(x)])
    return Piecewise.between(x, pieces, beyond)


def cubic_spline(x: ArrayLike, y: ArrayLike, ends: str, beyond: str) -> Piecewise:
    """Cubic spline; ``ends`` are natural (zero curvature), clamped (zero slope), or periodic."""
    from scipy.interpolate import CubicSpline

    y = np.array(y, dtype=float)
    if ends == "periodic":
        y[-1] = y[0]  # equal to the last digit
    return _piecewise(CubicSpline(x, y, bc_type=ends), beyond)


def akima_curve(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Akima's curve, which hardly overshoots next to a corner."""
    from scipy.interpolate import Akima1DInterpolator

    return _piecewise(Akima1DInterpolator(x, y), beyond)


def monotone_curve(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Monotone cubics: the curve has no extreme between two points."""
    from scipy.interpolate import PchipInterpolator

    return _piecewise(PchipInterpolator(x, y), beyond)


def _piecewise(curve: Any, beyond: str) -> Piecewise:
    """From SciPy's coefficients, which have the highest power first."""
    return Piecewise.between(curve.x, curve.c[::-1].T, beyond)


def straight_beyond(curve: Piecewise) -> Piecewise:
    """The same curve, continued beyond its ends by straight lines with the slopes there."""
    x, c, rows = curve.knots, curve.coefficients, curve.coefficients.copy()
    rows[0], rows[-1] = 0.0, 0.0
    rows[0, :2], rows[-1, :2] = c[1, :2], shifted(c[-2], x[-1] - x[-2])[:2]
    return Piecewise(x, rows)
