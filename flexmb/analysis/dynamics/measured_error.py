"""The error of a run, measured: what sensors of the same run with longer steps say.

Two runs of a method of order p on the same plan of steps, one with r times as many, differ by the
error of the coarser one less that of the finer one, rᵖ : 1, so that the finer one is off by their
difference over rᵖ − 1 (Richardson; Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, 1993, §II.4). In: rows of both runs, in order. Out: the largest error of positions,
velocities and reactions over the outputs, each over the peak-to-peak of its sensor, with the
sensor's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import Layout
from flexmb.model.model import Model
from flexmb.model.sensors.sensor import channels_of, unit_of
from flexmb.model.values.reading import Spec
from flexmb.results import OutputBlock

__all__ = ["QUANTITIES", "ErrorOf", "MeasuredError"]

Array = NDArray[np.float64]

QUANTITIES = {
    "m": "positions",
    "rad": "positions",
    "m/s": "velocities",
    "rad/s": "velocities",
    "m/s^2": "accelerations",
    "rad/s^2": "accelerations",
    "N": "reactions",
    "N m": "reactions",
}
"""What the channels of each unit are judged as."""
_SAMPLES = 256  # times at which the growth of the errors is kept
# A sensor that moves by less than this share of the largest motion of its kind is at rest.
_AT_REST = 1e-9
_PARTED = 0.1  # difference over the peak-to-peak from which on two runs are different motions


@dataclass(frozen=True)
class _Judged:
    """One sensor, body or joint: where its components stand in a table of the rows."""

    name: str
    quantity: str
    unit: str
    table: str
    columns: tuple[int, ...]


@dataclass(frozen=True)
class ErrorOf:
    """The largest error of one quantity."""

    error: float  # over the peak-to-peak of the sensor
    name: str  # of the sensor, body or joint
    time: float  # s, at which it is largest


class MeasuredError:
    """Differences of two runs of one model at the same outputs; fed in order.

    Parameters
    ----------
    layout, model : Layout, Model
        Names of channels, and sensors with their units. Bodies are judged where nothing senses a
        position or a velocity.
    least : mapping of str to float, optional
        Motion by unit below which a sensor counts as at rest.
    """

    def __init__(
        self, layout: Layout, model: Model, least: Mapping[str, float] | None = None
    ) -> None:
        self._judged = _judged(layout, model)
        self._least = least or {}
        n = len(self._judged)
        self._count = np.array([0, 0, 1])  # rows so far, samples of the growth, rows for each
        self._largest = np.zeros((2, n))  # difference so far; its time
        widest = max((len(one.columns) for one in self._judged), default=0)
        self._range = np.stack([np.full((n, widest), np.inf), np.full((n, widest), -np.inf)])
        self._places = [k for k, one in enumerate(self._judged) if one.quantity == "positions"]
        self._growth = np.full((_SAMPLES, 1 + len(self._places)), np.nan)  # time, of positions

    def arrays(self) -> dict[str, np.ndarray]:
        """All that is known so far, to be kept and filled in again."""
        return {
            "error_count": self._count, "error_largest": self._largest, "error_range": self._range,
            "error_growth": self._growth,
        }  # fmt: skip

    def add(self, coarse: OutputBlock, fine: OutputBlock) -> None:
        """Take in the same rows of both runs, as far as both have them (SI).

        Parameters
        ----------
        coarse, fine : OutputBlock
            Rows (k, ...) of the scout and of the run that is kept.
        """
        n = min(len(fine.t), len(coarse.t))
        if n == 0:
            return
        gaps = np.zeros((n, len(self._judged)))
        for k, one in enumerate(self._judged):
            columns = list(one.columns)
            ours, theirs = (getattr(rows, one.table)[:n][:, columns] for rows in (fine, coarse))
            gaps[:, k] = np.abs(ours - theirs).max(axis=1, initial=0.0)
            low, high = self._range[:, k, : len(columns)]
            np.minimum(low, ours.min(axis=0), out=low)
            np.maximum(high, ours.max(axis=0), out=high)
        gaps[np.isnan(gaps)] = np.inf  # nothing is known then
        so_far = np.maximum.accumulate(np.vstack([self._largest[0], gaps]), axis=0)[1:]
        rises = so_far[-1] > self._largest[0]
        self._largest[1, rises] = fine.t[gaps.argmax(axis=0)][rises]
        self._largest[0] = so_far[-1]
        row, count = 0, self._count
        while row < n:
            skipped = min(int(-count[0] % count[2]), n - row)
            count[0] += skipped
            row += skipped
            if row < n:
                self._sample(fine.t[row], so_far[row, self._places])
                row += 1

    def _sample(self, t: float, differences: Array) -> None:
        """Keep the differences so far at every row, then at every second, ..."""
        count = self._count
        if count[0] % count[2] == 0:
            if count[1] == _SAMPLES:
                self._growth[: _SAMPLES // 2] = self._growth[::2].copy()
                self._growth[_SAMPLES // 2 :] = np.nan
                count[1], count[2] = _SAMPLES // 2, 2 * count[2]
            if count[0] % count[2] == 0:
                self._growth[count[1]] = t, *differences
                count[1] += 1
        count[0] += 1

    def largest(self, ratio: float) -> dict[str, ErrorOf]:
        """The largest error of each quantity; `ratio` is that of the errors of the two runs."""
        spans, found = self._spans(), dict[str, ErrorOf]()
        for k, one in enumerate(self._judged):
            apart = self._largest[0, k] / spans[k] if spans[k] > 0.0 else 0.0
            # once the runs have parted, the finer one is no better than the other
            error = apart if apart > _PARTED else apart / (max(ratio, 1.0 + 1e-9) - 1.0)
            if one.quantity not in found or error > found[one.quantity].error:
                found[one.quantity] = ErrorOf(float(error), one.name, float(self._largest[1, k]))
        return found

    def reached_until(self, accuracy: float) -> float:
        """Time from which on the runs' positions are apart by more; infinite: never [s]."""
        spans, until = self._spans(), np.inf
        for column, k in enumerate(self._places, start=1):
            if spans[k] == 0.0:
                continue
            beyond = np.flatnonzero(self._growth[:, column] > accuracy * spans[k])
            if len(beyond):
                until = min(until, float(self._growth[beyond[0], 0]))
            elif self._largest[0, k] > accuracy * spans[k]:
                until = min(until, float(self._largest[1, k]))
        return until

    def _spans(self) -> Array:
        """Peak-to-peak of each; 0 for what is at rest beside others of its unit."""
        low, high = self._range
        spans = np.where(np.isfinite(low), high - low, 0.0).max(axis=1, initial=0.0)
        units = np.array([one.unit for one in self._judged])
        for unit in set(units):
            same = units == unit
            least = max(_AT_REST * spans[same].max(), self._least.get(unit, 0.0))
            spans[same & (spans <= least)] = 0.0
        return np.asarray(spans)


def _judged(layout: Layout, model: Model) -> list[_Judged]:
    """Sensors by what they measure, bodies where nothing is sensed, and joints."""
    column = {channel: k for k, channel in enumerate(layout.channels)}
    owners: dict[str, Spec] = {**model.sensors, **model.states, **model.controllers}
    judged = []
    for name, spec in owners.items():
        unit = unit_of(vars(spec)) or ""
        columns = tuple(column[c] for c in channels_of(name, spec) if c in column)
        if columns:
            judged.append(_Judged(name, QUANTITIES.get(unit, unit), unit, "sensors", columns))
    known = {one.quantity for one in judged}
    for body in layout.bodies:
        for quantity, unit, table, first, n in (
            ("positions", "m", "q", body.iq, 3), ("positions", "rad", "q", body.iq + 3, 4),
            ("velocities", "m/s", "v", body.iv, 3), ("velocities", "rad/s", "v", body.iv + 3, 3),
        ):  # fmt: skip
            if quantity not in known:
                columns = tuple(range(first, first + n))
                judged.append(_Judged(f"bodies.{body.name}", quantity, unit, table, columns))
    for k, name in enumerate(layout.reactions):
        for unit, first in (("N", 12 * k), ("N m", 12 * k + 3)):
            columns = (first, first + 1, first + 2)
            judged.append(_Judged(name, "reactions", unit, "reactions", columns))
    return judged
