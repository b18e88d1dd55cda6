"""All element families by the kind of their cells in a mesh."""

from __future__ import annotations

from flexmb.fe.elements import solids
from flexmb.fe.elements.beam import LINE
from flexmb.fe.elements.family import Family
from flexmb.fe.elements.shell import ADVICE as SHELL_ADVICE
from flexmb.fe.elements.shell import QUAD, TRIANGLE

__all__ = ["ADVICE", "ELEMENTS", "FAMILIES"]

FAMILIES: dict[str, Family] = {
    family.kind: family
    for family in (
        solids.TETRA,
        solids.TETRA10,
        solids.HEXAHEDRON,
        solids.HEXAHEDRON20,
        solids.HEXAHEDRON27,
        solids.WEDGE15,
        LINE,
        TRIANGLE,
        QUAD,
    )
}
"""Family by kind of cells."""

ELEMENTS: dict[str, str] = {kind: family.about for kind, family in FAMILIES.items()}
"""Kinds of elements that make up a body, by their names in meshes, and what they are."""

ADVICE = {
    **solids.ADVICE,
    **SHELL_ADVICE,
    "line3": "beams have two nodes: mesh them with first-order elements",
}
"""What to do about kinds that cannot be used."""
