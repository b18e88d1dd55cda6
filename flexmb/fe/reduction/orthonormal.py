"""From a reduced basis to modal coordinates: rigid motions removed, mass and stiffness diagonal.

In: reduced matrices, and the rigid motions in reduced coordinates. Out: :class:`ReducedModes`. The
six rigid motions are known exactly, so they are projected out (mass-orthogonally: a mean-axis
frame), never found by counting small frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, eigh, qr, solve_triangular

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.reduction.basis import ReducedBasis
from flexmb.fe.reduction.canonical import canonical_rotation, polynomial_fields
from flexmb.fe.reduction.loose import moving_nodes
from flexmb.flexbody.arrays import FloatArray

__all__ = ["ReducedModes", "elastic_modes", "orthonormalise"]

_LOOSE = 1e-12  # a squared frequency this small relative to the largest is zero but for rounding


@dataclass(frozen=True, eq=False)
class ReducedModes:
    """Elastic modes with unit modal mass.

    Parameters
    ----------
    omega2 : (m,) float
        Squared circular frequencies of the free body, ascending [1/s^2].
    Z : (k, m) float
        Modes in the coordinates of the reduced basis.
    Phi : (n, m) float
        Modes over all degrees of freedom of the model.
    """

    omega2: FloatArray
    Z: FloatArray
    Phi: FloatArray

    @property
    def frequencies(self) -> FloatArray:
        """(m,) Hz."""
        return np.sqrt(self.omega2) / (2 * np.pi)


def orthonormalise(fe: FEMatrices, reduced: ReducedBasis) -> ReducedModes:
    """Modes of the reduced free body without its rigid motions, unique in sign and direction.

    Raises
    ------
    ReductionError
        The reduced body is looser than a single solid: a mechanism or a part that nothing holds.
    """
    omega2, Z = elastic_modes(reduced.K, reduced.M, reduced.rigid)
    if len(omega2) and omega2[0] <= _LOOSE * omega2[-1]:
        where = moving_nodes(fe, reduced.basis @ Z[:, :1])
        raise ReductionError(
            f"the body has a motion without stiffness besides the six rigid ones: {where}"
        )
    products = (polynomial_fields(fe).T @ (fe.M @ reduced.basis)) @ Z
    Z = Z @ canonical_rotation(omega2, products)
    return ReducedModes(omega2, Z, reduced.basis @ Z)


def elastic_modes(K: FloatArray, M: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and mass-normalised modes that are mass-orthogonal to R.

    Parameters
    ----------
    K, M : (k, k) float
        Reduced matrices; K R = 0.
    R : (k, 6) float
        Rigid motions, fewer in a plane.

    Raises
    ------
    ReductionError
        A motion without mass.
    """
    massless = ~(np.diag(M) > 0)
    scale = 1.0 / np.sqrt(np.where(massless, 1.0, np.diag(M)))
    try:
        L = cholesky(scale[:, None] * M * scale, lower=True)
    except np.linalg.LinAlgError as error:
        raise ReductionError(
            "a motion of the reduced body has no mass, so its modes have no frequency: nodes that "
            "hang on springs or ties alone need a mass, or must be no interface"
        ) from error
    rigid = L.T @ (R / scale[:, None])
    rest = qr(rigid)[0][:, R.shape[1] :]
    half = solve_triangular(L, rest, lower=True, trans="T") * scale[:, None]
    A = half.T @ K @ half
    omega2, W = eigh(0.5 * (A + A.T))
    return omega2, half @ W
