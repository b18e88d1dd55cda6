"""The skin of a body: what is drawn of it.

In: blocks of elements. Out: triangles (outer faces of solids, shells themselves; second-order faces
as several) and the lines of beams, as mesh nodes.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flexmb.fe.elements.select import Block
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["outer_faces", "skin_lines", "skin_triangles"]

_SPLIT = {  # nodes of a face to the triangles it is drawn as: corners first, then mid-sides, centre
    3: [[0, 1, 2]],
    4: [[0, 1, 2], [0, 2, 3]],
    6: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    8: [[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6], [4, 6, 7]],
    9: [
        [0, 4, 8], [0, 8, 7], [4, 1, 5], [4, 5, 8],
        [8, 5, 2], [8, 2, 6], [7, 8, 6], [7, 6, 3],
    ],
}  # fmt: skip
_CORNERS = {3: 3, 4: 4, 6: 3, 8: 4, 9: 4}
_TURNED = {
    3: [0, 2, 1],
    4: [0, 3, 2, 1],
    6: [0, 2, 1, 5, 4, 3],
    8: [0, 3, 2, 1, 7, 6, 5, 4],
    9: [0, 3, 2, 1, 7, 6, 5, 4, 8],
}


def outer_faces(blocks: Iterable[Block], points: FloatArray) -> list[IntArray]:
    """Faces that belong to one solid element only, turned outwards: (nf, 3|4|6|8|9) by size."""
    faces: dict[int, list[IntArray]] = {}
    centers: dict[int, list[FloatArray]] = {}
    for block in blocks:
        if block.family.dimension != 3:
            continue
        middle = points[block.nodes].mean(axis=1)
        for face in block.family.faces:
            faces.setdefault(len(face), []).append(block.nodes[:, face])
            centers.setdefault(len(face), []).append(middle)
    sizes = list(faces)
    stacked = {k: np.concatenate(faces[k]) for k in sizes}
    single = _once([stacked[k][:, : _CORNERS[k]] for k in sizes])
    return [
        _outwards(stacked[k][rows], np.concatenate(centers[k])[rows], points)
        for k, rows in zip(sizes, single, strict=True)
        if len(rows)
    ]


def skin_triangles(blocks: Iterable[Block], points: FloatArray) -> IntArray:
    """(t, 3) linear triangles of the skin."""
    blocks = list(blocks)
    faces = outer_faces(blocks, points)
    faces += [block.nodes for block in blocks if block.family.dimension == 2]
    parts = [face[:, _SPLIT[face.shape[1]]].reshape(-1, 3) for face in faces]
    return np.concatenate([np.zeros((0, 3), dtype=int), *parts])


def skin_lines(blocks: Iterable[Block]) -> IntArray:
    """(l, 2) lines of the beams."""
    parts = [block.nodes for block in blocks if block.family.dimension == 1]
    return np.concatenate([np.zeros((0, 2), dtype=int), *parts])


def _once(corners: list[IntArray]) -> list[IntArray]:
    """Rows of each list of faces whose corners, in any order, occur once in all of them."""
    if not corners:
        return []
    padded = [
        np.pad(np.sort(part, axis=1), ((0, 0), (0, 4 - part.shape[1])), constant_values=-1)
        for part in corners
    ]
    _, first, count = np.unique(
        np.concatenate(padded), axis=0, return_index=True, return_counts=True
    )
    single = np.sort(first[count == 1])
    ends = np.cumsum([len(part) for part in corners])
    starts = ends - [len(part) for part in corners]
    return [single[(single >= a) & (single < b)] - a for a, b in zip(starts, ends, strict=True)]


def _outwards(faces: IntArray, centers: FloatArray, points: FloatArray) -> IntArray:
    x = points[faces]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, _CORNERS[faces.shape[1]] - 1] - x[:, 0])
    inward = np.sum(normal * (x[:, 0] - centers), axis=1) < 0
    found = faces.copy()
    found[inward] = faces[inward][:, _TURNED[faces.shape[1]]]
    return found
