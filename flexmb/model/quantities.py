"""Numbers, vectors, axes and references as a scene writes them.

In: a number or an expression over the parameters, in the scene's unit system or with a unit of its
own: ``"30 deg"``. Out: finite floats in SI (rad for angles) of the required sign. Each type is a
pydantic annotation that names its SI unit, from which the scene's unit follows.

A text may end in a unit, such as ``"30 mm"``, ``"360*t deg"`` or ``"1500 rpm"``. An expression
never has two values side by side, so it is always clear whether a text has a unit. The exception is
a parameter with the name of a unit, which is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, SerializationInfo, ValidationInfo

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.model.functions.expression import MAX_LENGTH, parse
from flexmb.model.reading import (
    NUMBER,
    FieldType,
    Form,
    ReadContext,
    Reader,
    choice,
    context_of,
    fail,
    list_form,
    quote,
    under,
)
from flexmb.units import UNITS, parse_unit

_ENDS_A_VALUE = re.compile(r"[\w.)]$")
_NUMBER_AND_WORD = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s+(?P<unit>[A-Za-zµ].*)$")
_NUMBER_AND_REST = re.compile(r"\s*([-+]?(?:\d+[.,]?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)\s*")
_POWER = re.compile(r"(?<=[A-Za-zµ])(-?\d)")
_SYMBOLS = re.compile(r"[A-Za-zµ]+")
_NOUNS = {
    "": "a plain number",
    "m": "a length",
    "kg": "a mass",
    "s": "a time",
    "rad": "an angle",
    "Hz": "a frequency",
    "m/s": "a velocity",
    "rad/s": "an angular velocity",
    "m/s^2": "an acceleration",
    "N": "a force",
    "N m": "a torque",
    "kg m^2": "a moment of inertia",
    "kg/m^3": "a density",
    "Pa": "a pressure or modulus",
    "N/m": "a stiffness",
    "N s/m": "a damping coefficient",
}


def expression_and_factor(
    text: str, names: ReadContext, unit: str | None, time: bool = False
) -> tuple[str, float]:
    """The expression in a text, and the factor from its unit to the scene's own.

    Parameters
    ----------
    text : str
        An expression, perhaps followed by a unit.
    names : mapping
        Values of the parameters.
    unit : str or None
        SI unit of the required quantity, ``""`` for a plain number; None allows any.
    time : bool
        Whether ``t`` means the time, not the tonne.

    Raises
    ------
    SceneError
        A unit of something else, a symbol that is a parameter too, or an unknown unit.
    """
    if text.rstrip().endswith(("%", "percent")):
        raise SceneError(f"shares are plain numbers, 2 % is 0.02; given {quote(text)}")
    front, unit_text = _split(text, time)
    if not unit_text:
        _refuse_unknown(text, names, time)
        return text, 1.0
    for symbol in _SYMBOLS.findall(unit_text):
        if symbol in names:
            what = f'"{symbol}" in {quote(text)} is a unit and a parameter: rename the parameter, '
            raise SceneError(what + f'or write "*{symbol}" if it was meant')
    own, units = parse_unit(unit_text), names.units
    if unit is not None and own.dimension != parse_unit(unit).dimension:
        label = f" [{units.label(unit)}]" if unit else ""
        noun = _NOUNS.get(unit, "another quantity")
        raise SceneError(f"{noun}{label} is expected, given {quote(text)}")
    return front, float(f"{own.factor / units.factor(*own.dimension[:3]):.15g}")


def _split(text: str, time: bool) -> tuple[str, str]:
    """Expression and unit of a text; the unit is empty if there is none."""
    # every gap is examined with all the text after it
    short = text if len(text) <= MAX_LENGTH else ""
    for gap in re.finditer(r"(?<=\S)\s+(?=\S)", short):
        front, rest = text[: gap.start()], text[gap.end() :].strip()
        if not _ENDS_A_VALUE.search(front[-1]) or (time and "t" in _SYMBOLS.findall(rest)):
            continue
        try:
            parse_unit(rest)
        except FlexmbError:
            continue
        return front, rest
    return text, ""


def _refuse_unknown(text: str, names: ReadContext, time: bool) -> None:
    """Refuse a number that is followed by an unknown unit, or by a unit written wrongly."""
    number = _NUMBER_AND_REST.fullmatch(text)
    if number is not None and not any(s in names for s in _SYMBOLS.findall(number[2])):
        rest = _POWER.sub(r"^\1", number[2].replace("°", "deg"))
        if not (time and "t" in _SYMBOLS.findall(rest)) and _is_unit(rest):
            decimal = number[1].replace(",", ".")
            raise SceneError(f'{quote(text)} is written "{decimal} {rest}"')
    match = _NUMBER_AND_WORD.match(text)
    symbols = _SYMBOLS.findall(match["unit"]) if match else []
    if match is None or any(s in names for s in symbols) or (time and "t" in symbols):
        return
    try:
        parse_unit(match["unit"])
    except FlexmbError as error:
        problem = error.problems[0]
        if problem.allowed:
            raise SceneError.from_problems(
                [Problem("", problem.what, tuple(UNITS), problem.nearest)]
            ) from None


def _is_unit(text: str) -> bool:
    try:
        parse_unit(text)
    except FlexmbError:
        return False
    return True


_UNIT_ROUND_OFF = 4e-16  # relative change of a vector of unit length by scaling it to unit length
Sign = Literal["any", "positive", "not negative"]
_SIGN_FORMS: dict[str, Form] = {
    "any": {},
    "positive": {"minimum": 0, "exclusiveMinimum": True},
    "not negative": {"minimum": 0},
}


def read_number(value: Any, names: ReadContext, unit: str | None = "") -> float:
    """A finite number in the scene's units, from a number or an expression.

    Parameters
    ----------
    value : float or str
        A number, or an expression over the parameters, perhaps with a unit.
    names : mapping
        Values of the parameters.
    unit : str or None
        SI unit of the required quantity, ``""`` for a plain number; None allows any.

    Raises
    ------
    SceneError
        No number, a mistake in the expression, a unit of something else, or no finite value.
    """
    if isinstance(value, float):
        return finite(float(value), value)
    if isinstance(value, str):
        text, factor = expression_and_factor(value, names, unit)
        constant = parse(text, names, time=False).constant
        assert constant is not None  # without time every expression folds to a constant
        return finite(constant * factor, value)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SceneError(f"a number or an expression is expected, given {quote(value)}")
    try:
        return finite(float(value), value)
    except OverflowError:
        return finite(math.inf, value)


def read_numbers(values: Sequence[Any], names: ReadContext, units: Iterable[str]) -> list[float]:
    """Numbers in SI, each with an SI unit of its own; all mistakes are reported at once."""
    numbers: list[float] = []
    problems: list[Problem] = []
    for i, (value, unit) in enumerate(zip(values, units, strict=False)):
        try:
            scaled = read_number(value, names, unit) * names.units.scale(unit)
            numbers.append(finite(scaled, value, LARGEST))
        except SceneError as error:
            problems += under(f"[{i}]", error.problems)
    if problems:
        raise SceneError.from_problems(problems)
    return numbers


LARGEST = 1e60
"""Largest magnitude of a quantity in SI, and inverse of the least positive one: its fifth power is
still finite."""


def finite(number: float, value: Any, largest: float = math.inf) -> float:
    """The number, given as `value`, if it is finite and at most `largest` in magnitude."""
    if not math.isfinite(number):
        raise SceneError(f"a finite number is expected, given {quote(value)}")
    if abs(number) > largest:
        raise SceneError(f"is too large, {number:g} in SI; allowed: up to {largest:g}")
    return number


@dataclass(frozen=True)
class Quantity(FieldType):
    """Annotation of a float: its SI unit, the required sign, and limits of the number."""

    unit: str = ""
    sign: Sign = "any"
    limits: tuple[float, float] | None = None

    def unit_in(self, names: ReadContext) -> str | None:
        """The SI unit of this field; None if it is not known."""
        return self.unit

    def read(self, value: Any, info: ValidationInfo) -> float:
        """The number in SI."""
        names = context_of(info)
        unit = self.unit_in(names)
        number = read_number(value, names, unit)
        units = names.units
        if (self.sign == "positive" and number <= 0) or (self.sign != "any" and number < 0):
            sign = "positive" if self.sign == "positive" else "zero or positive"
            source = f" (given {quote(value)})" if isinstance(value, str) else ""
            what = f"must be {sign}, is {number:g} {units.label(unit or '')}".rstrip() + source
            raise fail(Problem("", what))
        if self.limits is not None and not self.limits[0] <= number <= self.limits[1]:
            low, high = self.limits
            what = f"must lie between {low:.4g} and {high:.4g}, is {number:g}"
            raise fail(Problem("", what))
        try:
            scaled = finite(number * units.scale(unit or ""), value, LARGEST)
        except SceneError as error:
            raise fail(error.problems[0]) from None
        if self.sign == "positive" and scaled < 1.0 / LARGEST:
            what = f"is too small, {scaled:g} in SI; allowed: from {1.0 / LARGEST:g} on"
            raise fail(Problem("", what))
        return scaled

    def write(self, value: Any, info: SerializationInfo) -> Any:
        """The number in the scene's units."""
        names = context_of(info)
        unit = self.unit_in(names) or ""
        return names.units.written(value, unit) if isinstance(value, float) else value

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        form = {**NUMBER, **_SIGN_FORMS[self.sign]}
        if self.limits is not None:
            form["minimum"], form["maximum"] = self.limits
        return {**form, "description": f"[{self.unit}]"} if self.unit else form


@dataclass(frozen=True)
class WordOr(FieldType):
    """Annotation of a float or a word that stands for one; ``noun`` is what a number is."""

    word: str
    noun: str
    unit: str = ""
    sign: Sign = "any"

    def read(self, value: Any, info: ValidationInfo) -> float | str:
        """The word, or the number in SI."""
        names = context_of(info)
        if value == self.word:
            return self.word
        if isinstance(value, str) and value.isalpha() and value not in names:
            label = f" [{names.units.label(self.unit)}]" if self.unit else ""
            what = f"{self.noun}{label} is expected, given {quote(value)}"
            raise fail(Problem("", what, (self.word, "a number or an expression")))
        return Quantity(self.unit, self.sign).read(value, info)

    def write(self, value: Any, info: SerializationInfo) -> Any:
        return Quantity(self.unit, self.sign).write(value, info)

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        number = Quantity(self.unit, self.sign).form(source, form_of)
        return {"anyOf": [{"enum": [self.word]}, number]}


@dataclass(frozen=True)
class Measured(Quantity):
    """Annotation of a float whose SI unit depends on its use: the context's expected unit."""

    def unit_in(self, names: ReadContext) -> str | None:
        return names.expected_unit


@dataclass(frozen=True)
class Integer(FieldType):
    """Annotation of an int: the smallest and the largest value it may have."""

    minimum: int = 0
    maximum: int = 10_000_000

    def read(self, value: Any, info: ValidationInfo) -> int:
        """The whole number."""
        number = Quantity().read(value, info)
        if number != round(number) or number < self.minimum:
            raise fail(
                Problem("", f"a whole number from {self.minimum} on is expected, is {number:g}")
            )
        if number > self.maximum:
            raise fail(Problem("", f"at most {self.maximum}, is {number:g}"))
        return round(number)

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        return {"type": ["integer", "string"], "minimum": self.minimum, "maximum": self.maximum}


def plain(value: Any) -> Any:
    """Tables, lists and numbers as plain Python objects, whatever types of arrays they contain."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Real) and not isinstance(value, int | float | np.generic):
        with suppress(OverflowError):  # refused where it is read
            return float(value)
    return _as_list(value)


def _as_list(value: Any) -> Any:
    """NumPy arrays as lists."""
    return value.tolist() if hasattr(value, "tolist") else value


Number = Annotated[float, Quantity()]
Angle = Annotated[float, Quantity("rad")]
Length = Annotated[float, Quantity("m")]
Size = Annotated[float, Quantity("m", "positive")]
Time = Annotated[float, Quantity("s", "positive")]
_Speed = Annotated[float, Quantity("m/s")]
_Spin = Annotated[float, Quantity("rad/s")]
_Rate = Annotated[float, Quantity("m/s^2")]
Position = Annotated[tuple[Length, Length, Length], BeforeValidator(_as_list)]
Velocity = Annotated[tuple[_Speed, _Speed, _Speed], BeforeValidator(_as_list)]
AngularVelocity = Annotated[tuple[_Spin, _Spin, _Spin], BeforeValidator(_as_list)]
Acceleration = Annotated[tuple[_Rate, _Rate, _Rate], BeforeValidator(_as_list)]
Sizes = Annotated[tuple[Size, Size, Size], BeforeValidator(_as_list)]


def _text(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise fail(Problem("", f"a text is expected, given {quote(value)}"))
    return value


Text = Annotated[str, Reader(_text)]
Pair = tuple[Text, Text]
"""Two marker references, I and J."""

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def read_axis(value: Any, names: ReadContext) -> tuple[float, ...]:
    """A unit vector from ``"x"``, ``"-z"`` or three numbers.

    Raises
    ------
    SceneError
        Neither of them, or a vector of length zero.
    """
    value = _as_list(value)
    if isinstance(value, str):
        axis = _AXES.get(value.lstrip("+-"))
        if axis is None or len(value) > 2:
            raise _bad_axis(value)
        sign = -1.0 if value.startswith("-") else 1.0
        return (sign * axis[0] + 0.0, sign * axis[1] + 0.0, sign * axis[2] + 0.0)
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise _bad_axis(value)
    x, y, z = (read_number(item, names) for item in value)
    try:
        return unit_vector((x, y, z))
    except ZeroDivisionError:
        what = "an axis must have a direction, given a vector of length zero"
        raise SceneError(what) from None


def unit_vector(values: Iterable[float]) -> tuple[float, ...]:
    """Scaled to unit length, without overflow; a unit vector stays the same to the last bit.

    Raises
    ------
    ZeroDivisionError
        All components are zero.
    """
    vector = tuple(values)
    if abs(math.hypot(*vector) - 1.0) <= _UNIT_ROUND_OFF:
        return vector
    largest = max(abs(c) for c in vector)
    vector = tuple(c / largest for c in vector)
    length = math.hypot(*vector)
    return tuple(c / length for c in vector)


def _bad_axis(value: Any) -> SceneError:
    what = f"an axis is a direction, given {quote(value)}"
    allowed = (*_SIGNED_AXES, "[x, y, z]")
    return SceneError.from_problems([Problem("", what, allowed)])


_SIGNED_AXES = ("x", "y", "z", "-x", "-y", "-z")
_AXIS_FORM = {"anyOf": [choice(_SIGNED_AXES), list_form(NUMBER, 3)]}
Axis = Annotated[
    tuple[float, float, float],
    Reader(lambda value, info: read_axis(value, context_of(info)), form=_AXIS_FORM),
]
