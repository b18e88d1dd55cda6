"""Values whose unit the table itself gives, by its key ``unit``, such as those of an expression.

In: a table with ``unit``, the SI unit that names the quantity; its numbers and expressions are in
the scene's units of that quantity. Out: a :class:`Function` in SI. Fields marked so stand behind
the field ``unit``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, ValidationInfo
from pydantic_core import core_schema

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.model.functions.function import Function, read_function
from flexmb.model.values.reading import Reader, fail, given, names_of
from flexmb.units import parse_unit

__all__ = ["ToldUnit", "UnitName", "per_second"]


def per_second(unit: str) -> str:
    """The unit of a rate of what is measured in `unit`."""
    return f"{unit}/s" if unit else "1/s"


def _unit(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str):
        raise fail(Problem("", f'a unit such as "m" is expected, given {given(value)}'))
    try:
        unit = parse_unit(value)
    except FlexmbError as error:
        raise fail(*error.problems) from None
    if unit.factor != 1.0:
        what = f'names the quantity by its SI unit, given "{value}"; values are in the scene\'s'
        raise fail(Problem("", what))
    return value


UnitName = Annotated[str, Reader(_unit)]
"""The SI unit of a quantity, ``""`` for a plain number."""


@dataclass(frozen=True)
class ToldUnit:
    """Annotation of a :class:`Function` in the unit its table tells; ``rate``: that per time."""

    rate: bool = False
    channels: bool = True

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any, info: ValidationInfo) -> Function:
            unit = str(info.data.get("unit", ""))
            unit = per_second(unit) if self.rate else unit
            try:
                return read_function(value, names_of(info), unit, self.channels)
            except SceneError as error:
                raise fail(*error.problems) from None

        written = core_schema.plain_serializer_function_ser_schema(lambda f: f.given)
        return core_schema.with_info_plain_validator_function(read, serialization=written)
