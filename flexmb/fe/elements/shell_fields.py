"""Displacement fields of flat shells with six motions a node, of all elements at once.

:class:`Flat` is the mean plane of each element; its normal is that of the triangle, or of the two
diagonals of the quadrilateral, on the side from which the nodes run counter-clockwise. The
functions on the reference element are scikit-fem's: corners P1 or Q1, quadratic P2 or S2, edges
Nedelec N1, scaled to the line integral 1 along their own edge. :class:`Fields` gives, in element
axes, the displacement of the mid-surface, the rotation of its normal (a point at height z moves by
u + z beta) and the edge shear strains over the d = 6k motions of the nodes in body axes. Nodes are
tied rigidly to the mid-surface, over the offset and the warp.

Along an edge from i to j of length L, tangent s, with g = (w_j - w_i)/L + (beta_s,i + beta_s,j)/2
and phi = 12 D_ss/(S_ss L^2), the mid-side has beta_s = mean - 3/2 g/(1+phi), w = mean -
L/8 (beta_s,i - beta_s,j), and moves in the plane by mean + L/8 (theta_z,i - theta_z,j) (z x s);
the shear strain along the edge is phi/(1+phi) g. Sources: Katili (1993), Int. J. Numer. Meth. Eng.
36, 1859 and 1885 (DKMQ, DKMT; DKQ and DKT for phi = 0); Allman (1984), Computers & Structures 19, 1
and Cook (1986), Int. J. Numer. Meth. Eng. 23, 1347 (membrane).
"""

from __future__ import annotations

from collections.abc import Iterable
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

from flexmb.errors import MeshError
from flexmb.fe.sections.shell_section import ShellSection
from flexmb.flexbody.arrays import FloatArray, IntArray, skew

EDGES = {"triangle": ((0, 1), (1, 2), (2, 0)), "quad": ((0, 1), (1, 2), (2, 3), (3, 0))}
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
class ShellFunctions:
    """Shape functions at nq points of the reference element.

    Parameters
    ----------
    weights : (nq,) float
        Weights of the rule; zero where the points are only positions.
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
def shell_functions(kind: str, rule: str) -> ShellFunctions:
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
        return _functions_at(kind, points, np.zeros(1))
    order = 2 if rule == "sampling" else _ORDERS[kind][rule]
    points, weights = get_quadrature(corner, order)
    if (kind, rule) == ("quad", "stiffness"):
        points, weights = _five_points()
    area = 1.0 if kind == "quad" else 0.5
    return _functions_at(kind, points, weights * (area / weights.sum()))  # tables are rounded


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

    The 2 x 2 Gauss rule keeps curved shells from locking, but lets rectangles warp in their plane
    without energy; the centre point, of small weight, prevents that.
    """
    outer = (1 - _CENTER) / 4
    arm = np.sqrt(1 / (12 * outer)) / 2  # integrates squares exactly
    points = 0.5 + arm * np.array([[0, -1, 1, 1, -1], [0, -1, -1, 1, 1]])
    return points, np.array([_CENTER, outer, outer, outer, outer])


def _functions_at(kind: str, points: FloatArray, weights: FloatArray) -> ShellFunctions:
    corner, quadratic, edge = (element() for element in _ELEMENTS[kind])
    k = len(EDGES[kind])
    functions = [quadratic.lbasis(points, i) for i in range(2 * k)]
    return ShellFunctions(
        weights,
        np.stack([corner.lbasis(points, i)[1] for i in range(k)], axis=-1).transpose(1, 0, 2),
        np.stack([value for value, _ in functions], axis=-1),
        np.stack([slope for _, slope in functions], axis=-1).transpose(1, 0, 2),
        np.stack([_edge_function(kind, edge, e, points) for e in range(k)], axis=-1).transpose(
            1, 0, 2
        ),
    )


def _edge_function(kind: str, element: Any, e: int, points: FloatArray) -> FloatArray:
    """(2, nq) edge function with the line integral 1 along its edge: constant tangential part."""
    a, b = (element.refdom.p[:, node] for node in EDGES[kind][e])
    value, _ = element.lbasis((0.5 * (a + b))[:, None], e)
    shape, _ = element.lbasis(points, e)
    return shape / float((b - a) @ value[:, 0])


WARP_WARNING = 0.05
"""Warp from which a mesh is too coarse for its twist: the error is 2 % there (a twisted strip,
thick or thin), grows to 5 % at 0.1 and 20 % at 0.14, and falls with the size of the elements.
Splitting the quadrilaterals into triangles is no remedy: thin and twisted, those are too stiff."""
WARP_LIMIT = 0.15
"""Warp beyond which a quadrilateral should not be used at all."""

STEEP = 0.9  # share of the normal along x from which the default axis 1 is y
MIN_IN_PLANE = 1e-6  # least share of an orientation in the plane of an element


@dataclass(frozen=True, eq=False)
class Flat:
    """Elements in their mean planes.

    Parameters
    ----------
    center : (ne, 3) float
        Mean of the corners [m].
    axes : (ne, 3, 3) float
        Columns are axes 1, 2 and the normal, body frame.
    xy : (ne, k, 2) float
        Corners in the plane, from the centre [m].
    height : (ne, k) float
        Corners above the plane [m].
    """

    center: FloatArray
    axes: FloatArray
    xy: FloatArray
    height: FloatArray


def flatten(x: FloatArray, orientation: tuple[float, float, float] | None = None) -> Flat:
    """Project elements on their mean planes; axis 1 is the projection of ``orientation``.

    Raises
    ------
    MeshError
        The orientation is normal to an element, or an element is warped beyond ``WARP_LIMIT``.
    """
    _check_warp(x)
    normal = _normal(x)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    e1, size = plane_axis(normal, orientation)
    if (size < MIN_IN_PLANE).any():
        what = f"section.orientation is normal to {(size < MIN_IN_PLANE).sum()} shell elements"
        raise MeshError(f"{what}: it has no direction in their planes")
    axes = np.stack([e1 / size, np.cross(normal, e1 / size), normal], axis=2)
    center = x.mean(axis=1)
    local = np.matmul(x - center[:, None], axes)
    return Flat(center, axes, local[..., :2], local[..., 2])


def plane_axis(
    normal: FloatArray, orientation: tuple[float, float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """(n, 3) projections of ``orientation``, else of x or y, on planes, and (n, 1) their length."""
    if orientation is None:
        towards = np.where(np.abs(normal[:, :1]) > STEEP, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    else:
        towards = np.array([orientation]) / np.linalg.norm(orientation)
    e1 = towards - np.sum(towards * normal, axis=1, keepdims=True) * normal
    return e1, np.linalg.norm(e1, axis=1, keepdims=True)


def _check_warp(x: FloatArray) -> None:
    far = warp(x)
    if (far > WARP_LIMIT).any():
        what = f"{np.count_nonzero(far > WARP_LIMIT)} quadrilaterals are warped: their corners are "
        what += f"off a plane by up to {far.max():.2g} of their size, more than {WARP_LIMIT:g}"
        raise MeshError(f"{what}; mesh the twisted surface finer")


def warp(x: FloatArray) -> FloatArray:
    """(ne,) largest distance of a corner from the mean plane, over the root of the area."""
    normal = _normal(x)
    size = np.linalg.norm(normal, axis=1)
    safe = np.where(size > 0, size, 1.0)
    height = np.einsum("eka,ea->ek", x - x.mean(axis=1, keepdims=True), normal) / safe[:, None]
    return np.abs(height).max(axis=1) / np.sqrt(0.5 * safe)


def degenerate_elements(x: FloatArray) -> IntArray:
    """Elements without area, folded, or with a corner of 180 degrees or more."""
    normal = _normal(x)
    before, after = np.roll(x, 1, axis=1), np.roll(x, -1, axis=1)
    corner = np.einsum("eka,ea->ek", np.cross(after - x, before - x), normal)
    longest = np.linalg.norm(after - x, axis=2).max(axis=1)
    size = np.linalg.norm(normal, axis=1)
    flat = size <= 1e-10 * longest**2
    return np.flatnonzero(flat | (corner <= 1e-6 * size[:, None] ** 2).any(axis=1))


def opposed_edges(cells: Iterable[IntArray]) -> IntArray:
    """(k, 2) nodes of the edges at which two shells meet whose normals have opposite sides."""
    pairs, shared = _edges(cells)
    same, first, twice = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    return same[(twice == 2) & (shared[first] == 2)]


def free_edges(cells: Iterable[IntArray]) -> IntArray:
    """(k, 2) nodes of the edges of one shell alone."""
    pairs, shared = _edges(cells)
    return pairs[shared == 1]


def edge_bows(points: FloatArray, shells: Iterable[IntArray], edges: IntArray) -> FloatArray:
    """(k, 3, 3) B of lines between nodes i, j: rotations displace a line at the fraction t by
    1/2 t (1 - t) B (theta_i - theta_j). Edges bow in the plane of their shell, beams in both."""
    along = points[edges[:, 1]] - points[edges[:, 0]]
    B = -skew(along)
    cells = [nodes[np.isin(nodes, edges).sum(axis=1) > 1] for nodes in shells]
    pairs = [np.stack([c, np.roll(c, -1, axis=1)], axis=2).reshape(-1, 2) for c in cells]
    normals = [np.repeat(_normal(points[c]), c.shape[1], axis=0) for c in cells]
    if sum(map(len, pairs)):
        ends, n = np.sort(np.concatenate(pairs), axis=1), np.concatenate(normals)
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        keys, sought = (e @ [len(points), 1] for e in (ends, np.sort(edges, axis=1)))
        order = np.argsort(keys)
        row = order[np.searchsorted(keys[order], sought).clip(max=len(keys) - 1)]
        met = keys[row] == sought
        n = n[row[met]]
        B[met] = B[met] @ (n[:, :, None] * n[:, None, :])
    return B


def _edges(cells: Iterable[IntArray]) -> tuple[IntArray, IntArray]:
    """(k, 2) edges of all shells, directed as their nodes run, and the number of shells at each."""
    edges = [np.stack([c, np.roll(c, -1, axis=1)], axis=2).reshape(-1, 2) for c in cells]
    pairs = np.concatenate([np.zeros((0, 2), dtype=np.int64), *edges])
    ends = np.sort(pairs, axis=1)
    _, number, shared = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return pairs, shared[np.ravel(number)]


def _normal(x: FloatArray) -> FloatArray:
    """(ne, 3) vector along the normal, with a length of twice the area."""
    if x.shape[1] == 3:
        return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    return np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])


_LINEAR = {"triangle": 0.1**0.5, "quad": 1.0}
"""Factor on the linear part of the membrane strain; with all of it curved triangle meshes lock."""


@dataclass(frozen=True, eq=False)
class Fields:
    """Fields of elements of one kind; n = 2k corner and mid-side nodes.

    Parameters
    ----------
    flat : Flat
        The elements in their mean planes.
    nodal : (ne, n, 5, d) float
        u_x, u_y, w, beta_x, beta_y of the mid-surface at the nodes.
    shear : (ne, k, d) float
        Line integrals of the transverse shear strain along the edges [m].
    drill : (ne, d) float
        Mean rotation of the nodes about the normal less that of the mid-surface at the centre.
    length, tangent : (ne, k), (ne, k, 2) float
        Of the edges: length [m] and unit tangent in element axes.
    bow : (ne, k) float
        Rotation of mid-sides about the edges minus the mean of the corners, per g of the edge.
    linear : float
        Factor on the linear part of the membrane strain.
    """

    flat: Flat
    nodal: FloatArray
    shear: FloatArray
    drill: FloatArray
    length: FloatArray
    tangent: FloatArray
    bow: FloatArray
    linear: float


@dataclass(frozen=True, eq=False)
class ShellPoints:
    """Functions of the elements at nq points.

    Parameters
    ----------
    area : (ne, nq) float
        Weight of each point [m^2].
    values : (nq, n) float
        Quadratic functions.
    slopes : (ne, nq, 2, n) float
        Their derivatives in element axes.
    edge : (ne, nq, 2, k) float
        Edge functions in element axes.
    """

    area: FloatArray
    values: FloatArray
    slopes: FloatArray
    edge: FloatArray

    def gradients(self, fields: Fields) -> FloatArray:
        """(ne, nq, 2, 5, d) derivatives of the five fields along axes 1 and 2."""
        ne, nq, _, n = self.slopes.shape
        flat = fields.nodal.reshape(ne, n, -1)
        return np.matmul(self.slopes.reshape(ne, -1, n), flat).reshape(ne, nq, 2, 5, -1)

    def strains(self, fields: Fields) -> FloatArray:
        """(ne, nq, 6, d) membrane strains and curvatures xx, yy, xy."""
        H = self.gradients(fields)
        rows = (H[:, :, 0, 0], H[:, :, 1, 1], H[:, :, 1, 0] + H[:, :, 0, 1])
        bent = (H[:, :, 0, 3], H[:, :, 1, 4], H[:, :, 1, 3] + H[:, :, 0, 4])
        strains = np.stack([*rows, *bent], axis=2)
        if fields.linear < 1:
            membrane = strains[:, :, :3]
            mean = np.einsum("eq,eqid->eid", self.area, membrane)[:, None]
            mean /= self.area.sum(axis=1)[:, None, None, None]
            strains[:, :, :3] = mean + fields.linear * (membrane - mean)
        return strains

    def shear_strains(self, fields: Fields) -> FloatArray:
        """(ne, nq, 2, d) transverse shear strains xz, yz."""
        return np.matmul(self.edge, fields.shear[:, None])


def make_points(flat: Flat, at: ShellFunctions) -> ShellPoints:
    """Map functions of the reference element to the elements."""
    J = np.matmul(at.corner_slopes, flat.xy[:, None])  # (ne, nq, 2, 2): slope of coordinate c
    det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
    inverse = np.empty_like(J)
    inverse[..., 0, 0], inverse[..., 1, 1] = J[..., 1, 1] / det, J[..., 0, 0] / det
    inverse[..., 0, 1], inverse[..., 1, 0] = -J[..., 0, 1] / det, -J[..., 1, 0] / det
    slopes, edge = np.matmul(inverse, at.slopes), np.matmul(inverse, at.edge)
    return ShellPoints(det * at.weights, at.values, slopes, edge)


def make_fields(kind: str, x: FloatArray, section: ShellSection) -> Fields:
    """Fields of elements with corners ``x``.

    Raises
    ------
    MeshError
        The section's orientation is normal to an element, or an element is warped too much.
    """
    flat = flatten(x, section.orientation)
    start, end = (list(nodes) for nodes in zip(*EDGES[kind], strict=True))
    corner = _corner_fields(flat, section.offset)
    along = flat.xy[:, end] - flat.xy[:, start]
    length = np.linalg.norm(along, axis=2)
    tangent = along / length[..., None]
    phi = _shear_numbers(section, length, tangent)[..., None]
    L, sx, sy = length[..., None], tangent[..., :1], tangent[..., 1:]

    first, last = corner[:, start], corner[:, end]
    middle = 0.5 * (first + last)[:, :, :5]
    slope_i, slope_j = (sx * f[:, :, 3] + sy * f[:, :, 4] for f in (first, last))
    g = (last[:, :, 2] - first[:, :, 2]) / L + 0.5 * (slope_i + slope_j)
    turn = L / 8 * (first[:, :, 5] - last[:, :, 5])
    bow = -1.5 / (1 + phi)
    middle[:, :, 0] -= sy * turn
    middle[:, :, 1] += sx * turn
    middle[:, :, 2] -= L / 8 * (slope_i - slope_j)
    middle[:, :, 3] += sx * bow * g
    middle[:, :, 4] += sy * bow * g

    nodal = np.concatenate([corner[:, :, :5], middle], axis=1)
    slopes = make_points(flat, shell_functions(kind, "center")).slopes[:, 0]
    spin = 0.5 * (
        np.einsum("en,end->ed", slopes[:, 0], nodal[:, :, 1])
        - np.einsum("en,end->ed", slopes[:, 1], nodal[:, :, 0])
    )
    drill = corner[:, :, 5].mean(axis=1) - spin
    shear = phi / (1 + phi) * L * g
    return Fields(flat, nodal, shear, drill, length, tangent, bow[..., 0], _LINEAR[kind])


def _corner_fields(flat: Flat, offset: float) -> FloatArray:
    """(ne, k, 6, d) u_x, u_y, w, beta_x, beta_y, theta_z of the mid-surface at the corners."""
    ne, k = flat.height.shape
    local = flat.axes.transpose(0, 2, 1)
    out = np.zeros((ne, k, 6, k, 6))
    for i in range(k):
        arm = (offset - flat.height[:, i])[:, None]
        out[:, i, :3, i, :3] = local
        out[:, i, 3, i, 3:] = local[:, 1]  # beta_x = theta_y, beta_y = -theta_x
        out[:, i, 4, i, 3:] = -local[:, 0]
        out[:, i, 5, i, 3:] = local[:, 2]
        out[:, i, 0, i, 3:] = arm * local[:, 1]
        out[:, i, 1, i, 3:] = -arm * local[:, 0]
    return out.reshape(ne, k, 6, 6 * k)


def _shear_numbers(section: ShellSection, length: FloatArray, tangent: FloatArray) -> FloatArray:
    """(ne, k) phi = 12 D_ss/(S_ss L^2) of the edges."""
    if not section.shear:
        return np.zeros_like(length)
    c, s = tangent[..., 0], tangent[..., 1]
    bent = np.stack([c * c, s * s, 2 * c * s], axis=2)
    D = np.einsum("eki,ij,ekj->ek", bent, section.laminate.bending(), bent)
    S = np.einsum("eki,ij,ekj->ek", tangent, section.laminate.S, tangent)
    return 12 * D / (S * length**2)
