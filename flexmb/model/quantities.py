"""Numbers, vectors, axes and references as a scene writes them.

In: a number, or an expression over the parameters (angles also ``"30 deg"``). Out: floats in SI
(rad for angles), finite and of the asked sign. Each type is a pydantic annotation that names its
unit, so that messages can say it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, GetCoreSchemaHandler, ValidationInfo
from pydantic_core import core_schema

from flexmb.errors import Problem, SceneError
from flexmb.model.expression import parse
from flexmb.model.reading import Names, Reader, fail, given, names_of

__all__ = [
    "Angle",
    "Axis",
    "Integer",
    "Number",
    "Pair",
    "Quantity",
    "Size",
    "Text",
    "Time",
    "Vector",
    "in_radians",
    "plain",
    "read_axis",
    "read_number",
]

_DEGREES = re.compile(r"^(?P<value>.*\S)\s+(?P<unit>deg|rad)\s*$", re.DOTALL)
Sign = Literal["any", "positive", "not negative"]


def in_radians(text: str) -> str:
    """``"30 deg"`` as an expression in rad; other texts unchanged, and characters stay in place."""
    found = _DEGREES.match(text)
    if not found:
        return text
    return found["value"] + ("*deg" if found["unit"] == "deg" else "")


def read_number(value: Any, names: Names) -> float:
    """A finite number from a number or an expression.

    Raises
    ------
    SceneError
        No number, a mistake in the expression, or no finite value.
    """
    if isinstance(value, str):
        constant = parse(in_radians(value), names, time=False).constant
        assert constant is not None  # without time everything folds
        return constant
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SceneError(f"a number or an expression is expected, given {given(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SceneError(f"a finite number is expected, given {given(value)}")
    return number


@dataclass(frozen=True)
class Quantity:
    """Annotation of a float: its unit and the sign it must have."""

    unit: str = ""
    sign: Sign = "any"

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.with_info_plain_validator_function(self.read)

    def read(self, value: Any, info: ValidationInfo) -> float:
        """The number in SI."""
        try:
            number = read_number(value, names_of(info))
        except SceneError as error:
            raise fail(*error.problems) from None
        self.check(number, value)
        return number

    def check(self, number: float, value: Any) -> None:
        """Refuse a number of the wrong sign."""
        bad = (self.sign == "positive" and number <= 0) or (
            self.sign == "not negative" and number < 0
        )
        if bad:
            wanted = "positive" if self.sign == "positive" else "zero or positive"
            origin = f" (given {given(value)})" if isinstance(value, str) else ""
            raise fail(
                Problem("", f"must be {wanted}, is {number:g} {self.unit}".rstrip() + origin)
            )


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
Size = Annotated[float, Quantity("m", "positive")]
Time = Annotated[float, Quantity("s", "positive")]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_as_list)]
Sizes = Annotated[tuple[Size, Size, Size], BeforeValidator(_as_list)]


def _text(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise fail(Problem("", f"a text is expected, given {given(value)}"))
    return value


Text = Annotated[str, Reader(_text)]
Pair = tuple[Text, Text]
"""Two marker references, I and J."""

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def read_axis(value: Any, names: Names) -> tuple[float, float, float]:
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
    length = math.hypot(x, y, z)
    if length == 0:
        raise SceneError("an axis must have a direction, given a vector of length zero")
    return (x / length, y / length, z / length)


def _bad_axis(value: Any) -> SceneError:
    what = f"an axis is a direction, given {given(value)}"
    allowed = ("x", "y", "z", "-x", "-y", "-z", "[x, y, z]")
    return SceneError.from_problems([Problem("", what, allowed)])


def _axis(value: Any, info: ValidationInfo) -> tuple[float, float, float]:
    try:
        return read_axis(value, names_of(info))
    except SceneError as error:
        raise fail(*error.problems) from None


Axis = Annotated[tuple[float, float, float], Reader(_axis)]
