"""Sections of plates and shells: layers, offset, material directions, further mass.

In: thicknesses in metres, materials. Out: a :class:`ShellSection`. The element normal follows from
the order of an element's nodes by the right-hand rule; bottom and top are named by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from numbers import Real

from flexmb.errors import Problem, ReductionError
from flexmb.fe.sections.laminate import Laminate, laminate
from flexmb.materials import AnyMaterial

__all__ = ["Layer", "ShellSection", "layered", "shell"]

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
            if not _finite(layer.angle):
                what = f"must be a number, in rad, given {layer.angle}"
                problems.append(Problem(f"{where}.angle", what))
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
