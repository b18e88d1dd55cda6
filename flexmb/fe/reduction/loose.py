"""Naming what can move although it should be held.

In: a model and the degrees of freedom that move in a motion without stiffness. Out: a sentence with
their nodes and where they are.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["loose_part", "moving_nodes"]

_MOVES = 0.05  # of the largest motion: nodes below that are held
_SHOWN = 5


def loose_part(fe: FEMatrices, dofs: IntArray) -> str:
    """What moves freely with these degrees of freedom: how many nodes, the first few, and where."""
    nodes = fe.numbering.nodes
    moving = nodes[np.isin(fe.numbering.table[nodes], dofs).any(axis=1)]
    told = _told(fe, moving)
    return f"with all interfaces held, a part of the mesh still moves freely: {told}"


def moving_nodes(fe: FEMatrices, u: FloatArray) -> str:
    """The nodes that move in a field (n, 1): how many, the first few, and where."""
    table = fe.numbering.table
    nodes = fe.numbering.nodes
    padded = np.append(u[:, 0], 0.0)
    numbers = np.where((table[nodes] >= 0) & (table[nodes] < fe.numbering.n), table[nodes], -1)
    extent = max(float(np.ptp(fe.mesh.points[nodes], axis=0).max()), 1e-300)
    size = np.abs(padded[numbers]) * ([1.0] * 3 + [extent] * 3)
    amount = size.max(axis=1)
    return _told(fe, nodes[amount > _MOVES * amount.max()])


def _told(fe: FEMatrices, moving: IntArray) -> str:
    shown = ", ".join(str(node) for node in moving[:_SHOWN])
    more = ", ..." if len(moving) > _SHOWN else ""
    place = ", ".join(f"{value:.4g}" for value in fe.mesh.points[moving].mean(axis=0))
    many = f"{len(moving)} of {len(fe.numbering.nodes)} nodes"
    return (
        f"{many if len(moving) > 1 else 'one node'} ({shown}{more}) around ({place}) m; they are "
        "joined to the rest by too few nodes, or by a hinge"
    )
