"""States and controllers, and the channels that expressions read.

A state is a number with a rate, an expression of channels, states and the time. A controller
computes an output from an input, both in the scene's units, with states of its own; its name is a
channel like that of a state, which forces, rates and other controllers may use. A transfer function
is realised in controllable canonical form (Kailath, Linear Systems, 1980, sec. 2.1). The integral
of a PID controller is limited with its output by back-calculation (Åström and Hägglund, Advanced
PID Control, 2006, sec. 3.5).

Expressions are compiled over *primary* channels only: measured channels and states. A channel that
is an expression itself, or the output of a controller, is replaced by its own program, as postfix
programs allow. Problems are names with two meanings, channels that do not exist or that no force
can depend on, and algebraic loops.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from flexmb.errors import Problem
from flexmb.model.functions.expression import (
    CONSTANTS,
    Expression,
    Ops,
    channel_of,
    unknown_channel,
)
from flexmb.model.functions.function import Function, FunctionInDeclaredUnit, FunctionOf, UnitName
from flexmb.model.lookup import ModelData, Scope
from flexmb.model.quantities import Number, Quantity, Time, plain
from flexmb.model.reading import Spec, fail, fail_if
from flexmb.model.sensor import EnergySensorSpec, ExpressionSensorSpec, PlaceSensorSpec

_Input = Annotated[Function, FunctionOf("", channels=True)]
_Scale = Annotated[float, Quantity("", "positive")]
_Coefficients = Annotated[tuple[Number, ...], BeforeValidator(plain)]


@dataclass(frozen=True)
class State:
    """A number with a rate per second, its start value, and the size from which on it counts as
    large."""

    name: str
    rate: Expression
    start: float | Expression
    scale: float


def _const(value: float) -> Ops:
    return (("const", value),)


def _op(name: str, *arguments: Ops) -> Ops:
    return (*(step for argument in arguments for step in argument), (name, 0.0))


def scaled_program(factor: float, ops: Ops) -> Ops:
    """A factor times the value of a program."""
    return ops if factor == 1.0 else _op("*", ops, _const(factor))


def _sum(parts: list[Ops]) -> Ops:
    total = parts[0] if parts else _const(0.0)
    for part in parts[1:]:
        total = _op("+", total, part)
    return total


class StateSpec(Spec):
    """A number with a rate [unit/s], from ``start`` [unit] on.

    ``scale`` is a value from which on it is large: error control keeps errors small against it; by
    default the larger of the start and one.
    """

    unit: UnitName = ""
    rate: Annotated[Function, FunctionInDeclaredUnit(rate=True)]
    start: Annotated[Function, FunctionInDeclaredUnit(channels=False)] | None = None
    scale: _Scale | None = None

    @model_validator(mode="after")
    def _check_start(self) -> Self:
        if self.start is not None and self.start.constant is None:
            raise fail(Problem("start", "is a number, no function of time"))
        return self

    @property
    def first(self) -> float:
        """The start value, in SI."""
        return float(self.start.constant or 0.0) if self.start is not None else 0.0


class ControllerSpec(Spec):
    """Base of the controllers: ``input`` is an expression; ``unit`` that of the output.

    ``scale`` is the size of the input from which on it is large, for the error control.
    """

    unit: UnitName = ""
    input: _Input
    scale: _Scale = 1.0

    @property
    def direct(self) -> bool:
        """Whether the output depends on the present input (direct feedthrough)."""
        return True

    def output(self, name: str, e: Ops, time: float) -> Ops:
        """The program of the output in the scene's units; e: that of the input, ``time``: unit of
        time [s]."""
        raise NotImplementedError

    def states(self, name: str, e: Ops, time: float) -> Iterator[State]:
        """The states that the controller needs."""
        raise NotImplementedError


class PidSpec(ControllerSpec):
    """Output kp e + ki int(e) + kd e', e the input, its rate filtered: kd s/(1 + filter s).

    With ``limits = [low, high]`` the output stays between them, and the integral follows it there
    within the time ``tracking`` (anti-windup by back-calculation); by default sqrt(kd/ki), without
    kd kp/ki. Gains are in the scene's units. The filter starts at rest: no kick.
    """

    type: Literal["pid"]
    kp: Number = 0.0
    ki: Number = 0.0
    kd: Number = 0.0
    filter: Time | None = None
    limits: tuple[Number, Number] | None = None
    tracking: Time | None = None

    @model_validator(mode="after")
    def _check_gains(self) -> Self:
        problems = []
        if self.kp == 0 and self.ki == 0 and self.kd == 0:
            problems.append(Problem("", "needs kp, ki or kd"))
        if self.kd != 0 and self.filter is None:
            what = "is missing: the time constant of the rate's filter, a tenth of kd/kp or less"
            problems.append(Problem("filter", what))
        if self.kd == 0 and self.filter is not None:
            problems.append(Problem("filter", "is that of the rate, but kd is zero; leave it out"))
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            what = f"the lower limit comes first, given [{self.limits[0]:g}, {self.limits[1]:g}]"
            problems.append(Problem("limits", what))
        winds = self.limits is not None and self.ki != 0
        if self.tracking is not None and not winds:
            problems.append(Problem("tracking", "has a meaning with ki and limits; leave it out"))
        if winds and self.tracking is None and self.kp == 0 and self.kd == 0:
            what = "is missing: the time in which the integral follows an output at its limit"
            problems.append(Problem("tracking", what))
        fail_if(problems)
        return self

    def output(self, name: str, e: Ops, time: float) -> Ops:
        return self._limited(self._unlimited(name, e, time))

    def _unlimited(self, name: str, e: Ops, time: float) -> Ops:
        parts = [scaled_program(self.kp, e)] if self.kp != 0.0 else []
        if self.ki != 0.0:
            parts.append(((f"@{name}.integral", 0.0),))
        if self.filter is not None:
            past: Ops = ((f"@{name}.filter", 0.0),)
            gain = self.kd * time / self.filter
            parts.append(scaled_program(gain, _op("-", e, past)))
        return _sum(parts)

    def _limited(self, ops: Ops) -> Ops:
        if self.limits is None:
            return ops
        low, high = self.limits
        return _op("min", _op("max", ops, _const(low)), _const(high))

    def states(self, name: str, e: Ops, time: float) -> Iterator[State]:
        if self.ki != 0.0:
            rate = scaled_program(self.ki / time, e)
            if self.limits is not None:
                output = self._unlimited(name, e, time)
                excess = _op("-", self._limited(output), output)
                rate = _op("+", rate, scaled_program(1.0 / self._tracking_time(time), excess))
            gain = abs(self.kp) + abs(self.ki) + abs(self.kd)
            yield State(f"{name}.integral", Expression(name, rate), 0.0, self.scale * gain)
        if self.filter is not None:
            past: Ops = ((f"@{name}.filter", 0.0),)
            rate = scaled_program(1.0 / self.filter, _op("-", e, past))
            yield State(f"{name}.filter", Expression(name, rate), Expression(name, e), self.scale)

    def _tracking_time(self, time: float) -> float:
        """Time constant [s] with which the integral follows the limited output."""
        if self.tracking is not None:
            return self.tracking
        kd, kp = self.kd, self.kp
        return (math.sqrt(abs(kd / self.ki)) if kd != 0.0 else abs(kp / self.ki)) * time


class TransferFunctionSpec(ControllerSpec):
    """Output G(s) input, coefficients of falling powers of s; from rest.

    G = (b0 s^m + ... + bm)/(a0 s^n + ... + an), m <= n; realised in controllable canonical form.
    """

    type: Literal["transfer-function"]
    numerator: _Coefficients
    denominator: _Coefficients

    @model_validator(mode="after")
    def _check_degrees(self) -> Self:
        b, a = self.polynomials
        if len(a) == 0:
            raise fail(Problem("denominator", "is zero"))
        if len(b) > len(a):
            what = (
                f"has degree {len(b) - 1}, the denominator {len(a) - 1}: such a transfer function "
                "is improper, it would need rates of its input; raise the denominator's degree "
                "with a fast pole"
            )
            raise fail(Problem("numerator", what))
        return self

    @property
    def polynomials(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Numerator and denominator without leading zeros."""
        trimmed = (np.trim_zeros(np.array(p), "f") for p in (self.numerator, self.denominator))
        b, a = (tuple(float(c) for c in p) for p in trimmed)
        return b, a

    @property
    def direct(self) -> bool:
        b, a = self.polynomials
        return len(b) == len(a)

    def _monic(self) -> tuple[list[float], list[float]]:
        """Coefficients b (n + 1) and a (n) of rising powers, divided so that s^n has the
        coefficient 1."""
        b, a = self.polynomials
        rising = [c / a[0] for c in reversed(b)] + [0.0] * (len(a) - len(b))
        return rising, [c / a[0] for c in reversed(a[1:])]

    def output(self, name: str, e: Ops, time: float) -> Ops:
        b, a = self._monic()
        n = len(a)
        parts = [
            scaled_program(c, ((f"@{name}.{i}", 0.0),))
            for i in range(n)
            if (c := b[i] - a[i] * b[n]) != 0.0
        ]
        if self.direct:
            parts.append(scaled_program(b[n], e))
        return _sum(parts)

    def states(self, name: str, e: Ops, time: float) -> Iterator[State]:
        """x_i' = x_{i+1}, x_n' = e - Σ a_i x_i, in the scene's time."""
        _, a = self._monic()
        n, per_second = len(a), 1.0 / time
        fast = float(np.abs(np.roots([1.0, *reversed(a)])).max(initial=0.0)) or 1.0
        for i in range(n):
            rate: Ops = ((f"@{name}.{i + 1}", 0.0),)
            if i == n - 1:
                x = [((f"@{name}.{k}", 0.0),) for k in range(n)]
                rate = _sum([e, *(scaled_program(-a[k], x[k]) for k in range(n) if a[k] != 0.0)])
            program = Expression(name, scaled_program(per_second, rate))
            yield State(f"{name}.{i}", program, 0.0, self.scale * fast ** (i - n))


CHANNEL_SECTIONS = ("sensors", "states", "controllers")
"""Sections whose entries have channels."""

_AT_OUTPUTS_ONLY = {EnergySensorSpec: "an energy", PlaceSensorSpec: "a place along a curve"}


def resolved(model: ModelData, expression: Expression) -> Expression:
    """The expression over primary channels, in SI; unchanged if it has no channels."""
    return Expression(expression.text, _inlined(model, expression.ops))


def _inlined(model: ModelData, ops: Ops) -> Ops:
    return tuple(
        step
        for op in ops
        for step in (_in_scene_units(model, channel_of(op[0])) if channel_of(op[0]) else (op,))
    )


def _in_scene_units(model: ModelData, name: str) -> Ops:
    """The program of a channel in the scene's units, as an expression uses it."""
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
    # without direct feedthrough the input may depend on the output
    e = _input(model, name) if controller.direct else ()
    ops: Ops = controller.output(name, e, model.units.time)
    return ops


def channel_program(model: ModelData, name: str) -> Expression:
    """The program, in SI, of an expression sensor or of the output of a controller."""
    if name in model.controllers:
        scale = model.units.scale(model.controllers[name].unit)
        return Expression(name, scaled_program(scale, _output(model, name)))
    sensor = model.sensors[name]
    assert isinstance(sensor, ExpressionSensorSpec)  # all other channels are measured
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


def feedback_functions(model: ModelData, every: bool = False) -> Iterator[tuple[str, Function]]:
    """All functions that use channels (`every`: that are allowed to), with their scene paths."""
    for section in ("forces", *CHANNEL_SECTIONS):
        for name, spec in getattr(model, section).items():
            for key, value in vars(spec).items():
                for i, function in enumerate(value if isinstance(value, tuple) else (value,)):
                    if isinstance(function, Function) and (every or function.expression.channels):
                        at = f"[{i}]" if isinstance(value, tuple) else ""
                        yield f"{section}.{name}.{key}{at}", function


def channel_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the names in expressions, and algebraic loops."""
    yield from _name_problems(scope)
    channels = dict.fromkeys(scope.model.channels())
    broken = broken_channels(scope)
    unknown = False
    for where, function in feedback_functions(scope.model, every=True):
        text = function.expression.text
        yield from _ambiguous_names(scope, channels, where, text)
        for name in function.expression.channels:
            if name not in channels and name.partition(".")[0] not in broken:
                names = ("t", *channels, *scope.model.parameters)
                problem = unknown_channel(text, name, names)
                yield Problem(where, problem.what, problem.allowed, problem.nearest)
            unknown |= name not in channels
    if not unknown:
        loops = list(_algebraic_loops(scope.model))
        yield from loops
        if not loops:
            yield from _unavailable_channels(scope.model)


def broken_channels(scope: Scope) -> set[str]:
    """Names of entries that would give channels but could not be read."""
    return {name for section in CHANNEL_SECTIONS for name in scope.broken.get(section, {})}


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
    """Algebraic loops: channels that depend on themselves at the same time."""
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
    """The dependencies that lead from the last channel of a trail back to the first one; () if
    none."""
    for name in _inputs_of(model, trail[-1]):
        if name == first:
            return (*trail, name)
        if name not in trail:
            way = _way_back(model, first, (*trail, name))
            if way:
                return way
    return ()


def _inputs_of(model: ModelData, name: str) -> tuple[str, ...]:
    """The channels that a channel depends on at the same time."""
    sensor, controller = model.sensors.get(name), model.controllers.get(name)
    if isinstance(sensor, ExpressionSensorSpec):
        return sensor.value.expression.channels
    if controller is None or not controller.direct:
        return ()
    channels: tuple[str, ...] = controller.input.expression.channels
    return channels


def _unavailable_channels(model: ModelData) -> Iterator[Problem]:
    """Problems with energies and places along curves, which are computed at outputs only."""
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
