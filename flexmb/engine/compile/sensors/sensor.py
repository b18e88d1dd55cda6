"""Tables of sensors: their channels, the terms these are sums of, programs over other channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexmb.engine.functions import lower
from flexmb.engine.joints.joint import SECOND_TURN, driver_row
from flexmb.engine.lowering import Element, Lowering
from flexmb.engine.row_kinds import DISTANCE, DOT2, ROW_KINDS
from flexmb.engine.sensor_kinds import (
    ACCELERATION,
    ANGULAR_ACCELERATION,
    ANGULAR_VELOCITY,
    BODY_ENERGY,
    COORDINATE,
    COORDINATE_ACCELERATION,
    COORDINATE_RATE,
    ENERGY,
    EXPRESSION,
    JOINT_ANGLE,
    PLACE,
    PLACE_RATE,
    POSITION,
    STATE,
    SUM,
    TURNING_ANGLE,
    TURNING_CHANNEL,
    TURNING_OF_AXES,
    VELOCITY,
    WRENCH,
)
from flexmb.engine.sensor_tables import CHANNEL, TERM, Sensors
from flexmb.model import lookup
from flexmb.model.functions.expression import Expression
from flexmb.model.model import Model
from flexmb.model.sensors.channels import channel_program
from flexmb.model.sensors.sensor import (
    DistanceSensorSpec,
    EnergySensorSpec,
    JointSensorSpec,
    MarkerSensorSpec,
    OrientationSensorSpec,
    PlaceSensorSpec,
    ReactionSensorSpec,
)
from flexmb.model.values.reading import Spec

__all__ = ["Channels", "sensor_tables"]

_MOTIONS = {
    "position": POSITION,
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "angular_velocity": ANGULAR_VELOCITY,
    "angular_acceleration": ANGULAR_ACCELERATION,
}
_POINT_MOTIONS = (POSITION, VELOCITY, ACCELERATION)
_ROW_MEASURES = (COORDINATE, COORDINATE_RATE, COORDINATE_ACCELERATION)  # by derivative
_ENERGIES = ("kinetic", "strain", "gravity", "spring", "total")
_GLOBAL, _OWN = -1, -2


class Term(NamedTuple):
    """A term as `sensor_tables.TERM` says, but for its channel."""

    measure: int
    kind: int
    I: int  # noqa: E741
    J: int
    a: int
    b: int
    factor: float = 1.0


@dataclass
class Channels:
    """Channels in the making; those of the results first, then states that have no name there."""

    lowering: Lowering
    kinds: Sequence[str]  # kinds whose wrenches can be read
    places: tuple[int, int]  # position and velocity coordinate of the first curve marker
    states: Mapping[str, int]  # velocity coordinate of each state
    rows: list[tuple[int, ...]] = field(default_factory=list)
    terms: list[tuple[float, ...]] = field(default_factory=list)
    programs: list[Expression] = field(default_factory=list)

    @property
    def model(self) -> Model:
        """The model."""
        return self.lowering.model

    def marker(self, reference: str) -> int:
        """Index of a marker."""
        return self.lowering.marker(reference)

    def axes(self, reference: str, own: int = _GLOBAL) -> int:
        """The marker whose axes are meant, or a number for others."""
        fixed = {"global": _GLOBAL, "joint": own}
        return fixed[reference] if reference in fixed else self.marker(reference)

    def add_sum(self, terms: list[Term], what: int = SUM, number: int = 0) -> None:
        """A channel of terms: a sum of them, or one angle that counts turns."""
        channel = len(self.rows)
        self.rows.append((what, len(self.terms), len(terms), 0, 0, 0, number, -1))
        self.terms += [(*term[:-1], channel, term.factor) for term in terms]

    def add(self, what: int, first: int, n: int = -1) -> None:
        """A channel without terms."""
        self.rows.append((what, first, n, 0, 0, 0, 0, -1))

    def add_program(self, expression: Expression) -> None:
        """A channel that is computed of others."""
        self.add(EXPRESSION, len(self.programs))
        self.programs.append(expression)

    def add_sensor(self, name: str, spec: Spec) -> None:
        """All channels of one sensor."""
        if isinstance(spec, MarkerSensorSpec):
            self._motion(spec)
        elif isinstance(spec, OrientationSensorSpec):
            self._orientation(spec)
        elif isinstance(spec, JointSensorSpec):
            self._joint(spec)
        elif isinstance(spec, DistanceSensorSpec):
            i, j = (self.marker(reference) for reference in spec.between)
            self.add_sum([Term(_ROW_MEASURES[spec.derivative], DISTANCE, i, j, 0, 0)])
        elif isinstance(spec, ReactionSensorSpec):
            self._reaction(spec)
        elif isinstance(spec, PlaceSensorSpec):
            k = self.lowering.groups.curve_points.number(spec.joint, spec.on)
            self.add((PLACE, PLACE_RATE)[spec.derivative], self.places[spec.derivative] + k)
        elif isinstance(spec, EnergySensorSpec):
            number, body = _ENERGIES.index(spec.quantity), spec.body
            if body is None:
                self.add(ENERGY, number)
            else:
                self.add(BODY_ENERGY, number, self.lowering.markers.numbers[body])
        else:
            self.add_program(channel_program(self.model, name))

    def _motion(self, spec: MarkerSensorSpec) -> None:
        j, motion = self.marker(spec.of), _MOTIONS[spec.type]
        for a in range(3):
            if spec.seen_from is not None:
                self.add_sum(_seen(motion, self.marker(spec.seen_from), j, a))
                continue
            axes = self.axes(spec.axes)
            terms = [Term(motion, -1, axes, j, a, 0)]
            if spec.relative_to is not None:
                terms.append(Term(motion, -1, axes, self.marker(spec.relative_to), a, 0, -1.0))
            self.add_sum(terms)

    def _orientation(self, spec: OrientationSensorSpec) -> None:
        i, j = self.marker(spec.relative_to or "ground"), self.marker(spec.of)
        first, second, third = ("xyz".index(axis) for axis in spec.sequence)
        code = 9 * first + 3 * second + third
        for number in range(3):
            term = Term(TURNING_ANGLE, -1, i, j, code, number)
            self.add_sum([term], TURNING_CHANNEL, number)

    def _joint(self, spec: JointSensorSpec) -> None:
        if spec.joint is not None:
            frames = lookup.joint_frames(self.model, spec.joint, self.lowering.flexbodies)
            kind, a, b = driver_row(self.model.joints[spec.joint].type, spec.type)
            if spec.type == "second_angle":
                frames = replace(frames[1], R=frames[1].R @ SECOND_TURN), frames[0]
        else:
            assert spec.between is not None  # one of the two is given
            frames = lookup.frames(self.model, spec.between, spec.axis, self.lowering.flexbodies)
            kind, a, b = driver_row("", spec.type)
        i, j = (self.lowering.markers.add(marker) for marker in frames)
        turns = ROW_KINDS[kind].period > 0.0 and spec.derivative == 0
        term = Term(_ROW_MEASURES[spec.derivative], kind, i, j, a, b)
        self.add_sum([term], JOINT_ANGLE if turns else SUM)

    def _reaction(self, spec: ReactionSensorSpec) -> None:
        element = self._element(spec)
        side, quantity = int((spec.on == "I") != element.reversed), int(spec.quantity == "moment")
        axes = self.axes(spec.axes, _OWN)
        kind = self.kinds.index(element.kind)
        for a in range(3):
            self.rows.append((WRENCH, element.row, element.n, side, quantity, axes, a, kind))

    def _element(self, spec: ReactionSensorSpec) -> Element:
        """Where the element stands whose wrench is read."""
        groups = self.lowering.groups
        for section, name in (
            ("joints", spec.joint),
            ("drivers", spec.driver),
            ("forces", spec.force),
            ("couplers", spec.coupler),
        ):
            k = -1 if name is None else groups.numbers.get(f"{section}.{name}", -1)
            if k >= 0:
                return Element("joints", k, 1, k in groups.reversed)
        return self.lowering.elements[f"forces.{spec.force}"]


def _seen(motion: int, K: int, j: int, a: int) -> list[Term]:
    """Component a of a motion of j as an observer on K sees it."""
    if motion in _POINT_MOTIONS:
        return [Term(_ROW_MEASURES[_POINT_MOTIONS.index(motion)], DOT2, K, j, a, a)]
    terms = [Term(motion, -1, K, j, a, 0), Term(motion, -1, K, K, a, 0, -1.0)]
    if motion == ANGULAR_ACCELERATION:
        terms.append(Term(TURNING_OF_AXES, -1, K, j, a, 0, -1.0))
    return terms


def sensor_tables(
    lowering: Lowering,
    kinds: Sequence[str],
    states: Mapping[str, int],
    places: tuple[int, int],
) -> tuple[Sensors, dict[str, int]]:
    """The tables of all channels in the order of `Model.channels`, and their numbers by name.

    `kinds` are those whose wrenches can be read, in their order; `states` is the velocity
    coordinate of each state by name; those that are no channel of the results stand behind the
    others; `places` as in `Channels`.
    """
    model = lowering.model
    made = Channels(lowering, kinds, places, states)
    for name, spec in model.sensors.items():
        made.add_sensor(name, spec)
    for name in (*model.states, *model.controllers):
        if name in states:
            made.add(STATE, states[name])
        else:
            made.add_program(channel_program(model, name))
    names = list(model.channels())
    hidden = [name for name in states if name not in names]
    for name in hidden:
        made.add(STATE, states[name])
    numbers = {name: k for k, name in enumerate([*names, *hidden])}
    programs = lower(made.programs, numbers)
    return Sensors(np.array(made.rows, CHANNEL), np.array(made.terms, TERM), programs), numbers
