"""Weighted interfaces: a point that follows the mean motion of nodes and stiffens nothing (RBE3).

In: nodes, their weights and the reference point. Out: :class:`WeightedInterface` with q = W u, W =
(G^T w G)^-1 G^T w: the rigid motion nearest to that of the nodes; G is how nodes follow a rigid
motion. Loads at the point spread over the nodes by W^T. Displacements alone count; where they
cannot tell all rotations (nodes on a line) the nodes' own rotations count too, with the square of
the group's radius of gyration as their weight. Source: MSC Nastran, Linear Static Analysis User's
Guide, RBE3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.assembly.rigid_links import rigid_rows, spread
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["WeightedInterface", "weighted_rows"]


@dataclass(frozen=True, eq=False)
class WeightedInterface:
    """A point that moves as the weighted mean of nodes.

    Parameters
    ----------
    name : str
        Name of the marker.
    position : (3,) float
        Reference point, body frame [m].
    nodes : (k,) int
        The nodes.
    dofs : (s,) int
        Those of their degrees of freedom that count.
    W : (6, s) float
        Displacement and rotation of the point per unit of each.
    """

    name: str
    position: FloatArray
    nodes: IntArray
    dofs: IntArray
    W: FloatArray

    def motion(self, U: FloatArray) -> FloatArray:
        """(6, k) motion of the point in fields U (n, k)."""
        return self.W @ U[self.dofs]

    def loads(self) -> tuple[IntArray, FloatArray]:
        """Degrees of freedom (s,), and loads (s, 6) on them with unit force or moment each."""
        return self.dofs, self.W.T


def weighted_rows(
    numbering: Numbering, nodes: IntArray, arms: FloatArray, weights: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Degrees of freedom (s,) that count, and W (6, s).

    Parameters
    ----------
    numbering : Numbering
        Of the model.
    nodes : (k,) int
        The nodes; they must be able to hold all six motions.
    arms : (k, 3) float
        Their positions from the reference point [m].
    weights : (k,) float
        Positive.
    """
    dofs, G = rigid_rows(numbering, nodes, arms)
    exists = numbering.table[nodes] >= 0
    turning = np.broadcast_to(np.arange(6) >= 3, exists.shape)[exists]
    w = np.broadcast_to(weights[:, None], exists.shape)[exists]
    if spread(arms):
        dofs, G, w = dofs[~turning], G[~turning], w[~turning]
    else:
        middle = weights @ arms / weights.sum()
        gyration = weights @ np.sum((arms - middle) ** 2, axis=1) / weights.sum()
        w = np.where(turning, w * (gyration if gyration > 0 else 1.0), w)
    Q, R = np.linalg.qr(np.sqrt(w)[:, None] * G)
    return dofs, solve_triangular(R, Q.T * np.sqrt(w))
