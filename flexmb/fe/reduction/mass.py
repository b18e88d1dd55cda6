"""Solving with a sparse mass matrix.

In: a mass matrix, perhaps with held means. Out: the solution by conjugate gradients with the
diagonal as preconditioner: a consistent mass matrix scaled by its diagonal has a condition number
that depends on the element kind alone, so some dozens of products suffice. Source: Wathen (1987),
IMA Journal of Numerical Analysis 7(4).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from flexmb.flexbody.arrays import FloatArray

__all__ = ["held_mass_solve", "mass_solve"]

_TOLERANCE = 1e-13  # of the residual against the right side
_STEPS = 2000  # some dozens are usual; nodes with rotations of thin shells take more


def mass_solve(M: csr_array, B: FloatArray) -> FloatArray:
    """(n, k) M^-1 B for all columns of B (n, k) together; zero where M has nothing."""
    diagonal = M.diagonal()[:, None]
    inverse = np.where(diagonal > 0, 1.0 / np.where(diagonal > 0, diagonal, 1.0), 0.0)
    X, R = np.zeros_like(B), B.copy()
    Z = inverse * R
    P, energy = Z.copy(), np.sum(R * Z, axis=0)
    target = _TOLERANCE**2 * energy
    for _ in range(_STEPS):
        going = energy > target
        if not going.any():
            break
        MP = M @ P
        step = np.where(going, energy / np.where(going, np.sum(P * MP, axis=0), 1.0), 0.0)
        X += step * P
        R -= step * MP
        Z = inverse * R
        before, energy = energy, np.sum(R * Z, axis=0)
        P = Z + np.where(going, energy / np.where(going, before, 1.0), 0.0) * P
    return X


def held_mass_solve(M: csr_array, W: csr_array, B: FloatArray) -> FloatArray:
    """(n, k) the same with the means W (w, n) of the solution held at zero."""
    X = mass_solve(M, B)
    if not W.shape[0]:
        return X
    Y = mass_solve(M, W.T.toarray())
    return X - Y @ np.linalg.solve(W @ Y, W @ X)
