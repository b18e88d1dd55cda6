"""What a model holds, table by table, before its equations are put in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import bodies as body_tables
from flexmb.engine.compile.forces import basic, contacts, elements
from flexmb.engine.compile.joints import coordinates
from flexmb.engine.compile.joints.groups import Groups, check_ends
from flexmb.engine.compile.joints.joint import joint_groups
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Functions, Pool
from flexmb.engine.compile.sensors import sensor, signals
from flexmb.engine.element_tables import Elements
from flexmb.engine.sensor_tables import Sensors
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model.model import Model
from flexmb.model.sensors.signals import resolved, states_of

__all__ = ["Forces", "Gathered", "Measured", "gather"]

Table = NDArray[np.void]


@dataclass(frozen=True)
class Forces:
    """Tables of forces; None where the model has none."""

    springs: Table | None
    loads: Table
    elements: Elements | None
    contacts: Table | None
    frictions: Table | None

    @property
    def between_markers(self) -> tuple[Table, ...]:
        """Those whose rows join two markers, I and J."""
        return tuple(table for table in (self.springs, self.contacts) if table is not None)


@dataclass(frozen=True)
class Measured:
    """Tables of sensors; channels and states by number; functions that act by what they read."""

    sensors: Sensors
    numbers: Mapping[str, int]
    starts: tuple[signals.Start, ...]
    acting: signals.SignalTables | None


@dataclass(frozen=True)
class Gathered:
    """All tables of a model; places in the factor are still open.

    The scalar coordinates of curve markers are the last ones, from number `before` on.
    """

    model: Model
    flexbodies: Mapping[str, FlexBody]
    bodies: Table
    markers: Markers
    functions: Functions
    groups: Groups
    scalars: list[coordinates.Scalar]
    before: int
    coordinates: Table | None
    forces: Forces
    measured: Measured

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
    markers = Markers(list(model.bodies), Pool())
    bodies = body_tables.body_table(model, flexbodies, markers.pool)
    states = states_of(model)
    scalars = coordinates.scalars(model, functions, states)
    groups = joint_groups(model, flexbodies, markers, functions, scalars)
    _refuse_loops(groups)
    before = len(scalars)
    scalars = scalars + groups.sliders.scalars()
    nq, nv = int((7 + bodies["m"]).sum()), int((6 + bodies["m"]).sum())
    table = coordinates.coordinate_table(scalars, nq, nv)
    forces = _forces(model, flexbodies, markers, functions, groups, scalars)
    ivs = {s.name: nv + before - len(states) + k for k, s in enumerate(states)}
    starts = tuple(signals.starts(states, ivs, functions))
    sensors, numbers = sensor.sensor_tables(
        model, flexbodies, markers, groups, ivs, (nq + before, nv + before)
    )
    acting = signals.signal_tables(
        functions, numbers, sensors, forces.loads, table, markers, forces.elements
    )
    measured = Measured(sensors, numbers, starts, acting)
    return Gathered(
        model, flexbodies, bodies, markers, functions, groups, scalars, before, table, forces,
        measured,
    )  # fmt: skip


def _forces(
    model: Model,
    flexbodies: Mapping[str, FlexBody],
    markers: Markers,
    functions: Functions,
    groups: Groups,
    scalars: list[coordinates.Scalar],
) -> Forces:
    springs = basic.spring_table(model, flexbodies, markers)
    touching = contacts.contact_table(model, flexbodies, markers)
    kept = 1 + sum(contacts.memory_of(row) for row in (() if touching is None else touching))
    frictions = contacts.joint_friction_table(model, groups, kept)
    loads = basic.load_table(model, flexbodies, markers, functions)
    names = [scalar.name for scalar in scalars]
    held = elements.element_tables(model, flexbodies, markers, functions, names)
    return Forces(springs, loads, held, touching, frictions)


def _refuse_loops(groups: Groups) -> None:
    names = check_ends(groups)
    if names:
        raise SceneError.from_problems(
            [Problem(name.split(":")[0], "connects a body with itself") for name in names]
        )
