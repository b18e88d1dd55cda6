"""Surfaces of Abaqus: faces of solids by element and face, nodes, or sides of shells.

Source: Abaqus Keywords Reference Guide, SURFACE; Abaqus Elements Guide, faces of solids.
"""

from __future__ import annotations

from flexmb.fe.elements.solid_elements import HEXAHEDRON, HEXAHEDRON20, TETRA, TETRA10, WEDGE15

_FACETS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
_FAMILIES = {family.kind: family for family in (HEXAHEDRON, HEXAHEDRON20, TETRA, TETRA10, WEDGE15)}
_FACES = {  # corners of the faces S1, S2, ...
    "tetra": ("012", "013", "123", "023"),
    "wedge": ("012", "345", "0134", "1245", "0235"),
    "hexahedron": ("0123", "4567", "0145", "1256", "2367", "0347"),
}


def face(kind: str, nodes: list[int], name: str) -> tuple[str, list[int]] | None:
    """Kind and nodes of the face S1, S2, ... of a solid; None if there is no such face."""
    family, corners = _FAMILIES.get(kind), _FACES.get(kind.rstrip("0123456789"), ())
    number = int(name[1:]) if name[:1].upper() == "S" and name[1:].isdigit() else 0
    if family is None or not 1 <= number <= len(corners):
        return None
    plane = {int(corner) for corner in corners[number - 1]}
    for own in family.faces:
        if set(own[: len(plane)]) == plane:
            return _FACETS[len(own)], [nodes[k] for k in own]
    return None
