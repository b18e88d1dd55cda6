"""Tables of the kinds that every model has: which bodies, markers, rows each of them is for."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.engine.kernels.bodies.inertia import Bodies
from flexmb.engine.kernels.bodies.kinematics import Markers
from flexmb.engine.kernels.functions.function import FunctionTable
from flexmb.engine.kernels.functions.time_function import TimeFunctions
from flexmb.engine.kernels.joints.constraint import Joints
from flexmb.engine.kernels.joints.coordinate import Coordinates
from flexmb.engine.kernels.joints.curve_marker_tangent import CurveMarkers
from flexmb.engine.kernels.sensors.sensor import TurningChannels
from flexmb.engine.sensor_tables import Sensors
from flexmb.engine.tables import Parts

__all__ = ["core_tables"]


def core_tables(
    parts: Parts, rows: np.ndarray, functions: FunctionTable, sensors: Sensors
) -> dict[str, Any]:
    """Tables by the name of their kind, of the kinds that the model holds."""
    rigid = parts.bodies["m"] == 0
    stiff = parts.markers["modes"] < 0
    driven = (rows["fun"] >= 0) & (rows["follows"] == 0)
    tables = {
        "time_functions": (TimeFunctions(), np.any(functions.live == 0)),
        "coordinates": (Coordinates(), len(parts.coordinates)),
        "rigid_bodies": (Bodies(np.flatnonzero(rigid)), rigid.any()),
        "flexible_bodies": (Bodies(np.flatnonzero(~rigid)), not rigid.all()),
        "rigid_markers": (Markers(np.flatnonzero(stiff)), stiff.any()),
        "flexible_markers": (Markers(np.flatnonzero(~stiff)), not stiff.all()),
        "curve_markers": (CurveMarkers(), len(parts.curve_markers)),
        "joints": (Joints(np.flatnonzero(driven)), True),
        "turning_channels": (TurningChannels(), np.any(sensors.channels["turns"] != 0)),
    }
    return {name: table for name, (table, present) in tables.items() if present}
