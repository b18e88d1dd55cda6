"""Isoparametric solids: tetrahedra, hexahedra and wedges with three displacements at each node.

In: node coordinates (ne, k, 3) [m], a :class:`SolidSection`. Out: batches of element matrices in
body axes. All integrals are sums over the kind's integration points; stress is taken at the points
where it is most accurate and extrapolated to the nodes (Barlow, Int. J. Num. Meth. Eng. 10, 1976).
Stiffness of 300 000 degrees of freedom takes 0.2 to 0.7 s in batches of 2 MB of matrices, which
stay in the processor's cache, and 0.4 to 1.7 s in batches of 30 MB; callers that sum a sparse
matrix for each batch gain more by large ones. Source: Zienkiewicz, Taylor, The Finite Element
Method, vol. 1, chapters 4, 8, 14; geometric stiffness: vol. 2, section 11.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexmb.fe.elements import elastic
from flexmb.fe.elements.family import ScalarMass
from flexmb.fe.elements.isoparametric import determinants, gradients, strain_rows
from flexmb.fe.elements.reference import Points, Reference, Rule, extrapolation
from flexmb.fe.sections.solid import SolidSection
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Solid"]

_FLAT = 1e-12  # least det J over the cube of the element's size


@dataclass(frozen=True, eq=False)
class Solid:
    """A family of solids.

    Parameters
    ----------
    kind : str
        Name of the cells in a mesh.
    about : str
        A sentence for the list of elements.
    reference : Reference
        Shape functions, nodes in VTK order.
    rule, mass_rule, stress_rule : Rule
        Integration of stiffness and of mass, points of accurate stress. The mass rule has no
        negative weight, so that the mass matrix is positive definite however curved the element.
    faces : tuple of tuple of int
        Outer faces, outward for right-handed elements: corners, mid-sides, middle.
    edges : tuple of (int, int)
        Corners of the edges.
    warning : str
        What to tell whoever uses it.
    """

    kind: str
    about: str
    reference: Reference
    rule: Rule
    mass_rule: Rule
    stress_rule: Rule
    faces: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]
    warning: str = ""

    dimension = 3
    rotations = False

    @cached_property
    def points(self) -> Points:
        """Shape functions where stiffness is integrated."""
        return self.reference.at(self.rule)

    @cached_property
    def mass_points(self) -> Points:
        """Shape functions where mass is integrated."""
        return self.reference.at(self.mass_rule)

    @cached_property
    def stress_points(self) -> Points:
        """Shape functions where stress is taken."""
        return self.reference.at(self.stress_rule)

    @cached_property
    def node_points(self) -> Points:
        """Shape functions at the nodes."""
        return self.reference.at_nodes()

    def measure(self, x: FloatArray, section: SolidSection | None = None) -> FloatArray:
        """(ne,) volume [m^3]."""
        return np.abs(self.mass_points.rule.w @ determinants(x, self.mass_points))

    def defects(self, x: FloatArray) -> IntArray:
        """Elements that are flat or folded: det J vanishes or changes its sign.

        Looked at are the integration points and the corners. Either handedness of the numbering is
        right if an element keeps to it.
        """
        corners = self.reference.at(
            Rule(self.reference.nodes[: self.reference.corners], np.zeros(self.reference.corners))
        )
        det = np.vstack([determinants(x, p) for p in (self.mass_points, corners)])
        size = np.ptp(x, axis=1).max(axis=1) ** 3
        hand = np.sign(self.mass_points.rule.w @ det[: len(self.mass_points.rule.w)])
        return np.flatnonzero((hand * det).min(axis=0) <= _FLAT * size)

    def stiffness(self, x: FloatArray, section: SolidSection) -> FloatArray:
        """(ne, 3k, 3k) stiffness [N/m]."""
        return elastic.stiffness(*gradients(x, self.points), section)

    def mass(self, x: FloatArray, section: SolidSection) -> ScalarMass:
        """Consistent mass [kg]."""
        N, k = self.mass_points.N, len(self.reference.nodes)
        upper, right = np.triu_indices(k)
        dx = self.mass_points.rule.w[:, None] * np.abs(determinants(x, self.mass_points))
        products = section.material.density * (dx.T @ (N[:, upper] * N[:, right]))
        M = np.empty((len(x), k, k))
        M[:, upper, right] = M[:, right, upper] = products
        return ScalarMass(M)

    def geometric_stiffness(
        self, x: FloatArray, section: SolidSection, u: FloatArray
    ) -> FloatArray:
        """(ne, 3k, 3k) int sigma_ab dN_i/dx_a dN_j/dx_b in each direction [N/m].

        sigma is the stress that the displacements u (ne, 3k) [m] cause.
        """
        G, dx = gradients(x, self.points)
        nq, ne, _, k = G.shape
        stress = elastic.stress_along(self._slopes(x, section, u, self.points), section)
        weighted = np.matmul(stress * dx[:, :, None, None], G)
        left, right = (A.transpose(1, 0, 2, 3).reshape(ne, 3 * nq, k) for A in (weighted, G))
        scalar = np.matmul(left.transpose(0, 2, 1), right)
        scalar = 0.5 * (scalar + scalar.transpose(0, 2, 1))
        K = np.zeros((ne, k, 3, k, 3))
        for c in range(3):
            K[:, :, c, :, c] = scalar
        return K.reshape(ne, 3 * k, 3 * k)

    def stress_layers(self, section: SolidSection) -> tuple[str, ...]:
        """One layer: the solid."""
        return ("solid",)

    def stress(self, x: FloatArray, section: SolidSection) -> FloatArray:
        """(ne, k, 1, 6, 3k) stress at the nodes per displacement [Pa/m]."""
        B = self._strains(x, section, self.stress_points)
        ne, points, _, d = B.shape
        to_nodes = extrapolation(self.reference.nodes, self.stress_rule.X)
        at_points = np.matmul(section.stiffness(), B).reshape(ne, points, 6 * d)
        return np.matmul(to_nodes, at_points).reshape(ne, -1, 1, 6, d)

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, k, 3, 3k) half the curl of the displacement at the nodes [1/m]."""
        G, _ = gradients(x, self.node_points)
        k, ne, _, _ = G.shape
        R = np.zeros((ne, k, 3, k, 3))
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            R[:, :, a, :, c] = 0.5 * G[:, :, b].transpose(1, 0, 2)
            R[:, :, a, :, b] = -0.5 * G[:, :, c].transpose(1, 0, 2)
        return R.reshape(ne, k, 3, 3 * k)

    def _strains(self, x: FloatArray, section: SolidSection, points: Points) -> FloatArray:
        """(ne, nq, 6, 3k) strains at points per displacement [1/m]."""
        return strain_rows(gradients(x, points)[0])

    def _slopes(
        self, x: FloatArray, section: SolidSection, u: FloatArray, points: Points
    ) -> FloatArray:
        """(nq, ne, 3, 3) displacement gradient du_c/dx_a, [q, e, a, c]."""
        return np.matmul(gradients(x, points)[0], u.reshape(len(x), -1, 3))
