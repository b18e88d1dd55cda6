"""Sensors: what a run records, by channel.

Position, velocity and acceleration of a marker, absolute or relative to another one, in global
axes: channels ``name.x``, ``name.y``, ``name.z``. Angle [rad] of a joint, or between two markers
about an axis: channel ``name``, within ±pi at the start and continuous from there on, over any
number of turns. `CHANNEL_UNITS` says in what each kind is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.quantities import Axis, Pair, Text
from flexmb.model.reading import Spec, fail

__all__ = [
    "CHANNEL_UNITS",
    "SENSOR_TYPES",
    "AngleSensorSpec",
    "MarkerSensorSpec",
    "channel_unit",
    "channels_of",
]


class MarkerSensorSpec(Spec):
    """Motion of the marker ``of``, less that of ``relative_to``; components in global axes."""

    type: Literal["position", "velocity", "acceleration"]
    of: Text
    relative_to: Text | None = None


class AngleSensorSpec(Spec):
    """Angle of a joint, or from marker I to J about ``axis`` (as for joints).

    Within ±pi at the start and continuous from there on.
    """

    type: Literal["angle"]
    joint: Text | None = None
    between: Pair | None = None
    axis: Axis | None = None

    @model_validator(mode="after")
    def _joint_or_markers(self) -> Self:
        if (self.joint is None) == (self.between is None):
            raise fail(Problem("", 'give either "joint" or "between" (with "axis")'))
        if self.joint is not None and self.axis is not None:
            raise fail(Problem("axis", "is the joint's own; leave it out"))
        return self


SENSOR_TYPES: dict[str, type[Spec]] = {
    "position": MarkerSensorSpec,
    "velocity": MarkerSensorSpec,
    "acceleration": MarkerSensorSpec,
    "angle": AngleSensorSpec,
}


CHANNEL_UNITS = {"position": "m", "velocity": "m/s", "acceleration": "m/s^2", "angle": "rad"}
"""SI unit of the channels of every sensor type."""


def channel_unit(types: Mapping[str, str], channel: str) -> str | None:
    """SI unit of a channel, from the type of every sensor by name; None for an unknown sensor."""
    name = channel if channel in types else channel.rpartition(".")[0]
    return CHANNEL_UNITS.get(types.get(name, ""))


def channels_of(name: str, sensor: Spec) -> tuple[str, ...]:
    """Names of the channels a sensor writes."""
    if isinstance(sensor, MarkerSensorSpec):
        return tuple(f"{name}.{axis}" for axis in "xyz")
    return (name,)
