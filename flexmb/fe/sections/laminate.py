"""Stiffness and mass of a shell per area, from its layers.

In: layers with their materials, stacked from the bottom to the top face. Out: :class:`Laminate`:
membrane, coupling and bending stiffness, transverse shear stiffness, moments of the density, and
the elasticity of the two outermost layers. z counts from the mid-surface. Sources: Reddy,
Mechanics of Laminated Composite Plates and Shells, 2nd ed., section 3.3; shear correction by equal
energy in cylindrical bending, Vlachoutsis (1992), Int. J. Numer. Meth. Eng. 33, 1537 (5/6 for one
layer).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import FloatArray

__all__ = ["Laminate", "laminate"]

_GAUSS = np.polynomial.legendre.leggauss(3)  # the square of a parabola


@dataclass(frozen=True, eq=False)
class Laminate:
    """A shell's section in its own axes 1, 2; strains and curvatures in the order 11, 22, 12.

    Parameters
    ----------
    ABD : (6, 6) float
        Membrane forces [N/m] and moments [N] per membrane strain and curvature [1/m] of the
        mid-surface, engineering shear and twist.
    S : (2, 2) float
        Transverse shear forces [N/m] per shear strain 13, 23, shear correction included.
    mass : (3,) float
        int rho z^k dz for k = 0, 1, 2 [kg/m^2, kg/m, kg].
    outer : (2, 3, 3) float
        Plane-stress elasticity at the bottom and at the top face [Pa].
    z : (2,) float
        Heights of the bottom and of the top face [m].
    """

    ABD: FloatArray
    S: FloatArray
    mass: FloatArray
    outer: FloatArray
    z: FloatArray

    def bending(self) -> FloatArray:
        """(3, 3) moments per curvature with no membrane forces [N m]."""
        A, B, D = self.ABD[:3, :3], self.ABD[:3, 3:], self.ABD[3:, 3:]
        return D - B.T @ np.linalg.solve(A, B)


def laminate(layers: Sequence[Any], nonstructural: float) -> Laminate:
    """Sum the layers.

    Parameters
    ----------
    layers : sequence of Layer
        With materials, from bottom to top.
    nonstructural : float
        Further mass per area, spread over the mid-surface [kg/m^2].
    """
    t = np.array([layer.thickness for layer in layers])
    z = np.concatenate([[0.0], np.cumsum(t)]) - 0.5 * t.sum()
    if len(t) == 1:
        z = np.array([-0.5, 0.5]) * t[0]
    made = [(layer.material, layer.angle) for layer in layers]
    C = np.stack([_turned_plane(material.plane_stress(), angle) for material, angle in made])
    G = np.stack([_turned_shear(material.transverse_shear(), angle) for material, angle in made])
    rho = np.array([material.density for material, _ in made])
    powers = [np.diff(z ** (k + 1)) / (k + 1) for k in range(3)]
    A, B, D = (np.einsum("l,lij->ij", power, C) for power in powers)
    mass = np.array([rho @ power for power in powers])
    mass[0] += nonstructural
    k = np.sqrt([_correction(z, C[:, i, i], G[:, i, i]) for i in range(2)])
    S = np.einsum("l,lij->ij", t, G) * np.outer(k, k)
    ABD = np.block([[A, B], [B, D]])
    return Laminate(0.5 * (ABD + ABD.T), S, mass, C[[0, -1]], z[[0, -1]])


def _turned_plane(C: FloatArray, angle: float) -> FloatArray:
    """Plane-stress elasticity of a layer whose axis 1 is turned by ``angle`` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [0.0, 0.0, 0.0]])
    T[2] = -2 * c * s, 2 * c * s, c * c - s * s
    return T.T @ C @ T


def _turned_shear(G: FloatArray, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    T = np.array([[c, s], [-s, c]])
    return T.T @ G @ T


def _correction(z: FloatArray, C: FloatArray, G: FloatArray) -> float:
    """Shear correction factor of cylindrical bending.

    The shear stress balances the bending stress C (z - z0) of a shear force; its energy is that of
    a uniform shear strain with the stiffness sought.
    """
    bottom, top = z[:-1], z[1:]
    z0 = (C @ (top**2 - bottom**2)) / (2 * C @ (top - bottom))
    D = C @ ((top - z0) ** 3 - (bottom - z0) ** 3) / 3
    grown = np.cumsum(0.5 * C * ((top - z0) ** 2 - (bottom - z0) ** 2))
    below = np.concatenate([[0.0], grown[:-1]])
    half = 0.5 * (top - bottom)
    points = bottom[:, None] + half[:, None] * (1 + _GAUSS[0])
    flow = below[:, None] + 0.5 * C[:, None] * ((points - z0) ** 2 - (bottom[:, None] - z0) ** 2)
    energy = np.sum(flow**2 * _GAUSS[1] * half[:, None] / G[:, None])
    return float(D**2 / energy / (G @ (top - bottom)))
