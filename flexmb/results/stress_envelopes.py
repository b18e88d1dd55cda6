"""Envelopes of stress over a run, and its hot spots; rows are read as they are needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.flexbody import principal_stresses, von_mises
from flexmb.results.recovery import Recovery, labels

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class PeakStress(NamedTuple):
    """The largest von Mises stress at each place over a run, and when, in the scene's units."""

    values: Array  # (k,)
    time: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]

    @property
    def place(self) -> int:
        """Row of the place with the largest stress of all."""
        return int(np.argmax(self.values))


class StressEnvelope(NamedTuple):
    """Largest and least stress at each place over a run, and when, in the scene's units."""

    largest: Array  # (k,) von Mises, or the largest principal stress
    least: Array  # (k,) the least von Mises, or the least principal stress
    time_of_largest: Array  # (k,)
    time_of_least: Array  # (k,)
    node: IntArray  # (k,)
    layer: tuple[str, ...]
    part: tuple[str, ...]


class HotSpot(NamedTuple):
    """A place where the von Mises stress is largest over a run among all near it."""

    value: float  # in the scene's units
    time: float
    node: int
    layer: str
    part: str
    position: tuple[float, float, float]  # body axes


def _principal_pair(stress: Array) -> tuple[Array, Array]:
    values = principal_stresses(stress)
    return values[..., 0], values[..., 2]


_ENVELOPES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "von_mises": lambda stress: (von_mises(stress),) * 2,
    "principal": _principal_pair,
}
"""What is largest and what is least of a stress."""


class StressEnvelopes(Recovery):
    """Largest stresses over a run, where and when; see `Result`."""

    def peak_von_mises(
        self, body: str, *, layer: str | None = None, mode_acceleration: bool = False
    ) -> PeakStress:
        """The largest von Mises stress over the run at each place, and when.

        Parameters
        ----------
        body : str
            Name of the body.
        layer : str, optional
            Such as ``"top"``; all by default.
        mode_acceleration : bool
            As for `stress`.

        Returns
        -------
        PeakStress
            Also `place`, the row of the largest of all.

        Raises
        ------
        ResultFileError
            No such body or layer, a body without stress, or a result without rows.
        """
        one = self.stress_envelope(body, layer=layer, mode_acceleration=mode_acceleration)
        return PeakStress(one.largest, one.time_of_largest, one.node, one.layer, one.part)

    def stress_envelope(
        self,
        body: str,
        quantity: str = "von_mises",
        *,
        layer: str | None = None,
        mode_acceleration: bool = False,
    ) -> StressEnvelope:
        """Largest and least stress over the run at each place, and when; rows are read as needed.

        Parameters
        ----------
        body : str
            Name of the body.
        quantity : {"von_mises", "principal"}
            Of principal stresses the largest and the least.
        layer, mode_acceleration
            As for `stress`.

        Raises
        ------
        ResultFileError
            As `stress`, and an unknown quantity.
        """
        if quantity not in _ENVELOPES:
            what = f'no envelope of "{quantity}"'
            raise ResultFileError.unknown(what, quantity, _ENVELOPES)
        modes, rows = self.stress_places(body, None, layer)
        values = np.stack([np.full(len(rows), -np.inf), np.full(len(rows), np.inf)])
        when = np.zeros((2, len(rows)), dtype=int)
        for part, stress in self._stresses(body, modes, rows, None, mode_acceleration):
            pair = _ENVELOPES[quantity](stress)
            for side, (series, pick) in enumerate(zip(pair, (np.argmax, np.argmin), strict=True)):
                best = pick(series, axis=0)
                extreme = series[best, np.arange(len(rows))]
                better = extreme > values[0] if side == 0 else extreme < values[1]
                values[side, better] = extreme[better]
                when[side, better] = best[better] + (part.start or 0)
        largest, least = (self.in_scene_units(side, "Pa") for side in values)
        return StressEnvelope(
            largest, least, self.time[when[0]], self.time[when[1]], *labels(modes, rows)
        )

    def hot_spots(
        self,
        body: str,
        count: int = 10,
        *,
        distance: float | None = None,
        layer: str | None = None,
        mode_acceleration: bool = False,
    ) -> list[HotSpot]:
        """Where the von Mises stress is largest over the run, each the largest around it.

        Parameters
        ----------
        body : str
            Name of the body.
        count : int
            At most so many.
        distance : float, optional
            Between two of them, in the scene's units; a twentieth of the body's size by default.
        layer, mode_acceleration
            As for `stress`.
        """
        peak = self.peak_von_mises(body, layer=layer, mode_acceleration=mode_acceleration)
        nodes = self.flexbody(body).nodes
        assert nodes is not None  # stress is at nodes
        places = nodes.position[np.searchsorted(nodes.ids, peak.node)]
        gap = 0.05 * float(np.linalg.norm(np.ptp(nodes.position, axis=0)))
        if distance is not None:
            gap = distance * self.units.scale("m")
        spots: list[HotSpot] = []
        open_places = np.ones(len(peak.values), dtype=bool)
        while len(spots) < count and open_places.any():
            k = int(np.flatnonzero(open_places)[peak.values[open_places].argmax()])
            position = self.in_scene_units(places[k].copy(), "m")
            spots.append(
                HotSpot(
                    float(peak.values[k]), float(peak.time[k]), int(peak.node[k]), peak.layer[k],
                    peak.part[k], (float(position[0]), float(position[1]), float(position[2])),
                )
            )  # fmt: skip
            open_places &= np.linalg.norm(places - places[k], axis=1) > gap
        return spots
