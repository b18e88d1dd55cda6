"""Facets and lines: integrals over them, centroids and nodal areas of groups, the skin of a body.

Curved facets are integrated with their own shape functions; basis and quadrature are scikit-fem's.
For nodal areas facets with mid-side nodes are cut into small linear ones, each of which gives its
corners equal parts: consistent shares of such facets vanish or turn negative at the corners.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from skfem import (
    ElementLineP1,
    ElementLineP2,
    ElementQuad1,
    ElementQuad2,
    ElementQuadS2,
    ElementTriP1,
    ElementTriP2,
)
from skfem.element import Element
from skfem.quadrature import get_quadrature

from flexmb.fe.elements.element_blocks import Block
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

FACETS: dict[str, tuple[Element, int]] = {  # basis and quadrature order; node order agrees
    "triangle": (ElementTriP1(), 2),
    "triangle6": (ElementTriP2(), 6),
    "quad": (ElementQuad1(), 3),
    "quad8": (ElementQuadS2(), 7),
    "quad9": (ElementQuad2(), 7),
    "line": (ElementLineP1(), 2),
    "line3": (ElementLineP2(), 6),
}
"""Kinds of facets and lines that can be integrated."""


class FacetRule(NamedTuple):
    """Values at the quadrature points of nf cells."""

    N: FloatArray  # (k, q) shape functions
    size: FloatArray  # (nf, q) area or length, weights included
    normal: FloatArray  # (nf, q, 3) unit normal by the order of the nodes; along a line its tangent


def facet_rule(kind: str, x: FloatArray) -> FacetRule:
    """Quadrature of cells with node coordinates x (nf, k, 3)."""
    element, order = FACETS[kind]
    points, weights = get_quadrature(element.refdom, order)
    shapes = [element.lbasis(points, k) for k in range(x.shape[1])]
    N = np.array([shape[0] for shape in shapes])
    dN = np.array([np.reshape(shape[1], (len(points), -1)) for shape in shapes])
    tangents = np.einsum("fkc,kdq->fqdc", x, dN)
    if len(points) == 2:
        direction = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    else:
        direction = tangents[:, :, 0]
    size = np.linalg.norm(direction, axis=2)
    normal = direction / np.where(size > 0, size, 1.0)[:, :, None]
    return FacetRule(N, size * weights, normal)


def group_centroid(mesh: Mesh, group: str, nodes: IntArray) -> FloatArray:
    """(3,) area centroid of the group's facets, else the length centroid of its lines, else the
    mean of ``nodes``."""
    rows = mesh.group_elements(group)
    for dim in (2, 1):
        moments = [
            facet_moments(kind, mesh.points[mesh.blocks[kind][row]])
            for kind, row in rows.items()
            if dimension(kind) == dim and kind in FACETS and len(row)
        ]
        if moments:
            size = sum(part[0] for part in moments)
            return np.asarray(sum(part[1] for part in moments)) / size
    return mesh.points[nodes].mean(axis=0)


def facet_moments(kind: str, x: FloatArray) -> tuple[float, FloatArray]:
    """Area (or length) and its first moment (3,) of facets with node coordinates (nf, k, 3)."""
    rule = facet_rule(kind, x)
    return float(rule.size.sum()), np.einsum("fq,kq,fkc->c", rule.size, rule.N, x)


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
                _add_areas(total, mesh, kind, mesh.blocks[kind][row])
        if total[nodes].any():
            return total[nodes]
    return None


def _add_areas(total: FloatArray, mesh: Mesh, kind: str, cells: IntArray) -> None:
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
    outward = faces.copy()
    outward[inward] = faces[inward][:, _TURNED[faces.shape[1]]]
    return outward
