"""Motions that grow exponentially beyond all bounds, such as those of an unstable controller.

In: rows of a run, in order. Out: the name of what grows, with its rate. What counts as growing is
larger than anything in the scene explains, and has become so by the same large factor again and
again: no power of time does that (a fall, a rocket, a rotor that spins up), no planned motion that
ends, and no pendulum that leaves its upper rest, which stops growing at the energy it has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.model.model import Model
from flexmb.model.sensors.channels import feedback_functions
from flexmb.results import OutputBlock

__all__ = ["Growth"]

_SAMPLES = 256  # times at which the largest values so far are kept
# The second half of the run so far is looked at in so many parts. In each of them the largest value
# grows by this factor at least: powers of time up to the eighth do not.
_PARTS, _FACTOR = 4, 3.0
# From which on a value is beyond what a scene explains: translations over the size of the model,
# deformations over it, states over their scale, turns of a body within one part, rad.
_FAR, _DEFORMED, _LARGE, _TURNS = 100.0, 1.0, 1e6, 1e3
_TENFOLD = math.log(10.0)


@dataclass(frozen=True)
class _Quantity:
    """What may grow: columns of a table, their weights, and the bound."""

    name: str
    table: str
    columns: slice
    weights: np.ndarray
    bound: float
    of_start: bool = False  # whether it is the distance from the first value
    rate: bool = False  # whether the bound is one of value times the length of a part


class Growth:
    """Watches the rows of a run.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    """

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self.ends_run = any(where.startswith("forces.") for where, _ in feedback_functions(model))
        self._units = model.units
        self._quantities = _quantities(compiled)
        n = len(self._quantities)
        self._first: list[np.ndarray] = []
        self._largest = np.zeros(n)
        self._history = np.zeros((_SAMPLES, 1 + n))  # time and largest values so far
        self._count, self._every, self._rows = 0, 1, 0
        self.sentence = ""

    def add(self, rows: OutputBlock) -> None:
        """Take in further rows; `sentence` then names what grows, if anything does."""
        if not len(rows.t) or self.sentence:
            return
        values = self._values(rows)
        so_far = np.maximum.accumulate(np.vstack([self._largest, values]), axis=0)[1:]
        row = -self._rows % self._every
        while row < len(rows.t):
            self._sample(float(rows.t[row]), so_far[row])
            row += self._every - (self._rows + row) % self._every
        self._rows += len(rows.t)
        self._largest = so_far[-1]
        self._look()

    def _values(self, rows: OutputBlock) -> np.ndarray:
        """(k, quantities) sizes, over what they count for."""
        parts = [getattr(rows, q.table)[:, q.columns] for q in self._quantities]
        if not self._first:
            of_start = [q.of_start for q in self._quantities]
            self._first = [part[0] * yes for part, yes in zip(parts, of_start, strict=True)]
        sizes = [
            (np.abs(part - first) * q.weights).max(axis=1, initial=0.0)
            for part, first, q in zip(parts, self._first, self._quantities, strict=True)
        ]
        return np.stack(sizes, axis=1) if sizes else np.zeros((len(rows.t), 0))

    def _sample(self, t: float, largest: np.ndarray) -> None:
        """Keep every row, then every second one, ..."""
        if self._count == _SAMPLES:
            self._history[: _SAMPLES // 2] = self._history[::2].copy()
            self._count, self._every = _SAMPLES // 2, 2 * self._every
        self._history[self._count] = t, *largest
        self._count += 1

    def _look(self) -> None:
        """Compare the largest values at the ends of the parts."""
        known = self._history[: self._count]
        known = known[np.isfinite(known).all(axis=1)]
        if not len(known):
            return
        begin, now = known[0, 0], known[-1, 0]
        part = (now - begin) / (2 * _PARTS)
        at = np.searchsorted(known[:, 0], now - part * np.arange(_PARTS, -1, -1))
        at = np.minimum(at, len(known) - 1)
        if len(np.unique(at)) <= _PARTS:
            return
        values = known[at, 1:]
        grows = (values[1:] >= _FACTOR * values[:-1]).all(axis=0) & (values[0] > 0.0)
        for k in np.flatnonzero(grows):
            q = self._quantities[k]
            if values[-1, k] * (part if q.rate else 1.0) > q.bound:
                span = float(known[at[-1], 0] - known[at[0], 0])
                rate = float(np.log(values[-1, k] / values[0, k])) / span
                self.sentence = self._told(q.name, float(now), rate)
                return

    def _told(self, name: str, t: float, rate: float) -> str:
        at, tenfold = self._units.say(t, "s", 4), self._units.say(_TENFOLD / rate, "s", 3)
        return (
            f"{name} grows without bound at t = {at}, by a factor of ten every {tenfold}: the "
            "motion is unstable; check the signs and gains of what follows a measured quantity, "
            "and of stiffness and damping"
        )


def _quantities(compiled: Compiled) -> list[_Quantity]:
    """Translations, turning and deformation of all bodies, and states."""
    layout, weights = compiled.layout, compiled.system.weights
    found = []
    for body in layout.bodies:
        iq, iv, m, name = body.iq, body.iv, body.m, f"bodies.{body.name}"
        one = np.ones(3)
        w = weights[iv : iv + 6 + m]
        found.append(_Quantity(name, "q", slice(iq, iq + 3), w[:3], _FAR, of_start=True))
        turning = f"the angular velocity of {name}"
        found.append(_Quantity(turning, "v", slice(iv + 3, iv + 6), one, _TURNS, rate=True))
        if m:
            deformation = f"the deformation of {name}"
            found.append(_Quantity(deformation, "q", slice(iq + 7, iq + 7 + m), w[6:], _DEFORMED))
    first = layout.nv - len(layout.coordinates)
    for k, name in enumerate(layout.coordinates):
        if name.startswith("states."):
            column = slice(first + k, first + k + 1)
            found.append(_Quantity(name, "v", column, weights[column], _LARGE))
    return found
