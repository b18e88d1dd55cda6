"""Sections of plates and shells: layers, offset, material directions, nonstructural mass.

The element normal follows from the order of an element's nodes by the right-hand rule; "bottom" and
"top" refer to it. :class:`Laminate` sums over the layers: membrane, coupling and bending stiffness,
transverse shear stiffness, moments of the density; z is measured from the mid-surface. Sources:
Reddy, Mechanics of Laminated Composite Plates and Shells, 2nd ed., section 3.3; shear correction by
equal energy in cylindrical bending, Vlachoutsis (1992), Int. J. Numer. Meth. Eng. 33, 1537 (5/6 for
one layer).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite, sin
from numbers import Real
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError
from flexmb.flexbody.arrays import FloatArray
from flexmb.materials import AnyMaterial, OrthotropicMaterial, material_problems

_GAUSS = np.polynomial.legendre.leggauss(3)  # order 5: squares of quadratic functions are exact


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
    """Stiffness and mass of a stack of layers.

    Parameters
    ----------
    layers : sequence of Layer
        With materials, from bottom to top.
    nonstructural : float
        Additional mass per area, at the mid-surface [kg/m^2].
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
    k = np.sqrt([_shear_correction(z, C[:, i, i], G[:, i, i]) for i in range(2)])
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


def _shear_correction(z: FloatArray, C: FloatArray, G: FloatArray) -> float:
    """Shear correction factor for cylindrical bending.

    The shear stress that balances the bending stress C (z - z0) of a shear force has a strain
    energy; the factor makes the energy of a uniform shear strain equal to it.
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


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Layer:
    """One layer of a shell.

    Parameters
    ----------
    thickness : float
        m.
    material : Material or OrthotropicMaterial, optional
        The section's, or the body's, if none is given.
    angle : float
        From the section's axis 1 to the material's axis 1, positive about the element normal
        [rad].
    """

    thickness: float
    material: AnyMaterial | None = None
    angle: float = 0.0


@dataclass(frozen=True)
class ShellSection:
    """What plate and shell elements are made of.

    Parameters
    ----------
    layers : tuple of Layer
        From the bottom to the top face, along the element normal.
    offset : float
        Distance of the mid-surface from the surface of the mesh along the element normal [m].
    orientation : (3,) float, optional
        Direction, body frame, whose projection on the element is axis 1 of the section; by default
        the x axis of the body frame, or its y axis where the normal is within 26 degrees of x.
        Without meaning for isotropic materials.
    nonstructural : float
        Mass per area that adds no stiffness, at the mid-surface [kg/m^2].
    material : Material or OrthotropicMaterial, optional
        Of layers that name none.
    shear : bool
        False for a plate without transverse shear strain (Kirchhoff).

    Raises
    ------
    ReductionError
        Values that cannot be, all at once.
    """

    layers: tuple[Layer, ...]
    offset: float = 0.0
    orientation: Vector | None = None
    nonstructural: float = 0.0
    material: AnyMaterial | None = None
    shear: bool = True

    dimension = 2

    def __post_init__(self) -> None:
        problems = [] if self.layers else [Problem("section.layers", "has no layers")]
        for k, layer in enumerate(self.layers):
            where = "section" if len(self.layers) == 1 else f"section.layers[{k}]"
            if not (_finite(layer.thickness) and layer.thickness > 0):
                what = f"must be positive, in m, given {layer.thickness}"
                problems.append(Problem(f"{where}.thickness", what))
            problems += material_problems(f"{where}.material", layer.material)
            if not _finite(layer.angle):
                what = f"must be a number, in rad, given {layer.angle}"
                problems.append(Problem(f"{where}.angle", what))
        problems += material_problems("section.material", self.material)
        if not _finite(self.offset):
            what = f"must be a number, in m, given {self.offset}"
            problems.append(Problem("section.offset", what))
        if not (_finite(self.nonstructural) and self.nonstructural >= 0):
            what = f"must not be negative, in kg/m^2, given {self.nonstructural}"
            problems.append(Problem("section.nonstructural", what))
        if self.orientation is not None:
            numbers = len(self.orientation) == 3 and all(map(_finite, self.orientation))
            if not (numbers and any(self.orientation)):
                what = f"must be three numbers, not all zero, given {self.orientation}"
                problems.append(Problem("section.orientation", what))
        if problems:
            raise ReductionError.from_problems(problems)

    @property
    def has_sides(self) -> bool:
        """Whether it matters to which side the normals point."""
        angled = any(abs(sin(2 * layer.angle)) > 1e-9 for layer in self.layers)
        return self.offset != 0 or angled or self.layers != self.layers[::-1]

    @property
    def has_directions(self) -> bool:
        """Whether it matters where its axis 1 points."""
        return any(isinstance(layer.material, OrthotropicMaterial) for layer in self.layers)

    @property
    def thickness(self) -> float:
        """Of all layers [m]."""
        return sum(layer.thickness for layer in self.layers)

    @cached_property
    def laminate(self) -> Laminate:
        """Stiffness and mass per area.

        Raises
        ------
        ReductionError
            A layer without material.
        """
        layers = self.with_material(None).layers
        missing = [k for k, layer in enumerate(layers) if layer.material is None]
        if missing:
            problems = [Problem(f"section.layers[{k}].material", "is missing") for k in missing]
            raise ReductionError.from_problems(problems)
        return laminate(layers, self.nonstructural)

    def with_material(self, default: AnyMaterial | None) -> ShellSection:
        """The section with the materials of all layers known."""
        general = self.material if self.material is not None else default
        layers = tuple(
            layer if layer.material is not None else replace(layer, material=general)
            for layer in self.layers
        )
        return replace(self, layers=layers, material=general)


def shell(
    thickness: float,
    offset: float = 0.0,
    orientation: Vector | None = None,
    nonstructural: float = 0.0,
    material: AnyMaterial | None = None,
    shear: bool = True,
) -> ShellSection:
    """A shell of one layer of that thickness [m]; the other words are those of ShellSection."""
    return layered([Layer(thickness)], offset, orientation, nonstructural, material, shear)


def layered(
    layers: Sequence[Layer],
    offset: float = 0.0,
    orientation: Vector | None = None,
    nonstructural: float = 0.0,
    material: AnyMaterial | None = None,
    shear: bool = True,
) -> ShellSection:
    """A shell of layers from the bottom to the top; the other words are those of ShellSection."""
    return ShellSection(tuple(layers), offset, orientation, nonstructural, material, shear)


def _finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
