"""Cross-sections of the beams in a mesh: element group to a table of dimensions.

In: ``{all = {type = "tube", radius = 0.02, inner = 0.015}}``. Out: the same in SI, in the
words of ``flexmb.fe.sections.beam``. The key is an element group, or ``"all"``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.quantities import Axis, Quantity, Size
from flexmb.model.reading import (
    Reader,
    Spec,
    fail,
    given,
    names_of,
    read_variant,
    under,
    units_of,
)

__all__ = ["SECTION_TYPES", "Sections"]

Area = Annotated[float, Quantity("m^2", "positive")]
Moment = Annotated[float, Quantity("m^4", "positive")]
Coefficient = Annotated[float, Quantity("", "positive")]


class RectangleSection(Spec):
    """Solid rectangle, y by z; ``orientation`` is the direction of y; without shear: Euler."""

    type: Literal["rectangle"]
    y: Size
    z: Size
    shear: bool = True
    orientation: Axis | None = None


class CircleSection(Spec):
    """Solid round bar."""

    type: Literal["circle"]
    radius: Size
    shear: bool = True


class TubeSection(Spec):
    """Round tube, outer and inner radius."""

    type: Literal["tube"]
    radius: Size
    inner: Size
    shear: bool = True

    @model_validator(mode="after")
    def _hollow(self, info: ValidationInfo) -> Self:
        if self.inner >= self.radius:
            units = units_of(names_of(info))
            radius, inner = units.say(self.radius, "m"), units.say(self.inner, "m")
            what = f"must be less than the outer radius {radius}, is {inner}"
            raise fail(Problem("inner", what))
        return self


class GeneralSection(Spec):
    """Area, second moments, torsion constant; shear coefficients left out: no shear."""

    type: Literal["general"]
    A: Area
    Iy: Moment
    Iz: Moment
    J: Moment
    ky: Coefficient | None = None
    kz: Coefficient | None = None
    orientation: Axis | None = None


SECTION_TYPES: dict[str, type[Spec]] = {
    "rectangle": RectangleSection,
    "circle": CircleSection,
    "tube": TubeSection,
    "general": GeneralSection,
}


def _read(value: Any, info: ValidationInfo) -> dict[str, dict[str, Any]]:
    if not isinstance(value, Mapping):
        raise fail(
            Problem("", f"a table {{group = section, ...}} is expected, given {given(value)}")
        )
    problems: list[Problem] = []
    sections: dict[str, dict[str, Any]] = {}
    for group, table in value.items():
        spec, found = read_variant("section", SECTION_TYPES, table, names_of(info))
        problems += under(str(group), found)
        if spec is not None:
            sections[str(group)] = spec.model_dump(exclude_none=True)
    if problems:
        raise fail(*problems)
    return sections


def _write(value: dict[str, dict[str, Any]], info: SerializationInfo) -> dict[str, Any]:
    return {
        group: SECTION_TYPES[table["type"]]
        .model_construct(**table)
        .model_dump(exclude_none=True, context=info.context)
        for group, table in value.items()
    }


Sections = Annotated[dict[str, dict[str, Any]], Reader(_read, _write)]
