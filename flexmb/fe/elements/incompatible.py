"""The hexahedron with eight nodes and incompatible modes, QM6.

In: node coordinates (ne, 8, 3) [m] in VTK order, a section. Out: as :class:`Solid`. To the
trilinear displacements come three bubbles 1 - r^2, 1 - s^2, 1 - t^2 (r, s, t from -1 to 1) in each
direction, which bend the element without shear; they are condensed out element by element. Their
gradients use the Jacobian at the centre, scaled by det J_0 / det J, so that the work of a constant
stress on them vanishes and distorted elements pass the patch test. Source: Taylor, Beresford,
Wilson, A non-conforming element for stress analysis, Int. J. Num. Meth. Eng. 10, 1976.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexmb.fe.elements import elastic
from flexmb.fe.elements.isoparametric import gradients, inverse_jacobians, strain_rows
from flexmb.fe.elements.reference import Points, Rule
from flexmb.fe.elements.solid import Solid
from flexmb.fe.sections.solid import SolidSection
from flexmb.flexbody.arrays import FloatArray

__all__ = ["Incompatible"]

_NODES = 24  # degrees of freedom of the nodes; the modes follow


@dataclass(frozen=True, eq=False)
class Incompatible(Solid):
    """Solid with three condensed bubbles in each direction; parameters as :class:`Solid`."""

    @cached_property
    def center(self) -> Points:
        """Shape functions at the centre."""
        return self.reference.at(Rule(np.full((1, 3), 0.5), np.ones(1)))

    def stiffness(self, x: FloatArray, section: SolidSection) -> FloatArray:
        """(ne, 24, 24) stiffness [N/m]."""
        K, modes = self._condensed(x, section)
        condensed = K[:, :_NODES, :_NODES] + K[:, :_NODES, _NODES:] @ modes
        return 0.5 * (condensed + condensed.transpose(0, 2, 1))

    def _condensed(self, x: FloatArray, section: SolidSection) -> tuple[FloatArray, FloatArray]:
        """Stiffness with the modes (ne, 33, 33), and the modes' displacements (ne, 9, 24)."""
        G, dx = self._gradients(x, self.points)
        K = elastic.stiffness(G, dx, section)
        return K, -np.linalg.solve(K[:, _NODES:, _NODES:], K[:, _NODES:, :_NODES])

    def _strains(self, x: FloatArray, section: SolidSection, points: Points) -> FloatArray:
        B = strain_rows(self._gradients(x, points)[0])
        _, modes = self._condensed(x, section)
        return B[..., :_NODES] + np.matmul(B[..., _NODES:], modes[:, None])

    def _slopes(
        self, x: FloatArray, section: SolidSection, u: FloatArray, points: Points
    ) -> FloatArray:
        _, modes = self._condensed(x, section)
        whole = np.concatenate([u[..., None], modes @ u[..., None]], axis=1)
        return np.matmul(self._gradients(x, points)[0], whole.reshape(len(x), -1, 3))

    def _gradients(self, x: FloatArray, points: Points) -> tuple[FloatArray, FloatArray]:
        """Gradients of the shape functions, then of the bubbles (nq, ne, 3, 11); volumes."""
        G, dx = gradients(x, points)
        frame, det = inverse_jacobians(x, self.center)
        slopes = np.zeros((len(dx), 1, 3, 3))  # of the bubbles along r, s, t: [q, 1, along, bubble]
        slopes[:, 0, range(3), range(3)] = 1 - 2 * points.rule.X
        scale = np.abs(det) * points.rule.w[:, None] / dx
        return np.concatenate([G, scale[:, :, None, None] * (frame @ slopes)], axis=3), dx
