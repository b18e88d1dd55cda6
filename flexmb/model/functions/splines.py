"""Curves through points as piecewise polynomials: straight, cubic spline, Akima, monotone.

In: points (x, y) with increasing x. Out: a :class:`Piecewise`. SciPy finds the slopes: de Boor, A
Practical Guide to Splines (2001), ch. IV, for the cubic spline; Akima, J. ACM 17 (1970) 589;
Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238, with the means of Fritsch and Butland, SIAM
J. Sci. Stat. Comput. 5 (1984) 300. It is loaded when a scene first needs it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexmb.model.functions.piecewise import Piecewise, shifted

__all__ = ["akima", "cubic", "linear", "monotone", "straight_beyond"]


def linear(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Straight lines from point to point."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    pieces = np.column_stack([y[:-1], np.diff(y) / np.diff(x)])
    return Piecewise.between(x, pieces, beyond)


def cubic(x: ArrayLike, y: ArrayLike, ends: str, beyond: str) -> Piecewise:
    """Cubic spline; ``ends`` natural (no curvature), clamped (level), or periodic."""
    from scipy.interpolate import CubicSpline

    y = np.array(y, dtype=float)
    if ends == "periodic":
        y[-1] = y[0]  # to the last digit
    return _piecewise(CubicSpline(x, y, bc_type=ends), beyond)


def akima(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Akima's curve, which follows the points without overshooting next to a corner."""
    from scipy.interpolate import Akima1DInterpolator

    return _piecewise(Akima1DInterpolator(x, y), beyond)


def monotone(x: ArrayLike, y: ArrayLike, beyond: str) -> Piecewise:
    """Cubics that rise and fall as the points do: no extreme between two of them."""
    from scipy.interpolate import PchipInterpolator

    return _piecewise(PchipInterpolator(x, y), beyond)


def _piecewise(curve: Any, beyond: str) -> Piecewise:
    """From SciPy's coefficients, highest power first."""
    return Piecewise.between(curve.x, curve.c[::-1].T, beyond)


def straight_beyond(curve: Piecewise) -> Piecewise:
    """The same curve, going on straight with the slopes of its ends."""
    x, c, rows = curve.knots, curve.coefficients, curve.coefficients.copy()
    rows[0], rows[-1] = 0.0, 0.0
    rows[0, :2], rows[-1, :2] = c[1, :2], shifted(c[-2], x[-1] - x[-2])[:2]
    return Piecewise(x, rows)
