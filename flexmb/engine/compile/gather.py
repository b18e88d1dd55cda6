"""What a model holds, table by table, before its equations are put in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.marker import MarkerTable
from flexmb.engine.compile import bodies as body_tables
from flexmb.engine.geometry import Geometry
from flexmb.engine.joints.constraint_groups import (
    Groups,
    groups_within_bodies,
    joint_groups,
    scalar_coordinates,
)
from flexmb.engine.joints.coordinate import coordinate_table
from flexmb.engine.joints.joint import measured_coordinate
from flexmb.engine.kinds import KINDS
from flexmb.engine.lowering import Lowering
from flexmb.engine.sensor_kinds import CHANNEL_KINDS, SENSOR_KINDS
from flexmb.engine.sensors import feedback
from flexmb.engine.sensors.sensor import WRENCH, Channels, sensor_tables
from flexmb.engine.tables import Functions, Pool, Sensors
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model.model import Model
from flexmb.model.sensors.signals import channel_program, resolved, states_of

__all__ = ["Gathered", "Measured", "gather"]

Table = NDArray[np.void]


@dataclass(frozen=True)
class Measured:
    """Tables of sensors; channels and states by number; functions that act by what they read."""

    sensors: Sensors
    numbers: Mapping[str, int]
    starts: tuple[feedback.Start, ...]
    feedback: feedback.FeedbackTables | None


@dataclass(frozen=True)
class Gathered:
    """All tables of a model; places in the factor are still open.

    The scalar coordinates of curve markers are the last ones, from number `before` on. `kinds` are
    the tables of the kinds that the model holds, by name; `ground` (n, 3) are the points of the
    ground that joints and forces hold on to.
    """

    model: Model
    flexbodies: Mapping[str, FlexBody]
    bodies: Table
    lowering: Lowering
    before: int
    coordinates: Table
    kinds: dict[str, Any]
    ground: NDArray[np.float64]
    measured: Measured

    @property
    def markers(self) -> MarkerTable:
        """The markers."""
        return self.lowering.markers

    @property
    def functions(self) -> Functions:
        """The functions."""
        return self.lowering.functions

    @property
    def groups(self) -> Groups:
        """The groups of constraint rows."""
        return self.lowering.groups

    @property
    def nq(self) -> int:
        """Position coordinates of the bodies."""
        return int((7 + self.bodies["m"]).sum())

    @property
    def nv(self) -> int:
        """Velocity coordinates of the bodies."""
        return int((6 + self.bodies["m"]).sum())


def gather(model: Model, flexbodies: Mapping[str, FlexBody]) -> Gathered:
    """All tables of a model that holds together.

    Raises
    ------
    SceneError
        A joint or driver between two markers of one body, or what only the geometry tells.
    """
    functions = Functions(lambda expression: resolved(model, expression))
    markers = MarkerTable(list(model.bodies), Pool())
    bodies = body_tables.body_table(model, flexbodies, markers.pool)
    states = states_of(model)
    scalars = scalar_coordinates(model, functions, states)
    groups = joint_groups(model, flexbodies, markers, functions, scalars)
    _refuse_loops(groups)
    before = len(scalars)
    scalars = scalars + groups.curve_points.scalars()
    nq, nv = int((7 + bodies["m"]).sum()), int((6 + bodies["m"]).sum())
    table = coordinate_table(scalars, nq, nv)
    lowering = Lowering(Geometry(model, flexbodies), markers, functions, groups, scalars)
    kinds = {kind.name: kind.lower(lowering) for kind in KINDS if kind.lower is not None}
    kinds = {name: tables for name, tables in kinds.items() if tables is not None}
    ground = markers.on_ground()
    ivs = {s.name: nv + before - len(states) + k for k, s in enumerate(states)}
    starts = tuple(feedback.starts(states, ivs, functions))
    reading = [k.name for k in KINDS if "wrenches" in k.units and (k.name in kinds or k.core)]
    channels = Channels(
        lowering,
        SENSOR_KINDS,
        reading,
        (nq + before, nv + before),
        lambda spec: measured_coordinate(lowering.geometry, spec),
        lambda name: channel_program(model, name),
    )
    sensors, numbers = sensor_tables(channels, ivs)
    acting = [k.name for k in KINDS if "unit_force" in k.units and k.name in kinds]
    signals = feedback.feedback_tables(lowering, acting, numbers, sensors, table)
    if signals is not None:
        _frame_reactions(lowering, sensors, signals.feedback, reading.index("joints"))
    measured = Measured(sensors, numbers, starts, signals)
    return Gathered(model, flexbodies, bodies, lowering, before, table, kinds, ground, measured)


def _frame_reactions(
    lowering: Lowering, sensors: Sensors, acting: feedback.Feedback, joints: int
) -> None:
    """The axes of joints matter whose reactions act, in their axes, while the model moves."""
    for channel in sensors.channels[acting.channels]:
        if CHANNEL_KINDS[channel["what"]] is WRENCH and channel["kind"] == joints:
            for row in lowering.groups.in_group(int(channel["first"])):
                lowering.markers.framed |= {row.I, row.J}


def _refuse_loops(groups: Groups) -> None:
    names = groups_within_bodies(groups)
    if names:
        raise SceneError.from_problems(
            [Problem(name.split(":")[0], "connects a body with itself") for name in names]
        )
