"""Functions of time as data: a number, an expression in t, or a named form with its numbers.

In: ``25.0``, ``"speed*t"`` or ``{type = "harmonic", amplitude = 2, frequency = 50}``. Out: a
:class:`Function`, which keeps what was given and its :class:`Expression` over t; ``value(t)`` gives
value, first and second derivative. Each form lowers to the same operations, so that one small
kernel evaluates them all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, Self

from pydantic import GetCoreSchemaHandler, ValidationInfo, model_validator
from pydantic_core import core_schema

from flexmb.errors import Problem, SceneError
from flexmb.model.expression import Expression, Ops, parse
from flexmb.model.jets import Jet
from flexmb.model.quantities import Angle, Number, in_radians, plain, read_number
from flexmb.model.reading import Names, Spec, fail, given, names_of, read_variant

__all__ = ["FUNCTION_FORMS", "Function", "FunctionForm", "read_function"]


class FunctionForm(Spec):
    """Base of the named forms; each turns its numbers into operations over t."""

    def ops(self) -> Ops:
        raise NotImplementedError


class Constant(FunctionForm):
    """value"""

    type: Literal["constant"]
    value: Number

    def ops(self) -> Ops:
        return (("const", self.value),)


class Polynomial(FunctionForm):
    """c0 + c1 t + c2 t^2 + ..., with coefficients = [c0, c1, c2, ...]"""

    type: Literal["polynomial"]
    coefficients: tuple[Number, ...]

    def ops(self) -> Ops:
        """Horner's scheme."""
        *lower, highest = self.coefficients or (0.0,)
        program: Ops = (("const", highest),)
        for c in reversed(lower):
            program = (*program, ("t", 0.0), ("*", 0.0), ("const", c), ("+", 0.0))
        return program


class Harmonic(FunctionForm):
    """offset + amplitude sin(2 pi frequency t + phase), frequency in Hz"""

    type: Literal["harmonic"]
    amplitude: Number
    frequency: Number
    phase: Angle = 0.0
    offset: Number = 0.0

    def ops(self) -> Ops:
        names = {"a": self.amplitude, "w": 2 * math.pi * self.frequency}
        names |= {"phase": self.phase, "offset": self.offset}
        return parse("offset + a*sin(w*t + phase)", names).ops


class Step(FunctionForm):
    """y0 before t0, y1 after t1, between them a cubic with level ends"""

    type: Literal["step"]
    t0: Number = 0.0
    y0: Number = 0.0
    t1: Number
    y1: Number

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.t1 <= self.t0:
            raise fail(Problem("t1", f"must lie after t0 = {self.t0:g} s, is {self.t1:g} s"))
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
    """A function of time: what the user gave, and its program."""

    given: float | str | Mapping[str, Any]
    expression: Expression

    @property
    def constant(self) -> float | None:
        """The value if it does not depend on time, else None."""
        return self.expression.constant

    def value(self, t: float) -> Jet:
        """Value, first and second derivative at time ``t`` [s]; not finite outside its domain."""
        return self.expression.value(t)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any, info: ValidationInfo) -> Function:
            try:
                return read_function(value, names_of(info))
            except SceneError as error:
                raise fail(*error.problems) from None

        written = core_schema.plain_serializer_function_ser_schema(lambda f: f.given)
        return core_schema.with_info_plain_validator_function(read, serialization=written)


def read_function(value: Any, names: Names | None = None) -> Function:
    """A function of time from any of the ways to say it.

    Parameters
    ----------
    value : float, str, mapping or Function
        Number, expression in t and the parameters, or named form.
    names : mapping
        Values of the parameters.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    names = names or {}
    if isinstance(value, Function):
        return value
    if isinstance(value, str):
        return Function(value, parse(in_radians(value), names))
    if isinstance(value, Mapping):
        value = plain(value)
        form, problems = read_variant("function", FUNCTION_FORMS, value, names)
        if form is None:
            raise SceneError.from_problems(problems)
        return Function(value, Expression(given(value), form.ops()))
    if isinstance(value, Real) and not isinstance(value, bool):
        number = read_number(value, names)
        return Function(number, Expression(f"{number:g}", (("const", number),)))
    raise SceneError(
        "a function of time is a number, an expression in t, or a table such as "
        f'{{type = "harmonic", ...}}, given {given(value)}'
    )
