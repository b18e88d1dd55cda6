"""The share of a surface, or of lines, that belongs to each of their nodes.

In: a mesh and a group. Out: one positive number a node, together the group's area (or length).
Facets with mid-side nodes are cut into small linear ones, each of which gives its corners equal
parts: consistent shares of such facets vanish or turn negative at the corners.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["tributary"]

_PIECES: dict[str, tuple[tuple[int, ...], ...]] = {  # triangles or segments of local nodes
    "triangle": ((0, 1, 2),),
    "triangle6": ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    "quad": ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3)),
    "quad8": (
        (0, 4, 7),
        (4, 1, 5),
        (5, 2, 6),
        (7, 6, 3),
        (4, 5, 6),
        (4, 6, 7),
        (4, 5, 7),
        (5, 6, 7),
    ),
    "quad9": tuple(
        piece
        for a, b, c, d in ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))
        for piece in ((a, b, c), (a, c, d), (a, b, d), (b, c, d))
    ),
    "line": ((0, 1),),
    "line3": ((0, 2), (2, 1)),
}
_TWICE = {"quad": slice(0, 4), "quad8": slice(4, 8), "quad9": slice(0, 16)}  # both diagonals


def tributary(mesh: Mesh, group: str, nodes: IntArray) -> FloatArray | None:
    """(k,) area, or length, that belongs to each of ``nodes``; None if the group has no facets.

    Surfaces count before lines.
    """
    rows = mesh.group_elements(group)
    for dim in (2, 1):
        total = np.zeros(len(mesh.points))
        for kind, row in rows.items():
            if dimension(kind) == dim and kind in _PIECES and len(row):
                _add(total, mesh, kind, mesh.blocks[kind][row])
        if total[nodes].any():
            return total[nodes]
    return None


def _add(total: FloatArray, mesh: Mesh, kind: str, cells: IntArray) -> None:
    pieces = np.array(_PIECES[kind])
    share = np.ones(len(pieces))
    share[_TWICE.get(kind, slice(0, 0))] = 0.5
    corners = cells[:, pieces]
    x = mesh.points[corners]
    if pieces.shape[1] == 2:
        size = np.linalg.norm(x[:, :, 1] - x[:, :, 0], axis=2)
    else:
        normal = np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0])
        size = 0.5 * np.linalg.norm(normal, axis=2)
    part = size * share / pieces.shape[1]
    np.add.at(total, corners, np.broadcast_to(part[:, :, None], corners.shape))
