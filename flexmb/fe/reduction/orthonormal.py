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
from flexmb.fe.assembly.numbering import skew
from flexmb.fe.reduction.canonical import canonical_rotation, polynomial_fields
from flexmb.fe.reduction.craig_bampton import CraigBampton
from flexmb.flexbody.arrays import FloatArray

__all__ = ["ReducedModes", "elastic_modes", "orthonormalise", "rigid_coordinates"]

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


def orthonormalise(fe: FEMatrices, reduced: CraigBampton) -> ReducedModes:
    """Modes of the reduced free body without its rigid motions, unique in sign and direction.

    Raises
    ------
    ReductionError
        The reduced body is looser than a single solid: a mechanism or a part that nothing holds.
    """
    R = rigid_coordinates(fe, reduced)
    omega2, Z = elastic_modes(reduced.K, reduced.M, R)
    if len(omega2) and omega2[0] <= _LOOSE * omega2[-1]:
        raise ReductionError(
            "the body has a motion without stiffness besides the six rigid ones: parts of the mesh "
            "hang together by too few nodes"
        )
    products = (polynomial_fields(fe).T @ (fe.M @ reduced.basis)) @ Z
    Z = Z @ canonical_rotation(omega2, products)
    return ReducedModes(omega2, Z, reduced.basis @ Z)


def rigid_coordinates(fe: FEMatrices, reduced: CraigBampton) -> FloatArray:
    """(k, 6) rigid motions about the centre of mass in the coordinates of the reduced basis.

    Of a planar reduction the three that the basis holds: (k, 3).
    """
    motions = list(reduced.directions)
    count = len(motions)
    R = np.zeros((reduced.basis.shape[1], count))
    if not reduced.interfaces:
        R[:count] = np.eye(count)
    for k, interface in enumerate(reduced.interfaces):
        about = np.eye(6)
        about[:3, 3:] = -skew(interface.position - fe.center)
        R[count * k : count * (k + 1)] = about[np.ix_(motions, motions)]
    return R


def elastic_modes(K: FloatArray, M: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and mass-normalised modes that are mass-orthogonal to R.

    Parameters
    ----------
    K, M : (k, k) float
        Reduced matrices; K R = 0.
    R : (k, 6) float
        Rigid motions, fewer in a plane.
    """
    scale = 1.0 / np.sqrt(np.diag(M))
    L = cholesky(scale[:, None] * M * scale, lower=True)
    rigid = L.T @ (R / scale[:, None])
    rest = qr(rigid)[0][:, R.shape[1] :]
    half = solve_triangular(L, rest, lower=True, trans="T") * scale[:, None]
    A = half.T @ K @ half
    omega2, W = eigh(0.5 * (A + A.T))
    return omega2, half @ W
