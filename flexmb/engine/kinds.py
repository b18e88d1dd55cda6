"""The registry: all kinds that a model may hold, in the order in which stages walk over them."""

from __future__ import annotations

from flexmb.engine.kernels.bodies.energy import FLEXIBLE_BODIES, RIGID_BODIES
from flexmb.engine.kernels.bodies.kinematics import FLEXIBLE_MARKERS, RIGID_MARKERS
from flexmb.engine.kernels.functions.time_function import TIME_FUNCTIONS
from flexmb.engine.kernels.joints.constraint import JOINTS
from flexmb.engine.kernels.joints.coordinate import COORDINATES
from flexmb.engine.kernels.joints.curve_marker import CURVE_MARKERS
from flexmb.engine.kernels.sensors.sensor import TURNING_CHANNELS
from flexmb.engine.kind import Kind

__all__ = ["KINDS"]

KINDS: tuple[Kind, ...] = (
    TIME_FUNCTIONS,
    COORDINATES,
    RIGID_BODIES,
    FLEXIBLE_BODIES,
    RIGID_MARKERS,
    FLEXIBLE_MARKERS,
    CURVE_MARKERS,
    JOINTS,
    TURNING_CHANNELS,
)
