"""Named forms of functions of time: constant, polynomial, harmonic, Fourier, motion profiles.

In: the numbers of a table such as ``{type = "harmonic", amplitude = 2, frequency = 50}``, in the
scene's units. Out: operations over t in SI, the same as those of expressions. Motion profiles go
from one value to another and stay there; their rises from 0 to 1 are those of
:mod:`flexmb.model.functions.derivatives`, the trapezoidal profile is a piecewise polynomial. Source
of the cam curves: Norton, Cam Design and Manufacturing Handbook, 2nd ed. (2009), chapters 2 and 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.functions.piecewise import Piecewise
from flexmb.model.quantities import Angle, Measured, Quantity, plain, read_numbers
from flexmb.model.reading import ReadContext, Reader, Spec, context_of, fail, quote


def _coefficients(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Coefficients c0, c1, c2, ...; the k-th has the unit of the value over time to the power k."""
    names = context_of(info)
    value = plain(value)
    if not isinstance(value, list):
        raise fail(Problem("", f"a list is expected, given {quote(value)}"))
    unit = names.expected_unit or ""
    rates = ["/s", *(f"/s^{k}" for k in range(2, len(value)))]
    return tuple(read_numbers(value, names, [unit, *((unit or "1") + rate for rate in rates)]))


Ordinate = Annotated[float, Measured()]
Moment = Annotated[float, Quantity("s")]


class FunctionForm(Spec):
    """Base of the named forms; each converts its numbers, in SI, to operations over t."""

    def ops(self) -> Ops:
        raise NotImplementedError

    def written(self, table: Any, names: ReadContext) -> Any:
        """The user's table in a form that needs no other file."""
        return table


class Constant(FunctionForm):
    """value"""

    type: Literal["constant"]
    value: Ordinate

    def ops(self) -> Ops:
        return (("const", self.value),)


class Polynomial(FunctionForm):
    """c0 + c1 t + c2 t^2 + ..., with coefficients = [c0, c1, c2, ...]"""

    type: Literal["polynomial"]
    coefficients: Annotated[tuple[float, ...], Reader(_coefficients)]

    def ops(self) -> Ops:
        """Horner's scheme."""
        *lower, highest = self.coefficients or (0.0,)
        program: Ops = (("const", highest),)
        for c in reversed(lower):
            program = (*program, ("t", 0.0), ("*", 0.0), ("const", c), ("+", 0.0))
        return program


class Harmonic(FunctionForm):
    """offset + amplitude sin(2 pi frequency t + phase), frequency in cycles per unit of time"""

    type: Literal["harmonic"]
    amplitude: Ordinate
    frequency: Annotated[float, Quantity("Hz")]
    phase: Angle = 0.0
    offset: Ordinate = 0.0

    def ops(self) -> Ops:
        names = {"a": self.amplitude, "w": 2 * math.pi * self.frequency}
        names |= {"phase": self.phase, "offset": self.offset}
        return parse("offset + a*sin(w*t + phase)", names).ops


Amplitudes = Annotated[tuple[Ordinate, ...], BeforeValidator(plain)]


class Fourier(FunctionForm):
    """offset + sum over k = 1, 2, ... of a_k cos(k w t + phase) + b_k sin(k w t + phase),

    with w = 2 pi frequency, cosine = [a_1, a_2, ...] and sine = [b_1, b_2, ...]
    """

    type: Literal["fourier"]
    frequency: Annotated[float, Quantity("Hz")]
    cosine: Amplitudes = ()
    sine: Amplitudes = ()
    phase: Angle = 0.0
    offset: Ordinate = 0.0

    def ops(self) -> Ops:
        names = {"offset": self.offset, "w": 2 * math.pi * self.frequency, "phase": self.phase}
        terms = ["offset"]
        for wave, letter, amplitudes in (("cos", "a", self.cosine), ("sin", "b", self.sine)):
            for k, amplitude in enumerate(amplitudes, start=1):
                names[f"{letter}{k}"] = amplitude
                terms.append(f"{letter}{k}*{wave}({k}*w*t + phase)")
        program: Ops = ()
        for term in terms:  # each by itself: a long sum would nest too deeply for a parser
            program = (*program, *parse(term, names).ops, *((("+", 0.0),) if program else ()))
        return program


class Rise(FunctionForm):
    """Base of the forms that rise from y0 at t0 to y1 at t1 by a function of expressions."""

    function: ClassVar[str]
    t0: Moment = 0.0
    y0: Ordinate = 0.0
    t1: Moment
    y1: Ordinate

    @model_validator(mode="after")
    def _check_order(self, info: ValidationInfo) -> Self:
        _after("t1", self.t1, self.t0, context_of(info))
        return self

    def ops(self) -> Ops:
        names = {"t0": self.t0, "y0": self.y0, "t1": self.t1, "y1": self.y1}
        return parse(f"{self.function}(t, t0, y0, t1, y1)", names).ops


def _after(where: str, end: float, begin: float, names: ReadContext) -> None:
    if end <= begin:
        units = names.units
        t0, t1 = units.say(begin, "s"), units.say(end, "s")
        raise fail(Problem(where, f"must lie after t0 = {t0}, is {t1}"))


class Step(Rise):
    """y0 before t0, y1 after t1, in between a cubic with zero slope at both ends"""

    type: Literal["step"]
    function = "step"


class Step5(Rise):
    """y0 + (y1 - y0) (10 s^3 - 15 s^4 + 6 s^5), s from 0 at t0 to 1 at t1: 3-4-5 polynomial"""

    type: Literal["step5"]
    function = "step5"


class Havsin(Rise):
    """y0 + (y1 - y0) (1 - cos(pi s))/2, s from 0 at t0 to 1 at t1: haversine"""

    type: Literal["havsin"]
    function = "havsin"


class Cycloidal(Rise):
    """y0 + (y1 - y0) (s - sin(2 pi s)/(2 pi)), s from 0 at t0 to 1 at t1"""

    type: Literal["cycloidal"]
    function = "cycloidal"


class ModifiedSine(Rise):
    """y0 + (y1 - y0) m(s), s from 0 at t0 to 1 at t1;

    m'' = 4 pi^2/(4 + pi) times sin(4 pi s) in the first and last eighth, between them
    cos(4 pi s/3 - pi/6)
    """

    type: Literal["modified-sine"]
    function = "modsine"


@dataclass(frozen=True)
class _Rate(Quantity):
    """Annotation of a float whose unit is the expected one over a power of time."""

    power: int = 1

    def unit_in(self, names: ReadContext) -> str | None:
        unit = (names.expected_unit or "1") + "/s"
        return unit if self.power == 1 else f"{unit}^{self.power}"


class Trapezoidal(FunctionForm):
    """y0 before t0, then constant acceleration, constant speed and constant deceleration to y1;
    either within t1 - t0 (acceleration and deceleration take ramp each, a third by default), or in
    the shortest time within limits of speed and acceleration
    """

    type: Literal["trapezoidal"]
    t0: Moment = 0.0
    y0: Ordinate = 0.0
    y1: Ordinate
    t1: Moment | None = None
    ramp: Annotated[float, Quantity("s", "positive")] | None = None
    speed: Annotated[float, _Rate("", "positive")] | None = None
    acceleration: Annotated[float, _Rate("", "positive", power=2)] | None = None

    @model_validator(mode="after")
    def _check_law(self, info: ValidationInfo) -> Self:
        ways = ("t1", "ramp", "speed", "acceleration")
        present = [name for name in ways if getattr(self, name) is not None]
        if present not in (["t1"], ["t1", "ramp"], ["speed", "acceleration"]):
            what = 'give "t1" (and perhaps "ramp"), or "speed" and "acceleration"'
            raise fail(Problem("", f"{what}; given: {', '.join(present) or 'none of them'}"))
        if self.t1 is not None:
            _after("t1", self.t1, self.t0, context_of(info))
            if self.ramp is not None and self.ramp > 0.5 * (self.t1 - self.t0):
                half = context_of(info).units.say(0.5 * (self.t1 - self.t0), "s")
                raise fail(Problem("ramp", f"must not be longer than half the time, {half}"))
        elif self.y1 == self.y0:
            raise fail(Problem("y1", "must differ from y0: the profile has no length"))
        return self

    def times(self) -> tuple[float, float]:
        """Durations of the acceleration (equal to that of the deceleration) and of the constant
        speed [s]."""
        if self.t1 is not None:
            whole = self.t1 - self.t0
            ramp = whole / 3.0 if self.ramp is None else self.ramp
            return ramp, whole - 2.0 * ramp
        # speed and acceleration are given if t1 is not
        assert self.speed is not None and self.acceleration is not None
        way = abs(self.y1 - self.y0)
        if way * self.acceleration < self.speed**2:  # the speed is never reached
            return float(np.sqrt(way / self.acceleration)), 0.0
        ramp = self.speed / self.acceleration
        return ramp, way / self.speed - ramp

    def ops(self) -> Ops:
        ramp, cruise = self.times()
        speed = (self.y1 - self.y0) / (ramp + cruise)
        rate = 0.5 * speed / ramp
        first = self.y0 + 0.5 * speed * ramp
        last = first + speed * cruise
        pieces = [(ramp, [self.y0, 0.0, rate]), (cruise, [first, speed, 0.0])]
        pieces.append((ramp, [last, speed, -rate]))
        pieces = [piece for piece in pieces if piece[0] > 1e-12 * ramp]
        knots = self.t0 + np.cumsum([0.0, *(width for width, _ in pieces)])
        curve = Piecewise.between(knots, [row for _, row in pieces], "hold")
        return (("t", 0.0), ("piecewise", curve))
