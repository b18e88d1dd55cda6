"""Stiffness of solids from gradients of their shape functions, isotropic or orthotropic.

In: gradients and volumes at the integration points (:mod:`flexmb.fe.elements.isoparametric`), a
section. Out: element matrices in body axes, exactly symmetric (each is a product A^T A, which BLAS
forms as one triangle). Isotropic: with H_ab = int dN_i/dx_a dN_j/dx_b the block of directions c, d
is lambda H_cd + mu H_dc + mu delta_cd tr H: one small product for all of B^T C B. Otherwise A is
the strain operator times the Cholesky factor of C. Source: Zienkiewicz, Taylor, The Finite Element
Method, vol. 1, section 4.2.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.elements.isoparametric import strain_rows
from flexmb.fe.sections.solid import SolidSection
from flexmb.flexbody.arrays import FloatArray
from flexmb.materials import Material

__all__ = ["stiffness", "stress_along"]


def stiffness(G: FloatArray, dx: FloatArray, section: SolidSection) -> FloatArray:
    """(ne, 3k, 3k) int B^T C B from G (nq, ne, 3, k) [1/m] and dx (nq, ne) [m^3]."""
    if isinstance(section.material, Material):
        return _isotropic(G, dx, section.material)
    nq, ne, _, k = G.shape
    root = np.linalg.cholesky(section.stiffness()).T
    A = np.matmul(root, strain_rows(G)) * np.sqrt(dx.T)[:, :, None, None]
    A = A.reshape(ne, 6 * nq, 3 * k)
    return np.matmul(A.transpose(0, 2, 1), A)


def stress_along(slope: FloatArray, section: SolidSection) -> FloatArray:
    """(..., 3, 3) stress [Pa] from the displacement gradient (..., a, c) = du_c/dx_a."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    strain = [slope[..., a, b] if a == b else slope[..., a, b] + slope[..., b, a] for a, b in pairs]
    components = np.stack(strain, axis=-1) @ section.stiffness()
    stress = np.empty(slope.shape)
    for row, (a, b) in enumerate(pairs):
        stress[..., a, b] = stress[..., b, a] = components[..., row]
    return stress


def _isotropic(G: FloatArray, dx: FloatArray, material: Material) -> FloatArray:
    nq, ne, _, k = G.shape
    A = (G * np.sqrt(dx)[:, :, None, None]).reshape(nq, ne, 3 * k).transpose(1, 2, 0)
    H = np.matmul(A, A.transpose(0, 2, 1)).reshape(ne, 3, k, 3, k)
    mu = material.G
    lam = 2 * mu * material.nu / (1 - 2 * material.nu)
    trace = mu * (H[:, 0, :, 0] + H[:, 1, :, 1] + H[:, 2, :, 2])
    K = np.empty((ne, k, 3, k, 3))
    for c in range(3):
        K[:, :, c, :, c] = (lam + mu) * H[:, c, :, c] + trace
        for d in range(3):
            if c != d:
                K[:, :, c, :, d] = lam * H[:, c, :, d] + mu * H[:, d, :, c]
    return K.reshape(ne, 3 * k, 3 * k)
