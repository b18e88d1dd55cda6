"""Functions of time as data: a number, an expression in t, or a named form with its numbers.

In: ``25.0``, ``"speed*t"`` or ``{type = "harmonic", amplitude = 2, frequency = 50}``, value and t
in the scene's units. Out: a :class:`Function`, which stores the input and its :class:`Expression`
in SI; ``value(t)`` gives value, first and second derivative. Every form is converted to the same
operations, which one small kernel evaluates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, get_args

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.derivatives import Jet
from flexmb.model.functions.discontinuities import derivative_jumps
from flexmb.model.functions.expression import Expression, Ops, parse, rescaled
from flexmb.model.functions.forms import (
    Constant,
    Cycloidal,
    Fourier,
    FunctionForm,
    Harmonic,
    Havsin,
    ModifiedSine,
    Polynomial,
    Step,
    Step5,
    Trapezoidal,
)
from flexmb.model.functions.piecewise import Piecewise
from flexmb.model.functions.tabulated import AkimaSpline, CubicSpline, Table
from flexmb.model.quantities import LARGEST, expression_and_factor, finite, plain, read_number
from flexmb.model.reading import (
    NUMBER,
    FieldType,
    Form,
    Names,
    ReadContext,
    Reader,
    context_of,
    fail,
    quote,
    read_variant,
    reference,
)
from flexmb.units import parse_unit

_FORMS: tuple[type[FunctionForm], ...] = (
    Constant, Polynomial, Harmonic, Fourier, Step, Step5, Havsin, Cycloidal, ModifiedSine,
    Trapezoidal, CubicSpline, AkimaSpline, Table,
)  # fmt: skip
FUNCTION_FORMS: dict[str, type[FunctionForm]] = {
    get_args(form.model_fields["type"].annotation)[0]: form for form in _FORMS
}
"""Named forms of functions of time; the docstring of each is its formula."""


@dataclass(frozen=True)
class Function:
    """A function of time: the user's input in the scene's units, and its program in SI."""

    source: float | str | Mapping[str, Any]
    expression: Expression

    @property
    def constant(self) -> float | None:
        """The value if it does not depend on time, else None."""
        return self.expression.constant

    @property
    def curve(self) -> Piecewise | None:
        """The curve, if the function is a curve through points; else None."""
        ops = self.expression.ops
        curve = ops[-1][1] if ops and ops[0][0] == "t" and len(ops) == 2 else None
        return curve if isinstance(curve, Piecewise) else None

    def value(self, t: float) -> Jet:
        """Value, first and second derivative at time ``t`` [s]; not finite outside its domain."""
        return self.expression.value(t)

    def problems(self, where: str, derivatives: int = 0) -> Iterator[Problem]:
        """The problem of a value or derivative that is not finite at the start of a run."""
        if self.expression.channels:
            return  # their values come from the run
        parts = ("value", "first derivative", "second derivative")
        for part, value in zip(parts, self.value(0.0)[: derivatives + 1], strict=False):
            if not math.isfinite(value):
                text = self.expression.text
                yield Problem(where, f'the {part} of "{text}" is {value:g} at t = 0, not finite')
                return

    def derivative_jumps(self, end: float) -> tuple[float, ...]:
        """Times in (0, end) [s] at which value, first or second derivative jump, if known in closed
        form."""
        return derivative_jumps(self.expression.ops, end)


@dataclass(frozen=True)
class FunctionOf(FieldType):
    """Annotation of a :class:`Function`: the SI unit of its value, and whether it may use
    channels."""

    unit: str
    channels: bool = False

    def unit_here(self, info: ValidationInfo) -> str:
        """The SI unit of the value, which may depend on other fields."""
        return self.unit

    def read(self, value: Any, info: ValidationInfo) -> Function:
        return read_function(value, context_of(info), self.unit_here(info), self.channels)

    def write(self, value: Any, info: SerializationInfo) -> Any:
        return value.source

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        variables = "t and channels" if self.channels else "t"
        forms = [NUMBER, *(reference(form) for form in FUNCTION_FORMS.values())]
        return {"anyOf": forms, "description": f"as a function of {variables}"}


def per_second(unit: str) -> str:
    """The unit of the rate of a quantity measured in `unit`."""
    return f"{unit}/s" if unit else "1/s"


@dataclass(frozen=True)
class FunctionInDeclaredUnit(FunctionOf):
    """Annotation of a :class:`Function` in the unit that the field ``unit`` of its table states
    before.

    Its numbers and expressions are in the scene's units of that quantity; with ``rate`` per time.
    """

    unit: str = ""
    channels: bool = True
    rate: bool = False

    def unit_here(self, info: ValidationInfo) -> str:
        unit = str(info.data.get("unit", ""))
        return per_second(unit) if self.rate else unit


def _read_unit(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str):
        raise fail(Problem("", f'a unit such as "m" is expected, given {quote(value)}'))
    unit = parse_unit(value)
    if unit.factor != 1.0:
        what = f'names the quantity by its SI unit, given "{value}"; values are in the scene\'s'
        raise fail(Problem("", what))
    return value


UnitName = Annotated[str, Reader(_read_unit)]
"""The SI unit of a quantity, ``""`` for a plain number."""


def read_function(
    value: Any, names: Names | None = None, unit: str = "", channels: bool = False
) -> Function:
    """A function of time from any of its notations.

    Parameters
    ----------
    value : float, str, mapping or Function
        Number, expression in t and the parameters, or named form, in the scene's units.
    names : mapping
        Values of the parameters.
    unit : str
        SI unit of the value, ``""`` for a plain number.
    channels : bool
        Whether an expression may use channels, which then have their values in the scene's units.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    names = ReadContext.of(names)
    units = names.units
    if isinstance(value, Function):
        return value
    if isinstance(value, str):
        text, factor = expression_and_factor(value, names, unit, time=True)
        ops = parse(text, names, channels=channels).ops
        ops = rescaled(ops, units.time, factor * units.scale(unit))
        return Function(value, Expression(value, _moderate(ops)))
    if isinstance(value, Mapping):
        value = plain(value)
        terms = ReadContext(names, units, expected_unit=unit, folder=names.folder)
        form, problems = read_variant("function", FUNCTION_FORMS, value, terms)
        if form is None:
            raise SceneError.from_problems(problems)
        return Function(form.written(value, terms), Expression(quote(value), form.ops()))
    if isinstance(value, Real) and not isinstance(value, bool):
        number = read_number(value, names)
        ops = rescaled((("const", number),), units.time, units.scale(unit))
        return Function(number, Expression(f"{number:g}", _moderate(ops)))
    raise SceneError(
        "a function of time is a number, an expression in t, or a table such as "
        f'{{type = "harmonic", ...}}, given {quote(value)}'
    )


def _moderate(ops: Ops) -> Ops:
    """The same program, whose numbers are no larger than a quantity may be."""
    for op, value in ops:
        if op == "const":
            finite(value, value, LARGEST)
    return ops
