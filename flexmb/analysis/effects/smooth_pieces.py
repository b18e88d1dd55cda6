"""Rates of rows, piece by piece: between the rows behind which what drives a model jumps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexmb.flexbody.arrays import Array, IntArray

_SPIKE = 5  # rows: one or two beside one another are a spike
_COLUMNS = 64  # whose splines fit into the cache of a processor
_SLOW = 0.1  # rad of a change of coefficients between two rows, beyond which they are no series


@dataclass(frozen=True, eq=False)
class SmoothPieces:
    """Times (n,) of rows, and those of them with which a piece begins, but for the first one.

    What follows the loads jumps with them. It has the rates of either side.
    """

    t: Array
    begins: IntArray

    def part(self, rows: slice) -> SmoothPieces:
        """Some of the rows, one after the other."""
        t = self.t[rows]
        first = rows.start or 0
        begins = self.begins[(self.begins > first) & (self.begins < first + len(t))]
        return SmoothPieces(t, begins - first)

    def rate(self, values: Array, order: int = 1) -> Array:
        """First or second time derivative of rows, by cubic splines."""
        from scipy.interpolate import CubicSpline

        flat = values.reshape(len(values), -1)
        rates, changing = np.zeros_like(flat), np.flatnonzero((flat != flat[0]).any(axis=0))
        for piece in self._pieces():
            t = self.t[piece]
            for k in range(0, len(changing) if len(t) > 1 else 0, _COLUMNS):
                columns = changing[k : k + _COLUMNS]
                spline = CubicSpline(t, flat[piece, columns])
                rates[piece.start : piece.stop - 1, columns] = order * spline.c[3 - order]
                rates[piece.stop - 1, columns] = spline(t[-1], order)
        return rates.reshape(values.shape)

    def calm_second(self, values: Array, second: Array) -> Array:
        """Second time derivative of rows without its spikes.

        What follows a load has one where the load bends, as at the points of a table: more there
        than the median of differences beside it by the largest of these.
        """
        from scipy.ndimage import median_filter

        calm = second.copy()
        for piece in self._pieces():
            t, x = self.t[piece], values[piece]
            if len(t) > 2:
                h = np.diff(t)[:, None]
                beside = 2.0 * np.diff(np.diff(x, axis=0) / h, axis=0) / (h[1:] + h[:-1])
                beside = median_filter(beside, (_SPIKE, 1), mode="nearest")
                beside = np.concatenate([beside[:1], beside, beside[-1:]])
                spikes = np.abs(second[piece] - beside) > np.abs(beside).max(axis=0)
                calm[piece][spikes] = beside[spikes]
        return calm

    def jumps(self, values: Array, rates: Array) -> Array:
        """By how much rows jump from one piece to the next, in the rows behind it; else 0."""
        jumps, k = np.zeros_like(values), self.begins
        h = (self.t[k] - self.t[k - 1])[:, None]
        jumps[k] = values[k] - values[k - 1] - 0.5 * h * (rates[k] + rates[k - 1])
        return jumps

    def series(self, A: Array) -> Array:
        """What Magnus' series has of ẋ = A x beyond the mean of both ends of an interval.

        Of fourth order, (n - 1, d, d): without it a motion that swings on for long, whose
        disturbance grows with time, would have another period than its disturbance. Nothing where
        A changes at once.

        Source: Blanes, Casas, Oteo & Ros, Phys. Reports 470 (2009) 151, section 5.
        """
        h = np.diff(self.t)[:, None, None]
        slopes = np.zeros_like(A)
        for piece in self._pieces():
            if piece.stop - piece.start > 2:
                slopes[piece] = np.gradient(A[piece], self.t[piece], axis=0)
        commutator = A[:-1] @ A[1:] - A[1:] @ A[:-1]
        further = -h / 12.0 * (np.diff(slopes, axis=0) + commutator)
        jump = np.isin(np.arange(1, len(self.t)), self.begins)
        large = np.abs(h * further).sum(axis=2).max(axis=1, initial=0.0) > _SLOW
        further[large | jump] = 0.0
        return np.asarray(further)

    def _pieces(self) -> Iterator[slice]:
        for first, end in pairwise([0, *self.begins.tolist(), len(self.t)]):
            yield slice(first, end)
