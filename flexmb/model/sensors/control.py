"""States and controllers: numbers of a model with rates of their own, in addition to the bodies.

A state is a number with a rate, an expression of channels, states and the time. A controller makes
an output of an input, both numbers in the scene's units, with the states that this needs; its
name is a channel like that of a state, for forces, rates and other controllers. A transfer function
becomes states in controllable canonical form (Kailath, Linear Systems, 1980, sec. 2.1); the
integral of a PID controller follows the limited output (back-calculation: Åström and Hägglund,
Advanced PID Control, 2006, sec. 3.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from flexmb.errors import Problem
from flexmb.model.functions.expression import Expression, Ops
from flexmb.model.functions.function import (
    Function,
    FunctionInDeclaredUnit,
    FunctionOf,
    UnitName,
)
from flexmb.model.values.quantities import Number, Quantity, Time, plain
from flexmb.model.values.reading import Spec, fail, fail_if

_Input = Annotated[Function, FunctionOf("", channels=True)]
_Scale = Annotated[float, Quantity("", "positive")]
_Coefficients = Annotated[tuple[Number, ...], BeforeValidator(plain)]


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
    def _a_number(self) -> Self:
        if self.start is not None and self.start.constant is None:
            raise fail(Problem("start", "is a number, no function of time"))
        return self

    @property
    def first(self) -> float:
        """Value at the start, in SI."""
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
        """Whether the output follows the input at once."""
        return True

    def output(self, name: str, e: Ops, time: float) -> Ops:
        """The output in the scene's units, e the input and ``time`` the scene's unit of it [s]."""
        raise NotImplementedError

    def states(self, name: str, e: Ops, time: float) -> Iterator[State]:
        """The states that it needs."""
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
    def _words_fit(self) -> Self:
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
        """Time [s] in which the integral follows."""
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
    def _proper(self) -> Self:
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
        """Coefficients b (n + 1) and a (n) of rising powers; the denominator's of s^n is 1."""
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
