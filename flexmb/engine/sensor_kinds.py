"""The registries of sensors: measures, which terms are of, and kinds of channels, with numbers.

The number of a measure stands in `sensor_tables.TERM`, that of a kind of channel in `CHANNEL`.
"""

from __future__ import annotations

from flexmb.engine.kernels.sensors import channel, motion, row_measure, turning
from flexmb.engine.kind import ChannelKind, Measure

__all__ = [
    "ACCELERATION", "ANGULAR_ACCELERATION", "ANGULAR_VELOCITY", "BODY_ENERGY", "CHANNEL_KINDS",
    "COORDINATE", "COORDINATE_ACCELERATION", "COORDINATE_RATE", "ENERGY", "EXPRESSION",
    "JOINT_ANGLE", "MEASURES", "PLACE", "PLACE_RATE", "POSITION", "STATE", "SUM", "TURNING_ANGLE",
    "TURNING_CHANNEL", "TURNING_OF_AXES", "VELOCITY", "WRENCH",
]  # fmt: skip

MEASURES: list[Measure] = []
"""All measures, by number."""

CHANNEL_KINDS: list[ChannelKind] = []
"""All kinds of channels, by number."""


def _measure(measure: Measure) -> int:
    """The number of one more measure."""
    MEASURES.append(measure)
    return len(MEASURES) - 1


def _channel(kind: ChannelKind) -> int:
    """The number of one more kind of channel."""
    CHANNEL_KINDS.append(kind)
    return len(CHANNEL_KINDS) - 1


COORDINATE = _measure(row_measure.COORDINATE)
COORDINATE_RATE = _measure(row_measure.COORDINATE_RATE)
COORDINATE_ACCELERATION = _measure(row_measure.COORDINATE_ACCELERATION)
POSITION = _measure(motion.POSITION)
VELOCITY = _measure(motion.VELOCITY)
ACCELERATION = _measure(motion.ACCELERATION)
ANGULAR_VELOCITY = _measure(motion.ANGULAR_VELOCITY)
ANGULAR_ACCELERATION = _measure(motion.ANGULAR_ACCELERATION)
TURNING_OF_AXES = _measure(motion.TURNING_OF_AXES)
TURNING_ANGLE = _measure(turning.TURNING_ANGLE)

SUM = _channel(channel.SUM)
JOINT_ANGLE = _channel(row_measure.JOINT_ANGLE)
TURNING_CHANNEL = _channel(turning.TURNING_CHANNEL)
STATE = _channel(channel.STATE)
PLACE = _channel(channel.PLACE)
PLACE_RATE = _channel(channel.PLACE_RATE)
ENERGY = _channel(channel.ENERGY)
BODY_ENERGY = _channel(channel.BODY_ENERGY)
WRENCH = _channel(channel.WRENCH)
EXPRESSION = _channel(channel.EXPRESSION)
