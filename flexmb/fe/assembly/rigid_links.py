"""Rigid motion of nodes about a point, and the mean motion of nodes: what RBE2 and RBE3 are of.

In: a numbering, nodes and their arms from a point. Out: the rows of a rigid motion over the nodes'
degrees of freedom (RBE2: u = T q), and the weights of the nodes' displacements in the mean motion
of the point (RBE3: q = W u, the least-squares fit of a rigid motion). Source: MSC Nastran
Quick Reference Guide, entries RBE2 and RBE3.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.numbering import Numbering, skew
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["COLLINEAR", "mean_motion", "rigid_rows", "spread"]

COLLINEAR = 1e-6  # smallest over largest extent of nodes that still define a rotation


def spread(points: FloatArray) -> bool:
    """Whether displacements of the points (k, 3) define a rotation: they are on no line."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) >= 3 and bool(extent[1] > COLLINEAR * extent[0])


def rigid_rows(
    numbering: Numbering, nodes: IntArray, arms: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Numbers (s,) of the nodes' degrees of freedom, and their motion (s, 6) per unit motion of
    the point that the arms (k, 3) start from."""
    T = np.zeros((len(nodes), 6, 6))
    T[:] = np.eye(6)
    T[:, :3, 3:] = -skew(arms)
    numbers = numbering.table[nodes]
    exists = numbers >= 0
    return numbers[exists], T[exists]


def mean_motion(arms: FloatArray, weights: FloatArray) -> FloatArray:
    """(6, k, 3) displacement and rotation of the point per unit displacement of each node.

    Parameters
    ----------
    arms : (k, 3) float
        From the point to the nodes [m]; not on a line.
    weights : (k,) float
        Positive.
    """
    G = np.zeros((len(arms), 3, 6))
    G[:, :, :3] = np.eye(3)
    G[:, :, 3:] = -skew(arms)
    weighted = (weights[:, None, None] * G).reshape(-1, 6)
    return np.linalg.solve(weighted.T @ G.reshape(-1, 6), weighted.T).reshape(6, len(arms), 3)
