"""Numbers, vectors, axes and references as a scene writes them.

In: a number or an expression over the parameters, in the scene's unit system, perhaps with a unit
of its own: ``"30 deg"``. Out: floats in SI (rad for angles), finite and of the asked sign. Each
type is a pydantic annotation that names its SI unit, from which the scene's own follows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, GetCoreSchemaHandler, SerializationInfo, ValidationInfo
from pydantic_core import core_schema

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.expression import parse
from flexmb.model.values.reading import Names, Reader, fail, given, names_of, slot_of, units_of
from flexmb.model.values.unit_texts import expression_and_factor

__all__ = [
    "Acceleration",
    "Angle",
    "AngularVelocity",
    "Axis",
    "Integer",
    "Length",
    "Measured",
    "Number",
    "Pair",
    "Position",
    "Quantity",
    "Size",
    "Sizes",
    "Text",
    "Time",
    "Velocity",
    "plain",
    "read_axis",
    "read_number",
    "unit_vector",
]

_LAST_DIGITS = 4e-16  # what scaling to unit length leaves
Sign = Literal["any", "positive", "not negative"]


def read_number(value: Any, names: Names, unit: str | None = "") -> float:
    """A finite number, in the scene's units, from a number or an expression.

    Parameters
    ----------
    value : float or str
        A number, or an expression over the parameters, perhaps with a unit.
    names : mapping
        Values of the parameters.
    unit : str or None
        SI unit of what is asked for, ``""`` for a plain number; None takes any.

    Raises
    ------
    SceneError
        No number, a mistake in the expression, a unit of something else, or no finite value.
    """
    if isinstance(value, float):
        return _finite(float(value), value)
    if isinstance(value, str):
        text, factor = expression_and_factor(value, names, unit)
        constant = parse(text, names, time=False).constant
        assert constant is not None  # without time everything folds
        return _finite(constant * factor, value)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SceneError(f"a number or an expression is expected, given {given(value)}")
    try:
        return _finite(float(value), value)
    except OverflowError:
        return _finite(math.inf, value)


def _finite(number: float, value: Any) -> float:
    if not math.isfinite(number):
        raise SceneError(f"a finite number is expected, given {given(value)}")
    return number


@dataclass(frozen=True)
class Quantity:
    """Annotation of a float: its SI unit and the sign it must have."""

    unit: str = ""
    sign: Sign = "any"

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(self.write, info_arg=True)
        return core_schema.with_info_plain_validator_function(self.read, serialization=written)

    def unit_in(self, names: Names) -> str | None:
        """The SI unit in this place; None where it is not known."""
        return self.unit

    def read(self, value: Any, info: ValidationInfo) -> float:
        """The number in SI."""
        names = names_of(info)
        unit = self.unit_in(names)
        try:
            number = read_number(value, names, unit)
        except SceneError as error:
            raise fail(*error.problems) from None
        units = units_of(names)
        if self._wrong_sign(number):
            raise fail(self._sign_problem(number, value, units.label(unit or "")))
        scaled = number * units.scale(unit or "")
        if not math.isfinite(scaled):
            raise fail(Problem("", f"a finite number is expected, given {given(value)}"))
        return scaled

    def write(self, value: Any, info: SerializationInfo) -> Any:
        """The number in the scene's units, as it was given."""
        names = names_of(info)
        unit = self.unit_in(names) or ""
        return units_of(names).written(value, unit) if isinstance(value, float) else value

    def _wrong_sign(self, number: float) -> bool:
        return (self.sign == "positive" and number <= 0) or (
            self.sign == "not negative" and number < 0
        )

    def _sign_problem(self, number: float, value: Any, label: str) -> Problem:
        wanted = "positive" if self.sign == "positive" else "zero or positive"
        origin = f" (given {given(value)})" if isinstance(value, str) else ""
        return Problem("", f"must be {wanted}, is {number:g} {label}".rstrip() + origin)


@dataclass(frozen=True)
class Measured(Quantity):
    """Annotation of a float whose SI unit depends on where it is used: that of the slot."""

    def unit_in(self, names: Names) -> str | None:
        return slot_of(names)


@dataclass(frozen=True)
class Integer:
    """Annotation of an int: the smallest value it may have."""

    minimum: int = 0

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.read)

    def read(self, value: Any, info: ValidationInfo) -> int:
        """The whole number."""
        number = Quantity().read(value, info)
        if number != round(number) or number < self.minimum:
            raise fail(
                Problem("", f"a whole number from {self.minimum} on is expected, is {number:g}")
            )
        return round(number)


def plain(value: Any) -> Any:
    """Tables, lists and numbers as plain Python, whatever kind of array or number they hold."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Real) and not isinstance(value, int | float | np.generic):
        return _number(value)
    return _as_list(value)


def _number(value: Real) -> Any:
    try:
        return float(value)
    except OverflowError:
        return value  # refused where it is read


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
        raise fail(Problem("", f"a text is expected, given {given(value)}"))
    return value


Text = Annotated[str, Reader(_text)]
Pair = tuple[Text, Text]
"""Two marker references, I and J."""

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def read_axis(value: Any, names: Names) -> tuple[float, ...]:
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
    """Scaled to unit length, without overflow; one that has it already stays the same to the bit.

    Raises
    ------
    ZeroDivisionError
        All components are zero.
    """
    vector = tuple(values)
    if abs(math.hypot(*vector) - 1.0) <= _LAST_DIGITS:
        return vector
    largest = max(abs(c) for c in vector)
    vector = tuple(c / largest for c in vector)
    length = math.hypot(*vector)
    return tuple(c / length for c in vector)


def _bad_axis(value: Any) -> SceneError:
    what = f"an axis is a direction, given {given(value)}"
    allowed = ("x", "y", "z", "-x", "-y", "-z", "[x, y, z]")
    return SceneError.from_problems([Problem("", what, allowed)])


def _axis(value: Any, info: ValidationInfo) -> tuple[float, ...]:
    try:
        return read_axis(value, names_of(info))
    except SceneError as error:
        raise fail(*error.problems) from None


Axis = Annotated[tuple[float, float, float], Reader(_axis)]
