"""Sections of plates and shells: layers, offset, material directions, further mass.

In: thicknesses in metres, materials. Out: a :class:`ShellSection`. The element normal follows from
the order of an element's nodes by the right-hand rule; bottom and top are named by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.material import MaterialLike, resolve
from flexmb.fe.sections.laminate import Laminate, laminate
from flexmb.materials import AnyMaterial, OrthotropicMaterial

__all__ = ["Layer", "ShellSection", "shell"]

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
            if not (isfinite(layer.thickness) and layer.thickness > 0):
                what = f"must be positive, given {layer.thickness:g} m"
                problems.append(Problem(f"{where}.thickness", what))
            if not isfinite(layer.angle):
                problems.append(Problem(f"{where}.angle", f"must be finite, given {layer.angle}"))
        if not isfinite(self.offset):
            problems.append(Problem("section.offset", f"must be finite, given {self.offset} m"))
        if not (isfinite(self.nonstructural) and self.nonstructural >= 0):
            what = f"must not be negative, given {self.nonstructural:g} kg/m^2"
            problems.append(Problem("section.nonstructural", what))
        if self.orientation is not None:
            direction = np.asarray(self.orientation, dtype=float)
            if direction.shape != (3,) or not 0 < np.linalg.norm(direction) < np.inf:
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
        """Stiffness and mass per area; every layer must have its material."""
        return laminate(self.with_material(None).layers, self.nonstructural)

    def with_material(self, default: AnyMaterial | None) -> ShellSection:
        """The section with the materials of all layers known."""
        general = self.material if self.material is not None else default
        layers = tuple(
            layer if layer.material is not None else replace(layer, material=general)
            for layer in self.layers
        )
        return replace(self, layers=layers, material=general)


def shell(
    thickness: float | None = None,
    layers: Sequence[Layer | Mapping[str, Any]] | None = None,
    *,
    offset: float = 0.0,
    orientation: Vector | None = None,
    nonstructural: float = 0.0,
    material: MaterialLike | OrthotropicMaterial | None = None,
    shear: bool = True,
) -> ShellSection:
    """A shell section of one layer of that thickness [m], or of several layers.

    ``layers`` are :class:`Layer` objects or mappings with their words; the other words are those of
    :class:`ShellSection`.

    Raises
    ------
    ReductionError
        Neither or both of ``thickness`` and ``layers`` given, or values that cannot be.
    MaterialError
        An unknown material.
    """
    if (thickness is None) == (layers is None):
        what = "a shell needs either thickness or layers"
        raise ReductionError.from_problems([Problem("section", what)])
    stack = [Layer(thickness)] if thickness is not None else _layers(layers or ())
    place = None if orientation is None else tuple(orientation)
    return ShellSection(tuple(stack), offset, place, nonstructural, _material(material), shear)


def _layers(given: Sequence[Layer | Mapping[str, Any]]) -> list[Layer]:
    words, problems, found = tuple(field.name for field in fields(Layer)), [], []
    for k, layer in enumerate(given):
        if isinstance(layer, Layer):
            found.append(layer)
            continue
        where = f"section.layers[{k}]"
        wrong = [key for key in layer if key not in words]
        problems += [
            Problem(f"{where}.{key}", "unknown key", words, nearest(key, words)) for key in wrong
        ]
        if "thickness" not in layer:
            problems.append(Problem(f"{where}.thickness", "is missing"))
        elif not wrong:
            material = _material(layer.get("material"))
            found.append(Layer(layer["thickness"], material, layer.get("angle", 0.0)))
    if problems:
        raise ReductionError.from_problems(problems)
    return found


def _material(given: MaterialLike | OrthotropicMaterial | None) -> AnyMaterial | None:
    if given is None or isinstance(given, OrthotropicMaterial):
        return given
    return resolve(given)
