"""Straight Euler-Bernoulli and Timoshenko beams in space, also tapered, eccentric and hinged.

:class:`BeamFields` holds rows (ne, points, 12) on the local degrees of freedom of each element:
displacement and rotation of the centroids at its two ends, in principal axes. The material point
(x, y, z) moves by (u - y B - z C, V - z phi, W + y phi) with the section slopes B = v' - g_v, C =
w' - g_w. u and phi are linear; v and w, at the shear centre, are cubic with nodal slope theta + g;
the shear strains g are constant: g = Phi/(1+Phi) ((w2-w1)/L - (th1+th2)/2) with Phi = 12 E I/(k G A
L^2), so Phi = 0 is Euler-Bernoulli. V and W are at the centroid. ``turn`` brings motions of the
nodes in body axes to local ones: rigid arms to the centroids, axes, and where an end is released
the motion that leaves it without force. Basis and quadrature are scikit-fem's Hermite line on a
disjoint mesh. Source: Przemieniecki, Theory of Matrix Structural Analysis, sections 5.6 and 11.7.

Section forces N, Vy, Vz, T, My, Mz act from the side of larger x: N and the moments My, Mz at the
centroid, T about the shear centre. They balance the forces that the nodes exert, also where the
section changes.

Geometric stiffness is the integral over the volume of sigma_ij u_k,i u_k,j with the stresses that
the section forces cause and the kinematics of the section: with N alone N (u'^2 + V'^2 + W'^2) + N
I_p/A phi'^2. Moments vary linearly along the element and turn with their nodes. Third moments of
the section (Wagner's constants) are left out; a torque acts half by each shear stress. Source:
Yang, Kuo, Theory and Analysis of Nonlinear Framed Structures, section 5.5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import CellBasis, ElementLineHermite, ElementLineP1, MeshLine

from flexmb.fe.elements.element_family import ComponentMass, SeparateStresses
from flexmb.fe.sections.beam_chain import BoundBeam, local_axes, section_values
from flexmb.flexbody.arrays import FloatArray, IntArray, rotation_stiffness, skew

_ORDER = 6  # order of the quadrature: products of two cubics
_TAPERED_ORDER = 10  # the same times second moments of degree four
_ALONG = ("A", "Iy", "Iz", "J", "nonstructural")
# Equivalent nodal forces of a clamped beam, over its length, per force per length at its two ends.
_AT_ENDS = np.array([[[20, 21, 21], [10, 9, 9]], [[-10, -9, -9], [-20, -21, -21]]]) / 60


class BeamFields:
    """Interpolated fields and section values of elements with node coordinates x (ne, 2, 3)."""

    def __init__(self, x: FloatArray, section: Any) -> None:
        bound = section if isinstance(section, BoundBeam) else None
        self._span = None
        self.section = section
        if bound is not None:
            self.section = bound.section
            if self.section.at(0.0) is not self.section:
                self._span = bound.span
                assert len(x) == len(bound.span), "a tapered block goes as a whole"
        self._place(x)
        self._interpolate()
        middle = self._values(np.array([0.5]), ("A", "Iy", "Iz", "ky", "kz"))
        E, G = self.section.material.E, self.section.material.G
        base = 12 * E / (G * middle["A"] * self.length[:, None] ** 2)
        self.shear = (base * middle["Iz"] / middle["ky"], base * middle["Iy"] / middle["kz"])
        """(ne, 1) Phi of bending in the xy and in the xz plane."""
        self._bend()
        if bound is not None and bound.released:
            self._release(bound.released)

    def _place(self, x: FloatArray) -> None:
        """Centroids of the end sections, and the axes there."""
        axes = local_axes(x, self.section.orientation)
        offset = self.ends_of("offset", len(x))
        arms = np.einsum("eab,enb->ena", axes[:, :, 1:], offset)
        self.ends, self.arms = x + arms, arms
        center = self.ends_of("shear_center", len(x)).mean(axis=1)
        angle = self.section.at(0.0).angle
        along = self.ends[:, 1] - self.ends[:, 0]
        self.length = np.linalg.norm(along, axis=1)
        turned = np.cos(angle) * axes[:, :, 1] + np.sin(angle) * axes[:, :, 2]
        self.axes = _axes_from(along / self.length[:, None], turned)
        self.section_axes, self.center = axes, center
        self.turn = np.zeros((len(x), 12, 12))
        back = self.axes.transpose(0, 2, 1)
        for node in (0, 1):
            a = 6 * node
            self.turn[:, a : a + 3, a : a + 3] = back
            self.turn[:, a : a + 3, a + 3 : a + 6] = -back @ skew(arms[:, node])
            self.turn[:, a + 3 : a + 6, a + 3 : a + 6] = back

    def _interpolate(self) -> None:
        ne = len(self.length)
        ends = np.stack([np.zeros(ne), self.length], axis=1).reshape(1, -1)
        mesh = MeshLine(ends, np.ascontiguousarray(np.arange(2 * ne).reshape(ne, 2).T))
        order = _ORDER if self._span is None else _TAPERED_ORDER
        linear = CellBasis(mesh, ElementLineP1(), intorder=order)
        self._cubic = CellBasis(mesh, ElementLineHermite(), intorder=order)
        self.dx, self.x = linear.dx, np.asarray(linear.global_coordinates())[0]
        self.t = self.x[0] / self.length[0]
        value = np.stack([np.asarray(f[0]) for f in linear.basis], axis=2)
        grad = np.stack([f[0].grad[0] for f in linear.basis], axis=2)
        self.u, self.u_x = self._rows(value, (0, 6)), self._rows(grad, (0, 6))
        self.phi, self.phi_x = self._rows(value, (3, 9)), self._rows(grad, (3, 9))
        self.values = self._values(self.t, _ALONG)

    def _bend(self) -> None:
        """Fields of both bending planes, including twist about the shear centre."""
        y, z = self.center.T
        v = self._plane(0, (1, 5, 7, 11), 1.0, -z)
        w = self._plane(1, (2, 4, 8, 10), -1.0, y)
        self.v_x, self.B, self.B_x, chord_v = v[1:]
        self.w_x, self.C, self.C_x, chord_w = w[1:]
        self.chord = (chord_v, chord_w)
        y, z = y[:, None, None], z[:, None, None]
        self.V, self.V_x = v[0] + z * self.phi, self.v_x + z * self.phi_x
        self.W, self.W_x = w[0] - y * self.phi, self.w_x - y * self.phi_x

    def _plane(
        self, plane: int, columns: tuple[int, ...], sign: float, arm: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Deflection of the shear centre, its slope, section slope and curvature, and the slope
        of the chord less the mean section rotation; nodal slope is sign * theta + g.

        ``arm`` (ne,) is its motion per unit twist of an end.
        """
        Phi, L = self.shear[plane][:, :, None], self.length[:, None, None]
        move, turn = columns[0], columns[1]
        mean = np.full((*self.dx.shape, 4), -0.5 * sign)
        mean[..., 0:1], mean[..., 1:2] = -1 / L, 1 / L
        chord = self._rows(mean, (move, move + 6, turn, turn + 6))
        chord[..., 3] = -arm[:, None] / self.length[:, None]
        chord[..., 9] = arm[:, None] / self.length[:, None]
        g = Phi / (1 + Phi) * chord
        signs, derivatives = np.array([1.0, sign, 1.0, sign]), []
        fields = [f[0] for f in self._cubic.basis]
        for derivative in (fields, [f.grad for f in fields], [f.hess for f in fields]):
            shapes = np.stack([np.reshape(d, self.dx.shape) for d in derivative], axis=2)
            of_g = shapes[:, :, 1] + shapes[:, :, 3]
            rows = self._rows(shapes * signs, columns) + of_g[:, :, None] * g
            rows[..., 3] += arm[:, None] * shapes[..., 0]
            rows[..., 9] += arm[:, None] * shapes[..., 2]
            derivatives.append(rows)
        deflection, slope, curvature = derivatives
        return deflection, slope, slope - g, curvature, chord

    def _rows(self, values: FloatArray, columns: tuple[int, ...]) -> FloatArray:
        row = np.zeros((*values.shape[:2], 12))
        row[:, :, columns] = values
        return row

    def _release(self, released: tuple[int, ...]) -> None:
        """Condense released motions: released ends move so that no force acts on them."""
        back = np.zeros_like(self.turn)
        for k in range(0, 12, 3):
            back[:, k : k + 3, k : k + 3] = self.section_axes.transpose(0, 2, 1)
        local = self.turn @ back.transpose(0, 2, 1)
        K = local.transpose(0, 2, 1) @ self.stiffness() @ local
        r, free = np.array(released), np.zeros_like(K)
        free[:] = np.eye(12)
        free[:, r] = -np.linalg.solve(K[:, r[:, None], r], K[:, r])
        free[:, :, r] = 0.0
        self.turn = local @ free @ back

    def _values(self, t: FloatArray, names: tuple[str, ...]) -> dict[str, FloatArray]:
        """(ne, points) section values by name at fractions t of the element."""
        if self._span is None:
            shape = (len(self.length), len(t))
            return {name: np.full(shape, getattr(self.section, name)) for name in names}
        start, end = self._span[:, :1], self._span[:, 1:]
        return section_values(self.section, (1 - t) * start + t * end, names)

    def end_sections(self, ne: int) -> list[list[Any]]:
        """The sections at both ends of each element; one row for all if they are the same."""
        if self._span is None:
            return [[self.section, self.section]]
        return [[self.section.at(s) for s in row] for row in self._span]

    def ends_of(self, name: str, ne: int) -> FloatArray:
        """(ne, 2, ...) a value of the section at the ends of the elements."""
        rows = [[getattr(part, name) for part in row] for row in self.end_sections(ne)]
        values = np.array(rows, dtype=float)
        return np.broadcast_to(values, (ne, *values.shape[1:]))

    def product(self, weight: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
        """(ne, 12, 12) int weight left^T right dx, weight (ne, points)."""
        return np.matmul((left * (weight * self.dx)[:, :, None]).transpose(0, 2, 1), right)

    def integral(self, weight: FloatArray, row: FloatArray) -> FloatArray:
        """(ne, 12) int weight row dx."""
        return np.einsum("eq,eqi->ei", weight * self.dx, row)

    def stiffness(self) -> FloatArray:
        """(ne, 12, 12) stiffness on the local degrees of freedom."""
        E, G, at = self.section.material.E, self.section.material.G, self.values
        K = self.product(E * at["A"], self.u_x, self.u_x)
        K += self.product(G * at["J"], self.phi_x, self.phi_x)
        K += self.product(E * at["Iz"], self.B_x, self.B_x)
        K += self.product(E * at["Iy"], self.C_x, self.C_x)
        # k G A g^2 = 12 E I/(L^2 Phi) g^2, and g carries Phi/(1+Phi): finite for Phi = 0
        for name, Phi, chord in zip(("Iz", "Iy"), self.shear, self.chord, strict=True):
            weight = 12 * E * at[name] / self.length[:, None] ** 2 * Phi / (1 + Phi) ** 2
            K += self.product(weight, chord, chord)
        return K


def _axes_from(x: FloatArray, y: FloatArray) -> FloatArray:
    """(ne, 3, 3) axes as columns, y made normal to x."""
    y = y - np.sum(x * y, axis=1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=2)


def geometric_products(
    fields: BeamFields, forces: FloatArray, axial: FloatArray | float = 0.0
) -> FloatArray:
    """(ne, 12, 12) geometric stiffness; only its symmetric part is used.

    Parameters
    ----------
    fields : BeamFields
        The elements.
    forces : (ne, 2, 6) float
        Section forces at both ends.
    axial : (ne, points) float
        Axial force added to N along the elements.
    """
    along = forces[:, :1] + fields.t[:, None] * (forces[:, 1:] - forces[:, :1])
    N, Vy, Vz, T, My, Mz = np.moveaxis(along, 2, 0)
    N += axial
    A, Iy, Iz = (fields.values[name] for name in ("A", "Iy", "Iz"))
    terms = (
        (N, fields.u_x, fields.u_x),
        (N, fields.V_x, fields.V_x),
        (N, fields.W_x, fields.W_x),
        (N * (Iy + Iz) / A, fields.phi_x, fields.phi_x),
        (N * Iz / A, fields.B_x, fields.B_x),
        (N * Iy / A, fields.C_x, fields.C_x),
        (2 * Mz, fields.u_x, fields.B_x),
        (-2 * My, fields.u_x, fields.C_x),
        (-2 * My, fields.V_x, fields.phi_x),
        (-2 * Mz, fields.W_x, fields.phi_x),
        (-2 * Vy, fields.u_x, fields.B),
        (2 * Vy, fields.W_x, fields.phi),
        (-2 * Vz, fields.u_x, fields.C),
        (-2 * Vz, fields.V_x, fields.phi),
        (T, fields.C, fields.B_x),
        (-T, fields.B, fields.C_x),
    )
    return np.asarray(sum(fields.product(*term) for term in terms))


FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Order of section forces."""


def section_forces(fields: BeamFields) -> FloatArray:
    """(ne, 2, 6, 12) section forces at both ends, principal axes, per unit motion of the nodes."""
    forces = fields.stiffness() @ fields.turn
    ends = np.stack([-forces[:, :6], forces[:, 6:]], axis=1)
    y, z = fields.center.T[:, :, None, None]
    ends[:, :, 3] -= y * ends[:, :, 2] - z * ends[:, :, 1]
    return ends


class _Line(SeparateStresses):
    """Two-node beam."""

    kind = "line"
    about = (
        "beam: straight, two nodes with six motions each, Euler-Bernoulli or Timoshenko; "
        "needs a section"
    )
    dimension = 1
    rotations = True
    warning = ""
    faces: tuple[tuple[int, ...], ...] = ()
    edges = ((0, 1),)

    def measure(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne,) lengths."""
        return np.linalg.norm(x[:, 1] - x[:, 0], axis=1)

    def defects(self, x: FloatArray) -> IntArray:
        """Rows of elements without length."""
        return np.flatnonzero(np.linalg.norm(x[:, 1] - x[:, 0], axis=1) == 0)

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, 12, 12) stiffness."""
        fields = BeamFields(x, section)
        return _symmetric(_turned(fields.stiffness(), fields.turn))

    def mass(self, x: FloatArray, section: Any) -> ComponentMass:
        """Mass with the kinematics of the section, every component exact."""
        fields = BeamFields(x, section)
        local, first = _local_mass(fields)
        R, turn = fields.axes, fields.turn
        line, _, _ = _mass_per_length(fields)
        p_local = np.stack([fields.integral(line, N) for N in (fields.u, fields.V, fields.W)], 1)
        p = np.einsum("ebd,edi->ebi", R, p_local)
        P = np.einsum("eac,ebd,ecdi->eabi", R, R, first, optimize=True)
        P += fields.ends[:, 0, :, None, None] * p[:, None]
        Mab = np.einsum("eac,ebd,ecdij->eabij", R, R, local, optimize=True)
        Mab = _turned(Mab, turn[:, None, None])
        Mab = 0.5 * (Mab + Mab.transpose(0, 2, 1, 4, 3))
        return ComponentMass(Mab, P @ turn[:, None], p @ turn, *_rigid(fields))

    def geometric_stiffness(
        self, x: FloatArray, section: Any, u: FloatArray, field: FloatArray | None = None
    ) -> FloatArray:
        """(ne, 12, 12) geometric stiffness of the stress that displacements u (ne, 12) cause.

        ``field`` (3, 4), [G, g], is the force per mass G s + g at s: with it the axial force varies
        along an element, and the error falls with the fourth power of its length, not the second.
        """
        fields = BeamFields(x, section)
        forces = np.einsum("enci,ei->enc", section_forces(fields), u)
        field = np.zeros((3, 4)) if field is None else field
        q = _line_load(fields, field)
        ends = np.einsum("nmc,emc,e->enc", _AT_ENDS, q, fields.length) + forces[:, :, :3]
        K = geometric_products(fields, forces, _axial_variation(fields, q[:, :, 0]))
        K = _symmetric(_turned(K - _turning_of_sections(fields, field), fields.turn))
        K.reshape(-1, 4, 3, 4, 3)[:, [1, 3], :, [1, 3]] += _turning_of_ends(fields, forces, ends)
        return K

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """Names of the stress points of the section."""
        section = getattr(section, "section", section)
        return tuple(point.name for point in section.at(0.0).points)

    def stress(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, 2, layers, 6, 12) stress per unit of each degree of freedom."""
        fields, ne = BeamFields(x, section), len(x)
        forces, place = section_forces(fields), _point_values(fields, ne)
        A, Iy, Iz = (fields.ends_of(name, ne)[..., None] for name in ("A", "Iy", "Iz"))
        local = np.zeros((ne, 2, place.shape[2], 3, 6))  # xx, xy, xz per section force
        local[..., 0, 0] = 1 / A
        local[..., 0, 4] = place[..., 1] / Iy
        local[..., 0, 5] = -place[..., 0] / Iz
        for c, three in ((1, slice(2, 5)), (2, slice(5, 8))):
            local[..., c, 3] = place[..., three][..., 0]
            local[..., c, 1:3] = place[..., three][..., 1:]
        return np.einsum("esc,enlcf,enfi->enlsi", _to_body(fields.axes), local, forces)

    def rotation(self, x: FloatArray) -> FloatArray:
        """(ne, 2, 3, 12) rotation at the nodes per unit of each degree of freedom."""
        turn = np.zeros((len(x), 2, 3, 12))
        turn[:, 0, :, 3:6] = turn[:, 1, :, 9:12] = np.eye(3)
        return turn


def _turned(local: FloatArray, turn: FloatArray) -> FloatArray:
    return np.swapaxes(turn, -1, -2) @ local @ turn


def _symmetric(K: FloatArray) -> FloatArray:
    return 0.5 * (K + K.transpose(0, 2, 1))


def _mass_per_length(fields: BeamFields) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(ne, points) mass, int rho z^2 dA and int rho y^2 dA."""
    rho, at = fields.section.material.density, fields.values
    return rho * at["A"] + at["nonstructural"], rho * at["Iy"], rho * at["Iz"]


def _local_mass(fields: BeamFields) -> tuple[FloatArray, FloatArray]:
    """int rho N_c^T N_d (ne, 3, 3, 12, 12) and int rho s_c N_d (ne, 3, 3, 12), local axes, s from
    the centroid at the first end."""
    line, Iy, Iz = _mass_per_length(fields)
    N = (fields.u, fields.V, fields.W)
    local = np.stack([np.stack([fields.product(line, a, b) for b in N], 1) for a in N], 1)
    # section kinematics: x moves by -y B - z C, y by -z phi, z by y phi
    B, C, phi = fields.B, fields.C, fields.phi
    local[:, 0, 0] += fields.product(Iz, B, B) + fields.product(Iy, C, C)
    local[:, 1, 1] += fields.product(Iy, phi, phi)
    local[:, 2, 2] += fields.product(Iz, phi, phi)
    local[:, 0, 1] += fields.product(Iy, C, phi)
    local[:, 0, 2] -= fields.product(Iz, B, phi)
    local[:, 1, 0], local[:, 2, 0] = (local[:, 0, k].transpose(0, 2, 1) for k in (1, 2))
    first = np.zeros((len(line), 3, 3, 12))
    for d in range(3):
        first[:, 0, d] = fields.integral(line * fields.x, N[d])
    first[:, 1, 0], first[:, 1, 2] = fields.integral(-Iz, B), fields.integral(Iz, phi)
    first[:, 2, 0], first[:, 2, 1] = fields.integral(-Iy, C), fields.integral(-Iy, phi)
    return local, first


def _turning_of_ends(fields: BeamFields, forces: FloatArray, ends: FloatArray) -> FloatArray:
    """(2, ne, 3, 3) sym(M) - tr(M) I of rotating end nodes, M the sum of s f^T about the node."""
    x, y, z = fields.axes.transpose(2, 0, 1)
    M = np.einsum("ena,ebc,enc->enab", fields.arms, fields.axes, ends)
    bent = forces[:, :, 4, None] * z[:, None] - forces[:, :, 5, None] * y[:, None]
    M = np.array([[[-1.0]], [[1.0]]]) * (M + bent[..., None] * x[:, None, None])
    return rotation_stiffness(M).swapaxes(0, 1)


def _turning_of_sections(fields: BeamFields, field: FloatArray) -> FloatArray:
    """(ne, 12, 12) second-order work of a force per mass on sections that rotate in place."""
    _, Iy, Iz = _mass_per_length(fields)
    G = fields.axes.transpose(0, 2, 1) @ field[:, :3] @ fields.axes
    moments = np.stack([0 * Iy, Iz, Iy], axis=2)[..., None] * G.swapaxes(1, 2)[:, None]
    turns = np.stack([fields.phi, -fields.C, fields.B], axis=2)
    S = rotation_stiffness(moments) * fields.dx[..., None, None]
    return np.asarray(np.sum(turns.swapaxes(2, 3) @ S @ turns, axis=1))


def _line_load(fields: BeamFields, field: FloatArray) -> FloatArray:
    """(ne, 2, 3) force per length at both ends, element axes, of a force per mass."""
    force = fields.ends @ field[:, :3].T + field[:, 3]
    rho = fields.section.material.density
    line = rho * fields.ends_of("A", len(force)) + fields.ends_of("nonstructural", len(force))
    return np.asarray(line[:, :, None] * np.matmul(force, fields.axes))


def _axial_variation(fields: BeamFields, q: FloatArray) -> FloatArray:
    """(ne, points) axial force minus its mean, from the axial force per length at both ends."""
    L, rise = fields.length[:, None], q[:, 1:] - q[:, :1]
    return q[:, :1] * (L / 2 - fields.x) + rise * (L / 6 - fields.x**2 / (2 * L))


def _rigid(fields: BeamFields) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass and its first and second moments."""
    line, Iy, Iz = (part * fields.dx for part in _mass_per_length(fields))
    R, start = fields.axes, fields.ends[:, 0]
    mass, first = line.sum(axis=1), (line * fields.x).sum(axis=1)
    own = np.stack([(line * fields.x**2).sum(axis=1), Iz.sum(axis=1), Iy.sum(axis=1)], axis=1)
    arm = first[:, None] * R[:, :, 0]
    S1 = mass[:, None] * start + arm
    S0 = np.einsum("eac,ec,ebc->eab", R, own, R)
    S0 += start[:, :, None] * arm[:, None, :] + S1[:, :, None] * start[:, None, :]
    return mass, S1, 0.5 * (S0 + S0.transpose(0, 2, 1))


def _point_values(fields: BeamFields, ne: int) -> FloatArray:
    """(ne, 2, layers, 8) y, z and the shear stress along y and z per T, Vy, Vz of each point."""
    rows = [
        [[[p.y, p.z, *p.xy, *p.xz] for p in part.points] for part in row]
        for row in fields.end_sections(ne)
    ]
    values = np.array(rows, dtype=float)
    values = values.reshape(len(rows), 2, len(rows[0][0]), 8)
    return np.broadcast_to(values, (ne, *values.shape[1:]))


def _to_body(R: FloatArray) -> FloatArray:
    """(ne, 6, 3) body stress components xx, yy, zz, yz, zx, xy per local xx, xy, xz."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    out = np.zeros((len(R), 6, 3))
    for row, (i, j) in enumerate(pairs):
        out[:, row] = R[:, i, :1] * R[:, j] + R[:, i] * R[:, j, :1]
    out[:, :, 0] *= 0.5
    return out


LINE = _Line()
"""The family of two-node beams."""
