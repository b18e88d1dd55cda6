"""Tables of the kinds that every model has: which bodies, markers, rows each of them is for."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.engine.bodies.marker import Markers
from flexmb.engine.bodies.rigid_body import Bodies, PlanarBodies
from flexmb.engine.functions.function import TimeFunctions
from flexmb.engine.joints.constraint import ConstraintRows, Joints
from flexmb.engine.joints.coordinate import Coordinates
from flexmb.engine.joints.curve_marker import CurveMarkers
from flexmb.engine.joints.point_joint import PointJoints
from flexmb.engine.row_kinds import POINT
from flexmb.engine.sensor_kinds import CHANNEL_KINDS
from flexmb.engine.sensors.joint_coordinate import JOINT_ANGLE, JointAngles
from flexmb.engine.sensors.orientation_angles import TURNING_CHANNEL, TurningAngles
from flexmb.engine.tables import FunctionTable, Parts, Sensors, System

__all__ = ["core_tables", "with_markers"]


def core_tables(
    parts: Parts,
    rows: np.ndarray,
    groups: np.ndarray,
    functions: FunctionTable,
    sensors: Sensors,
    plane: tuple[np.ndarray, np.ndarray] | None = None,
) -> dict[str, Any]:
    """Tables by the name of their kind, of the kinds that the model holds.

    `plane`: of a planar model the axes in it and its normal (3,), and of each body the axis along
    the normal (bodies,).
    """
    rigid = parts.bodies["m"] == 0
    modal = parts.markers["modes"] >= 0
    point = parts.markers["point"] == 1
    driven = np.flatnonzero((rows["fun"] >= 0) & (rows["follows"] == 0))
    points = _joints_of_points(parts, rows, groups)
    coincident = rows["kind"] == POINT
    others = coincident & ~np.repeat(points, groups["n"])
    channels = sensors.channels
    angles = np.flatnonzero(channels["what"] == CHANNEL_KINDS.index(JOINT_ANGLE))
    turning = channels["what"] == CHANNEL_KINDS.index(TURNING_CHANNEL)
    turning = np.flatnonzero(turning & (channels["a"] == 0))
    tables = {
        "time_functions": (TimeFunctions(), np.any(functions.live == 0)),
        "coordinates": (Coordinates(), len(parts.coordinates)),
        "rigid_bodies": (Bodies(np.flatnonzero(rigid)), rigid.any() and plane is None),
        "flexible_bodies": (Bodies(np.flatnonzero(~rigid)), not rigid.all()),
        "point_markers": (Markers(np.flatnonzero(point)), point.any()),
        "rigid_markers": (Markers(np.flatnonzero(~modal & ~point)), np.any(~modal & ~point)),
        "flexible_markers": (Markers(np.flatnonzero(modal)), modal.any()),
        "curve_markers": (CurveMarkers(), len(parts.curve_markers)),
        "joints": (Joints(np.flatnonzero(~points), driven), True),
        "constraint_rows": (ConstraintRows(np.flatnonzero(~coincident)), not coincident.all()),
        "point_joints": (
            PointJoints(np.flatnonzero(coincident), np.flatnonzero(others), np.flatnonzero(points)),
            coincident.any(),
        ),
        "joint_angles": (JointAngles(angles), len(angles)),
        "turning_angles": (TurningAngles(turning), len(turning)),
    }
    if plane is not None:
        about = plane[1][rigid]
        tables["planar_bodies"] = PlanarBodies(np.flatnonzero(rigid), about, plane[0]), rigid.any()
    return {name: table for name, (table, present) in tables.items() if present}


def _joints_of_points(parts: Parts, rows: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(groups,) whether all rows of a group hold points of which only the place matters."""
    if not len(groups):
        return np.zeros(0, bool)
    point = parts.markers["point"] == 1
    plain = (rows["kind"] == POINT) & point[rows["I"]] & point[rows["J"]]
    return np.logical_and.reduceat(plain, groups["row"])


def with_markers(system: System, markers: np.ndarray, pool: np.ndarray) -> System:
    """The same system with another table of markers and their pool."""
    parts = system.parts._replace(markers=markers, pool=pool)
    core = core_tables(parts, system.rows, system.groups, system.functions, system.sensors)
    markers_of = ("point_markers", "rigid_markers", "flexible_markers")
    words = (*markers_of, "joints", "constraint_rows", "point_joints")
    kinds = {name: tables for name, tables in system.kinds.items() if name not in words}
    return system._replace(
        parts=parts, kinds=kinds | {name: core[name] for name in words if name in core}
    )
