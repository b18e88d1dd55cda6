"""Shapes of rigid bodies: what is drawn, and what mass properties follow from a density.

In: dimensions in m. Out: volume [m^3] and the inertia per unit mass about the shape's own centre
[m^2], in body axes, in closed form. Source: any table of moments of inertia of solids, e.g. Meriam
and Kraige, Engineering Mechanics: Dynamics, appendix D.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from flexmb.model.values.quantities import Size, Sizes
from flexmb.model.values.reading import Spec, Variant

__all__ = ["SHAPES", "BoxShape", "CylinderShape", "Shape", "ShapeSpec", "SphereShape"]

Diagonal = tuple[float, float, float]


class ShapeSpec(Spec):
    """Base of the shapes."""

    @property
    def volume(self) -> float:
        """m^3"""
        raise NotImplementedError

    @property
    def inertia_per_mass(self) -> Diagonal:
        """Principal moments about the centre over the mass, body axes [m^2]."""
        raise NotImplementedError


class BoxShape(ShapeSpec):
    """A box, its edges along the body axes."""

    type: Literal["box"] = "box"
    size: Sizes

    @property
    def volume(self) -> float:
        x, y, z = self.size
        return x * y * z

    @property
    def inertia_per_mass(self) -> Diagonal:
        x, y, z = self.size
        return ((y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12)


class CylinderShape(ShapeSpec):
    """A solid circular cylinder along a body axis."""

    type: Literal["cylinder"] = "cylinder"
    radius: Size
    length: Size
    axis: Literal["x", "y", "z"] = "z"

    @property
    def volume(self) -> float:
        return math.pi * self.radius**2 * self.length

    @property
    def inertia_per_mass(self) -> Diagonal:
        across = self.radius**2 / 4 + self.length**2 / 12
        moments = [across, across, across]
        moments["xyz".index(self.axis)] = self.radius**2 / 2
        return (moments[0], moments[1], moments[2])


class SphereShape(ShapeSpec):
    """A solid sphere."""

    type: Literal["sphere"] = "sphere"
    radius: Size

    @property
    def volume(self) -> float:
        return 4 / 3 * math.pi * self.radius**3

    @property
    def inertia_per_mass(self) -> Diagonal:
        moment = 0.4 * self.radius**2
        return (moment, moment, moment)


SHAPES: dict[str, type[ShapeSpec]] = {
    "box": BoxShape,
    "cylinder": CylinderShape,
    "sphere": SphereShape,
}

Shape = Annotated[Any, Variant("shape", lambda: SHAPES)]
