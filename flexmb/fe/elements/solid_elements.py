"""Solid elements: tetrahedra, hexahedra and wedges, isoparametric or with incompatible modes.

Element matrices are products A^T A, exactly symmetric. Isotropic: with H_ab = int dN_i/dx_a
dN_j/dx_b the block of directions c, d is lambda H_cd + mu H_dc + mu delta_cd tr H: one small
product for all of B^T C B. Otherwise A is the strain operator times the Cholesky factor of C.
Stiffness of tetrahedra of second order is integrated by 4 points, their mass by 14 (rules of orders
3 and 4 have negative weights, which can spoil the mass); hexahedra of second order 27 points for
both. Stress is taken where it is most accurate, at 2 x 2 x 2 points, 4 points of tetrahedra, 3 x 2
of wedges, and extrapolated to the nodes (Barlow, Int. J. Num. Meth. Eng. 10, 1976). Stiffness of
300 000 degrees of freedom takes 0.2 to 0.7 s in batches of 2 MB, 0.4 to 1.7 s in batches of 30 MB.
Source: Zienkiewicz, Taylor, The Finite Element Method, vol. 1, chapters 4, 8, 14; vol. 2, section
11.4.

The hexahedron with eight nodes is QM6: three bubbles 1 - r^2, 1 - s^2, 1 - t^2 (r, s, t from -1 to
1) in each direction bend it without shear and are condensed element by element. Their gradients use
the Jacobian at the centre, scaled by det J_0 / det J, so that distorted elements pass the patch
test. Source: Taylor, Beresford, Wilson, Int. J. Num. Meth. Eng. 10, 1976.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexmb.fe.elements.element_family import (
    HEX_EDGES,
    TET_EDGES,
    WEDGE_EDGES,
    Points,
    Reference,
    Rule,
    ScalarMass,
    SeparateStresses,
    determinants,
    extrapolation,
    gradients,
    hexahedron,
    hexahedron_rule,
    inverse_jacobians,
    second_order_faces,
    strain_rows,
    tetrahedron,
    tetrahedron_rule,
    wedge15,
    wedge_rule,
)
from flexmb.fe.sections.section_tables import SolidSection
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import Material


def elastic_stiffness(G: FloatArray, dx: FloatArray, section: SolidSection) -> FloatArray:
    """(ne, 3k, 3k) int B^T C B from G (nq, ne, 3, k) [1/m] and dx (nq, ne) [m^3]."""
    if isinstance(section.material, Material):
        return _isotropic(G, dx, section.material)
    nq, ne, _, k = G.shape
    root = np.linalg.cholesky(section.stiffness()).T
    A = np.matmul(root, strain_rows(G)) * np.sqrt(dx.T)[:, :, None, None]
    A = A.reshape(ne, 6 * nq, 3 * k)
    return np.matmul(A.transpose(0, 2, 1), A)


def stress_along(slope: FloatArray, section: SolidSection) -> FloatArray:
    """(..., 3, 3) stress [Pa] from the displacement gradient (..., a, c) = du_c/dx_a."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    strain = [slope[..., a, b] if a == b else slope[..., a, b] + slope[..., b, a] for a, b in pairs]
    components = np.stack(strain, axis=-1) @ section.stiffness()
    stress = np.empty(slope.shape)
    for row, (a, b) in enumerate(pairs):
        stress[..., a, b] = stress[..., b, a] = components[..., row]
    return stress


def _isotropic(G: FloatArray, dx: FloatArray, material: Material) -> FloatArray:
    nq, ne, _, k = G.shape
    A = (G * np.sqrt(dx)[:, :, None, None]).reshape(nq, ne, 3 * k).transpose(1, 2, 0)
    H = np.matmul(A, A.transpose(0, 2, 1)).reshape(ne, 3, k, 3, k)
    mu = material.G
    lam = 2 * mu * material.nu / (1 - 2 * material.nu)
    trace = mu * (H[:, 0, :, 0] + H[:, 1, :, 1] + H[:, 2, :, 2])
    K = np.empty((ne, k, 3, k, 3))
    for c in range(3):
        K[:, :, c, :, c] = (lam + mu) * H[:, c, :, c] + trace
        for d in range(3):
            if c != d:
                K[:, :, c, :, d] = lam * H[:, c, :, d] + mu * H[:, d, :, c]
    return K.reshape(ne, 3 * k, 3 * k)


_FLAT = 1e-12  # least det J over the cube of the element's size; below it an element is flat


@dataclass(frozen=True, eq=False)
class Solid(SeparateStresses):
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
        A warning for its users; empty if none.
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
        """Elements that are flat or folded: det J vanishes or changes its sign within the element.

        It is checked at the integration points and the corners. Either handedness of the node
        numbering is allowed.
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
        return elastic_stiffness(*gradients(x, self.points), section)

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
        self, x: FloatArray, section: SolidSection, u: FloatArray, field: FloatArray | None = None
    ) -> FloatArray:
        """(ne, 3k, 3k) int sigma_ab dN_i/dx_a dN_j/dx_b in each direction [N/m].

        sigma is the stress that the displacements u (ne, 3k) [m] cause.
        """
        G, dx = gradients(x, self.points)
        nq, ne, _, k = G.shape
        stress = stress_along(self._slopes(x, section, u, self.points), section)
        weighted = np.matmul(stress * dx[:, :, None, None], G)
        left, right = (A.transpose(1, 0, 2, 3).reshape(ne, 3 * nq, k) for A in (weighted, G))
        scalar = np.matmul(left.transpose(0, 2, 1), right)
        scalar = 0.5 * (scalar + scalar.transpose(0, 2, 1))
        K = np.zeros((ne, k, 3, k, 3))
        for c in range(3):
            K[:, :, c, :, c] = scalar
        return K.reshape(ne, 3 * k, 3 * k)

    def mean_strains(
        self, x: FloatArray, section: SolidSection, u: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Means over the elements of strains of first and second order of displacements u (ne, 3k,
        s).

        Returns
        -------
        (ne, 6, 3k), (ne, 6, s, s), (6, 6) and (ne,) float
            Rows of strains; symmetric parts u_c,a u_c,b of two displacements; elasticity; volume.
        """
        H = np.stack([self._slopes(x, section, one, self.points) for one in np.moveaxis(u, 2, 0)])
        _, dx = gradients(x, self.points)
        weight = dx / dx.sum(axis=0)
        s, nq, ne = H.shape[:3]
        along = (np.sqrt(weight)[:, :, None, None] * H).transpose(3, 2, 1, 4, 0)
        along = along.reshape(3, ne, nq * 3, s)
        E = np.empty((ne, 6, s, s))
        for row, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))):
            both = np.matmul(along[a].transpose(0, 2, 1), along[b])
            E[:, row] = 0.5 * (both if a == b else both + both.swapaxes(1, 2))
        B = np.einsum("qe,eqid->eid", weight, self._strains(x, section, self.points))
        return B, E, section.stiffness(), dx.sum(axis=0)

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
        K = elastic_stiffness(G, dx, section)
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


_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
_HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_WEDGE_FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2))


TETRA = Solid(
    "tetra",
    "solid: first-order tetrahedron, three displacements a node; far too stiff in bending",
    tetrahedron(1),
    rule=tetrahedron_rule(1),
    mass_rule=tetrahedron_rule(2),
    stress_rule=tetrahedron_rule(1),
    faces=_TET_FACES,
    edges=TET_EDGES,
    warning="first-order tetrahedra are far too stiff in bending and torsion, frequencies 10 % too "
    "high are usual, and their stress is constant in each: mesh with second-order tetrahedra",
)
TETRA10 = Solid(
    "tetra10",
    "solid: second-order tetrahedron, straight or curved, three displacements a node",
    tetrahedron(2),
    rule=tetrahedron_rule(2),
    mass_rule=tetrahedron_rule(5),
    stress_rule=tetrahedron_rule(2),
    faces=second_order_faces(_TET_FACES, TET_EDGES, 4),
    edges=TET_EDGES,
)
HEXAHEDRON = Incompatible(
    "hexahedron",
    "solid: first-order hexahedron with incompatible modes for bending, three displacements a node",
    hexahedron(8),
    rule=hexahedron_rule(3),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=_HEX_FACES,
    edges=HEX_EDGES,
)
HEXAHEDRON20 = Solid(
    "hexahedron20",
    "solid: second-order hexahedron of 20 nodes, straight or curved, three displacements a node",
    hexahedron(20),
    rule=hexahedron_rule(5),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=second_order_faces(_HEX_FACES, HEX_EDGES, 8),
    edges=HEX_EDGES,
)
HEXAHEDRON27 = Solid(
    "hexahedron27",
    "solid: second-order hexahedron of 27 nodes, straight or curved, three displacements a node",
    hexahedron(27),
    rule=hexahedron_rule(5),
    mass_rule=hexahedron_rule(5),
    stress_rule=hexahedron_rule(3),
    faces=tuple(
        (*face, 20 + number)
        for number, face in enumerate(second_order_faces(_HEX_FACES, HEX_EDGES, 8))
    ),
    edges=HEX_EDGES,
)
WEDGE15 = Solid(
    "wedge15",
    "solid: second-order wedge of 15 nodes, straight or curved, three displacements a node",
    wedge15(),
    rule=wedge_rule(2, 5),
    mass_rule=wedge_rule(4, 5),
    stress_rule=wedge_rule(2, 3),
    faces=second_order_faces(_WEDGE_FACES, WEDGE_EDGES, 6),
    edges=WEDGE_EDGES,
)

SOLIDS: dict[str, Solid] = {
    family.kind: family
    for family in (TETRA, TETRA10, HEXAHEDRON, HEXAHEDRON20, HEXAHEDRON27, WEDGE15)
}
"""Solid elements by their names in meshes."""

_PYRAMID = "pyramids cannot be used: mesh with tetrahedra, or with hexahedra alone"
_LESS = 'mesh without nodes inside faces (gmsh: "Mesh.SecondOrderIncomplete = 1")'
_HIGHER = "elements above second order cannot be used: mesh with second-order elements"

SOLID_ADVICE = {
    "wedge": "first-order wedges are far too stiff: mesh with second-order elements",
    "wedge12": "wedges have 15 nodes: mesh with second-order elements along the wedge too",
    "wedge18": f"wedges have 15 nodes: {_LESS}",
    "pyramid": _PYRAMID,
    "pyramid13": _PYRAMID,
    "pyramid14": _PYRAMID,
    "hexahedron24": "hexahedra have 8, 20 or 27 nodes",
    "tetra14": _HIGHER,
    "tetra20": _HIGHER,
    "wedge40": _HIGHER,
    "hexahedron64": _HIGHER,
}
"""What to do about solids that cannot be used."""
