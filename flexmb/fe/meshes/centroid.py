"""The centroid of a group: of its surface, else of its lines, else of its nodes.

In: a mesh and a group. Out: a point. Curved facets are integrated with their own shape functions,
taken from scikit-fem with its quadrature.
"""

from __future__ import annotations

import numpy as np
from skfem import ElementLineP1, ElementLineP2, ElementTriP1, ElementTriP2
from skfem.element import Element
from skfem.quadrature import get_quadrature

from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["facet_moments", "group_centroid"]

_FACETS: dict[str, tuple[Element, int]] = {  # basis and quadrature order; node order agrees
    "triangle": (ElementTriP1(), 2),
    "triangle6": (ElementTriP2(), 6),
    "line": (ElementLineP1(), 2),
    "line3": (ElementLineP2(), 6),
}


def group_centroid(mesh: Mesh, group: str, nodes: IntArray) -> FloatArray:
    """(3,) area centroid of the group's facets, else the length centroid of its lines, else the
    mean of ``nodes``."""
    rows = mesh.group_elements(group)
    for dim in (2, 1):
        moments = [
            facet_moments(kind, mesh.points[mesh.blocks[kind][row]])
            for kind, row in rows.items()
            if dimension(kind) == dim and kind in _FACETS and len(row)
        ]
        if moments:
            size = sum(part[0] for part in moments)
            return np.asarray(sum(part[1] for part in moments)) / size
    return mesh.points[nodes].mean(axis=0)


def facet_moments(kind: str, x: FloatArray) -> tuple[float, FloatArray]:
    """Area (or length) and its first moment (3,) of facets with node coordinates (nf, k, 3)."""
    element, order = _FACETS[kind]
    points, weights = get_quadrature(element.refdom, order)
    shapes = [element.lbasis(points, k) for k in range(x.shape[1])]
    N = np.array([shape[0] for shape in shapes])
    dN = np.array([np.reshape(shape[1], (len(points), -1)) for shape in shapes])
    tangents = np.einsum("fkc,kdq->fqdc", x, dN)
    if len(points) == 2:
        size = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=2) * weights
    else:
        size = np.linalg.norm(tangents[:, :, 0], axis=2) * weights
    return float(size.sum()), np.einsum("fq,kq,fkc->c", size, N, x)
