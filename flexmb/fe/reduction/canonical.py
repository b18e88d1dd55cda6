"""Making modes unique: their signs, and their directions where frequencies coincide.

In: modes and their products with fixed polynomial displacement fields. Out: the rotation that
makes each mode, within its cluster of equal frequencies, the one with the largest product with a
fixed field, and that product positive. So symmetric bodies give the same modes in every run and
unit system.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import qr

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.flexbody.arrays import FloatArray

__all__ = ["canonical_rotation", "polynomial_fields"]

_SAME = 1e-6  # relative gap of omega^2 below which the directions of modes are arbitrary
_DEGREE = 3


def polynomial_fields(fe: FEMatrices) -> FloatArray:
    """(n, f) displacement fields e_c times monomials of the position, with falling weights.

    The weights settle which of two fields counts when a symmetric mode shape likes both.
    """
    table, nodes = fe.numbering.table, fe.numbering.nodes
    s = fe.mesh.points[nodes] - fe.center
    s = s / np.abs(s).max()
    monomials = [
        np.prod(s[:, powers], axis=1)
        for degree in range(1, _DEGREE + 1)
        for powers in combinations_with_replacement(range(3), degree)
    ]
    fields = np.zeros((fe.numbering.n_all, 3 * len(monomials)))
    for k, monomial in enumerate(monomials):
        for c in range(3):
            column = 3 * k + c
            fields[table[nodes, c], column] = monomial / (1 + 0.05 * column)
    return fields[: fe.numbering.n]


def canonical_rotation(omega2: FloatArray, products: FloatArray) -> FloatArray:
    """(k, k) orthogonal matrix Q such that the modes V Q are unique.

    Parameters
    ----------
    omega2 : (k,) float
        Squared frequencies, ascending.
    products : (f, k) float
        Mass products of the polynomial fields with the modes.
    """
    k = len(omega2)
    rotation = np.zeros((k, k))
    gaps = np.diff(omega2) > _SAME * omega2[1:]
    for cluster in np.split(np.arange(k), np.flatnonzero(gaps) + 1):
        if not len(cluster):
            continue
        Q, R, _ = qr(products[:, cluster].T, pivoting=True)
        signs = np.where(np.diag(R) < 0, -1.0, 1.0)
        rotation[np.ix_(cluster, cluster)] = Q * signs
    return rotation
