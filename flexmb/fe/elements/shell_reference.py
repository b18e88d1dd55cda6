"""Interpolation of flat shells on the reference triangle and square, from scikit-fem.

In: the kind. Out: :class:`Reference` with the values of the corner functions (P1, Q1), of the
quadratic functions (P2, serendipity S2), and of the edge functions (Nedelec N1), at the points of a
quadrature rule. Edge functions are scaled so that function e has the line integral 1 along its own
edge, run from its first to its second corner, and 0 along the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from skfem import (
    ElementQuad1,
    ElementQuadN1,
    ElementQuadS2,
    ElementTriN1,
    ElementTriP1,
    ElementTriP2,
)
from skfem.quadrature import get_quadrature

from flexmb.flexbody.arrays import FloatArray

__all__ = ["EDGES", "Reference", "extrapolation", "reference"]

EDGES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
}
"""Corners of the edges; the mid-side node of edge e comes k + e th."""

_ELEMENTS = {
    "triangle": (ElementTriP1, ElementTriP2, ElementTriN1),
    "quad": (ElementQuad1, ElementQuadS2, ElementQuadN1),
}
_ORDERS = {  # of the rules; products on triangles are polynomials: these are exact
    "triangle": {"stiffness": 2, "mass": 4},
    "quad": {"stiffness": 3, "mass": 5},
}
_CENTER = 1 / 40
"""Weight of the centre in the stiffness rule of quadrilaterals."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Functions at nq points of the reference element.

    Parameters
    ----------
    weights : (nq,) float
        Of the rule; zero where the points are only places.
    corner_slopes : (nq, 2, k) float
        Derivatives of the corner functions.
    values, slopes : (nq, 2k), (nq, 2, 2k) float
        Quadratic functions and their derivatives: corners, then mid-sides.
    edge : (nq, 2, k) float
        Edge functions, covariant.
    """

    weights: FloatArray
    corner_slopes: FloatArray
    values: FloatArray
    slopes: FloatArray
    edge: FloatArray


@cache
def reference(kind: str, rule: str) -> Reference:
    """The functions of a kind at the points of a rule.

    Parameters
    ----------
    kind : str
        ``"triangle"`` or ``"quad"``.
    rule : str
        ``"stiffness"`` or ``"mass"``, a quadrature; ``"center"``; or ``"sampling"``, points of best
        stress: those of the rule of order 2.
    """
    corner, _, _ = (element() for element in _ELEMENTS[kind])
    if rule == "center":
        points = corner.refdom.p.mean(axis=1, keepdims=True)
        return _at(kind, points, np.zeros(1))
    order = 2 if rule == "sampling" else _ORDERS[kind][rule]
    points, weights = get_quadrature(corner, order)
    if (kind, rule) == ("quad", "stiffness"):
        points, weights = _five_points()
    area = 1.0 if kind == "quad" else 0.5
    return _at(kind, points, weights * (area / weights.sum()))  # tables are rounded


@cache
def extrapolation(kind: str) -> FloatArray:
    """(k, nq) from values at the sampling points to the corners, by the (bi)linear field."""
    corner = _ELEMENTS[kind][0]()
    points, _ = get_quadrature(corner, 2)
    terms = [np.ones(points.shape[1]), *points]
    ends = [np.ones(corner.refdom.p.shape[1]), *corner.refdom.p]
    if kind == "quad":
        terms.append(points[0] * points[1])
        ends.append(corner.refdom.p[0] * corner.refdom.p[1])
    return np.linalg.solve(np.array(terms), np.array(ends)).T


def _five_points() -> tuple[FloatArray, FloatArray]:
    """Points (2, 5) and weights (5,) of a rule of order 3 on the square.

    Close to the 2 x 2 Gauss rule, which keeps curved shells from locking but lets rectangles warp
    in their plane without energy, with a centre point against that.
    """
    outer = (1 - _CENTER) / 4
    arm = np.sqrt(1 / (12 * outer)) / 2  # integrates squares exactly
    points = 0.5 + arm * np.array([[0, -1, 1, 1, -1], [0, -1, -1, 1, 1]])
    return points, np.array([_CENTER, outer, outer, outer, outer])


def _at(kind: str, points: FloatArray, weights: FloatArray) -> Reference:
    corner, quadratic, edge = (element() for element in _ELEMENTS[kind])
    k = len(EDGES[kind])
    functions = [quadratic.lbasis(points, i) for i in range(2 * k)]
    return Reference(
        weights,
        np.stack([corner.lbasis(points, i)[1] for i in range(k)], axis=-1).transpose(1, 0, 2),
        np.stack([value for value, _ in functions], axis=-1),
        np.stack([slope for _, slope in functions], axis=-1).transpose(1, 0, 2),
        np.stack([_edge(kind, edge, e, points) for e in range(k)], axis=-1).transpose(1, 0, 2),
    )


def _edge(kind: str, element: Any, e: int, points: FloatArray) -> FloatArray:
    """(2, nq) edge function with the line integral 1 along its edge: constant tangential part."""
    a, b = (element.refdom.p[:, node] for node in EDGES[kind][e])
    value, _ = element.lbasis((0.5 * (a + b))[:, None], e)
    shape, _ = element.lbasis(points, e)
    return shape / float((b - a) @ value[:, 0])
