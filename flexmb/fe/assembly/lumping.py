"""Lumped mass: each element's mass at its nodes, by scaling the diagonal of the consistent matrix.

In: consistent masses of elements. Out: :class:`NodalInertia`. Each element keeps its mass exactly;
its nodes share it as the diagonal does, which is positive for every family (row sums are not).
Where nodes turn, the mean of the three rotational entries, scaled alike, becomes an isotropic
moment of inertia. So mass is exact; moments of inertia are those of the lumps, which approach the
body's as the mesh is refined but for what the sections of beams and shells have of their own.
Source: Hinton, Rock, Zienkiewicz (1976), A note on mass
lumping, Earthquake Engineering and Structural Dynamics 4.
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.nodal import NodalInertia
from flexmb.fe.elements.family import ComponentMass, ScalarMass
from flexmb.flexbody.arrays import IntArray

__all__ = ["MASS_MATRICES", "LumpedSum"]

MASS_MATRICES = ("consistent", "hrz")
"""Ways to build the mass matrix."""


class LumpedSum:
    """The mass of elements at ``count`` nodes, summed batch by batch."""

    def __init__(self, count: int) -> None:
        self._mass, self._J = np.zeros(count), np.zeros(count)

    def add(self, mass: ScalarMass | ComponentMass, nodes: IntArray) -> None:
        """Add elements with their nodes (ne, k)."""
        if isinstance(mass, ScalarMass):
            entries = np.einsum("eii->ei", mass.M)
            total, turning = mass.M.sum(axis=(1, 2)), None
        else:
            diagonal = np.einsum("ebbii->ei", mass.Mab).reshape(*nodes.shape, 6)
            entries, turning = diagonal[..., :3].mean(axis=2), diagonal[..., 3:].mean(axis=2)
            total = mass.mass
        scale = (total / entries.sum(axis=1))[:, None]
        np.add.at(self._mass, nodes, scale * entries)
        if turning is not None:
            np.add.at(self._J, nodes, scale * turning)

    def total(self) -> NodalInertia:
        """The sum, at the nodes that have any."""
        nodes = np.flatnonzero(self._mass)
        second = 0.5 * self._J[nodes, None, None] * np.eye(3)
        return NodalInertia(nodes, self._mass[nodes], np.zeros((len(nodes), 3)), second)
