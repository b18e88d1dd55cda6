"""The fields of flexible bodies: material, unit system, interfaces, reduced body.

In: names or tables of a scene. Out: a :class:`Material`, checked names, or the ``FlexBody`` itself
where a model is built from Python.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import FlexmbError, Problem
from flexmb.materials import LIBRARY, Material, material
from flexmb.model.names import bad_name
from flexmb.model.quantities import Number, Quantity
from flexmb.model.reading import Reader, Spec, fail, given, names_of, read_entry, units_of
from flexmb.units import unit_system

__all__ = ["FlexibleSource", "Groups", "MaterialField", "UnitsName"]


class _MaterialValues(Spec):
    name: str = "given"
    E: Annotated[float, Quantity("Pa", "positive")]
    nu: Number
    density: Annotated[float, Quantity("kg/m^3", "positive")]
    source: str = "given by the user"


def _read_material(value: Any, info: ValidationInfo) -> Material:
    try:
        if isinstance(value, str | Material):
            return material(value)
        values, problems = read_entry(_MaterialValues, value, names_of(info))
        if values is None:
            raise fail(*problems)
        return Material(**values.model_dump())
    except FlexmbError as error:
        places = (p.where.removeprefix("material").removeprefix(".") for p in error.problems)
        found = zip(places, error.problems, strict=True)
        raise fail(*(Problem(at, p.what, p.allowed, p.nearest) for at, p in found)) from None


def _write_material(value: Material, info: SerializationInfo) -> Any:
    if LIBRARY.get(value.name) == value:
        return value.name
    values = _MaterialValues.model_construct(**asdict(value))
    return values.model_dump(context=info.context)


MaterialField = Annotated[Material, Reader(_read_material, _write_material)]
"""A name of the library, or a table {E, nu, density} in the scene's units."""


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


def _read_groups(value: Any, info: ValidationInfo) -> dict[str, str]:
    if not isinstance(value, Mapping) or not value:
        what = "a table {name = mesh group, ...} of at least one interface is expected"
        raise fail(Problem("", f"{what}, given {given(value)}"))
    problems = []
    for name, group in value.items():
        if bad := bad_name(name):
            problems.append(Problem(str(name), bad))
        if isinstance(group, bool) or not isinstance(group, str | int):
            problems.append(
                Problem(str(name), f"the name of a mesh group is expected, given {given(group)}")
            )
    if problems:
        raise fail(*problems)
    return {name: str(group) for name, group in value.items()}


Groups = Annotated[dict[str, str], Reader(_read_groups)]
"""Interface name to the mesh group it takes."""


def _read_source(value: Any, info: ValidationInfo) -> Any:
    from flexmb.flexbody import FlexBody

    if isinstance(value, FlexBody):
        return value
    if isinstance(value, str | Path) and str(value).isprintable() and str(value).strip():
        return Path(value).as_posix()
    raise fail(Problem("", f"a flexible-body file is expected, given {given(value)}"))


FlexibleSource = Annotated[Any, Reader(_read_source)]
"""Path of a flexible-body file, or a FlexBody."""
