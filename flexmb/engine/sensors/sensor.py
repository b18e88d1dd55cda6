"""Sensors: their channels, what each channel reads, and how all are read at a state.

A channel is a sum of terms (measured quantities), a state, a position along a curve, an energy, a
component of the force or moment of an element, or an expression of other channels. Measures and
kinds of channels are numbered in `engine.sensors`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexmb.engine.algebra.vector import copy
from flexmb.engine.bodies.flexible_body import body_energy
from flexmb.engine.equations_of_motion import pose_stage, run_stage
from flexmb.engine.function import lower, run_program
from flexmb.engine.jit import Vector, call_channel, call_step, kernel, unit
from flexmb.engine.kind import GLOBAL_AXES, ChannelKind, Measure, SensorKind, Term
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import (
    BRISTLE_ENERGY,
    GRAVITY_ENERGY,
    KINETIC_ENERGY,
    SPRING_ENERGY,
    STRAIN_ENERGY,
    Point,
    Run,
)
from flexmb.engine.tables import CHANNEL, TERM, Sensors

if TYPE_CHECKING:
    from flexmb.engine.geometry import Ends
    from flexmb.engine.lowering import Lowering
    from flexmb.model.functions.expression import Expression
    from flexmb.model.sensor import (
        EnergySensorSpec,
        ExpressionSensorSpec,
        JointSensorSpec,
        PlaceSensorSpec,
        ReactionSensorSpec,
    )

_ENERGIES = ("kinetic", "strain", "gravity", "spring", "total")
_TOTAL = 4  # index of "total" in _ENERGIES
_AXES_OF_SIDE = -2  # for CHANNEL.axes: axes of the marker on which the wrench acts


@unit
def sum_of_terms(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Sum of the terms of channel c."""
    channel, terms, units = sensors.channels[c], sensors.terms, run.sensors.measure
    s = 0.0
    for t in range(channel["first"], channel["first"] + channel["n"]):
        value = call_channel(units[terms[t]["measure"]], run, sensors, at, t)
        s += terms[t]["factor"] * value
    return s


@unit
def velocity_coordinate(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """A velocity coordinate: a state, or the rate of a position along a curve."""
    return at.v[sensors.channels[c]["first"]]  # type: ignore[no-any-return]


@unit
def place(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Position (arc length) of a curve marker along its curve."""
    return at.q[sensors.channels[c]["first"]]  # type: ignore[no-any-return]


@unit
def energy(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """An energy of the model, as evaluated last; that of springs includes that of bristles."""
    e, number = run.work.energies, sensors.channels[c]["first"]
    spring = e[SPRING_ENERGY] + e[BRISTLE_ENERGY]
    if number == _TOTAL:
        return e[KINETIC_ENERGY] + e[STRAIN_ENERGY] + e[GRAVITY_ENERGY] + spring  # type: ignore[no-any-return]
    return spring if number == SPRING_ENERGY else e[number]  # type: ignore[no-any-return]


@unit
def energy_of_body(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """An energy of one body."""
    channel = sensors.channels[c]
    return body_energy(run, channel["n"], channel["first"], at)


@unit
def wrench(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """One component of the force or moment that an element exerts on one of its two markers."""
    channel, d, stage = sensors.channels[c], run.work.dense, run.stages.wrenches
    kind, axes, a = channel["kind"], channel["axes"], channel["a"]
    call_channel(stage.units[kind], run, stage.tables[kind], at, c)
    w = d.g[1]
    o = 6 * (1 - channel["side"]) + 3 * channel["quantity"]
    if axes == -1:
        return w[o + a]  # type: ignore[no-any-return]
    own = d.pair[1] if channel["side"] == 0 else d.pair[0]
    R = run.work.now.marker[own if axes < 0 else axes]["R"]
    return R[0, a] * w[o] + R[1, a] * w[o + 1] + R[2, a] * w[o + 2]  # type: ignore[no-any-return]


@unit
def expression(run: Run, sensors: Sensors, at: Point, c: int) -> float:
    """Value of a program of other channels, whose values are in Trial.variables."""
    trial, k = run.work.trial, sensors.channels[c]["first"]
    return run_program(sensors.programs, k, at.t[0], trial.variables, trial.stack)


SUM = ChannelKind(sum_of_terms, "terms")
STATE = ChannelKind(velocity_coordinate, "state")
PLACE = ChannelKind(place, "coordinate")
PLACE_RATE = ChannelKind(velocity_coordinate, "coordinate")
ENERGY = ChannelKind(energy, "forces")
BODY_ENERGY = ChannelKind(energy_of_body, "forces")
WRENCH = ChannelKind(wrench, "forces")
EXPRESSION = ChannelKind(expression, "channels")


@kernel
def count_turns(run, at, angles):
    """Update angles that count turns to the present position: `angles`, and FeedbackWork.near."""
    near = run.work.feedback.near
    copy(angles, near)
    run_stage(run.stages.angles, run, at)
    for c in range(angles.shape[0]):
        angles[c] = near[c]


@unit
def follow_angles(run: Run, begin: float, end: float) -> int:
    """Continue Trial.angles through the last step, from the fraction `begin` of it to `end`.

    At `end` is the trial state. If the motion in between is so large that both ends do not decide
    on the turns, the step is divided, with states by its dense output.
    """
    at, stage, passed, share = run.trial_point, run.stages.angle_path, begin, end
    while len(stage.units) > 0:
        pose_stage(run, at)
        if run_stage(stage, run, at) == SUCCESS:
            if share == end:
                break
            part, passed = 2.0 * (share - passed), share
            share = passed + part if abs(part) < abs(end - passed) else end
        else:
            share = 0.5 * (passed + share)
        status = call_step(run.method.interpolate[0], run, run.method.coefficients[0], share)
        if status != SUCCESS:
            return status  # type: ignore[no-any-return]
    return SUCCESS


@kernel
def channel_value(run, at, c):
    """Value of channel c at the present state."""
    sensors = run.system.sensors
    unit = run.sensors.channel[sensors.channels[c]["what"]]
    return call_channel(unit, run, sensors, at, c)


@unit
def read_channels(run: Run, at: Point, angles: Vector, out: Vector) -> int:
    """Put the channels of all sensors into out; after all stages and the energies.

    `angles`: the angles that count turns, at this position.
    """
    channels, turns, computed = run.system.sensors.channels, run.sensors.turns, run.sensors.computed
    variables, n_computed = run.work.trial.variables, 0
    for c in range(out.shape[0]):
        what = channels[c]["what"]
        if computed[what] == 1:
            n_computed += 1
        else:
            out[c] = angles[c] if turns[what] == 1 else channel_value(run, at, c)
    if n_computed > 0:
        for c in range(channels.shape[0]):
            x = out[c] if c < out.shape[0] else channel_value(run, at, c)
            variables[c, 0], variables[c, 1], variables[c, 2] = x, 0.0, 0.0
        for c in range(out.shape[0]):
            if computed[channels[c]["what"]] == 1:
                out[c] = channel_value(run, at, c)
    return SUCCESS


def measures_of(kinds: Sequence[SensorKind]) -> tuple[Measure, ...]:
    """All measures; the place of one is its number in `tables.TERM`."""
    return tuple(measure for kind in kinds for measure in kind.measures)


def channel_kinds_of(kinds: Sequence[SensorKind]) -> tuple[ChannelKind, ...]:
    """All kinds of channels; the place of one is its number in `tables.CHANNEL`."""
    return (SUM, STATE, *(channel for kind in kinds for channel in kind.channels))


@dataclass
class Channels:
    """Collects the rows of all channels: those of the results first, then hidden states."""

    lowering: Lowering
    kinds: Sequence[SensorKind]
    elements: Sequence[str]  # kinds whose wrenches can be read
    places: tuple[int, int]  # position and velocity coordinate of the first curve marker
    joint_coordinate: Callable[[JointSensorSpec], tuple[Ends, tuple[int, int, int]]]
    controller_output: Callable[[str], Expression]
    rows: list[tuple[int, ...]] = field(default_factory=list)
    terms: list[tuple[float, ...]] = field(default_factory=list)
    programs: list[Expression] = field(default_factory=list)

    def add(self, what: ChannelKind, first: int, n: int = -1, **fields: int) -> None:
        """Add a channel without terms."""
        words = {"side": 0, "quantity": 0, "axes": 0, "a": 0, "kind": -1} | fields
        self.rows.append((channel_kinds_of(self.kinds).index(what), first, n, *words.values()))

    def add_sum(self, terms: Sequence[Term]) -> None:
        """Add a channel that is a sum of terms."""
        self._add_terms(SUM, terms, 0)

    def add_angle(self, what: ChannelKind, term: Term, a: int = 0, kind: int = -1) -> None:
        """Add a channel of one term that counts turns: angle number `a` of a sensor, and `kind`."""
        self._add_terms(what, [term], a, kind)

    def _add_terms(self, what: ChannelKind, terms: Sequence[Term], a: int, kind: int = -1) -> None:
        channel, first = len(self.rows), len(self.terms)
        self.add(what, first, len(terms), a=a, kind=kind)
        for term in terms:
            measure = measures_of(self.kinds).index(term.measure)
            self.terms.append((measure, *term[1:-1], channel, term.factor))

    def add_program(self, expression: Expression) -> None:
        """Add a channel that is an expression of others."""
        self.add(EXPRESSION, len(self.programs))
        self.programs.append(expression)


def add_place(channels: Channels, spec: PlaceSensorSpec) -> None:
    """Add a channel: position of a curve marker along its curve, or its rate."""
    k = channels.lowering.groups.curve_points.number(spec.joint, spec.on)
    channels.add((PLACE, PLACE_RATE)[spec.derivative], channels.places[spec.derivative] + k)


def add_energy(channels: Channels, spec: EnergySensorSpec) -> None:
    """Add a channel: an energy of the model or of one body."""
    number = _ENERGIES.index(spec.quantity)
    if spec.body is None:
        channels.add(ENERGY, number)
    else:
        channels.add(BODY_ENERGY, number, channels.lowering.markers.numbers[spec.body])


def add_reaction(channels: Channels, spec: ReactionSensorSpec) -> None:
    """Add three channels: components of the force or moment of an element on one of its markers."""
    lowering = channels.lowering
    element = lowering.element(spec)
    fixed = {"global": GLOBAL_AXES, "joint": _AXES_OF_SIDE}
    axes = fixed[spec.axes] if spec.axes in fixed else lowering.marker(spec.axes)
    for a in range(3):
        channels.add(
            WRENCH,
            element.row,
            element.n,
            side=int((spec.on == "I") != element.reversed),
            quantity=int(spec.quantity == "moment"),
            axes=axes,
            a=a,
            kind=channels.elements.index(element.kind),
        )


def add_expression(channels: Channels, spec: ExpressionSensorSpec) -> None:
    """Add a channel: an expression of other channels."""
    channels.add_program(channels.lowering.functions.resolve(spec.value.expression))


PLACES = SensorKind(("place",), add_place, channels=(PLACE, PLACE_RATE))
ENERGIES = SensorKind(("energy",), add_energy, channels=(ENERGY, BODY_ENERGY))
REACTIONS = SensorKind(("reaction",), add_reaction, channels=(WRENCH,))
EXPRESSIONS = SensorKind(("expression",), add_expression, channels=(EXPRESSION,))


def sensor_tables(channels: Channels, states: Mapping[str, int]) -> tuple[Sensors, dict[str, int]]:
    """The tables of all channels in the order of `Model.channels`, and their numbers by name.

    `states`: velocity coordinate of each state by name. States that are no channel of the results
    come after all others.
    """
    model = channels.lowering.model
    add_sensor = {word: kind.add for kind in channels.kinds for word in kind.types}
    for spec in model.sensors.values():
        add_sensor[spec.type](channels, spec)
    for name in (*model.states, *model.controllers):
        if name in states:
            channels.add(STATE, states[name])
        else:
            channels.add_program(channels.controller_output(name))
    names = list(model.channels())
    hidden = [name for name in states if name not in names]
    for name in hidden:
        channels.add(STATE, states[name])
    numbers = {name: k for k, name in enumerate([*names, *hidden])}
    rows, terms = np.array(channels.rows, CHANNEL), np.array(channels.terms, TERM)
    return Sensors(rows, terms, lower(channels.programs, numbers)), numbers
