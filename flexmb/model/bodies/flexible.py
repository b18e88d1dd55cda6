"""The fields of flexible bodies that are names: unit system, reduced body.

In: names of a scene. Out: checked names, or the ``FlexBody`` itself where a model is built from
Python.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import ValidationInfo

from flexmb.errors import FlexmbError, Problem
from flexmb.model.values.reading import Reader, fail, given, names_of, units_of
from flexmb.units import unit_system

__all__ = ["FlexibleSource", "UnitsName"]


def _read_units(value: Any, info: ValidationInfo) -> str:
    if value == "scene":
        return units_of(names_of(info)).name
    try:
        return unit_system(value).name
    except FlexmbError as error:
        first = error.problems[0]
        raise fail(Problem("", first.what, first.allowed, first.nearest)) from None


UnitsName = Annotated[str, Reader(_read_units)]
"""Name of a unit system; ``"scene"`` for the scene's own."""


def _read_source(value: Any, info: ValidationInfo) -> Any:
    from flexmb.flexbody import FlexBody

    if isinstance(value, FlexBody):
        return value
    if isinstance(value, str | Path) and str(value).isprintable() and str(value).strip():
        return Path(value).as_posix()
    raise fail(Problem("", f"a flexible-body file is expected, given {given(value)}"))


FlexibleSource = Annotated[Any, Reader(_read_source)]
"""Path of a flexible-body file, or a FlexBody."""
