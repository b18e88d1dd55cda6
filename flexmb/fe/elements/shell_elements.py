"""Flat shells with three or four corners: plates in bending, membranes, both.

Membrane and bending share the quadratic interpolation of :mod:`flexmb.fe.elements.shell_fields` and
may be coupled; transverse shear is interpolated from the edges; a penalty ties nodal rotations
about the normal to the rotation of the mid-surface. Mass: a point at height z above the mid-surface
moves by u + z beta, and all integrals over area and thickness are exact. Nodal rotations about the
normal in excess of that of the mid-surface move the mid-sides around the element: without that they
would have no mass if all are equal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.fe.elements.element_family import ComponentMass, StressStiffness
from flexmb.fe.elements.shell_fields import (
    EDGES,
    Fields,
    ShellPoints,
    degenerate_elements,
    extrapolation,
    make_fields,
    make_points,
    shell_functions,
)
from flexmb.fe.sections.shell_section import ShellSection
from flexmb.flexbody.arrays import FloatArray, IntArray, rotation_stiffness

DRILLING = 0.3
"""Drilling stiffness as a share of the in-plane shear stiffness; results are alike from 1e-6 to 1.
"""


def _stiffness_product(rows: FloatArray, elasticity: FloatArray, weight: FloatArray) -> FloatArray:
    """(ne, d, d) sum over the points of weight rows^T elasticity rows."""
    ne, _, _, d = rows.shape
    forces = np.matmul(elasticity, rows) * weight[..., None, None]
    return np.matmul(rows.reshape(ne, -1, d).transpose(0, 2, 1), forces.reshape(ne, -1, d))


def _internal_forces(
    rows: FloatArray, elasticity: FloatArray, weight: FloatArray, u: FloatArray
) -> FloatArray:
    """(ne, d) nodal forces by displacements u with the stiffness of :func:`_stiffness_product`."""
    forces = np.einsum("eqid,ed->eqi", rows, u) @ elasticity.T
    return np.einsum("eqid,eqi->ed", rows, forces * weight[..., None])


def _stress_axes(axes: FloatArray) -> FloatArray:
    """(ne, 6, 3) stress in body axes per stress 11, 22, 12 in element axes."""
    a, b = [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]
    e1, e2 = axes[:, :, 0], axes[:, :, 1]
    mixed = e1[:, a] * e2[:, b] + e2[:, a] * e1[:, b]
    return np.stack([e1[:, a] * e1[:, b], e2[:, a] * e2[:, b], mixed], axis=2)


def _mass_motion(fields: Fields) -> FloatArray:
    """(ne, 2n, 3, d) displacement of the nodes, then rotation of the normal, along body axes."""
    ne, n, _, d = fields.nodal.shape
    k = n // 2
    local = np.zeros((ne, 2 * n, 3, d))
    local[:, :n] = fields.nodal[:, :, :3]
    swirl = (fields.length / 8)[..., None] * fields.drill[:, None]
    local[:, k:n, 0] += fields.tangent[..., :1] * swirl
    local[:, k:n, 1] += fields.tangent[..., 1:] * swirl
    local[:, n:, :2] = fields.nodal[:, :, 3:]
    return np.matmul(fields.flat.axes[:, None], local)


def _mass_weights(points: ShellPoints, section: ShellSection) -> FloatArray:
    """(ne, 2n, 4) positions of the nodes, followed by 1, and directions of the normal, followed by
    0."""
    ne, n = len(points.area), points.values.shape[1]
    products = (points.values[:, :, None] * points.values[:, None]).reshape(-1, n * n)
    area = (points.area @ products).reshape(ne, n, n)
    area = 0.5 * (area + area.transpose(0, 2, 1))
    m0, m1, m2 = section.laminate.mass
    upper = np.concatenate([m0 * area, m1 * area], axis=2)
    return np.concatenate([upper, np.concatenate([m1 * area, m2 * area], axis=2)], axis=1)


def _mass_position(kind: str, fields: Fields, offset: float) -> FloatArray:
    """(ne, 2n, 4) place of the nodes and direction of the normal, each with 1 and 0 behind."""
    flat = fields.flat
    ne, k = flat.height.shape
    corners = np.concatenate([flat.xy, np.full((ne, k, 1), offset)], axis=2)
    places = flat.center[:, None] + np.matmul(corners, flat.axes.transpose(0, 2, 1))
    edges = np.array(EDGES[kind])
    out = np.zeros((ne, 4 * k, 4))
    out[:, :k, :3] = places
    out[:, k : 2 * k, :3] = places[:, edges].mean(axis=2)
    out[:, : 2 * k, 3] = 1.0
    out[:, 2 * k :, :3] = flat.axes[:, None, :, 2]
    return out


SHELL_ADVICE = dict.fromkeys(
    ("triangle6", "quad8", "quad9"),
    "shells have three or four corners and no mid-sides: mesh with first-order elements",
)
"""What to do about surface elements that cannot be used with a shell section."""


@dataclass(frozen=True)
class Shell:
    """Flat shells with k corners as a family."""

    kind: str
    about: str

    dimension = 2
    rotations = True
    warning = ""

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """Corners at the ends of each side."""
        return EDGES[self.kind]

    @property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Corners of the one face."""
        return (tuple(range(len(self.edges))),)

    def measure(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne,) areas [m^2], of the projections on the mean planes."""
        s = x - x[:, :1]
        return 0.5 * np.linalg.norm(np.cross(s, np.roll(s, -1, axis=1)).sum(axis=1), axis=1)

    def defects(self, x: FloatArray) -> IntArray:
        """Elements that are flat, folded or concave."""
        return degenerate_elements(x)

    def stiffness(self, x: FloatArray, section: ShellSection) -> FloatArray:
        """(ne, d, d) stiffness."""
        parts = self._strains(make_fields(self.kind, x, section), section)
        K = sum(_stiffness_product(*part) for part in parts)
        return np.asarray(0.5 * (K + K.transpose(0, 2, 1)))

    def _strains(self, fields: Fields, section: ShellSection) -> list[tuple[FloatArray, ...]]:
        """Rows of strains (ne, nq, r, d), elasticity (r, r) and weights (ne, nq) of each kind."""
        points = make_points(fields.flat, shell_functions(self.kind, "stiffness"))
        hold = DRILLING * section.laminate.ABD[2, 2] * points.area.sum(axis=1)
        parts = [
            (points.strains(fields), section.laminate.ABD, points.area),
            (fields.drill[:, None, None], np.eye(1), hold[:, None]),
        ]
        if section.shear:
            parts.append((points.shear_strains(fields), section.laminate.S, points.area))
        return parts

    def mass(self, x: FloatArray, section: ShellSection) -> ComponentMass:
        """Consistent mass."""
        fields = make_fields(self.kind, x, section)
        points = make_points(fields.flat, shell_functions(self.kind, "mass"))
        ne, n = len(x), points.values.shape[1]
        W = _mass_weights(points, section)
        N = _mass_motion(fields)  # (ne, 2n, 3, d)
        s = _mass_position(self.kind, fields, section.offset)  # (ne, 2n, 4)
        d = N.shape[3]
        flat = N.reshape(ne, 2 * n, 3 * d)
        weighted = np.matmul(W, flat)
        M = np.matmul(flat.transpose(0, 2, 1), weighted)
        M = 0.5 * (M + M.transpose(0, 2, 1))
        moments = np.matmul(s.transpose(0, 2, 1), weighted).reshape(ne, 4, 3, d)
        rigid = np.matmul(s.transpose(0, 2, 1), np.matmul(W, s))
        return ComponentMass(
            M.reshape(ne, 3, d, 3, d).transpose(0, 1, 3, 2, 4),
            moments[:, :3],
            moments[:, 3],
            rigid[:, 3, 3],
            rigid[:, :3, 3],
            0.5 * (rigid[:, :3, :3] + rigid[:, :3, :3].transpose(0, 2, 1)),
        )

    def geometric_stiffness(
        self, x: FloatArray, section: ShellSection, u: FloatArray, field: FloatArray | None = None
    ) -> FloatArray:
        """(ne, d, d) geometric stiffness of the stress that displacements u (ne, d) cause."""
        return self.stress_stiffness(x, section)(u, field)

    def stress_stiffness(self, x: FloatArray, section: ShellSection) -> StressStiffness:
        """Geometric stiffness (ne, d, d) of displacements u (ne, d), and of a ``field``.

        int N_ab u_c,a u_c,b + 2 M_ab u_c,a beta_c,b over the displacements c of the mid-surface,
        with membrane forces N and moments M; along the edges, the forces conjugate to the edge
        shear g times 2 u_c,s beta_c. Normals rotate with their nodes, by rotation vectors; offset
        arms and nodal moments rotate with them.
        """
        fields = make_fields(self.kind, x, section)
        flat, points = fields.flat, make_points(fields.flat, shell_functions(self.kind, "mass"))
        ne, nq = points.area.shape
        rows, parts, per_mass = points.strains(fields), self._strains(fields, section), list[Any]()
        edge_work, H = self._edge_work(fields, section), points.gradients(fields)
        d, pairs, k = H.shape[-1], [[0, 2], [2, 1]], flat.height.shape[1]
        stretched, turned = (
            H[..., part, :].reshape(ne, nq, 2, -1) for part in (slice(3), slice(3, None))
        )
        slopes = stretched.reshape(ne, nq * 6, d).transpose(0, 2, 1)

        def stiffness(u: FloatArray, field: FloatArray | None = None) -> FloatArray:
            strains = np.einsum("eqid,ed->eqi", rows, u)
            N, M = np.split((strains @ section.laminate.ABD.T) * points.area[..., None], 2, axis=2)
            forces = sum(_internal_forces(*part, u) for part in parts)
            forces = forces.reshape(ne, -1, 2, 3) @ flat.axes[:, None]  # element axes
            work = np.matmul(N[..., pairs], stretched).reshape(ne, nq, 2, 3, d)
            work[..., :2, :] += 2 * np.matmul(M[..., pairs], turned).reshape(ne, nq, 2, 2, d)
            K = np.matmul(slopes, work.reshape(ne, nq * 6, d)) + edge_work(u)
            K = 0.5 * (K + K.transpose(0, 2, 1))
            if field is not None:
                if not per_mass:
                    per_mass.append(self._load_per_mass(fields, section))
                forces = forces - (per_mass[0] @ field.ravel()).reshape(ne, -1, 2, 3)
            moments = np.zeros((ne, k, 3, 3))  # n x (moment x n + arm n.f) at each node
            moments[:, :, 2, 0], moments[:, :, 2, 1] = forces[:, :, 1, 1], -forces[:, :, 1, 0]
            moments[:, :, 2, 2] = (section.offset - flat.height) * forces[:, :, 0, 2]
            axes, nodes = flat.axes[:, None], np.arange(k)
            turns = axes @ rotation_stiffness(moments) @ axes.transpose(0, 1, 3, 2)
            K.reshape(ne, k, 2, 3, k, 2, 3)[:, nodes, 1, :, nodes, 1] += turns.swapaxes(0, 1)
            return np.asarray(K)

        return stiffness

    def _edge_work(
        self, fields: Fields, section: ShellSection
    ) -> Callable[[FloatArray], FloatArray]:
        """Of displacements u (ne, d) the (ne, d, d) forces conjugate to g of each edge, times the
        mean of 2 u_c,s beta_c over the edge.

        These forces are the shear force and the moments of the bow of the edge. Neighbours share an
        edge, so that large parts of both cancel, which they would not inside the elements.
        """
        points = make_points(fields.flat, shell_functions(self.kind, "stiffness"))
        k, nodal, d = fields.length.shape[1], fields.nodal, fields.nodal.shape[-1]
        ABD, sides = section.laminate.ABD[3:], points.slopes[..., k:]
        M = np.matmul(ABD, points.strains(fields) * points.area[..., None, None])
        M = M[..., [[0, 2], [2, 1]], :]
        g = np.einsum("eqabd,eqbk,eka->ekd", M, sides, fields.tangent, optimize=True)
        g *= fields.bow[..., None]
        if section.shear:
            Q = np.matmul(section.laminate.S, points.shear_strains(fields))
            share = (1 + fields.bow / 1.5) * fields.length
            g += share[..., None] * np.einsum("eq,eqad,eqak->ekd", points.area, Q, points.edge)
        start, end = (list(nodes) for nodes in zip(*EDGES[self.kind], strict=True))
        along = (nodal[:, end, :2] - nodal[:, start, :2]) / fields.length[..., None, None]
        beta = (nodal[:, start, 3:] + 4 * nodal[:, k:, 3:] + nodal[:, end, 3:]) / 6
        along, beta = 2 * along.reshape(-1, k, 2, d), beta.reshape(-1, 2 * k, d)

        def work(u: FloatArray) -> FloatArray:
            left = np.einsum("ekd,ed->ek", g, u)[..., None, None] * along
            return np.matmul(left.reshape(len(u), 2 * k, d).transpose(0, 2, 1), beta)

        return work

    def _load_per_mass(self, fields: Fields, section: ShellSection) -> FloatArray:
        """(ne, d, 12) forces and moments at the nodes, element axes, of a force per mass (3, 4)."""
        points = make_points(fields.flat, shell_functions(self.kind, "mass"))
        s = _mass_position(self.kind, fields, section.offset)
        load, N = np.matmul(_mass_weights(points, section), s), _mass_motion(fields)
        (ne, n, _, d), k = N.shape, fields.flat.height.shape[1]
        f = np.matmul(load.transpose(0, 2, 1), N.reshape(ne, n, 3 * d)).reshape(ne, 4, 3, k, 2, 3)
        f = f.transpose(0, 3, 4, 5, 2, 1).reshape(ne, k * 2, 3, 12)
        return np.matmul(fields.flat.axes.transpose(0, 2, 1)[:, None], f).reshape(ne, d, 12)

    def mean_strains(
        self, x: FloatArray, section: ShellSection, u: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Means over the elements of strains of first and second order of displacements u (ne, d,
        k).

        Returns
        -------
        (ne, 6, d), (ne, 6, k, k), (6, 6) and (ne,) float
            Rows of strains; symmetric parts u_c,a u_c,b of two displacements, for membrane strains;
            elasticity; area.
        """
        fields = make_fields(self.kind, x, section)
        points = make_points(fields.flat, shell_functions(self.kind, "stiffness"))
        slopes = points.gradients(fields)[..., :3, :]
        (ne, nq), k = slopes.shape[:2], u.shape[2]
        H = np.matmul(slopes.reshape(ne, nq * 6, -1), u).reshape(ne, nq, 2, 3, k)
        weight = points.area / points.area.sum(axis=1, keepdims=True)
        along = (np.sqrt(weight)[:, :, None, None, None] * H).transpose(2, 0, 1, 3, 4)
        along = along.reshape(2, ne, nq * 3, k)
        E = np.zeros((ne, 6, k, k))
        for row, (a, b) in enumerate(((0, 0), (1, 1), (0, 1))):
            both = np.matmul(along[a].transpose(0, 2, 1), along[b])
            E[:, row] = 0.5 * (both if a == b else both + both.swapaxes(1, 2))
        B = np.einsum("eq,eqid->eid", weight, points.strains(fields))
        return B, E, section.laminate.ABD, points.area.sum(axis=1)

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """The outer faces; the element normal points from bottom to top."""
        return ("bottom", "top")

    def stress(self, x: FloatArray, section: ShellSection) -> FloatArray:
        """(ne, k, 2, 6, d) stress at the corners of the bottom and of the top face, body axes.

        Strains are taken at the points of the quadrature of order 2, where they are most accurate,
        and extrapolated to the corners. Transverse shear stress vanishes on the faces.
        """
        fields = make_fields(self.kind, x, section)
        points = make_points(fields.flat, shell_functions(self.kind, "sampling"))
        at_corners = self._at_corners(points.strains(fields))
        ne, _, _, d = at_corners.shape
        laminate = section.laminate
        faces = np.stack(
            [np.hstack([C, z * C]) for C, z in zip(laminate.outer, laminate.z, strict=True)]
        )
        to_body = np.matmul(_stress_axes(fields.flat.axes)[:, None], faces)  # (ne, 2, 6, 6)
        stress = np.matmul(to_body.reshape(ne, 1, 12, 6), at_corners)
        return stress.reshape(ne, -1, 2, 6, d)

    def resultants(self, x: FloatArray, section: ShellSection) -> tuple[FloatArray, FloatArray]:
        """Membrane forces and moments at the corners (ne, k, 6, d), and their axes (ne, 3, 3)."""
        fields = make_fields(self.kind, x, section)
        points = make_points(fields.flat, shell_functions(self.kind, "sampling"))
        strains = self._at_corners(points.strains(fields))
        return np.matmul(section.laminate.ABD, strains), fields.flat.axes

    def _at_corners(self, values: FloatArray) -> FloatArray:
        """(ne, k, r, d) at the corners from (ne, nq, r, d) at the sampling points."""
        ne, nq, r, d = values.shape
        return np.matmul(extrapolation(self.kind), values.reshape(ne, nq, -1)).reshape(ne, -1, r, d)

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, k, 3, d) the nodes' own rotations."""
        ne, k, _ = x.shape
        out = np.zeros((k, 3, k, 6))
        for node in range(k):
            out[node, :, node, 3:] = np.eye(3)
        return np.broadcast_to(out.reshape(k, 3, 6 * k), (ne, k, 3, 6 * k))


QUAD = Shell(
    "quad",
    "shell: flat quadrilateral, four nodes with six motions each, thin or thick, layered "
    "(DKMQ bending, Allman membrane); needs a section",
)
TRIANGLE = Shell(
    "triangle",
    "shell: flat triangle, three nodes with six motions each, thin or thick, layered "
    "(DKMT bending, Allman membrane); needs a section; too stiff where thin shells are twisted: "
    "quadrilaterals are better there",
)
