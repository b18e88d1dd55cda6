"""Naming what can move although it should be held.

In: a model, and degrees of freedom or a field that moves without stiffness. Out: a sentence with
the nodes that move and their place.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["loose_part", "moving_nodes"]

_MOVES = 0.05  # of the largest motion: nodes below that are held
_SHOWN = 5


def loose_part(fe: FEMatrices, dofs: IntArray) -> str:
    """What to say of degrees of freedom that move freely with all interfaces held."""
    u = np.zeros((fe.numbering.n, 1))
    u[dofs] = 1.0
    where = moving_nodes(fe, u)
    return f"with all interfaces held, a part of the mesh still moves freely: {where}"


def moving_nodes(fe: FEMatrices, u: FloatArray) -> str:
    """The nodes that move in a field (n, 1): how many, the first few, and where."""
    nodes = fe.numbering.nodes
    padded = np.append(fe.expand(u[:, 0]), 0.0)  # -1 in the table is the zero at the end
    extent = float(np.ptp(fe.mesh.points[nodes], axis=0).max())
    size = np.abs(padded[fe.numbering.table[nodes]]) * ([1.0] * 3 + [extent] * 3)
    amount = size.max(axis=1)
    moving = nodes[amount > _MOVES * amount.max()]
    shown = ", ".join(str(node) for node in moving[:_SHOWN])
    more = ", ..." if len(moving) > _SHOWN else ""
    low, high = fe.mesh.points[moving].min(axis=0), fe.mesh.points[moving].max(axis=0)
    many = f"{len(moving)} of {len(nodes)} nodes" if len(moving) > 1 else "one node"
    return (
        f"{many} ({shown}{more}) between {_place(low)} and {_place(high)} m; they are joined to "
        "the rest by too few nodes, or by a hinge"
    )


def _place(point: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"
