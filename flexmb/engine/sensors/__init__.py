"""The registry of sensors; the place of a measure or a kind of channel is its number in tables."""

from __future__ import annotations

from flexmb.engine.kind import SensorKind
from flexmb.engine.sensors.joint_coordinate import JOINT_COORDINATES
from flexmb.engine.sensors.marker_motion import MARKER_MOTIONS, ORIENTATIONS
from flexmb.engine.sensors.sensor import (
    ENERGIES,
    EXPRESSIONS,
    PLACES,
    REACTIONS,
    channel_kinds_of,
    measures_of,
)

SENSOR_KINDS: tuple[SensorKind, ...] = (
    JOINT_COORDINATES,
    MARKER_MOTIONS,
    ORIENTATIONS,
    PLACES,
    ENERGIES,
    REACTIONS,
    EXPRESSIONS,
)

MEASURES = measures_of(SENSOR_KINDS)
CHANNEL_KINDS = channel_kinds_of(SENSOR_KINDS)
