"""Context of lowering, the step that makes the tables of a kind from the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # files of kernels import this one
    from flexmb.engine.bodies.marker import MarkerTable
    from flexmb.engine.geometry import Geometry
    from flexmb.engine.joints.constraint_groups import Groups
    from flexmb.engine.joints.coordinate import Scalar
    from flexmb.engine.kind import Kind
    from flexmb.engine.symbolic import Symbolic
    from flexmb.engine.tables import Functions
    from flexmb.flexbody import FlexBody
    from flexmb.model.model import Model
    from flexmb.model.sensor import ReactionSensorSpec

Forces = Sequence[tuple[str, Any]]
"""Names and specifications of the forces from which the tables of a kind are made."""


class Element(NamedTuple):
    """Table rows of a force of the scene: kind, first row, number of rows.

    `reversed`: markers I and J of its rows are J and I of the scene.
    """

    kind: str
    row: int
    n: int = 1
    reversed: bool = False


class Action(NamedTuple):
    """A function that acts on a marker, as component `a` of a row, on marker J or I (`on` 0, 1)."""

    program: int
    kind: str
    row: int
    on: int
    a: int
    marker: int


@dataclass
class Lowering:
    """The model, and shared tables that grow while the tables of all kinds are made.

    Attributes
    ----------
    geometry : Geometry
        The model, its flexible bodies and its markers in the initial pose.
    markers, functions : MarkerTable, Functions
        Markers and functions of the system; kinds add to them.
    groups : Groups
        The constraint rows of joints, drivers and scalar coordinates.
    scalars : sequence of Scalar
        The scalar coordinates, in their order.
    history : int
        Number of internal variables of elements, which keep values from step to step; the first is
        time.
    events : int
        Number of event functions that the step control watches.
    program_depth : int
        Stack depth that the programs of the kinds need.
    elements : dict
        Forces by scene path, for sensors of their wrenches.
    actions : list of Action
        Functions that act on markers.
    reaction_loads : list of (int, int)
        Groups whose multipliers act on scalar coordinates, and these coordinates.
    """

    geometry: Geometry
    markers: MarkerTable
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

    @property
    def model(self) -> Model:
        """The model."""
        return self.geometry.model

    @property
    def flexbodies(self) -> Mapping[str, FlexBody]:
        """The flexible bodies by name."""
        return self.geometry.flexbodies

    def __post_init__(self) -> None:
        self._coordinates = {scalar.name: k for k, scalar in enumerate(self.scalars)}

    def lower(self, kind: Kind) -> Any:
        """Tables of a kind; None if the model has none."""
        if kind.lower is None or not kind.types:
            return None if kind.lower is None else kind.lower(self)
        forces = [
            (name, spec)
            for name, spec in self.model.forces.items()
            if spec.type in kind.types  # type: ignore[attr-defined]
        ]
        return kind.lower(self, forces) if forces else None

    def add_element(
        self, name: str, kind: str, row: int, n: int = 1, reversed: bool = False
    ) -> None:
        """Record the rows of a force, for sensors of its wrench."""
        self.elements[f"forces.{name}"] = Element(kind, row, n, reversed)

    def element(self, spec: ReactionSensorSpec) -> Element:
        """Rows of the joint, driver, force or coupler whose wrench a sensor reads."""
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

    def add_action(self, program: int, kind: str, row: int, on: int, a: int, marker: int) -> None:
        """Record that a function acts on a marker."""
        self.actions.append(Action(program, kind, row, on, a, marker))

    def add_history(self, n: int) -> int:
        """Add n internal variables; return the index of the first."""
        self.history += n
        return self.history - n

    def add_events(self, n: int) -> int:
        """Add n event functions; return the index of the first."""
        self.events += n
        return self.events - n

    def marker(self, reference: str) -> int:
        """Index of a marker by its scene path."""
        return self.markers.add(self.geometry.marker(reference))

    def coordinate(self, name: str) -> int:
        """Number of a scalar coordinate by its scene path."""
        return self._coordinates[name]


class Placement(NamedTuple):
    """Places of bodies, groups and couplings in the iteration matrix."""

    symbolic: Symbolic
    markers: MarkerTable
    n_bodies: int

    def link(self, first: int, second: int) -> int:
        """LINK of the bodies of two markers; −1 if they are not coupled."""
        pair = self.markers.body(first), self.markers.body(second)
        return self.symbolic.couple_links.get(pair, -1)
