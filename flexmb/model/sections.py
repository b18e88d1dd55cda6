"""Cross-sections of the beams in a mesh: element group to a table of dimensions.

In: ``{all = {type = "tube", radius = 0.02, inner = 0.015}}``. Out: the same in SI, in the
words of ``flexmb.fe.sections``. The key is an element group, or ``"all"``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.flexible import MaterialField
from flexmb.model.quantities import Axis, Length, Quantity, Size
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
Product = Annotated[float, Quantity("m^4")]
Coefficient = Annotated[float, Quantity("", "positive")]
LineMass = Annotated[float, Quantity("kg/m", "not negative")]
Motion = Literal["ux", "uy", "uz", "rx", "ry", "rz"]
Releases = dict[Literal["start", "end"], tuple[Motion, ...]]


def _as_list(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


Place = Annotated[tuple[Length, Length], BeforeValidator(_as_list)]


class BeamWords(Spec):
    """What all sections of beams have.

    ``orientation`` is the direction of the section's y, ``offset`` the place of its centroid from
    the nodes, ``nonstructural`` a further mass per length; ``releases`` are motions that the first
    and last node of the group do not pass on.
    """

    ky: Coefficient | None = None
    kz: Coefficient | None = None
    orientation: Axis | None = None
    offset: Place | None = None
    nonstructural: LineMass | None = None
    material: MaterialField | None = None
    releases: Releases | None = None


class ShapeWords(BeamWords):
    """A shape with dimensions; without ``shear`` an Euler-Bernoulli beam."""

    shear: bool = True


class RectangleSection(ShapeWords):
    """Solid rectangle, y by z."""

    type: Literal["rectangle"]
    y: Size
    z: Size


class CircleSection(ShapeWords):
    """Solid round bar."""

    type: Literal["circle"]
    radius: Size


class TubeSection(ShapeWords):
    """Round tube, outer and inner radius."""

    type: Literal["tube"]
    radius: Size
    inner: Size

    @model_validator(mode="after")
    def _hollow(self, info: ValidationInfo) -> Self:
        if self.inner >= self.radius:
            units = units_of(names_of(info))
            radius, inner = units.say(self.radius, "m"), units.say(self.inner, "m")
            what = f"must be less than the outer radius {radius}, is {inner}"
            raise fail(Problem("inner", what))
        return self


class ISection(ShapeWords):
    """I-section, web along z; the bottom flange (-z) is as the one on top unless given."""

    type: Literal["I"]
    height: Size
    width: Size
    web: Size
    flange: Size
    bottom_width: Size | None = None
    bottom_flange: Size | None = None


class BoxSection(ShapeWords):
    """Closed box y by z outside; walls ``web`` along z and ``flange`` along y."""

    type: Literal["box"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


class AngleSection(ShapeWords):
    """Angle with legs y and z outside; ``flange`` is the thickness along y, ``web`` along z."""

    type: Literal["L"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


class GeneralSection(BeamWords):
    """Area, second moments, torsion constant; shear coefficients left out: no shear.

    ``points`` are places from the centroid where stress is told.
    """

    type: Literal["general"]
    A: Area
    Iy: Moment
    Iz: Moment
    J: Moment
    Iyz: Product | None = None
    shear_center: Place | None = None
    points: dict[str, Place] | None = None


def _read_one(value: Any, info: ValidationInfo) -> dict[str, Any]:
    spec, problems = read_variant("section", _SHAPES, value, names_of(info))
    if spec is None:
        raise fail(*problems)
    return _table(spec)


def _table(spec: Spec) -> dict[str, Any]:
    """What a section says, in SI."""
    values = {name: getattr(spec, name) for name in type(spec).model_fields}
    return {name: value for name, value in values.items() if value is not None}


def _write_one(table: dict[str, Any], info: SerializationInfo) -> dict[str, Any]:
    spec = SECTION_TYPES[table["type"]].model_construct(**table)
    return spec.model_dump(exclude_none=True, exclude_unset=True, context=info.context)


_SHAPES: dict[str, type[Spec]] = {
    "rectangle": RectangleSection,
    "circle": CircleSection,
    "tube": TubeSection,
    "I": ISection,
    "box": BoxSection,
    "L": AngleSection,
    "general": GeneralSection,
}
End = Annotated[dict[str, Any], Reader(_read_one, _write_one)]


class TaperedSection(Spec):
    """From one section to another along a chain of elements, by arc length.

    The chain starts at the end that its elements run away from, else at the lower node number.
    """

    type: Literal["tapered"]
    start: End
    end: End
    orientation: Axis | None = None
    material: MaterialField | None = None
    releases: Releases | None = None


SECTION_TYPES: dict[str, type[Spec]] = {**_SHAPES, "tapered": TaperedSection}


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
            sections[str(group)] = _table(spec)
    if problems:
        raise fail(*problems)
    return sections


def _write(value: dict[str, dict[str, Any]], info: SerializationInfo) -> dict[str, Any]:
    return {group: _write_one(table, info) for group, table in value.items()}


Sections = Annotated[dict[str, dict[str, Any]], Reader(_read, _write)]
