"""Errors of a run against another one: the largest over the outputs, over the peak-to-peak.

In: results of the same machine. Out: per quantity one number and the name of the sensor or joint it
comes from. A sensor's components share one scale, the largest peak-to-peak among them, so that a
component that hardly moves counts for what it is. The scale of a reaction is that of its joint or
driver, at least a hundredth of the largest force (or moment) in the machine. What stands still is
left out. Energy is judged by its own balance, constraints by their own drift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.studies.sensing import History, histories
from flexmb.studies.store import result_of

if TYPE_CHECKING:
    from flexmb.model import Model

__all__ = ["COMPARED", "Difference", "Reading", "difference", "own_errors", "read_run"]

COMPARED = ("positions", "velocities", "accelerations", "reactions")
"""Quantities whose error is the distance from a reference."""

_STILL = 1e-9  # of the largest peak-to-peak of the same unit: what moves less stands still
_SMALL_REACTION = 0.01  # of the largest one of the same unit: the least scale of a reaction


class Difference(NamedTuple):
    """The largest difference of a quantity over its scale, and where it is."""

    value: float
    where: str


class Reading(NamedTuple):
    """What a run has of the quantities that are compared, and how large its histories are."""

    histories: list[History]
    scales: list[float]  # 0: stands still


def read_run(model: Model, folder: Path, asked: Sequence[str]) -> Reading:
    """The histories of a run.

    Raises
    ------
    ResultFileError
        Its result is gone or damaged.
    """
    from flexmb.results import Result

    found = histories(model, Result(result_of(folder)), asked)
    return Reading(found, _scales(found))


def _scales(found: Sequence[History]) -> list[float]:
    own = [float(np.ptp(one.values, axis=0).max(initial=0.0)) for one in found]
    largest: dict[tuple[str, str], float] = {}
    for one, size in zip(found, own, strict=True):
        kind = one.quantity, one.unit
        largest[kind] = max(largest.get(kind, 0.0), size)
    scales = []
    for one, size in zip(found, own, strict=True):
        most = largest[one.quantity, one.unit]
        still = size <= _STILL * most
        least = _SMALL_REACTION * most if one.quantity == "reactions" else 0.0
        scales.append(0.0 if still else max(size, least))
    return scales


def difference(run: Reading, truth: Reading) -> dict[str, Difference]:
    """Distance of a run from another one by quantity."""
    worst: dict[str, Difference] = {}
    for mine, other, scale in zip(run.histories, truth.histories, truth.scales, strict=True):
        if scale == 0.0:
            continue
        error = float(np.abs(mine.values - other.values).max(initial=0.0)) / scale
        if mine.quantity not in worst or error > worst[mine.quantity].value:
            worst[mine.quantity] = Difference(error, mine.name)
    return {name: worst[name] for name in COMPARED if name in worst}


def own_errors(statistics: Mapping[str, Any]) -> dict[str, float]:
    """What a run says about itself: mismatch of energy and work, violation of the constraints."""
    names = {"energy": "energy_balance_error", "drift": "largest_position_drift"}
    return {name: float(statistics[key]) for name, key in names.items() if key in statistics}
