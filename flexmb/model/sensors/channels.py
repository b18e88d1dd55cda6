"""Expressions over channels: what stands behind each name, and whether the names fit together.

In: a model. Out: expressions in SI over *primary* channels only, those that are measured and those
of states: channels that are expressions themselves, and the outputs of controllers, are put in as
they stand, which postfix programs allow. And problems: names with two meanings, channels that do
not exist or that no force can follow, algebraic loops.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator

from flexmb.errors import Problem
from flexmb.model.functions.expression import (
    CONSTANTS,
    Expression,
    Ops,
    channel_of,
    unknown_channel,
)
from flexmb.model.functions.function import Function
from flexmb.model.lookup import ModelData
from flexmb.model.references import Scope
from flexmb.model.sensors.control import State, scaled_program
from flexmb.model.sensors.sensor import EnergySensorSpec, ExpressionSensorSpec, PlaceSensorSpec

CHANNEL_SECTIONS = ("sensors", "states", "controllers")
"""Sections whose entries have channels."""

_AT_OUTPUTS_ONLY = {EnergySensorSpec: "an energy", PlaceSensorSpec: "a place along a curve"}


def resolved(model: ModelData, expression: Expression) -> Expression:
    """The same expression over primary channels, in SI; one without channels as it is."""
    return Expression(expression.text, _inlined(model, expression.ops))


def _inlined(model: ModelData, ops: Ops) -> Ops:
    return tuple(
        step
        for op in ops
        for step in (_in_scene_units(model, channel_of(op[0])) if channel_of(op[0]) else (op,))
    )


def _in_scene_units(model: ModelData, name: str) -> Ops:
    """A channel as an expression means it."""
    if name in model.controllers:
        return _output(model, name)
    sensor = model.sensors.get(name)
    si: Ops = ((f"@{name}", 0.0),)
    if isinstance(sensor, ExpressionSensorSpec):
        si = _inlined(model, sensor.value.expression.ops)
    return scaled_program(1.0 / model.units.scale(model.channel_unit(name) or ""), si)


def _input(model: ModelData, name: str) -> Ops:
    return _inlined(model, model.controllers[name].input.expression.ops)


def _output(model: ModelData, name: str) -> Ops:
    """The output of a controller in the scene's units."""
    controller = model.controllers[name]
    e = _input(model, name) if controller.direct else ()  # else it may depend on the output
    ops: Ops = controller.output(name, e, model.units.time)
    return ops


def channel_program(model: ModelData, name: str) -> Expression:
    """What an expression or the output of a controller is, in SI."""
    if name in model.controllers:
        scale = model.units.scale(model.controllers[name].unit)
        return Expression(name, scaled_program(scale, _output(model, name)))
    sensor = model.sensors[name]
    assert isinstance(sensor, ExpressionSensorSpec)  # all others are measured
    return resolved(model, sensor.value.expression)


def states_of(model: ModelData) -> tuple[State, ...]:
    """All states of a model: its own, then those of its controllers."""
    states = []
    for name, spec in model.states.items():
        unit = model.units.scale(spec.unit)
        scale = (spec.scale or max(1.0, abs(spec.first) / unit)) * unit
        states.append(State(name, resolved(model, spec.rate.expression), spec.first, scale))
    for name, controller in model.controllers.items():
        states += controller.states(name, _input(model, name), model.units.time)
    return tuple(states)


def feedback_functions(model: ModelData) -> Iterator[tuple[str, Function]]:
    """All functions that name channels, with their scene paths."""
    for section in ("forces", *CHANNEL_SECTIONS):
        for name, spec in getattr(model, section).items():
            for key, value in vars(spec).items():
                for i, function in enumerate(value if isinstance(value, tuple) else (value,)):
                    if isinstance(function, Function) and function.expression.channels:
                        at = f"[{i}]" if isinstance(value, tuple) else ""
                        yield f"{section}.{name}.{key}{at}", function


def channel_problems(scope: Scope) -> Iterator[Problem]:
    """Names in expressions, and how they depend on each other."""
    yield from _name_problems(scope)
    channels = dict.fromkeys(scope.model.channels())
    broken = {name for section in CHANNEL_SECTIONS for name in scope.broken.get(section, {})}
    unknown = False
    for where, function in feedback_functions(scope.model):
        text = function.expression.text
        yield from _ambiguous_names(scope, channels, where, text)
        for name in function.expression.channels:
            if name not in channels and name.partition(".")[0] not in broken:
                names = (*channels, *scope.model.parameters)
                problem = unknown_channel(text, name, names)
                yield Problem(where, problem.what, problem.allowed, problem.nearest)
            unknown |= name not in channels
    if not unknown:
        loops = list(_algebraic_loops(scope.model))
        yield from loops
        if not loops:
            yield from _unavailable_channels(scope.model)


def _name_problems(scope: Scope) -> Iterator[Problem]:
    owner: dict[str, str] = {}
    for section in CHANNEL_SECTIONS:
        for name in scope.names(section):
            if name in owner:
                what = f'the name "{name}" is taken by {owner[name]}: both would be channels'
                yield Problem(f"{section}.{name}", what)
            owner.setdefault(name, f"{section}.{name}")


def _ambiguous_names(
    scope: Scope, channels: Container[str], where: str, text: str
) -> Iterator[Problem]:
    meanings = {**dict.fromkeys(CONSTANTS, "a constant"), "t": "the time"}
    meanings |= dict.fromkeys(scope.model.parameters, "a parameter")
    for name, meaning in meanings.items():
        if name in channels and re.search(rf"(?<![\w.]){re.escape(name)}\b", text):
            yield Problem(where, f'"{name}" is {meaning} and a channel; rename the channel')


def _algebraic_loops(model: ModelData) -> Iterator[Problem]:
    """Channels that depend on themselves at the same moment."""
    reported: set[str] = set()
    for first in model.channels():
        trail = _way_back(model, first, (first,))
        if trail and not reported & set(trail):
            reported |= set(trail)
            section = next(s for s in CHANNEL_SECTIONS if first in getattr(model, s))
            what = f"depends on itself at the same moment: {' -> '.join(trail)}"
            cure = "leave one of them out, or put a state or a filter between"
            yield Problem(f"{section}.{first}", f"{what}; {cure}")


def _way_back(model: ModelData, first: str, trail: tuple[str, ...]) -> tuple[str, ...]:
    """The way from the last channel of a trail to the first one, () if there is none."""
    for name in _inputs_of(model, trail[-1]):
        if name == first:
            return (*trail, name)
        if name not in trail:
            way = _way_back(model, first, (*trail, name))
            if way:
                return way
    return ()


def _inputs_of(model: ModelData, name: str) -> tuple[str, ...]:
    """The channels that a channel depends on at the same moment."""
    sensor, controller = model.sensors.get(name), model.controllers.get(name)
    if isinstance(sensor, ExpressionSensorSpec):
        return sensor.value.expression.channels
    if controller is None or not controller.direct:
        return ()
    channels: tuple[str, ...] = controller.input.expression.channels
    return channels


def _unavailable_channels(model: ModelData) -> Iterator[Problem]:
    """Energies and places along curves are computed at outputs only."""
    for where, function in feedback_functions(model):
        if where.startswith("sensors."):
            continue
        for name in resolved(model, function.expression).channels:
            for kind, noun in _AT_OUTPUTS_ONLY.items():
                if isinstance(model.sensors.get(name), kind):
                    what = (
                        f'"{name}" is {noun}, computed at outputs only: no force can depend on it'
                    )
                    yield Problem(where, what)
