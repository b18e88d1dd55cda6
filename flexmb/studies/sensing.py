"""What a study looks at: positions and velocities of sensors, reactions of joints and drivers.

In: a scene, or a model and the result of its run. Out: histories by quantity and name. Where a
scene senses a position and not the velocity of the same marker, the study adds that sensor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.measured_error import QUANTITIES
from flexmb.errors import SceneError
from flexmb.model.sensors.sensor import channels_of, unit_of
from flexmb.model.values.reading import Spec

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.results import Result

__all__ = ["History", "check_sensors", "histories", "with_velocities"]

Array = NDArray[np.float64]
_OTHERS = "positions"  # a number that a state or an expression gives is judged as strictly
_NOT_JUDGED = ("energy", "reaction")  # unless asked for: these a study has anyhow
_ADDED = "_velocity"  # what the name of an added sensor ends with


class History(NamedTuple):
    """One sensor, joint or driver over the outputs."""

    quantity: str  # positions, velocities, accelerations, reactions
    name: str
    unit: str  # histories of the same unit may be compared in size
    values: Array  # (rows, components)


def with_velocities(scene: Mapping[str, Any]) -> dict[str, Any]:
    """The scene with a velocity sensor for each position sensor that has none."""
    sensors = dict(scene.get("sensors", {}))
    tables = {name: table for name, table in sensors.items() if isinstance(table, Mapping)}
    sensed = [_target(table) for table in tables.values() if table.get("type") == "velocity"]
    for name, table in tables.items():
        if table.get("type") == "position" and _target(table) not in sensed:
            added = f"{name}{_ADDED}"
            while added in sensors:
                added += "_"
            sensors[added] = {**table, "type": "velocity"}
            sensed.append(_target(table))
    return {**scene, "sensors": sensors} if sensors else dict(scene)


def _target(table: Mapping[str, Any]) -> tuple[Any, Any]:
    return table.get("of"), table.get("relative_to")


def check_sensors(model: Model, asked: Sequence[str]) -> None:
    """Refuse a study that would have no position to judge by.

    Raises
    ------
    SceneError
        The scene has no sensors of positions or angles, or none of them was asked for.
    """
    chosen = _chosen(model, asked)
    if any(_quantity(model, name) == "positions" for name in chosen):
        return
    if asked:
        raise SceneError(
            f"study.sensors: none of {', '.join(asked)} is a position or an angle; the errors of "
            "positions are what a study starts from"
        )
    raise SceneError(
        "the scene has no sensor of a position or an angle to judge a study by; add one, such as\n"
        f'    [sensors.place]\n    type = "position"\n    of = "{next(iter(model.bodies), "body")}"'
    )


def _quantity(model: Model, name: str) -> str:
    """What the channels of a sensor, state or controller are judged as."""
    owners: dict[str, Spec] = {**model.sensors, **model.states, **model.controllers}
    return QUANTITIES.get(unit_of(vars(owners[name])) or "", _OTHERS)


def _chosen(model: Model, asked: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Channels by sensor; with a position its velocity is chosen too."""
    chosen: dict[str, tuple[str, ...]] = {}
    owners: dict[str, Spec] = {**model.sensors, **model.states, **model.controllers}
    for name, spec in owners.items():
        channels = channels_of(name, spec)
        if not asked and getattr(spec, "type", "") in _NOT_JUDGED:
            continue
        if asked and name not in asked:
            channels = tuple(channel for channel in channels if channel in asked)
        if channels:
            chosen[name] = channels
    for name in list(chosen):
        chosen |= _rates(model, name, chosen[name])
    return chosen


def _rates(model: Model, name: str, channels: Iterable[str]) -> dict[str, tuple[str, ...]]:
    spec: Any = model.sensors.get(name)
    if spec is None or spec.type != "position":
        return {}
    axes = [channel.rpartition(".")[2] for channel in channels]
    for other, candidate in model.sensors.items():
        same = (getattr(candidate, "of", None), getattr(candidate, "relative_to", None))
        if candidate.type == "velocity" and same == (spec.of, spec.relative_to):
            return {other: tuple(f"{other}.{axis}" for axis in axes)}
    return {}


def histories(model: Model, result: Result, asked: Sequence[str]) -> list[History]:
    """All that is judged, over the outputs of a run."""
    found = []
    for name, channels in _chosen(model, asked).items():
        unit = model.channel_unit(channels[0]) or ""
        values = np.stack([result[channel] for channel in channels], axis=1)
        found.append(History(_quantity(model, name), name.removesuffix(_ADDED), unit, values))
    return found + _reactions(model, result)


def _reactions(model: Model, result: Result) -> list[History]:
    """Multipliers of each joint and driver, forces and moments apart."""
    columns: dict[tuple[str, str], list[int]] = {}
    for i, row in enumerate(result.layout.rows):
        owner, _, what = row.partition(": ")
        columns.setdefault((owner, _unit(model, owner, what)), []).append(i)
    lam = result.lam
    return [
        History("reactions", owner.partition(".")[2], unit, lam[:, places])
        for (owner, unit), places in columns.items()
    ]


def _unit(model: Model, owner: str, what: str) -> str:
    if what.startswith("driven"):
        driver = model.drivers[owner.partition(".")[2]]
        coordinate = driver.coordinate if what == "driven" else what.removeprefix("driven ")
        return "N m" if coordinate == "angle" else "N"
    return "N" if what.startswith(("place", "offset")) else "N m"
