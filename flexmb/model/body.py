"""Bodies: what all have, and rigid ones by their mass properties or a shape.

Everything in the body frame, for a mesh its own frame; ``position`` and ``orientation`` place it in
the global one. Initial velocities are those of markers: ``velocity`` and ``angular_velocity`` at
the body's origin, ``initial`` at any other; where none is given the assembly is free to choose.

A shape gives a volume [m^3] and the inertia per unit mass about its own centre [m^2], in body axes,
in closed form. Source: any table of moments of inertia of solids, e.g. Meriam and Kraige,
Engineering Mechanics: Dynamics, appendix D.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo, model_validator

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model.markers import Marker, Orientation
from flexmb.model.option_specs import Inertia, MaterialField
from flexmb.model.quantities import (
    AngularVelocity,
    Position,
    Quantity,
    Size,
    Sizes,
    Velocity,
)
from flexmb.model.reading import (
    Entry,
    Reader,
    Spec,
    Variant,
    choice,
    context_of,
    fail,
    quote,
)
from flexmb.units import UNIT_SYSTEMS, unit_system

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


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass [kg], centre of mass (3,) in the body frame [m], inertia (3, 3) about it [kg m^2]."""

    mass: float
    center: NDArray[np.float64]
    inertia: NDArray[np.float64]


def _read_units(value: Any, info: ValidationInfo) -> str:
    if value == "scene":
        return context_of(info).units.name
    try:
        return unit_system(value).name
    except FlexmbError as error:
        first = error.problems[0]
        raise fail(Problem("", first.what, first.allowed, first.nearest)) from None


UnitsName = Annotated[str, Reader(_read_units, form=choice(UNIT_SYSTEMS))]
"""Name of a unit system; ``"scene"`` for the scene's own."""


COLORS = (
    "black",
    "gray",
    "silver",
    "white",
    "maroon",
    "red",
    "orange",
    "gold",
    "yellow",
    "olive",
    "green",
    "lime",
    "teal",
    "cyan",
    "blue",
    "navy",
    "purple",
    "magenta",
    "pink",
    "brown",
)
_HEX = re.compile(r"#[0-9a-fA-F]{6}\Z")


def _color(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str) or not (value in COLORS or _HEX.match(value)):
        near = nearest(str(value), COLORS)
        raise fail(Problem("", f"unknown color {quote(value)}", ("#rrggbb", *COLORS), near))
    return value


class InitialVelocity(Spec):
    """Velocity and angular velocity of a marker at the start, either or both.

    Components along global axes, or with ``axes = "body"`` along the marker's own.
    """

    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None
    axes: Literal["global", "body"] = "global"

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.velocity is None and self.angular_velocity is None:
            raise fail(Problem("", 'give "velocity", "angular_velocity" or both'))
        return self


class BodySpec(Spec):
    """What all bodies have: place, initial velocity, markers, color."""

    position: Position = (0.0, 0.0, 0.0)
    orientation: Orientation = (1.0, 0.0, 0.0, 0.0)
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None
    initial: dict[str, Annotated[InitialVelocity, Entry()]] = {}
    markers: dict[str, Marker] = {}
    color: Annotated[str, Reader(_color, form=choice(COLORS))] | None = None

    @model_validator(mode="after")
    def _check_origin(self) -> Self:
        words = [key for key in ("velocity", "angular_velocity") if getattr(self, key) is not None]
        if words and "origin" in self.initial:
            what = f'is the body\'s "{words[0]}" already; say it in one place'
            raise fail(Problem("initial.origin", what))
        return self

    @property
    def initial_velocities(self) -> dict[str, InitialVelocity]:
        """Initial velocities by marker, those of the origin among them."""
        if self.velocity is None and self.angular_velocity is None:
            return dict(self.initial)
        origin = InitialVelocity(velocity=self.velocity, angular_velocity=self.angular_velocity)
        return {"origin": origin, **self.initial}

    @property
    def flexible(self) -> bool:
        """Whether its modes come from a mesh or a reduced body."""
        return not isinstance(self, RigidBodySpec)


class RigidBodySpec(BodySpec):
    """A rigid body: mass and inertia, or a shape with a density, a material or the mass."""

    mass: Annotated[float, Quantity("kg", "positive")] | None = None
    center: Position = (0.0, 0.0, 0.0)
    inertia: Inertia | None = None
    shape: Shape | None = None
    density: Annotated[float, Quantity("kg/m^3", "positive")] | None = None
    material: MaterialField | None = None

    @model_validator(mode="after")
    def _check_mass(self) -> Self:
        words = [key for key in ("mass", "density", "material") if getattr(self, key) is not None]
        names = " and ".join(f'"{key}"' for key in words)
        if len(words) > 1:
            raise fail(Problem("", f"the mass is given twice, by {names}"))
        if not words:
            what = 'has no mass: give "mass" and "inertia", or a "shape" with "density", '
            raise fail(Problem("", what + '"material" or "mass"; or "mesh" for a flexible body'))
        if self.shape is None and self.mass is None:
            raise fail(Problem("", f"{names} needs a shape"))
        if self.shape is None and self.inertia is None:
            raise fail(Problem("inertia", "is missing (or give a shape to compute it from)"))
        if self.mass is None and self.inertia is not None:
            raise fail(Problem("inertia", f"follows from the shape and {names}; leave it out"))
        return self

    @property
    def mass_properties(self) -> MassProperties:
        """Mass, centre and inertia about the centre, as given or from the shape."""
        density = self.material.density if self.material is not None else self.density
        mass = self.mass
        if mass is None:
            assert density is not None and self.shape is not None  # checked when it was read
            mass = density * self.shape.volume
        if self.inertia is not None:
            return MassProperties(mass, np.array(self.center), np.array(self.inertia))
        assert self.shape is not None
        inertia = mass * np.diag(self.shape.inertia_per_mass)
        return MassProperties(mass, np.array(self.center), inertia)
