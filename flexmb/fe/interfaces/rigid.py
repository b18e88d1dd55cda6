"""Rigid interfaces: nodes that move as one rigid body with a reference point (RBE2).

In: the nodes and the reference point. Out: :class:`RigidInterface` with u_slave = T q, q the
displacement and rotation of the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["RigidInterface"]


@dataclass(frozen=True, eq=False)
class RigidInterface:
    """Nodes that move as one rigid body with a reference point.

    Parameters
    ----------
    name : str
        Name of the marker.
    position : (3,) float
        Reference point, body frame [m].
    nodes : (k,) int
        The nodes.
    dofs : (s,) int
        Their degrees of freedom.
    T : (s, 6) float
        Motion of these per displacement and rotation of the reference point.
    """

    name: str
    position: FloatArray
    nodes: IntArray
    dofs: IntArray
    T: FloatArray

    def motion(self, U: FloatArray) -> FloatArray:
        """(6, k) motion of the point in fields U (n, k) in which the nodes move rigidly."""
        return np.linalg.lstsq(self.T, U[self.dofs], rcond=None)[0]

    def loads(self) -> tuple[IntArray, FloatArray]:
        """Degrees of freedom (s,), and loads (s, 6) on them with unit force or moment each."""
        return self.dofs, np.linalg.pinv(self.T).T
