"""Errors of a run against another run: the largest difference at outputs over the peak-to-peak.

In: a model and results of its runs. Out: histories of sensors, joints and drivers; for each
quantity one error, and the name of the sensor or joint where it occurs.

The components of a sensor have a common scale, the largest peak-to-peak among them, so that a
component that hardly moves has little weight. The scale of a reaction is that of its joint or
driver, but at least a hundredth of the largest force (or moment) in the machine. Histories that
stand still are left out. Energy is measured by its own balance, constraints by their own drift. If
a scene has a position sensor but no velocity sensor of the same marker, the study adds one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import QUANTITIES
from flexmb.errors import SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.reading import Spec
from flexmb.model.sensor import channels_of, unit_of

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result

COMPARED = ("positions", "velocities", "accelerations", "reactions")
"""Quantities whose error is the difference from a reference."""

_DEFAULT_QUANTITY = "positions"  # for sensors of states and expressions
# types of sensors; every study computes these quantities anyway
_ON_REQUEST = ("energy", "reaction")
_VELOCITY_SUFFIX = "_velocity"  # suffix of the names of sensors that the study adds
# peak-to-peak over the largest of the same unit, below which a history stands still
_STANDSTILL = 1e-9
_SMALL_REACTION = 0.01  # least scale of a reaction over the largest one of the same unit


class History(NamedTuple):
    """One sensor, joint or driver over the outputs."""

    quantity: str  # positions, velocities, accelerations, reactions
    name: str
    unit: str  # histories of the same unit may be compared in size
    values: Array  # (rows, components)


class Difference(NamedTuple):
    """The largest difference of a quantity over its scale, and where it occurs."""

    value: float
    where: str


class RunHistories(NamedTuple):
    """The histories of a run to be compared, and their scales."""

    histories: list[History]
    scales: list[float]  # 0: the history stands still


def error_text(value: float) -> str:
    """An error with two digits: ``1.5e-6``."""
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa


def add_velocity_sensors(scene: Mapping[str, Any]) -> dict[str, Any]:
    """The scene with a velocity sensor added for each position sensor that has none."""
    sensors = dict(scene.get("sensors", {}))
    tables = {name: table for name, table in sensors.items() if isinstance(table, Mapping)}
    targets = [_target(table) for table in tables.values() if table.get("type") == "velocity"]
    for name, table in tables.items():
        if table.get("type") == "position" and _target(table) not in targets:
            new_name = f"{name}{_VELOCITY_SUFFIX}"
            while new_name in sensors:
                new_name += "_"
            sensors[new_name] = {**table, "type": "velocity"}
            targets.append(_target(table))
    return {**scene, "sensors": sensors} if sensors else dict(scene)


def _target(table: Mapping[str, Any]) -> tuple[Any, Any]:
    return table.get("of"), table.get("relative_to")


def check_sensors(model: Model, names: Sequence[str]) -> None:
    """Refuse a study that has no position for comparison.

    Raises
    ------
    SceneError
        The scene has no sensors of positions or angles, or none of them is among `names`.
    """
    if any(_quantity(model, name) == "positions" for name in _select_channels(model, names)):
        return
    if names:
        raise SceneError(
            f"study.sensors: none of {', '.join(names)} is a position or an angle, which "
            "errors are judged by"
        )
    raise SceneError(
        "the scene has no sensor of a position or an angle to judge errors by; add one, such as\n"
        f'    [sensors.place]\n    type = "position"\n    of = "{next(iter(model.bodies), "body")}"'
    )


def _owners(model: Model) -> dict[str, Spec]:
    return {**model.sensors, **model.states, **model.controllers}


def _quantity(model: Model, name: str) -> str:
    return QUANTITIES.get(unit_of(vars(_owners(model)[name])) or "", _DEFAULT_QUANTITY)


def _select_channels(model: Model, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Channels by sensor; the velocity that belongs to a position is added."""
    selected: dict[str, tuple[str, ...]] = {}
    for name, spec in _owners(model).items():
        channels = channels_of(name, spec)
        if not names and getattr(spec, "type", "") in _ON_REQUEST:
            continue
        if names and name not in names:
            channels = tuple(channel for channel in channels if channel in names)
        if channels:
            selected[name] = channels
    for name in list(selected):
        selected |= _velocity_channels(model, name, selected[name])
    return selected


def _velocity_channels(
    model: Model, name: str, channels: Iterable[str]
) -> dict[str, tuple[str, ...]]:
    spec: Any = model.sensors.get(name)
    if spec is None or spec.type != "position":
        return {}
    axes = [channel.rpartition(".")[2] for channel in channels]
    for other, candidate in model.sensors.items():
        target = (getattr(candidate, "of", None), getattr(candidate, "relative_to", None))
        if candidate.type == "velocity" and target == (spec.of, spec.relative_to):
            return {other: tuple(f"{other}.{axis}" for axis in axes)}
    return {}


def read_run(model: Model, result_file: Path, names: Sequence[str]) -> RunHistories:
    """The histories of a run: sensors of these names (all if none are given), and reactions.

    Raises
    ------
    ResultFileError
        Its result is gone or damaged.
    """
    from flexmb.results import Result

    result = Result(result_file)
    histories = []
    for name, channels in _select_channels(model, names).items():
        unit = model.channel_unit(channels[0]) or ""
        values = np.stack([result[channel] for channel in channels], axis=1)
        sensor = name.removesuffix(_VELOCITY_SUFFIX)
        histories.append(History(_quantity(model, name), sensor, unit, values))
    histories += _reactions(model, result)
    places = [result.part("q", slice(b.iq, b.iq + 3)) for b in result.layout.bodies]
    length = float(np.ptp(np.vstack(places), axis=0).max()) if places else 0.0
    return RunHistories(histories, _scales(histories, length))


def _reactions(model: Model, result: Result) -> list[History]:
    """Multipliers of each joint and driver; forces and moments separately."""
    columns: dict[tuple[str, str], list[int]] = {}
    for i, row in enumerate(result.layout.rows):
        owner, _, what = row.partition(": ")
        columns.setdefault((owner, _reaction_unit(model, owner, what)), []).append(i)
    lam = result.lam
    return [
        History("reactions", owner.partition(".")[2], unit, lam[:, indices])
        for (owner, unit), indices in columns.items()
    ]


def _reaction_unit(model: Model, owner: str, what: str) -> str:
    if what.startswith("driven"):
        driver = model.drivers[owner.partition(".")[2]]
        coordinate = driver.coordinate if what == "driven" else what.removeprefix("driven ")
        return "N m" if coordinate == "angle" else "N"
    return "N" if what.startswith(("place", "offset")) else "N m"


def _scales(histories: Sequence[History], length: float = 0.0) -> list[float]:
    """The scale of each history. It is 0 (standstill) also for moments that are round-off of the
    forces in a machine of this length [m], and for forces that are round-off of moments."""
    sizes = [float(np.ptp(one.values, axis=0).max(initial=0.0)) for one in histories]
    largest: dict[tuple[str, str], float] = {}
    for one, size in zip(histories, sizes, strict=True):
        kind = one.quantity, one.unit
        largest[kind] = max(largest.get(kind, 0.0), size)
    forces, moments = (largest.get(("reactions", unit), 0.0) for unit in ("N", "N m"))
    least_of = {"N m": _STANDSTILL * forces * length}
    least_of["N"] = _STANDSTILL * moments / length if length > 0.0 else 0.0
    scales = []
    for one, size in zip(histories, sizes, strict=True):
        rest = least_of.get(one.unit, 0.0) if one.quantity == "reactions" else 0.0
        most = largest[one.quantity, one.unit]
        least = _SMALL_REACTION * most if one.quantity == "reactions" else 0.0
        scales.append(0.0 if size <= max(_STANDSTILL * most, rest) else max(size, least))
    return scales


def difference(run: RunHistories, reference: RunHistories) -> dict[str, Difference]:
    """Largest difference of a run from a reference, by quantity."""
    worst: dict[str, Difference] = {}
    pairs = zip(run.histories, reference.histories, reference.scales, strict=True)
    for mine, other, scale in pairs:
        if scale == 0.0:
            continue
        error = float(np.abs(mine.values - other.values).max(initial=0.0)) / scale
        if mine.quantity not in worst or error > worst[mine.quantity].value:
            worst[mine.quantity] = Difference(error, mine.name)
    return {name: worst[name] for name in COMPARED if name in worst}


def read_statistics(data: Any) -> dict[str, Any]:
    """The statistics of a run from a record that may be damaged.

    Raises
    ------
    TypeError, ValueError
        They are not statistics.
    """
    statistics = dict(data)
    for name, value in statistics.items():
        if name.startswith(("seconds_", "energy_", "largest_")):
            float(value)
    return statistics


def own_errors(statistics: Mapping[str, Any]) -> dict[str, float]:
    """Errors in the statistics of a run: energy balance, drift of the constraints."""
    names = {"energy": "energy_balance_error", "drift": "largest_position_drift"}
    return {name: float(statistics[key]) for name, key in names.items() if key in statistics}
