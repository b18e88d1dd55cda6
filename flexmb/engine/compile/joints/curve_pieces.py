"""A curve as pieces of degree five over its own length, as the kernels read it.

Value, unit tangent and curvature agree with the curve at both ends of every piece, so the pieces
join with continuous curvature, and their error shrinks with the sixth power of their length.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.model.joints.curve import CurveShape

__all__ = ["Pieces", "pieces_of"]

Array = NDArray[np.float64]
_EXACT = 1e-13  # of the size of the curve: smaller errors than this are round-off
_FEWEST, _MOST = 64, 512
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(7)


class Pieces(NamedTuple):
    """Ends of the pieces along the curve (n + 1,) [m], coefficients (n, 3, 6), error over size."""

    ends: Array
    coefficients: Array
    error: float

    def at(self, s: Array) -> Array:
        """(n, 3, 3) place, unit tangent and curvature vector at places (n,) within the ends."""
        k = np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, len(self.coefficients) - 1)
        t = s - self.ends[k]
        powers = np.zeros((len(t), 3, 6))
        for n in range(6):
            powers[:, 0, n] = t**n
            powers[:, 1, n] = n * t ** max(n - 1, 0)
            powers[:, 2, n] = n * (n - 1) * t ** max(n - 2, 0)
        return np.einsum("kdn,kan->kda", powers, self.coefficients[k])


@lru_cache(maxsize=64)  # the same shape has the same pieces in every joint
def pieces_of(shape: CurveShape) -> Pieces:
    """As many pieces as it takes for errors of the size of round-off."""
    per_break = max(1, -(-_FEWEST // (len(shape.breaks) - 1)))
    while True:
        found = _divided(shape, per_break)
        if found.error <= _EXACT or 2 * len(found.coefficients) > _MOST:
            return found
        per_break *= 2


def _divided(shape: CurveShape, per_break: int) -> Pieces:
    b = shape.breaks
    u = np.append(
        (b[:-1, None] + np.diff(b)[:, None] * np.arange(per_break) / per_break).ravel(), b[-1]
    )
    lengths = _length(shape, u[:-1], u[1:])
    ends = np.append(0.0, np.cumsum(lengths))
    nodes = _over_length(shape.at(u))
    if shape.closed:
        nodes[-1] = nodes[0]
    found = Pieces(ends, _hermite(nodes, lengths), 0.0)
    middle = 0.5 * (u[:-1] + u[1:])
    places = ends[:-1] + _length(shape, u[:-1], middle)
    exact = shape.at(middle)[:, 0]
    size = float(np.linalg.norm(np.ptp(nodes[:, 0], axis=0)))
    error = float(np.abs(found.at(places)[:, 0] - exact).max()) / size
    return found._replace(error=error)


def _length(shape: CurveShape, low: Array, high: Array) -> Array:
    """(n,) length between parameters, by seven points of Gauss."""
    half = 0.5 * (high - low)
    u = 0.5 * (high + low)[:, None] + half[:, None] * _GAUSS
    speed = np.linalg.norm(shape.at(u.ravel())[:, 1], axis=1).reshape(u.shape)
    found: Array = half * (speed @ _WEIGHTS)
    return found


def _over_length(found: Array) -> Array:
    """(n, 3, 3) value, tangent and curvature vector from derivatives over any parameter."""
    speed = np.linalg.norm(found[:, 1], axis=1)[:, None]
    tangent = found[:, 1] / speed
    along = np.einsum("ka,ka->k", found[:, 2], tangent)[:, None]
    return np.stack([found[:, 0], tangent, (found[:, 2] - along * tangent) / speed**2], axis=1)


def _hermite(nodes: Array, lengths: Array) -> Array:
    """(n, 3, 6) coefficients of the polynomials of degree five between nodes (n + 1, 3, 3)."""
    h = lengths[:, None]
    (p, d, a), (q, e, b) = nodes[:-1].swapaxes(0, 1), nodes[1:].swapaxes(0, 1)
    # what value, slope and curvature at the far end lack of the parabola from the near end
    x = q - p - h * (d + 0.5 * h * a)
    y = (e - d - h * a) * h
    z = (b - a) * h * h
    return np.stack(
        [
            p,
            d,
            0.5 * a,
            (10.0 * x - 4.0 * y + 0.5 * z) / h**3,
            (-15.0 * x + 7.0 * y - z) / h**4,
            (6.0 * x - 3.0 * y + 0.5 * z) / h**5,
        ],
        axis=2,
    )
