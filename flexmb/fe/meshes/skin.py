"""The skin of a mesh: what is drawn of a body.

In: the elements of a body. Out: triangles (the outer faces of tetrahedra, each second-order face
as four) and beam lines, as mesh nodes.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.tet10 import FACES
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["outer_faces", "skin_triangles"]

_SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


def outer_faces(tets: IntArray, points: FloatArray) -> IntArray:
    """(nf, 6) second-order triangles that belong to one tetrahedron only, turned outwards."""
    faces = tets[:, FACES].reshape(-1, 6)
    corners = np.sort(faces[:, :3], axis=1)
    _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
    chosen = np.sort(first[count == 1])
    found = faces[chosen]
    edges = points[tets[:, 1:4]] - points[tets[:, :1]]
    left_handed = (np.linalg.det(edges) < 0)[chosen // len(FACES)]
    found[left_handed] = found[left_handed][:, [0, 2, 1, 5, 4, 3]]
    return found


def skin_triangles(tets: IntArray, points: FloatArray) -> IntArray:
    """(t, 3) linear triangles of the skin."""
    return outer_faces(tets, points)[:, _SPLIT].reshape(-1, 3)
