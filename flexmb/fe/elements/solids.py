"""The solids there are: tetrahedra, hexahedra and wedges with their rules, faces and words.

In: nothing. Out: one family for each kind of cells. Integration: stiffness of tetrahedra of second
order by 4 points, their mass by 14 (rules of orders 3 and 4 have negative weights, which can spoil
the mass); hexahedra of second order 27 points for both; stress from 2 x 2 x 2 points, 4 points of
tetrahedra, 3 x 2 of wedges.
"""

from __future__ import annotations

from flexmb.fe.elements.incompatible import Incompatible
from flexmb.fe.elements.reference import (
    HEX_EDGES,
    TET_EDGES,
    WEDGE_EDGES,
    hexahedron,
    hexahedron_rule,
    tetrahedron,
    tetrahedron_rule,
    wedge15,
    wedge_rule,
)
from flexmb.fe.elements.solid import Solid

__all__ = ["ADVICE", "HEXAHEDRON", "HEXAHEDRON20", "HEXAHEDRON27", "TETRA", "TETRA10", "WEDGE15"]

_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
_HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_WEDGE_FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2))

Faces = tuple[tuple[int, ...], ...]


def _second_order(faces: Faces, edges: tuple[tuple[int, int], ...], corners: int) -> Faces:
    """The faces with the nodes in the middle of their sides."""
    middle = {frozenset(edge): corners + number for number, edge in enumerate(edges)}
    return tuple(
        face + tuple(middle[frozenset(s)] for s in zip(face, face[1:] + face[:1], strict=True))
        for face in faces
    )


TETRA = Solid(
    "tetra",
    "solid: first-order tetrahedron, three displacements a node; far too stiff in bending",
    tetrahedron(1),
    rule=tetrahedron_rule(1),
    mass_rule=tetrahedron_rule(2),
    stress_rule=tetrahedron_rule(1),
    faces=_TET_FACES,
    edges=TET_EDGES,
    warning="first-order tetrahedra are far too stiff in bending and torsion, frequencies 10 % too "
    "high are usual, and their stress is constant in each: mesh with second-order tetrahedra",
)
TETRA10 = Solid(
    "tetra10",
    "solid: second-order tetrahedron, straight or curved, three displacements a node",
    tetrahedron(2),
    rule=tetrahedron_rule(2),
    mass_rule=tetrahedron_rule(5),
    stress_rule=tetrahedron_rule(2),
    faces=_second_order(_TET_FACES, TET_EDGES, 4),
    edges=TET_EDGES,
)
HEXAHEDRON = Incompatible(
    "hexahedron",
    "solid: first-order hexahedron with incompatible modes for bending, three displacements a node",
    hexahedron(8),
    rule=hexahedron_rule(3),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=_HEX_FACES,
    edges=HEX_EDGES,
)
HEXAHEDRON20 = Solid(
    "hexahedron20",
    "solid: second-order hexahedron of 20 nodes, straight or curved, three displacements a node",
    hexahedron(20),
    rule=hexahedron_rule(5),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=_second_order(_HEX_FACES, HEX_EDGES, 8),
    edges=HEX_EDGES,
)
HEXAHEDRON27 = Solid(
    "hexahedron27",
    "solid: second-order hexahedron of 27 nodes, straight or curved, three displacements a node",
    hexahedron(27),
    rule=hexahedron_rule(5),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=tuple(
        (*face, 20 + number) for number, face in enumerate(_second_order(_HEX_FACES, HEX_EDGES, 8))
    ),
    edges=HEX_EDGES,
)
WEDGE15 = Solid(
    "wedge15",
    "solid: second-order wedge of 15 nodes, straight or curved, three displacements a node",
    wedge15(),
    rule=wedge_rule(2, 5),
    mass_rule=wedge_rule(4, 5),
    stress_rule=wedge_rule(2, 3),
    faces=_second_order(_WEDGE_FACES, WEDGE_EDGES, 6),
    edges=WEDGE_EDGES,
)

_PYRAMID = "pyramids cannot be used: mesh with tetrahedra, or with hexahedra alone"
_LESS = 'mesh without nodes inside faces (gmsh: "Mesh.SecondOrderIncomplete = 1")'
_HIGHER = "elements above second order cannot be used: mesh with second-order elements"

ADVICE = {
    "wedge": "first-order wedges are far too stiff: mesh with second-order elements",
    "wedge12": "wedges have 15 nodes: mesh with second-order elements along the wedge too",
    "wedge18": f"wedges have 15 nodes: {_LESS}",
    "pyramid": _PYRAMID,
    "pyramid13": _PYRAMID,
    "pyramid14": _PYRAMID,
    "hexahedron24": "hexahedra have 8, 20 or 27 nodes",
    "tetra14": _HIGHER,
    "tetra20": _HIGHER,
    "wedge40": _HIGHER,
    "hexahedron64": _HIGHER,
}
"""What to do about solids that cannot be used."""
