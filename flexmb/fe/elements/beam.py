"""Straight Euler-Bernoulli and Timoshenko beams in space, also tapered, eccentric and hinged.

In: end coordinates and a section. Out: (ne, 12, 12) matrices in body axes, degrees of freedom
(displacement, rotation) of the first node, then of the second. The fields are those of
:mod:`flexmb.fe.elements.beam_fields`. Section forces N, Vy, Vz, T, My, Mz act from the side of
larger x: N and the moments My, Mz at the centroid, T about the shear centre. They come from the
forces that the nodes exert, so that they are in equilibrium with these also where the section
changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.fe.elements.beam_fields import BeamFields
from flexmb.fe.elements.beam_geometric import geometric_products
from flexmb.fe.elements.family import ComponentMass
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["LINE", "FORCES", "section_forces"]

FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
"""Order of section forces."""


def section_forces(fields: BeamFields) -> FloatArray:
    """(ne, 2, 6, 12) section forces at both ends, principal axes, per unit motion of the nodes."""
    forces = fields.stiffness() @ fields.turn
    ends = np.stack([-forces[:, :6], forces[:, 6:]], axis=1)
    y, z = fields.center.T[:, :, None, None]
    ends[:, :, 3] -= y * ends[:, :, 2] - z * ends[:, :, 1]
    return ends


class _Line:
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

        ``field`` (3, 4), [G, g], tells the force per mass G s + g at s that acts along the
        elements: the displacements know the mean axial force alone, with the field it varies
        along an element as it does, and the error falls with the fourth power of the element
        length instead of the second.
        """
        fields = BeamFields(x, section)
        forces = np.einsum("enci,ei->enc", section_forces(fields), u)
        axial = 0.0 if field is None else _axial_variation(fields, field)
        return _symmetric(_turned(geometric_products(fields, forces, axial), fields.turn))

    def stress_layers(self, section: Any) -> tuple[str, ...]:
        """Names of the stress points of the section."""
        section = getattr(section, "section", section)
        return tuple(point.name for point in section.at(0.0).points)

    def stress(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, 2, layers, 6, 12) stress per unit of each degree of freedom."""
        fields = BeamFields(x, section)
        forces, ne = section_forces(fields), len(x)
        place = _point_values(fields, ne)
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


def _axial_variation(fields: BeamFields, field: FloatArray) -> FloatArray:
    """(ne, points) axial force less its mean, from a force per mass along the elements."""
    force = fields.ends @ field[:, :3].T + field[:, 3]
    per_length = np.einsum("eni,ei->en", force, fields.axes[:, :, 0])
    rho = fields.section.material.density
    line = rho * fields.ends_of("A", len(force)) + fields.ends_of("nonstructural", len(force))
    start, end = (line * per_length)[:, :, None].transpose(1, 0, 2)
    L = fields.length[:, None]
    gone = start * fields.x + (end - start) * fields.x**2 / (2 * L)
    return start * L / 2 + (end - start) * L / 6 - gone


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
    found = [
        [[[p.y, p.z, *p.xy, *p.xz] for p in part.points] for part in row]
        for row in fields.end_sections(ne)
    ]
    values = np.array(found, dtype=float)
    values = values.reshape(len(found), 2, len(found[0][0]), 8)
    return np.broadcast_to(values, (ne, *values.shape[1:]))


def _to_body(R: FloatArray) -> FloatArray:
    """(ne, 6, 3) body stress components xx, yy, zz, yz, zx, xy per local xx, xy, xz."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    out = np.zeros((len(R), 6, 3))
    for row, (i, j) in enumerate(pairs):
        out[:, row, 0] = R[:, i, 0] * R[:, j, 0]
        for c in (1, 2):
            out[:, row, c] = R[:, i, 0] * R[:, j, c] + R[:, i, c] * R[:, j, 0]
    return out


LINE = _Line()
"""The family of two-node beams."""
