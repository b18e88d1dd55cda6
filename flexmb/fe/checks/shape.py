"""How well shaped elements are.

In: corner coordinates of elements of one kind. Out: the scaled Jacobian, at each corner the volume
(area) spanned by its edges over the product of their lengths, scaled to 1 for the regular element;
of an element the least of its corners. Source: Knupp et al., The Verdict Library Reference Manual,
Sandia 2007.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.flexbody.arrays import FloatArray

__all__ = ["CORNERS", "scaled_jacobian"]

CORNERS: dict[str, tuple[str, float]] = {
    "triangle": ("12 20 01", 2 / math.sqrt(3)),
    "quad": ("13 20 31 02", 1.0),
    "tetra": ("123 203 013 021", math.sqrt(2)),
    "wedge": ("123 204 015 540 351 432", 2 / math.sqrt(3)),
    "hexahedron": ("134 205 316 027 750 461 572 643", 1.0),
}
"""Neighbours of each corner, in a right-handed order, and the scale of the regular element."""


def scaled_jacobian(kind: str, x: FloatArray) -> FloatArray | None:
    """(ne,) quality of elements with node coordinates x (ne, k, 3); None for other kinds.

    Left-handed numbering, or a normal to either side, counts as right; negative is what folds.
    """
    known = CORNERS.get(kind.rstrip("0123456789"))
    if known is None:
        return None
    corners, scale = known
    normal = None
    found = []
    for corner, neighbours in enumerate(corners.split()):
        edges = x[:, [int(k) for k in neighbours]] - x[:, [corner]]
        lengths = np.prod(np.linalg.norm(edges, axis=2), axis=1)
        if edges.shape[1] == 3:
            spanned = np.einsum("ec,ec->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
        else:
            areas = np.cross(edges[:, 0], edges[:, 1])
            normal = areas if normal is None else normal
            sign = np.where(np.einsum("ec,ec->e", areas, normal) < 0, -1.0, 1.0)
            spanned = sign * np.linalg.norm(areas, axis=1)
        found.append(spanned / np.where(lengths > 0, lengths, np.inf))
    quality = scale * np.array(found)
    return np.min(quality * np.where(quality.sum(axis=0) < 0, -1.0, 1.0), axis=0)
