"""Sections of the elements in a mesh: a table of dimensions for each element group.

In: ``{all = {type = "tube", radius = 0.02, inner = 0.015}}``; the key is an element group, or
``"all"`` for whatever no other section names. Out: specifications in SI, in the words of
``flexmb.fe.sections``: of beams, of shells, of solids.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from flexmb.model.bodies.beam_sections import BEAM_SECTIONS, TaperedSection
from flexmb.model.bodies.material import MaterialField
from flexmb.model.values.quantities import Angle, Axis, Length, Quantity, Size, plain
from flexmb.model.values.reading import Entry, Spec, Variant

__all__ = ["SECTION_TYPES", "Sections"]


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
