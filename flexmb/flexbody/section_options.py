"""Options of the sections of elements in a mesh: beams, shells, solids.

y and z are the section's axes, x runs along the beam. Scenes and :func:`flexmb.fe.reduce` read
these options; the functions of :mod:`flexmb.fe.sections` have parameters of the same names.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from flexmb.errors import Problem
from flexmb.flexbody.mesh_options import Direction, MaterialOption
from flexmb.flexbody.options import Length, OneOf, Say, Size, Unit

Moment = Annotated[float, Unit("m^4", "positive")]
Coefficient = Annotated[float, Unit("", "positive")]
Place = tuple[Length, Length]
Motion = Literal["ux", "uy", "uz", "rx", "ry", "rz"]


@dataclass(frozen=True, kw_only=True)
class ReleasesOptions:
    """Motions, in the section's axes, that the ends of the beam do not pass on: hinges."""

    start: tuple[Motion, ...] = ()
    end: tuple[Motion, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BeamSectionOptions:
    """What all sections of beams have: direction of y, material, place, further mass, hinges."""

    orientation: Direction | None = None
    material: MaterialOption | None = None
    offset: Place | None = None
    nonstructural: Annotated[float, Unit("kg/m", "not negative")] = 0.0
    releases: ReleasesOptions | None = None


@dataclass(frozen=True, kw_only=True)
class ShapedOptions(BeamSectionOptions):
    """Sections with a shape; without `shear` the beam is one of Euler and Bernoulli."""

    shear: bool = True
    ky: Coefficient | None = None
    kz: Coefficient | None = None


@dataclass(frozen=True, kw_only=True)
class RectangleSection(ShapedOptions):
    """Solid rectangle, y by z."""

    type: Literal["rectangle"]
    y: Size
    z: Size


@dataclass(frozen=True, kw_only=True)
class CircleSection(ShapedOptions):
    """Solid round bar."""

    type: Literal["circle"]
    radius: Size


@dataclass(frozen=True, kw_only=True)
class TubeSection(ShapedOptions):
    """Round tube, outer and inner radius."""

    type: Literal["tube"]
    radius: Size
    inner: Size

    def check(self, say: Say) -> list[Problem]:
        """It must be hollow."""
        if self.inner < self.radius:
            return []
        what = f"must be less than the outer radius {say(self.radius, 'm')}, "
        return [Problem("inner", f"{what}is {say(self.inner, 'm')}")]


@dataclass(frozen=True, kw_only=True)
class ISection(ShapedOptions):
    """I section, web along z; width and thickness of its flanges, of the lower if it differs."""

    type: Literal["I"]
    height: Size
    width: Size
    web: Size
    flange: Size
    bottom_width: Size | None = None
    bottom_flange: Size | None = None


@dataclass(frozen=True, kw_only=True)
class BoxSection(ShapedOptions):
    """Hollow rectangle, y by z outside; thickness of the walls along z and of those along y."""

    type: Literal["box"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


@dataclass(frozen=True, kw_only=True)
class AngleSection(ShapedOptions):
    """Angle with legs along y and z; thickness of the leg along z and of that along y."""

    type: Literal["L"]
    y: Size
    z: Size
    web: Size
    flange: Size | None = None


@dataclass(frozen=True, kw_only=True)
class GeneralSection(BeamSectionOptions):
    """Area, second moments about the centroid, torsion constant; without ky, kz: no shear."""

    type: Literal["general"]
    A: Annotated[float, Unit("m^2", "positive")]
    Iy: Moment
    Iz: Moment
    J: Moment
    Iyz: Annotated[float, Unit("m^4")] = 0.0
    ky: Coefficient | None = None
    kz: Coefficient | None = None
    shear_center: Place | None = None
    points: dict[str, Place] = field(default_factory=dict)


BEAM_SECTIONS: dict[str, type] = {
    "rectangle": RectangleSection,
    "circle": CircleSection,
    "tube": TubeSection,
    "I": ISection,
    "box": BoxSection,
    "L": AngleSection,
    "general": GeneralSection,
}
"""Sections of beams that are the same along the beam, by type."""
BeamSectionOption = Annotated[Any, OneOf("section", BEAM_SECTIONS)]


@dataclass(frozen=True, kw_only=True)
class TaperedSection:
    """A section that goes over from `start` to `end` along its group, which is one chain."""

    type: Literal["tapered"]
    start: BeamSectionOption
    end: BeamSectionOption
    orientation: Direction | None = None
    material: MaterialOption | None = None
    releases: ReleasesOptions | None = None


@dataclass(frozen=True, kw_only=True)
class ShellOptions:
    """What all shells have: place of the middle along the normal, direction of material axis 1,
    further mass; without `shear` a plate of Kirchhoff."""

    offset: Length = 0.0
    orientation: Direction | None = None
    material: MaterialOption | None = None
    nonstructural: Annotated[float, Unit("kg/m^2", "not negative")] = 0.0
    shear: bool = True


@dataclass(frozen=True, kw_only=True)
class ShellSection(ShellOptions):
    """A shell or plate of one thickness."""

    type: Literal["shell"]
    thickness: Size


@dataclass(frozen=True, kw_only=True)
class LayerOptions:
    """A layer of a shell; its material axis 1 is turned by `angle` about the normal."""

    thickness: Size
    material: MaterialOption | None = None
    angle: Annotated[float, Unit("rad")] = 0.0


@dataclass(frozen=True, kw_only=True)
class LayeredSection(ShellOptions):
    """A shell of layers, the first one lowest along the normal."""

    type: Literal["layered"]
    layers: tuple[LayerOptions, ...]


@dataclass(frozen=True, kw_only=True)
class SolidSection:
    """Solids: their material, its axis 1 and a direction in the plane of its axes 1 and 2."""

    type: Literal["solid"]
    material: MaterialOption | None = None
    axis1: Direction | None = None
    axis2: Direction | None = None


SECTIONS: dict[str, type] = {
    **BEAM_SECTIONS,
    "tapered": TaperedSection,
    "shell": ShellSection,
    "layered": LayeredSection,
    "solid": SolidSection,
}
"""All sections by type."""
