"""Sections of the elements in a mesh: a table of dimensions for each element group.

In: dimensions and places in the scene's units. Out: specifications in SI with the words of
``flexmb.fe.sections``. y and z are the section's axes, x runs along the beam.

In: ``{all = {type = "tube", radius = 0.02, inner = 0.015}}``; the key is an element group, or
``"all"`` for whatever no other section names. Out: specifications in SI, in the words of
``flexmb.fe.sections``: of beams, of shells, of solids.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.material import MaterialField
from flexmb.model.values.quantities import Angle, Axis, Length, Quantity, Size, plain
from flexmb.model.values.reading import Entry, Spec, Variant, context_of, fail

Area = Annotated[float, Quantity("m^2", "positive")]
Moment = Annotated[float, Quantity("m^4", "positive")]
Product = Annotated[float, Quantity("m^4")]
Coefficient = Annotated[float, Quantity("", "positive")]
Place = Annotated[tuple[Length, Length], BeforeValidator(plain)]
Motion = Literal["ux", "uy", "uz", "rx", "ry", "rz"]
Motions = Annotated[tuple[Motion, ...], BeforeValidator(plain)]


class ReleasesSpec(Spec):
    """Motions, in the section's axes, that the ends of the beam do not pass on: hinges."""

    start: Motions = ()
    end: Motions = ()


class BeamSectionSpec(Spec):
    """What all sections of beams have: direction of y, material, place, further mass, hinges."""

    orientation: Axis | None = None
    material: MaterialField | None = None
    offset: Place | None = None
    nonstructural: Annotated[float, Quantity("kg/m", "not negative")] = 0.0
    releases: Annotated[ReleasesSpec, Entry()] | None = None


class ShapedSpec(BeamSectionSpec):
    """Sections with a shape; without `shear` the beam is one of Euler and Bernoulli."""

    shear: bool = True
    ky: Coefficient | None = None
    kz: Coefficient | None = None


class RectangleSection(ShapedSpec):
    """Solid rectangle, y by z."""

    type: Literal["rectangle"]
    y: Size
    z: Size


class CircleSection(ShapedSpec):
    """Solid round bar."""

    type: Literal["circle"]
    radius: Size


class TubeSection(ShapedSpec):
    """Round tube, outer and inner radius."""

    type: Literal["tube"]
    radius: Size
    inner: Size

    @model_validator(mode="after")
    def _hollow(self, info: ValidationInfo) -> Self:
        if self.inner >= self.radius:
            units = context_of(info).units
            radius, inner = units.say(self.radius, "m"), units.say(self.inner, "m")
            what = f"must be less than the outer radius {radius}, is {inner}"
            raise fail(Problem("inner", what))
        return self


class ISection(ShapedSpec):
    """I section, web along z; width and thickness of its flanges, of the lower if it differs."""

    type: Literal["I"]
    height: Size
    width: Size
    web: Size
    flange: Size
    bottom_width: Size | None = None
    bottom_flange: Size | None = None


class BoxSection(ShapedSpec):
    """Hollow rectangle, y by z outside; thickness of the walls along z and of those along y."""

    type: Literal["box"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


class AngleSection(ShapedSpec):
    """Angle with legs along y and z; thickness of the leg along z and of that along y."""

    type: Literal["L"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


class GeneralSection(BeamSectionSpec):
    """Area, second moments about the centroid, torsion constant; without ky, kz: no shear."""

    type: Literal["general"]
    A: Area
    Iy: Moment
    Iz: Moment
    J: Moment
    Iyz: Product = 0.0
    ky: Coefficient | None = None
    kz: Coefficient | None = None
    shear_center: Place | None = None
    points: dict[str, Place] = {}


BEAM_SECTIONS: dict[str, type[Spec]] = {
    "rectangle": RectangleSection,
    "circle": CircleSection,
    "tube": TubeSection,
    "I": ISection,
    "box": BoxSection,
    "L": AngleSection,
    "general": GeneralSection,
}


class TaperedSection(Spec):
    """A section that goes over from `start` to `end` along its group, which is one chain."""

    type: Literal["tapered"]
    start: Annotated[Any, Variant("section", lambda: BEAM_SECTIONS)]
    end: Annotated[Any, Variant("section", lambda: BEAM_SECTIONS)]
    orientation: Axis | None = None
    material: MaterialField | None = None
    releases: Annotated[ReleasesSpec, Entry()] | None = None


class ShellSpec(Spec):
    """What all shells have: place of the middle along the normal, direction of material axis 1."""

    offset: Length = 0.0
    orientation: Axis | None = None
    material: MaterialField | None = None
    nonstructural: Annotated[float, Quantity("kg/m^2", "not negative")] = 0.0


class ShellSection(ShellSpec):
    """A shell or plate of one thickness."""

    type: Literal["shell"]
    thickness: Size


class LayerSpec(Spec):
    """A layer of a shell; its material axis 1 is turned by `angle` about the normal."""

    thickness: Size
    material: MaterialField | None = None
    angle: Angle = 0.0


class LayeredSection(ShellSpec):
    """A shell of layers, the first one lowest along the normal."""

    type: Literal["layered"]
    layers: Annotated[tuple[Annotated[LayerSpec, Entry()], ...], BeforeValidator(plain)]


class SolidSection(Spec):
    """Solids: their material, its axis 1 and a direction in the plane of its axes 1 and 2."""

    type: Literal["solid"]
    material: MaterialField | None = None
    axis1: Axis | None = None
    axis2: Axis | None = None


SECTION_TYPES: dict[str, type[Spec]] = {
    **BEAM_SECTIONS,
    "tapered": TaperedSection,
    "shell": ShellSection,
    "layered": LayeredSection,
    "solid": SolidSection,
}

Sections = dict[str, Annotated[Any, Variant("section", lambda: SECTION_TYPES)]]
"""Element group, or ``"all"``, to its section."""
