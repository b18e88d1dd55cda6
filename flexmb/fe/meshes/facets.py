"""Integrals over facets and lines with their own shape functions.

In: a kind of cell and the coordinates of its nodes. Out: shape functions, area (or length) and
normals at quadrature points. Curved facets count as curved; basis and quadrature are scikit-fem's.
"""

from __future__ import annotations

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

from flexmb.flexbody.arrays import FloatArray

__all__ = ["FACETS", "FacetRule", "facet_rule"]

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
