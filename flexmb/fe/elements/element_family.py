"""What an element family gives, and the reference elements of solids.

A family gives the matrices of all elements of one kind at once. In: node coordinates x (ne, k, 3)
[m] in the body frame, in the mesh's (VTK's) node order, and the section they share. Out: batches of
element matrices in body axes. Degrees of freedom run node by node: three displacements, and three
rotations where the family has them; d is their number. Stresses are in the order xx, yy, zz, yz,
zx, xy, body axes [Pa].

Shape functions and rules are scikit-fem's where it has them, brought into the mesh's node order;
the wedge with 15 nodes is the span of {1, r, s, r^2, rs, s^2} x {1, t} and {1, r, s} x {t^2}
(Zienkiewicz, Taylor, The Finite Element Method, vol. 1, section 8.10). Reference domains are the
unit simplex, the unit cube and the unit triangle times the unit interval. All elements share the
reference slopes, so that Jacobians and gradients of all elements are large matrix products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from skfem import ElementHex1, ElementHex2, ElementHexS2, ElementTetP1, ElementTetP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefHex, RefLine, RefTet, RefTri

from flexmb.flexbody.arrays import FloatArray, IntArray

Faces = tuple[tuple[int, ...], ...]
StressStiffness = Callable[..., FloatArray]
STRESS = ("xx", "yy", "zz", "yz", "zx", "xy")
"""Order of stress components."""


@dataclass(frozen=True, eq=False)
class ScalarMass:
    """Mass of elements whose nodes only displace, and whose position and displacement share one
    interpolation.

    Parameters
    ----------
    M : (ne, k, k) float
        int rho N_i N_j [kg].
    """

    M: FloatArray


@dataclass(frozen=True, eq=False)
class ComponentMass:
    """Mass of elements with nodal rotations, by components of the displacement.

    With N_a (1, d) the interpolation of the displacement along a of a material point, rotations of
    the section included, and s its reference position: each integral is exact.

    Parameters
    ----------
    Mab : (ne, 3, 3, d, d) float
        int rho N_a^T N_b.
    P : (ne, 3, 3, d) float
        int rho s_a N_b.
    p : (ne, 3, d) float
        int rho N_b.
    mass : (ne,) float
        kg.
    S1 : (ne, 3) float
        int rho s.
    S0 : (ne, 3, 3) float
        int rho s s^T.
    """

    Mab: FloatArray
    P: FloatArray
    p: FloatArray
    mass: FloatArray
    S1: FloatArray
    S0: FloatArray


class Family(Protocol):
    """A kind of element; one object for each, in :mod:`flexmb.fe.elements.element_blocks`."""

    kind: str  # name of the cells in a mesh
    about: str  # a sentence for the list of elements
    dimension: int  # 1 beam, 2 shell, 3 solid
    rotations: bool  # nodes carry rotations too
    warning: str  # a warning for its users; empty if none
    faces: tuple[tuple[int, ...], ...]  # local nodes of outer faces: corners, then mid-sides
    edges: tuple[tuple[int, int], ...]  # corners of straight edges: for checks and drawing

    def measure(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne,) volume, area or length."""
        ...

    def defects(self, x: FloatArray) -> IntArray:
        """Rows of elements that are flat, folded or without length."""
        ...

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, d, d) stiffness."""
        ...

    def mass(self, x: FloatArray, section: Any) -> ScalarMass | ComponentMass:
        """Consistent mass."""
        ...

    def geometric_stiffness(
        self, x: FloatArray, section: Any, u: FloatArray, field: FloatArray | None = None
    ) -> FloatArray:
        """(ne, d, d) geometric stiffness of the stress that displacements u (ne, d) cause.

        ``field`` (3, 4), [G, g], is a force per mass G s + g at s that acts in the elements.
        """
        ...

    def stress_stiffness(self, x: FloatArray, section: Any) -> StressStiffness:
        """``geometric_stiffness`` of u and ``field``, for many stresses in the same elements."""
        ...

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """Names of the places across the section where stress is reported: top, bottom, ..."""
        ...

    def stress(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, k, layers, 6, d) stress at the nodes per unit of each degree of freedom."""
        ...

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, k, 3, d) rotation at the nodes per unit of each degree of freedom.

        Half the curl of the displacement where nodes carry no rotations.
        """
        ...


TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
HEX_EDGES = (
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)
WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
"""Corners of the edges, in the order of their mid-side nodes."""

_TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
_HEX = np.array([[r, s, t] for t in (0, 1) for r, s in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
_WEDGE = np.array([[r, s, t] for t in (0, 1) for r, s in ((0, 0), (1, 0), (0, 1))], float)
_HEX_FACES = [[a, 0.5, 0.5] for a in (0, 1)], [[0.5, a, 0.5] for a in (0, 1)]
_HEX27 = np.array([*_HEX_FACES[0], *_HEX_FACES[1], [0.5, 0.5, 0], [0.5, 0.5, 1], [0.5] * 3])


class SeparateStresses:
    """A family whose stresses have nothing in common but the nodes."""

    def stress_stiffness(self: Family, x: FloatArray, section: Any) -> StressStiffness:
        """As of `Family`."""
        return partial(self.geometric_stiffness, x, section)


@dataclass(frozen=True, eq=False)
class Rule:
    """Integration points X (nq, 3) of a reference domain and their weights w (nq,)."""

    X: FloatArray
    w: FloatArray


@dataclass(frozen=True, eq=False)
class Points:
    """Shape functions at points of the reference element.

    Parameters
    ----------
    rule : Rule
        The points and weights.
    N : (nq, k) float
        Shape functions.
    dN : (nq, 3, k) float
        Their slopes along the reference coordinates.
    """

    rule: Rule
    N: FloatArray
    dN: FloatArray


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference element.

    Parameters
    ----------
    nodes : (k, 3) float
        Where the nodes are, VTK order.
    corners : int
        How many of them are corners; these come first.
    shapes : callable
        From points (nq, 3) to N (nq, k) and dN (nq, 3, k).
    """

    nodes: FloatArray
    corners: int
    shapes: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    def at(self, rule: Rule) -> Points:
        """Shape functions at integration points."""
        return Points(rule, *self.shapes(rule.X))

    def at_nodes(self) -> Points:
        """Shape functions at the nodes; no integration rule, the weights are zero."""
        return self.at(Rule(self.nodes, np.zeros(len(self.nodes))))


def tetrahedron(order: int) -> Reference:
    """Tetrahedron with 4 (order 1) or 10 nodes (order 2)."""
    element = ElementTetP1() if order == 1 else ElementTetP2()
    nodes = _TET if order == 1 else _with_middles(_TET, TET_EDGES)
    return Reference(nodes, 4, _ordered(element, nodes))


def hexahedron(nodes: int) -> Reference:
    """Hexahedron with 8, 20 or 27 nodes."""
    element = {8: ElementHex1, 20: ElementHexS2, 27: ElementHex2}[nodes]()
    places = _HEX if nodes == 8 else _with_middles(_HEX, HEX_EDGES)
    places = np.vstack([places, _HEX27]) if nodes == 27 else places
    return Reference(places, 8, _ordered(element, places))


def wedge15() -> Reference:
    """Wedge with 15 nodes."""
    flat = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    powers = np.array([(*p, t) for t in (0, 1) for p in flat] + [(*p, 2) for p in flat[:3]])
    nodes = _with_middles(_WEDGE, WEDGE_EDGES)
    to_nodes = np.linalg.inv(_monomials(nodes, powers))

    def shapes(X: FloatArray) -> tuple[FloatArray, FloatArray]:
        slopes = []
        for axis in range(3):
            lower = powers - np.eye(3, dtype=int)[axis] * (powers[:, axis : axis + 1] > 0)
            slopes.append(powers[:, axis] * _monomials(X, lower) @ to_nodes)
        return _monomials(X, powers) @ to_nodes, np.stack(slopes, axis=1)

    return Reference(nodes, 6, shapes)


def tetrahedron_rule(order: int) -> Rule:
    """Rule exact to that order; those of orders 3 and 4 have negative weights."""
    X, w = get_quadrature(RefTet, order)
    return Rule(X.T, w)


def hexahedron_rule(order: int) -> Rule:
    """Gauss points: 1 (order 1), 8 (order 3), 27 (order 5)."""
    X, w = get_quadrature(RefHex, order)
    return Rule(X.T, w)


def wedge_rule(triangle: int, line: int) -> Rule:
    """Rule of order ``triangle`` in the triangle times Gauss points of order ``line``."""
    X, w = get_quadrature(RefTri, triangle)
    T, v = get_quadrature(RefLine, line)
    points = [[*x, t] for x in X.T for t in T[0]]
    return Rule(np.array(points), np.outer(w, v).ravel())


def extrapolation(nodes: FloatArray, X: FloatArray) -> FloatArray:
    """(k, np) from values at points X to values at the nodes.

    The values are taken to be constant (1 point), linear (4 points of a tetrahedron), linear in the
    triangle times linear along the wedge (6), or trilinear (8 points of a hexahedron).
    """
    cube = [(r, s, t) for t in (0, 1) for s in (0, 1) for r in (0, 1)]
    fields = {
        1: cube[:1],
        4: [p for p in cube if sum(p) < 2],
        6: [p for p in cube if p[:2] != (1, 1)],
        8: cube,
    }
    powers = np.array(fields[len(X)])
    return _monomials(nodes, powers) @ np.linalg.inv(_monomials(X, powers))


def _monomials(X: FloatArray, powers: IntArray) -> FloatArray:
    """(nq, number of monomials) the products of powers of the coordinates."""
    return np.prod(X[:, None, :] ** powers[None], axis=2)


def _with_middles(corners: FloatArray, edges: tuple[tuple[int, int], ...]) -> FloatArray:
    return np.vstack([corners, [(corners[a] + corners[b]) / 2 for a, b in edges]])


def _ordered(
    element: ElementTetP1, nodes: FloatArray
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Shape functions of a scikit-fem element, in the order of ``nodes``."""
    distance = np.linalg.norm(element.doflocs[None] - nodes[:, None], axis=2)
    order = distance.argmin(axis=1)

    def shapes(X: FloatArray) -> tuple[FloatArray, FloatArray]:
        functions = [element.lbasis(X.T, number) for number in order]
        N = np.stack([np.broadcast_to(phi, len(X)) for phi, _ in functions], axis=1)
        dN = np.stack([np.asarray(slope).T for _, slope in functions], axis=2)
        return N.astype(float), dN.astype(float)

    return shapes


def gradients(x: FloatArray, points: Points) -> tuple[FloatArray, FloatArray]:
    """Gradients of the shape functions, and the volumes of the points.

    Returns
    -------
    G : (nq, ne, 3, k) float
        dN/dx along the axes of the body [1/m].
    dx : (nq, ne) float
        Weight times |det J| [m^3].
    """
    inverse, det = inverse_jacobians(x, points)
    G = np.matmul(inverse.reshape(len(det), -1, 3), points.dN)
    return G.reshape(*inverse.shape[:3], -1), points.rule.w[:, None] * np.abs(det)


def inverse_jacobians(x: FloatArray, points: Points) -> tuple[FloatArray, FloatArray]:
    """(nq, ne, 3, 3) slope of reference coordinate i along x_a, [q, e, a, i]; det J (nq, ne)."""
    J = _jacobians(x, points)
    cofactors = _cofactors(J)
    det = np.einsum("qae,qae->qe", J[:, 0], cofactors[:, 0])
    inverse = cofactors / det[:, None, None]
    return np.ascontiguousarray(inverse.transpose(0, 3, 2, 1)), det


def determinants(x: FloatArray, points: Points) -> FloatArray:
    """(nq, ne) det J with its sign."""
    J = _jacobians(x, points)
    return np.einsum("qae,qae->qe", J[:, 0], _cofactors(J)[:, 0])


def strain_rows(G: FloatArray) -> FloatArray:
    """(ne, nq, 6, 3k) strains xx, yy, zz, yz, zx, xy (shear: engineering) per displacement."""
    nq, ne, _, k = G.shape
    B = np.zeros((ne, nq, 6, k, 3))
    dx, dy, dz = (G[:, :, a].transpose(1, 0, 2) for a in range(3))
    for row, (first, second) in enumerate(((dx, 0), (dy, 1), (dz, 2))):
        B[:, :, row, :, second] = first
    for row, (a, b, along_a, along_b) in enumerate(
        ((1, 2, dy, dz), (2, 0, dz, dx), (0, 1, dx, dy)), start=3
    ):
        B[:, :, row, :, a] = along_b
        B[:, :, row, :, b] = along_a
    return B.reshape(ne, nq, 6, 3 * k)


def _jacobians(x: FloatArray, points: Points) -> FloatArray:
    """(nq, 3, 3, ne) slope of coordinate a along reference coordinate i, [q, i, a, e]."""
    nq, _, k = points.dN.shape
    ne = len(x)
    flat = np.ascontiguousarray(x.transpose(1, 2, 0)).reshape(k, 3 * ne)
    return (points.dN.reshape(3 * nq, k) @ flat).reshape(nq, 3, 3, ne)


def _cofactors(J: FloatArray) -> FloatArray:
    """(nq, 3, 3, ne) cofactors, [q, i, a, e]; over the determinant they are the inverse, turned."""
    C = np.empty_like(J)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            C[:, i, a] = J[:, j, b] * J[:, k, c] - J[:, j, c] * J[:, k, b]
    return C


def second_order_faces(faces: Faces, edges: tuple[tuple[int, int], ...], corners: int) -> Faces:
    """The faces with the nodes in the middle of their sides."""
    middle = {frozenset(edge): corners + number for number, edge in enumerate(edges)}
    return tuple(
        face + tuple(middle[frozenset(s)] for s in zip(face, face[1:] + face[:1], strict=True))
        for face in faces
    )
