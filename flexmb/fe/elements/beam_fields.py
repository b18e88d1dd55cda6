"""The displacement field of beam elements, and the values of their sections along it.

In: node coordinates and a section. Out: :class:`BeamFields`, rows (ne, points, 12) on the local
degrees of freedom of each element: displacement and rotation of the centroids at its two ends, in
principal axes. The material point (x, y, z) moves by (u - y B - z C, V - z phi, W + y phi) with the
section slopes B = v' - g_v, C = w' - g_w. u and phi are linear; v and w, at the shear centre, are
cubic with nodal slope theta + g; the shear strains g are constant: g = Phi/(1+Phi) ((w2-w1)/L -
(th1+th2)/2) with Phi = 12 E I/(k G A L^2), so Phi = 0 is Euler-Bernoulli. V and W are at the
centroid. ``turn`` brings motions of the nodes in body axes to local ones: rigid arms to the
centroids, axes, and where an end is released the motion that leaves it without force.
Source: Przemieniecki, Theory of Matrix Structural Analysis, sections 5.6 and 11.7. scikit-fem
gives basis and quadrature on a disjoint mesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import CellBasis, ElementLineHermite, ElementLineP1, MeshLine

from flexmb.fe.assembly.numbering import skew
from flexmb.fe.sections.axes import local_axes
from flexmb.fe.sections.binding import BoundBeam
from flexmb.fe.sections.taper import spread
from flexmb.flexbody.arrays import FloatArray

__all__ = ["BeamFields"]

_ORDER = 6  # products of two cubics
_TAPERED_ORDER = 10  # the same times second moments of degree four
_ALONG = ("A", "Iy", "Iz", "J", "nonstructural")


class BeamFields:
    """Fields and section values of elements with node coordinates x (ne, 2, 3)."""

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
        self.ends = x + arms
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
        """Fields of both planes, twist about the shear centre included."""
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
        signs, found = np.array([1.0, sign, 1.0, sign]), []
        fields = [f[0] for f in self._cubic.basis]
        for derivative in (fields, [f.grad for f in fields], [f.hess for f in fields]):
            shapes = np.stack([np.reshape(d, self.dx.shape) for d in derivative], axis=2)
            of_g = shapes[:, :, 1] + shapes[:, :, 3]
            rows = self._rows(shapes * signs, columns) + of_g[:, :, None] * g
            rows[..., 3] += arm[:, None] * shapes[..., 0]
            rows[..., 9] += arm[:, None] * shapes[..., 2]
            found.append(rows)
        deflection, slope, curvature = found
        return deflection, slope, slope - g, curvature, chord

    def _rows(self, values: FloatArray, columns: tuple[int, ...]) -> FloatArray:
        row = np.zeros((*values.shape[:2], 12))
        row[:, :, columns] = values
        return row

    def _release(self, released: tuple[int, ...]) -> None:
        """Let released ends move so that no force acts on them: static condensation."""
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
        """(ne, points) values at fractions t of the element."""
        if self._span is None:
            shape = (len(self.length), len(t))
            return {name: np.full(shape, getattr(self.section, name)) for name in names}
        start, end = self._span[:, :1], self._span[:, 1:]
        return spread(self.section, (1 - t) * start + t * end, names)

    def end_sections(self, ne: int) -> list[list[Any]]:
        """The sections at both ends of each element; one row for all if they are the same."""
        if self._span is None:
            return [[self.section, self.section]]
        return [[self.section.at(s) for s in row] for row in self._span]

    def ends_of(self, name: str, ne: int) -> FloatArray:
        """(ne, 2, ...) a value of the section at the ends of the elements."""
        found = [[getattr(part, name) for part in row] for row in self.end_sections(ne)]
        values = np.array(found, dtype=float)
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
