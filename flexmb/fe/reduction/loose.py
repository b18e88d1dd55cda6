"""Naming what can move although it should be held.

In: a stiffness matrix that cannot be factorised. Out: a sentence with the nodes that move in its
null space and their place. The null vector is found by inverse iteration on K with a little of its
diagonal added, so that no eigenvalues need to be computed.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from flexmb.errors import ReductionError
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.reduction.eigen import start_vector
from flexmb.fe.solver.linear_solver import factor
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["loose_part", "moving_nodes"]

_SHIFT = 1e-9  # of the diagonal: far above rounding, far below the softest deformation
_MOVES = 0.05  # of the largest motion: nodes below that are held
_SHOWN = 5


def loose_part(fe: FEMatrices, K: csr_array, dofs: IntArray, error: ReductionError) -> str:
    """What moves freely in the part of the model with these degrees of freedom.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    K : (k, k) sparse
        The singular stiffness over ``dofs`` (k,).
    error : ReductionError
        What the factorisation said.
    """
    diagonal = K.diagonal()
    floor = _SHIFT * np.maximum(diagonal, diagonal.max(initial=0.0) * _SHIFT)
    try:
        shifted = factor(csr_array(K + diags_array(floor)))
    except ReductionError:
        return str(error)
    u = start_vector(len(dofs))
    for _ in range(3):
        u = shifted.solve(u / np.abs(u).max())
    whole = np.zeros((fe.numbering.n, 1))
    whole[dofs, 0] = u
    where = moving_nodes(fe, whole)
    return f"with all interfaces held, a part of the mesh still moves freely: {where}"


def moving_nodes(fe: FEMatrices, u: FloatArray) -> str:
    """The nodes that move in a field (n, 1): how many, the first few, and where."""
    table = fe.numbering.table
    nodes = fe.numbering.nodes
    padded = np.append(u[:, 0], 0.0)
    numbers = np.where((table[nodes] >= 0) & (table[nodes] < fe.numbering.n), table[nodes], -1)
    extent = max(float(np.ptp(fe.mesh.points[nodes], axis=0).max()), 1e-300)
    size = np.abs(padded[numbers]) * ([1.0] * 3 + [extent] * 3)
    amount = size.max(axis=1)
    moving = nodes[amount > _MOVES * amount.max()]
    shown = ", ".join(str(node) for node in moving[:_SHOWN])
    more = ", ..." if len(moving) > _SHOWN else ""
    place = ", ".join(f"{value:.4g}" for value in fe.mesh.points[moving].mean(axis=0))
    many = f"{len(moving)} of {len(nodes)} nodes" if len(moving) > 1 else "one node"
    return (
        f"{many} ({shown}{more}) around ({place}) m; they are joined to the rest by too few nodes, "
        "or by a hinge"
    )
