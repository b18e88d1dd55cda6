"""Straight Euler-Bernoulli and Timoshenko beams in space: stiffness, mass and mass components.

In: end coordinates, a section and a material for each element. Out: (ne, 12, 12) matrices in body
axes, degrees of freedom (displacement, rotation) of the first node, then of the second. In local
axes the material point (x, y, z) moves by (u - y psi_z + z psi_y, v - z phi, w + y phi) with the
section rotations psi_z = v' - g_v, psi_y = -(w' - g_w); u and phi are linear, v and w cubic with
nodal slope theta + g, the shear strains g constant: g = Phi/(1+Phi) ((w2-w1)/L - (th1+th2)/2) with
Phi = 12 E I/(k G A L^2), so Phi = 0 is Euler-Bernoulli. Source: Przemieniecki, Theory of Matrix
Structural Analysis, sections 5.6 and 11.7. scikit-fem gives basis and quadrature on a disjoint
mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import CellBasis, ElementLineHermite, ElementLineP1, MeshLine

from flexmb.fe.elements.family import ComponentMass
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import Material

__all__ = ["LINE", "Beams", "local_axes", "mass", "stiffness"]

_ORDER = 6  # products of two cubics


@dataclass(frozen=True, eq=False)
class Beams:
    """Geometry and section values of all beam elements, (ne, ...) each, SI."""

    ends: FloatArray  # (ne, 2, 3)
    axes: FloatArray  # (ne, 3, 3), columns are the local axes in body axes
    A: FloatArray
    Iy: FloatArray
    Iz: FloatArray
    J: FloatArray
    ky: FloatArray
    kz: FloatArray
    material: Material

    @property
    def length(self) -> FloatArray:
        """(ne,) element lengths [m]."""
        return np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)

    def shear_numbers(self) -> tuple[FloatArray, FloatArray]:
        """(ne,) Phi of bending in the xy and in the xz plane."""
        E, G = self.material.E, self.material.E / (2 * (1 + self.material.nu))
        base = 12 * E / (G * self.A * self.length**2)
        return base * self.Iz / self.ky, base * self.Iy / self.kz


def local_axes(ends: FloatArray, orientation: FloatArray) -> FloatArray:
    """(ne, 3, 3) local axes as columns; y is the part of ``orientation`` (ne, 3) normal to x.

    Where ``orientation`` is NaN, y is z x x (perpendicular to the body z axis), or the body y axis
    for a beam along z. An orientation along the beam gives NaN axes: the caller refuses it.
    """
    x = ends[:, 1] - ends[:, 0]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    level = np.cross([0.0, 0.0, 1.0], x)
    upright = np.linalg.norm(level, axis=1) < 1e-6
    level[upright] = [0.0, 1.0, 0.0]
    y = np.where(np.isnan(orientation), level, orientation)
    size = np.linalg.norm(y, axis=1, keepdims=True)
    y = y - np.sum(x * y, axis=1, keepdims=True) * x
    left = np.linalg.norm(y, axis=1, keepdims=True)
    y = np.where(left > 1e-6 * size, y / np.where(left > 0, left, 1.0), np.nan)
    return np.stack([x, y, np.cross(x, y)], axis=2)


def stiffness(beams: Beams) -> FloatArray:
    """(ne, 12, 12) stiffness in body axes."""
    rows = _Rows(beams)
    E, G = beams.material.E, beams.material.E / (2 * (1 + beams.material.nu))
    K = rows.product(E * beams.A, rows.u_x, rows.u_x)
    K += rows.product(G * beams.J, rows.phi_x, rows.phi_x)
    K += rows.product(E * beams.Iz, rows.bend_v, rows.bend_v)
    K += rows.product(E * beams.Iy, rows.bend_w, rows.bend_w)
    # k G A g^2 = 12 E I / (L^2 Phi) g^2, and g carries Phi/(1+Phi): finite for Phi = 0
    L = beams.length
    for I, Phi, chord in zip((beams.Iz, beams.Iy), rows.shear, rows.chord, strict=True):  # noqa: E741
        K += rows.product(12 * E * I / L**2 * Phi / (1 + Phi) ** 2, chord, chord)
    return K


def mass(beams: Beams) -> ComponentMass:
    """Mass components of the elements in body axes."""
    rows = _Rows(beams)
    rho = beams.material.density
    line, Iy, Iz = rho * beams.A, rho * beams.Iy, rho * beams.Iz
    ne = len(line)
    N = (rows.u, rows.v, rows.w)
    local = np.zeros((ne, 3, 3, 12, 12))
    for c in range(3):
        for d in range(3):
            local[:, c, d] = rows.product(line, N[c], N[d])
    # section kinematics: x moves by -y B - z C, y by -z phi, z by y phi (B, C: section slopes)
    B, C, phi = rows.slope_v, rows.slope_w, rows.phi
    local[:, 0, 0] += rows.product(Iz, B, B) + rows.product(Iy, C, C)
    local[:, 1, 1] += rows.product(Iy, phi, phi)
    local[:, 2, 2] += rows.product(Iz, phi, phi)
    local[:, 0, 1] += rows.product(Iy, C, phi)
    local[:, 0, 2] -= rows.product(Iz, B, phi)
    local[:, 1, 0], local[:, 2, 0] = (local[:, 0, k].transpose(0, 2, 1) for k in (1, 2))
    first = np.zeros((ne, 3, 3, 12))  # int rho s_c N_d with s from the first node, local axes
    for d in range(3):
        first[:, 0, d] = rows.integral(line, N[d], rows.x)
    first[:, 1, 0], first[:, 1, 2] = rows.integral(-Iz, B), rows.integral(Iz, phi)
    first[:, 2, 0], first[:, 2, 1] = rows.integral(-Iy, C), rows.integral(-Iy, phi)
    p_local = np.stack([rows.integral(line, row) for row in N], axis=1)
    R, origin = beams.axes, beams.ends[:, 0]
    p = np.einsum("ebd,edi->ebi", R, p_local)
    P = np.einsum("eac,ebd,ecdi->eabi", R, R, first, optimize=True)
    P += origin[:, :, None, None] * p[:, None]
    Mab = np.einsum("eac,ebd,ecdij->eabij", R, R, local, optimize=True)
    return ComponentMass(Mab, P, p, *_rigid(beams))


def _rigid(beams: Beams) -> tuple[FloatArray, FloatArray, FloatArray]:
    rho, L, R = beams.material.density, beams.length, beams.axes
    mass_ = rho * beams.A * L
    middle = beams.ends.mean(axis=1)
    own = np.stack([mass_ * L**2 / 12, rho * beams.Iz * L, rho * beams.Iy * L], axis=1)
    S0 = np.einsum("eac,ec,ebc->eab", R, own, R)
    S0 += mass_[:, None, None] * middle[:, :, None] * middle[:, None, :]
    return mass_, mass_[:, None] * middle, S0


class _Rows:
    """Local fields as rows (ne, quadrature points, 12) on degrees of freedom in body axes."""

    def __init__(self, beams: Beams) -> None:
        L = beams.length
        ne = len(L)
        ends = np.stack([np.zeros(ne), L], axis=1).reshape(1, -1)
        mesh = MeshLine(ends, np.arange(2 * ne).reshape(ne, 2).T)
        linear = CellBasis(mesh, ElementLineP1(), intorder=_ORDER)
        cubic = CellBasis(mesh, ElementLineHermite(), intorder=_ORDER)
        self.dx, self.x = linear.dx, np.asarray(linear.global_coordinates())[0]
        self._turn = np.zeros((ne, 12, 12))
        for k in range(0, 12, 3):
            self._turn[:, k : k + 3, k : k + 3] = beams.axes.transpose(0, 2, 1)
        value = np.stack([np.asarray(f[0]) for f in linear.basis], axis=2)
        grad = np.stack([f[0].grad[0] for f in linear.basis], axis=2)
        self.u, self.u_x = self._local(value, (0, 6)), self._local(grad, (0, 6))
        self.phi, self.phi_x = self._local(value, (3, 9)), self._local(grad, (3, 9))
        self.shear = beams.shear_numbers()
        self.chord = (self._chord(L, 1, 5, 1.0), self._chord(L, 2, 4, -1.0))
        self.v, self.slope_v, self.bend_v = self._bending(cubic, 0, (1, 5, 7, 11), 1.0)
        self.w, self.slope_w, self.bend_w = self._bending(cubic, 1, (2, 4, 8, 10), -1.0)

    def product(self, weight: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
        """(ne, 12, 12) int weight left^T right dx."""
        weighted = left * (weight[:, None] * self.dx)[:, :, None]
        return np.matmul(weighted.transpose(0, 2, 1), right)

    def integral(
        self, weight: FloatArray, row: FloatArray, x: FloatArray | float = 1.0
    ) -> FloatArray:
        """(ne, 12) int weight x row dx."""
        return np.einsum("eq,eqi->ei", weight[:, None] * self.dx * x, row)

    def _local(self, values: FloatArray, columns: tuple[int, ...]) -> FloatArray:
        row = np.zeros((*values.shape[:2], 12))
        row[:, :, columns] = values
        return row @ self._turn

    def _chord(self, L: FloatArray, move: int, turn: int, sign: float) -> FloatArray:
        """Chord slope minus the mean section rotation, the same at all quadrature points."""
        values = np.zeros((*self.dx.shape, 4))
        values[..., 0], values[..., 1] = -1 / L[:, None], 1 / L[:, None]
        values[..., 2:] = -0.5 * sign
        return self._local(values, (move, move + 6, turn, turn + 6))

    def _bending(
        self, cubic: CellBasis, plane: int, columns: tuple[int, ...], sign: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Deflection, section slope and curvature; nodal slope is sign*theta + g."""
        Phi = self.shear[plane][:, None, None]
        g = Phi / (1 + Phi) * self.chord[plane]
        signs = np.array([1.0, sign, 1.0, sign])
        found = []
        fields = [f[0] for f in cubic.basis]
        for derivative in (fields, [f.grad for f in fields], [f.hess for f in fields]):
            shapes = np.stack([np.reshape(d, self.dx.shape) for d in derivative], axis=2)
            of_g = shapes[:, :, 1] + shapes[:, :, 3]
            found.append(self._local(shapes * signs, columns) + of_g[:, :, None] * g)
        deflection, slope, curvature = found
        return deflection, slope - g, curvature


class Line:
    """Beams as a family."""

    kind = "line"
    about = (
        "beam: straight, two nodes with six motions each, Euler-Bernoulli or Timoshenko; "
        "needs a section"
    )
    dimension = 1
    rotations = True
    warning = ""
    faces = ()
    edges = ((0, 1),)

    def defects(self, x: FloatArray) -> IntArray:
        """Elements without length."""
        return np.flatnonzero(np.linalg.norm(x[:, 1] - x[:, 0], axis=1) == 0)

    def stiffness(self, x: FloatArray, section: Any) -> FloatArray:
        """(ne, 12, 12)."""
        return stiffness(_beams(x, section))

    def mass(self, x: FloatArray, section: Any) -> ComponentMass:
        """Consistent mass."""
        return mass(_beams(x, section))


LINE = Line()


def _beams(x: FloatArray, section: Any) -> Beams:
    orientation = np.full(3, np.nan) if section.orientation is None else section.orientation
    axes = local_axes(x, np.broadcast_to(np.asarray(orientation, float), (len(x), 3)))
    values = {
        name: np.full(len(x), getattr(section, name)) for name in ("A", "Iy", "Iz", "J", "ky", "kz")
    }
    return Beams(x, axes, **values, material=section.material)
