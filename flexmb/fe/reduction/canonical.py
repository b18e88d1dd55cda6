"""Making modes unique: their signs, and their directions where frequencies coincide.

In: modes and their products with fixed displacement fields. Out: the rotation that makes each mode,
within its cluster of equal frequencies, the one with the largest product with a fixed field, and
that product positive. The fields are functions of position alone, so symmetric bodies give the same
modes in every run, on every machine, in every unit system and for any order of the nodes.
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
_WAVES = np.array(  # wave vectors without symmetry, for modes that no polynomial tells apart
    [[1.7, 2.3, 3.1], [4.3, -2.9, 1.3], [-2.1, 5.3, 3.7], [7.1, 3.3, -4.7]]
)
_FAINT = 0.01  # weight of the waves against the polynomials


def polynomial_fields(fe: FEMatrices) -> FloatArray:
    """(n, f) fields of the position: each motion times monomials, and times waves.

    Falling weights settle which of two fields counts when a symmetric mode shape likes both.
    Rotations count as displacements at the distance of the body's size.
    """
    table, nodes = fe.numbering.table, fe.numbering.nodes
    s = fe.mesh.points[nodes] - fe.center
    size = np.abs(s).max()
    shapes = _shapes(s / size)
    motions = range(6 if len(fe.numbering.rotating) else 3)
    fields = np.zeros((fe.numbering.n_all, len(motions) * len(shapes)))
    for k, shape in enumerate(shapes):
        for c in motions:
            column = len(motions) * k + c
            there = table[nodes, c] >= 0
            scale = 1.0 if c < 3 else 1.0 / size
            fields[table[nodes[there], c], column] = scale * shape[there] / (1 + 0.05 * column)
    return fields[: fe.numbering.n]


def _shapes(s: FloatArray) -> list[FloatArray]:
    """Monomials of the position (k, 3), of degree one first, then waves."""
    monomials = [
        np.prod(s[:, powers], axis=1)
        for degree in range(1, _DEGREE + 1)
        for powers in combinations_with_replacement(range(3), degree)
    ]
    return monomials + [_FAINT * np.cos(s @ wave + k) for k, wave in enumerate(_WAVES)]


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
