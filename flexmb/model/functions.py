"""Functions of time as data: a number, an expression in t, or a named form with its numbers.

In: ``25.0``, ``"speed*t"`` or ``{type = "harmonic", amplitude = 2, frequency = 50}``, value and t
in the scene's units. Out: a :class:`Function`, which keeps what was given and its
:class:`Expression` in SI; ``value(t)`` gives value, first and second derivative. Each
form lowers to the same operations, so that one small kernel evaluates them all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, Literal, Self

from pydantic import GetCoreSchemaHandler, ValidationInfo, model_validator
from pydantic_core import core_schema

from flexmb.errors import Problem, SceneError
from flexmb.model.expression import Expression, Ops, parse
from flexmb.model.jets import Jet
from flexmb.model.quantities import Angle, Measured, Quantity, plain, read_number
from flexmb.model.reading import (
    Names,
    Reader,
    Spec,
    Terms,
    fail,
    given,
    names_of,
    read_variant,
    slot_of,
    under,
    units_of,
)
from flexmb.model.unit_texts import expression_and_factor
from flexmb.units import UnitSystem

__all__ = ["FUNCTION_FORMS", "Function", "FunctionForm", "FunctionOf", "read_function"]


def _coefficients(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    """Numbers c0, c1, c2, ... of which the k-th is a value over time to the power k."""
    names = names_of(info)
    value = plain(value)
    if not isinstance(value, list):
        raise fail(Problem("", f"a list is expected, given {given(value)}"))
    slot = slot_of(names) or ""
    powers = ("", "/s", *(f"/s^{k}" for k in range(2, len(value))))
    found, problems = [], []
    for k, item in enumerate(value):
        unit = (slot or "1") + powers[k] if k else slot
        try:
            found.append(read_number(item, names, unit) * units_of(names).scale(unit))
        except SceneError as error:
            problems += under(f"[{k}]", error.problems)
    if problems:
        raise fail(*problems)
    return tuple(found)


Ordinate = Annotated[float, Measured()]
Moment = Annotated[float, Quantity("s")]


class FunctionForm(Spec):
    """Base of the named forms; each turns its numbers, in SI, into operations over t."""

    def ops(self) -> Ops:
        raise NotImplementedError


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


class Step(FunctionForm):
    """y0 before t0, y1 after t1, between them a cubic with level ends"""

    type: Literal["step"]
    t0: Moment = 0.0
    y0: Ordinate = 0.0
    t1: Moment
    y1: Ordinate

    @model_validator(mode="after")
    def _in_order(self, info: ValidationInfo) -> Self:
        if self.t1 <= self.t0:
            units = units_of(names_of(info))
            t0, t1 = units.say(self.t0, "s"), units.say(self.t1, "s")
            raise fail(Problem("t1", f"must lie after t0 = {t0}, is {t1}"))
        return self

    def ops(self) -> Ops:
        names = {"t0": self.t0, "y0": self.y0, "t1": self.t1, "y1": self.y1}
        return parse("step(t, t0, y0, t1, y1)", names).ops


FUNCTION_FORMS: dict[str, type[FunctionForm]] = {
    "constant": Constant,
    "polynomial": Polynomial,
    "harmonic": Harmonic,
    "step": Step,
}
"""Named forms of functions of time; the docstring of each is its formula."""


@dataclass(frozen=True)
class Function:
    """A function of time: what the user gave, in the scene's units, and its program in SI."""

    given: float | str | Mapping[str, Any]
    expression: Expression

    @property
    def constant(self) -> float | None:
        """The value if it does not depend on time, else None."""
        return self.expression.constant

    def value(self, t: float) -> Jet:
        """Value, first and second derivative at time ``t`` [s]; not finite outside its domain."""
        return self.expression.value(t)


@dataclass(frozen=True)
class FunctionOf:
    """Annotation of a :class:`Function`: the SI unit of its value; whether it may name channels."""

    unit: str
    channels: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any, info: ValidationInfo) -> Function:
            try:
                return read_function(value, names_of(info), self.unit, self.channels)
            except SceneError as error:
                raise fail(*error.problems) from None

        written = core_schema.plain_serializer_function_ser_schema(lambda f: f.given)
        return core_schema.with_info_plain_validator_function(read, serialization=written)


def read_function(
    value: Any, names: Names | None = None, unit: str = "", channels: bool = False
) -> Function:
    """A function of time from any of the ways to say it.

    Parameters
    ----------
    value : float, str, mapping or Function
        Number, expression in t and the parameters, or named form, in the scene's units.
    names : mapping
        Values of the parameters.
    unit : str
        SI unit of the value, ``""`` for a plain number.
    channels : bool
        Whether an expression may name channels; they stand for values in the scene's units.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    names = {} if names is None else names
    units = units_of(names)
    if isinstance(value, Function):
        return value
    if isinstance(value, str):
        text, factor = expression_and_factor(value, names, unit, time=True)
        ops = parse(text, names, channels=channels).ops
        return Function(value, Expression(value, _in_si(ops, factor * units.scale(unit), units)))
    if isinstance(value, Mapping):
        value = plain(value)
        terms = Terms(names, units, slot=unit)
        form, problems = read_variant("function", FUNCTION_FORMS, value, terms)
        if form is None:
            raise SceneError.from_problems(problems)
        return Function(value, Expression(given(value), form.ops()))
    if isinstance(value, Real) and not isinstance(value, bool):
        number = read_number(value, names)
        ops = _in_si((("const", number),), units.scale(unit), units)
        return Function(number, Expression(f"{number:g}", ops))
    raise SceneError(
        "a function of time is a number, an expression in t, or a table such as "
        f'{{type = "harmonic", ...}}, given {given(value)}'
    )


def _in_si(ops: Ops, scale: float, units: UnitSystem) -> Ops:
    """A program over the scene's time, as one over time in s whose value is `scale` times it."""
    if len(ops) == 1 and ops[0][0] == "const":
        return (("const", ops[0][1] * scale),)
    if units.time != 1.0:
        own = (("t", 0.0), ("const", units.time), ("/", 0.0))
        ops = tuple(step for op in ops for step in (own if op[0] == "t" else (op,)))
    return ops if scale == 1.0 else (*ops, ("const", scale), ("*", 0.0))
