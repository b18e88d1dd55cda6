"""What the lowering of a kind works with: the model, and what grows while tables are built."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.joints.coordinates import Scalar
from flexmb.engine.compile.joints.groups import Groups
from flexmb.engine.compile.joints.joint_rows import SECOND_TURN, driver_row
from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Functions
from flexmb.engine.symbolic import Symbolic
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.bodies.markers import MarkerSpec, PlacedMarker, place
from flexmb.model.forces.contact_checks import nodes_of
from flexmb.model.forces.contacts import PointsSide
from flexmb.model.functions.expression import Expression
from flexmb.model.model import Model
from flexmb.model.sensors import signals
from flexmb.model.sensors.sensor import JointSensorSpec, ReactionSensorSpec
from flexmb.model.values.names import GROUND, split_reference
from flexmb.model.values.orientation import rotation_matrix, triad

Array = NDArray[np.float64]
Frames = tuple[PlacedMarker, PlacedMarker]


class Element(NamedTuple):
    """Where a force of the scene stands: its kind, its first row there, and how many it has.

    `reversed`: markers I and J of its rows are J and I of the scene.
    """

    kind: str
    row: int
    n: int = 1
    reversed: bool = False


class Action(NamedTuple):
    """A function that acts on a marker: component `a` of a row of a kind, on J or I (`on` 0, 1)."""

    program: int
    kind: str
    row: int
    on: int
    a: int
    marker: int


@dataclass
class Lowering:
    """What the tables of all kinds are made from, and how they reach the model.

    Attributes
    ----------
    model, flexbodies : Model, mapping
        The model and its flexible bodies.
    markers, functions : Markers, Functions
        Tables that grow.
    groups : Groups
        The constraint rows of joints, drivers and what follows joints.
    scalars : sequence of Scalar
        The scalar coordinates, in their order.
    history : int
        Numbers that elements remember from step to step, time first.
    events : int
        Values that the step control watches.
    program_depth : int
        Rows of stack that programs of the kinds need.
    elements : dict
        Forces by scene path, for sensors of their wrenches.
    actions : list of Action
        Functions that act on markers.
    reaction_loads : list of (int, int)
        Groups whose multipliers act on scalar coordinates.
    """

    model: Model
    flexbodies: Mapping[str, FlexBody]
    markers: Markers
    functions: Functions
    groups: Groups
    scalars: Sequence[Scalar]
    history: int = 1
    events: int = 0
    program_depth: int = 1
    elements: dict[str, Element] = field(default_factory=dict)
    actions: list[Action] = field(default_factory=list)
    reaction_loads: list[tuple[int, int]] = field(default_factory=list)
    _coordinates: dict[str, int] = field(init=False)

    def __post_init__(self) -> None:
        self._coordinates = {scalar.name: k for k, scalar in enumerate(self.scalars)}

    def forces(self, *types: str) -> Iterator[tuple[str, Any]]:
        """Forces of the scene of these types, by name."""
        for name, spec in self.model.forces.items():
            if spec.type in types:  # type: ignore[attr-defined]
                yield name, spec

    def add_element(
        self, name: str, kind: str, row: int, n: int = 1, reversed: bool = False
    ) -> None:
        """Note where a force stands, for sensors of its wrench."""
        self.elements[f"forces.{name}"] = Element(kind, row, n, reversed)

    def add_action(self, program: int, kind: str, row: int, on: int, a: int, marker: int) -> None:
        """Note where a function acts."""
        self.actions.append(Action(program, kind, row, on, a, marker))

    def remember(self, n: int) -> int:
        """Room for n numbers of history; returns the first place."""
        self.history += n
        return self.history - n

    def watch(self, n: int) -> int:
        """Room for n values that the step control watches; returns the first place."""
        self.events += n
        return self.events - n

    def marker(self, reference: str) -> int:
        """Index of a marker by its scene path."""
        return self.markers.add(lookup.placed(self.model, reference, self.flexbodies))

    def coordinate(self, name: str) -> int:
        """Number of a scalar coordinate by its scene path."""
        return self._coordinates[name]

    def placed(self, reference: str) -> PlacedMarker:
        """A marker by its scene path."""
        return lookup.placed(self.model, reference, self.flexbodies)

    def frames(self, between: tuple[str, str], axis: Any) -> Frames:
        """Two markers with triads along an axis, None: with their own."""
        return lookup.frames(self.model, between, axis, self.flexbodies)

    def position(self, marker: PlacedMarker) -> Array:
        """Position (3,) of a marker in the placed pose, global [m]."""
        return lookup.global_position(self.model, marker)

    def _body_axes(self, body: str) -> Array:
        if body == GROUND:
            return np.eye(3)
        return rotation_matrix(self.model.bodies[body].orientation)

    def axes(self, marker: PlacedMarker) -> Array:
        """Axes (3, 3) of a marker in the placed pose, global."""
        axes: Array = self._body_axes(marker.body) @ marker.R
        return axes

    def turned(self, marker: PlacedMarker, R: Array) -> PlacedMarker:
        """The marker with axes R (3, 3), global in the placed pose."""
        return replace(marker, R=self._body_axes(marker.body).T @ R)

    def normal_to(self, direction: Array) -> Array:
        """A unit vector (3,) at right angles to a unit vector."""
        return triad(tuple(direction))[:, 0]

    def contact_points(self, reference: str, side: PointsSide) -> Iterator[PlacedMarker]:
        """Markers at the points or mesh nodes of one side of a contact."""
        body = split_reference(reference)[0]
        known = None if body == GROUND else lookup.flexbody_of(self.model, body, self.flexbodies)
        if side.points is not None:
            for point in side.points:
                yield place(body, MarkerSpec(position=point), known)
            return
        assert known is not None  # checked with the model
        for node in nodes_of(known, side):
            yield place(body, MarkerSpec(node=int(node)), known)

    def measured_coordinate(self, spec: JointSensorSpec) -> tuple[Frames, tuple[int, int, int]]:
        """Markers of a joint coordinate, and kind and axes of the row that measures it."""
        if spec.joint is None:
            assert spec.between is not None  # one of the two is given
            return self.frames(spec.between, spec.axis), driver_row("", spec.type)
        I, J = lookup.joint_frames(self.model, spec.joint, self.flexbodies)  # noqa: E741
        row = driver_row(self.model.joints[spec.joint].type, spec.type)
        if spec.type == "second_angle":
            return (replace(J, R=J.R @ SECOND_TURN), I), row
        return (I, J), row

    def element(self, spec: ReactionSensorSpec) -> Element:
        """Where the element stands whose wrench a sensor reads."""
        for section, name in (
            ("joints", spec.joint),
            ("drivers", spec.driver),
            ("forces", spec.force),
            ("couplers", spec.coupler),
        ):
            k = -1 if name is None else self.groups.numbers.get(f"{section}.{name}", -1)
            if k >= 0:
                return Element("joints", k, 1, k in self.groups.reversed)
        return self.elements[f"forces.{spec.force}"]

    def channel_program(self, name: str) -> Expression:
        """What the output of a controller is, in SI."""
        return signals.channel_program(self.model, name)


class Placement(NamedTuple):
    """Where everything stands in the iteration matrix."""

    symbolic: Symbolic
    markers: Markers
    n_bodies: int

    def link(self, first: int, second: int) -> int:
        """LINK of the bodies of two markers, −1: they are not coupled."""
        pair = self.markers.body(first), self.markers.body(second)
        return self.symbolic.couple_links.get(pair, -1)
