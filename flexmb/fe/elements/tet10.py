"""Second-order tetrahedra: stiffness, scalar mass and gradients of all elements at once.

In: node coordinates by element, (ne, 10, 3) [m], VTK node order (which is scikit-fem's). Out:
batches of element matrices. Each element gets its own copy of its nodes in a disjoint scikit-fem
mesh, whose isoparametric mapping, P2 basis and quadrature are used; products are batched BLAS
instead of scikit-fem's vector forms. Stiffness by a rule of order 2, mass of order 4 (a rule of
order 3 has a negative weight and spoils the mass). Source: Zienkiewicz, Taylor, The Finite Element
Method, vol. 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import CellBasis, ElementTetP2, MappingIsoparametric, MeshTet1, MeshTet2

from flexmb.fe.elements.family import ScalarMass
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["TETRA10", "inverted", "mass", "node_gradients", "stiffness"]

FACES = ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6))
_STIFFNESS_ORDER, _MASS_ORDER = 2, 4


def stiffness(x: FloatArray, lame: tuple[float, float]) -> FloatArray:
    """(ne, 30, 30) stiffness, degree of freedom 3*node + direction.

    Parameters
    ----------
    x : (ne, 10, 3) float
        Node coordinates [m].
    lame : (lambda, mu)
        Lame's constants [Pa].
    """
    basis = _basis(x, intorder=_STIFFNESS_ORDER)
    G = _gradients(basis).reshape(len(x), 30, -1)  # row 3*i + a: derivative of N_i along a
    H = np.matmul(G * basis.dx[:, None, :], G.transpose(0, 2, 1)).reshape(-1, 10, 3, 10, 3)
    lam, mu = lame
    K = lam * H + mu * H.transpose(0, 1, 4, 3, 2)
    trace = mu * np.einsum("eicjc->eij", H)
    for c in range(3):
        K[:, :, c, :, c] += trace
    return K.reshape(-1, 30, 30)


def mass(x: FloatArray, density: float) -> FloatArray:
    """(ne, 10, 10) scalar consistent mass, int rho N_i N_j; ``x`` as for the stiffness."""
    basis = _basis(x, intorder=_MASS_ORDER)
    N = np.array([np.asarray(field[0])[0] for field in basis.basis])
    products = (N[:, None] * N[None]).reshape(100, -1)
    return density * (basis.dx @ products.T).reshape(-1, 10, 10)


def node_gradients(x: FloatArray) -> FloatArray:
    """(ne, 10, 3, 10) derivative of N_i along a at each node: [element, i, a, node]."""
    basis = _basis(x, quadrature=(ElementTetP2.doflocs.T, np.full(10, 0.1)))
    return _gradients(basis)


def inverted(x: FloatArray) -> IntArray:
    """Elements that are flat or folded: the Jacobian vanishes, or has not the corners' sign.

    Either numbering of the corners, left- or right-handed, is right if an element keeps to it.
    """
    basis = _basis(x, intorder=_MASS_ORDER)
    hand = np.sign(np.linalg.det(x[:, 1:4] - x[:, :1]))
    size = np.ptp(x[:, :4], axis=1).max(axis=1) ** 3
    worst = (hand[:, None] * basis.mapping.detDF(basis.X)).min(axis=1)
    return np.flatnonzero(worst <= 1e-12 * size)


def _basis(x: FloatArray, **rule: object) -> CellBasis:
    ne = len(x)
    vertices = np.ascontiguousarray(x[:, :4].reshape(-1, 3).T)
    corners = MeshTet1(vertices, np.ascontiguousarray(np.arange(4 * ne).reshape(ne, 4).T))
    mesh = MeshTet2.from_mesh(corners)
    mesh.doflocs[:, mesh.dofs.element_dofs] = x.transpose(2, 1, 0)
    element = ElementTetP2()
    mapping = MappingIsoparametric(mesh, element)
    return CellBasis(mesh, element, mapping, disable_doflocs=True, **rule)


def _gradients(basis: CellBasis) -> FloatArray:
    return np.stack([field[0].grad.transpose(1, 0, 2) for field in basis.basis], axis=1)


class Tetra10:
    """Second-order tetrahedra as a family."""

    kind = "tetra10"
    about = "solid: second-order tetrahedron, straight or curved, three displacements a node"
    dimension = 3
    rotations = False
    warning = ""
    faces = FACES
    edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))

    def defects(self, x: FloatArray) -> IntArray:
        """Flat or folded elements."""
        return inverted(x)

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, 30, 30)."""
        E, nu = section.material.E, section.material.nu
        return stiffness(x, (E * nu / ((1 + nu) * (1 - 2 * nu)), section.material.G))

    def mass(self, x: FloatArray, section: Any) -> ScalarMass:
        """Consistent mass."""
        return ScalarMass(mass(x, section.material.density))

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, 10, 3, 30) half the curl at the nodes."""
        g = node_gradients(x).transpose(0, 3, 2, 1)  # element, node, derivative, shape
        out = np.zeros((len(x), 10, 3, 10, 3))
        for c, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            out[:, :, c, :, b] = 0.5 * g[:, :, a]
            out[:, :, c, :, a] = -0.5 * g[:, :, b]
        return out.reshape(len(x), 10, 3, 30)


TETRA10 = Tetra10()
