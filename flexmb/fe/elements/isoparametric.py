"""From reference to real elements: gradients of shape functions for many elements at once.

In: node coordinates (ne, k, 3) [m], shape functions at points of the reference element. Out:
gradients in the body frame and volumes of the integration points, the point first. The mapping is
isoparametric; either handedness of the numbering is right, so volumes are taken positive. All
elements share the shape functions' reference slopes, so that both the Jacobians and the gradients
are large matrix products.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.reference import Points
from flexmb.flexbody.arrays import FloatArray

__all__ = ["determinants", "gradients", "inverse_jacobians", "strain_rows"]


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
