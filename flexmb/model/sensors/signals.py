"""Expressions over channels: what stands behind each name, and what states a model has by it.

In: a model. Out: expressions in SI over *primary* channels only, those that are measured and those
of states: channels that are expressions themselves, and the outputs of controllers, are put in as
they stand, which postfix programs allow. A transfer function becomes states in controllable
canonical form (Kailath, Linear Systems, 1980, sec. 2.1); the integral of a PID controller follows
the limited output (back-calculation: Åström and Hägglund, Advanced PID Control, 2006, sec. 3.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexmb.model.functions.expression import Expression, Ops, channel_of
from flexmb.model.functions.function import Function
from flexmb.model.sensors.sensor import ExpressionSensorSpec
from flexmb.model.sensors.states import ControllerSpec, PidSpec, TransferFunctionSpec

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = [
    "State",
    "channel_program",
    "depends_on",
    "live_functions",
    "resolved",
    "states_of",
]


@dataclass(frozen=True)
class State:
    """A number with a rate per second; where it starts, and from where on it is large."""

    name: str
    rate: Expression
    start: float | Expression
    scale: float


def _const(value: float) -> Ops:
    return (("const", value),)


def _op(name: str, *arguments: Ops) -> Ops:
    """An operation on its arguments."""
    return (*(step for argument in arguments for step in argument), (name, 0.0))


def _times(factor: float, ops: Ops) -> Ops:
    return ops if factor == 1.0 else _op("*", ops, _const(factor))


def _sum(parts: list[Ops]) -> Ops:
    total = parts[0] if parts else _const(0.0)
    for part in parts[1:]:
        total = _op("+", total, part)
    return total


def resolved(model: Model, expression: Expression) -> Expression:
    """The same expression over primary channels, in SI; one without channels as it is."""
    return Expression(expression.text, _inlined(model, expression.ops))


def _inlined(model: Model, ops: Ops) -> Ops:
    return tuple(
        step
        for op in ops
        for step in (_in_scene_units(model, channel_of(op[0])) if channel_of(op[0]) else (op,))
    )


def _in_scene_units(model: Model, name: str) -> Ops:
    """A channel as an expression means it."""
    if name in model.controllers:
        return _output(model, name, model.controllers[name])
    sensor = model.sensors.get(name)
    si: Ops = ((f"@{name}", 0.0),)
    if isinstance(sensor, ExpressionSensorSpec):
        si = _inlined(model, sensor.value.expression.ops)
    return _times(1.0 / model.units.scale(model.channel_unit(name) or ""), si)


def channel_program(model: Model, name: str) -> Expression:
    """What an expression or the output of a controller is, in SI."""
    if name in model.controllers:
        spec = model.controllers[name]
        return Expression(name, _times(model.units.scale(spec.unit), _output(model, name, spec)))
    sensor = model.sensors[name]
    assert isinstance(sensor, ExpressionSensorSpec)  # all others are measured
    return resolved(model, sensor.value.expression)


def states_of(model: Model) -> tuple[State, ...]:
    """All states of a model: its own, then those of its controllers."""
    own = [
        State(
            name,
            resolved(model, spec.rate.expression),
            spec.first,
            (spec.scale or max(1.0, abs(spec.first) / model.units.scale(spec.unit)))
            * model.units.scale(spec.unit),
        )
        for name, spec in model.states.items()
    ]
    return (*own, *(s for name in model.controllers for s in _kept(model, name)))


def _kept(model: Model, name: str) -> Iterator[State]:
    """The states of one controller."""
    spec = model.controllers[name]
    e = _inlined(model, spec.input.expression.ops)
    if isinstance(spec, PidSpec):
        yield from _pid_states(model, name, spec, e)
    elif isinstance(spec, TransferFunctionSpec):
        yield from _transfer_states(model, name, spec, e)


def _output(model: Model, name: str, spec: ControllerSpec) -> Ops:
    """The output of a controller in the scene's units."""
    if isinstance(spec, PidSpec):
        return _limited(spec, _wanted(model, name, spec))
    assert isinstance(spec, TransferFunctionSpec)  # there are no others
    b, a = _monic(spec)
    n = len(a)
    parts = [
        _times(c, ((f"@{name}.{i}", 0.0),)) for i in range(n) if (c := b[i] - a[i] * b[n]) != 0.0
    ]
    if spec.direct:
        parts.append(_times(b[n], _inlined(model, spec.input.expression.ops)))
    return _sum(parts)


def _wanted(model: Model, name: str, spec: PidSpec) -> Ops:
    """What a PID controller would give without limits."""
    e = _inlined(model, spec.input.expression.ops)
    parts = [_times(spec.kp, e)] if spec.kp != 0.0 else []
    if spec.ki != 0.0:
        parts.append(((f"@{name}.integral", 0.0),))
    if spec.filter is not None:
        past: Ops = ((f"@{name}.filter", 0.0),)
        gain = spec.kd * model.units.time / spec.filter
        parts.append(_times(gain, _op("-", e, past)))
    return _sum(parts)


def _limited(spec: PidSpec, ops: Ops) -> Ops:
    if spec.limits is None:
        return ops
    low, high = spec.limits
    return _op("min", _op("max", ops, _const(low)), _const(high))


def _pid_states(model: Model, name: str, spec: PidSpec, e: Ops) -> Iterator[State]:
    time = model.units.time
    if spec.ki != 0.0:
        rate = _times(spec.ki / time, e)
        if spec.limits is not None:
            wanted = _wanted(model, name, spec)
            excess = _op("-", _limited(spec, wanted), wanted)
            rate = _op("+", rate, _times(1.0 / _tracking(spec, time), excess))
        gain = abs(spec.kp) + abs(spec.ki) + abs(spec.kd)
        yield State(f"{name}.integral", Expression(name, rate), 0.0, spec.scale * gain)
    if spec.filter is not None:
        past: Ops = ((f"@{name}.filter", 0.0),)
        rate = _times(1.0 / spec.filter, _op("-", e, past))
        yield State(f"{name}.filter", Expression(name, rate), Expression(name, e), spec.scale)


def _tracking(spec: PidSpec, time: float) -> float:
    """Time [s] in which the integral follows."""
    if spec.tracking is not None:
        return spec.tracking
    ratio = math.sqrt(abs(spec.kd / spec.ki)) if spec.kd != 0.0 else abs(spec.kp / spec.ki)
    return ratio * time


def _monic(spec: TransferFunctionSpec) -> tuple[list[float], list[float]]:
    """Coefficients b (n + 1) and a (n) of rising powers, that of s^n in the denominator being 1."""
    b, a = spec.polynomials
    rising = [c / a[0] for c in reversed(b)] + [0.0] * (len(a) - len(b))
    return rising, [c / a[0] for c in reversed(a[1:])]


def _transfer_states(
    model: Model, name: str, spec: TransferFunctionSpec, e: Ops
) -> Iterator[State]:
    """x_i' = x_{i+1}, x_n' = e − Σ a_i x_i, in the scene's time."""
    _, a = _monic(spec)
    n, per_second = len(a), 1.0 / model.units.time
    fast = float(np.abs(np.roots([1.0, *reversed(a)])).max(initial=0.0)) or 1.0
    for i in range(n):
        rate: Ops = ((f"@{name}.{i + 1}", 0.0),)
        if i == n - 1:
            parts = [_times(-c, ((f"@{name}.{k}", 0.0),)) for k, c in enumerate(a) if c != 0.0]
            rate = _sum([e, *parts])
        program = Expression(name, _times(per_second, rate))
        yield State(f"{name}.{i}", program, 0.0, spec.scale * fast ** (i - n))


def live_functions(model: Model) -> Iterator[tuple[str, Function]]:
    """All functions that name channels, with their scene paths."""
    for section in ("forces", "sensors", "states", "controllers"):
        for name, spec in getattr(model, section).items():
            for key, value in vars(spec).items():
                for i, function in enumerate(value if isinstance(value, tuple) else (value,)):
                    if isinstance(function, Function) and function.expression.channels:
                        at = f"[{i}]" if isinstance(value, tuple) else ""
                        yield f"{section}.{name}.{key}{at}", function


def depends_on(model: Model, name: str) -> tuple[str, ...]:
    """The channels that a channel depends on at the same moment."""
    sensor, controller = model.sensors.get(name), model.controllers.get(name)
    if isinstance(sensor, ExpressionSensorSpec):
        return sensor.value.expression.channels
    if controller is None or (
        isinstance(controller, TransferFunctionSpec) and not controller.direct
    ):
        return ()
    return controller.input.expression.channels
