"""Bodies: what all have, and rigid ones by their mass properties or a shape.

Everything is in the body frame, which for a mesh is its own frame; ``position`` and ``orientation``
place it in the global frame. Initial velocities are those of markers: ``velocity`` and
``angular_velocity`` at the body's origin, ``initial`` at any other. Velocities that are not given
are computed by the assembly.

A shape gives a volume [m^3] and the inertia per unit mass about its own centre [m^2], in body axes,
in closed form. Source: any table of moments of inertia of solids, e.g. Meriam and Kraige,
Engineering Mechanics: Dynamics, appendix D; of polygons Green's theorem.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import PrivateAttr, ValidationInfo, field_validator, model_validator

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model.markers import Marker, Orientation
from flexmb.model.option_specs import Inertia, MaterialField
from flexmb.model.quantities import (
    AngularVelocity,
    Length,
    Position,
    Quantity,
    Size,
    Sizes,
    Text,
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
    only_one,
    quote,
)
from flexmb.model.surface_mesh import (
    enclosed,
    open_edges,
    pack_surface,
    read_surface,
    unpack_surface,
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

    @property
    def inertia(self) -> NDArray[np.float64]:
        """Moments (3, 3) about the centre over the mass, body axes [m^2]."""
        return np.diag(self.inertia_per_mass)

    @property
    def centroid(self) -> NDArray[np.float64] | None:
        """Its centre of mass (3,) in body axes [m]; None: the shape is placed at that of the
        body."""
        return None


class BoxShape(ShapeSpec):
    """A box with edges along the body axes."""

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


class ExtrusionShape(ShapeSpec):
    """A plate with a straight-edged ``outline`` in body axes, half of its thickness to each side of
    it.

    The points of the outline are x, y across the axis z; y, z across x; z, x across y.
    """

    type: Literal["extrusion"] = "extrusion"
    outline: tuple[tuple[Length, Length], ...]
    thickness: Size
    axis: Literal["x", "y", "z"] = "z"

    @model_validator(mode="after")
    def _check_outline(self) -> Self:
        points = np.array(self.outline, dtype=float).reshape(-1, 2)
        if len(points) < 3:
            raise fail(Problem("outline", f"needs 3 points at least, given {len(points)}"))
        crossing = _crossing(points)
        if crossing is not None:
            what = f"its edges {crossing[0] + 1} and {crossing[1] + 1} cross or touch"
            raise fail(Problem("outline", what))
        return self

    @property
    def volume(self) -> float:
        return _polygon(self.outline)[0] * self.thickness

    @property
    def centroid(self) -> NDArray[np.float64]:
        return np.roll([*_polygon(self.outline)[1], 0.0], "zxy".index(self.axis))

    @property
    def inertia(self) -> NDArray[np.float64]:
        xx, yy, xy = _polygon(self.outline)[2]
        S = np.array([[xx, xy, 0], [xy, yy, 0], [0, 0, self.thickness**2 / 12]])
        turn = "zxy".index(self.axis)
        return np.roll(np.trace(S) * np.eye(3) - S, (turn, turn), axis=(0, 1))


class MeshShape(ShapeSpec):
    """A surface from an STL or VTU ``file`` in body axes; a closed one gives mass properties.

    A length of the file times ``scale`` is one of the scene. ``data`` stands for the file in
    results.
    """

    type: Literal["mesh"] = "mesh"
    file: Text | None = None
    data: Text | None = None
    scale: Annotated[float, Quantity("", "positive")] = 1.0
    _points: NDArray[np.float64] = PrivateAttr()
    _faces: NDArray[np.int64] = PrivateAttr()

    @model_validator(mode="after")
    def _read_surface(self, info: ValidationInfo) -> Self:
        word = only_one(self, "file", "data")
        context = context_of(info)
        try:
            if self.data is not None:
                self._points, self._faces = unpack_surface(self.data)
            else:
                self._points, self._faces = read_surface(context.folder / str(self.file))
        except FlexmbError as error:
            raise fail(Problem(word, str(error))) from None
        factor = 1.0 if self.data is not None else context.units.scale("m")
        self._points = self._points * self.scale * factor
        return self

    @property
    def surface(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Points (n, 3) in body axes [m], and triangles (t, 3)."""
        return self._points, self._faces

    @property
    def volume(self) -> float:
        return enclosed(*self.surface)[0]

    @property
    def centroid(self) -> NDArray[np.float64]:
        return enclosed(*self.surface)[1]

    @property
    def inertia(self) -> NDArray[np.float64]:
        S = enclosed(*self.surface)[2]
        return np.asarray(np.trace(S) * np.eye(3) - S)

    @property
    def packed(self) -> dict[str, Any]:
        """The shape without its file, to be stored with a result."""
        return {"type": "mesh", "data": pack_surface(*self.surface)}


def _polygon(outline: Any) -> tuple[float, NDArray[np.float64], tuple[float, float, float]]:
    """Area, centroid (2,), and second moments xx, yy, xy about the centroid over the area."""
    points = np.array(outline, dtype=float)
    origin = points.mean(axis=0)
    x, y = (points - origin).T
    a, b = np.roll(x, -1), np.roll(y, -1)
    c = x * b - a * y
    area = 0.5 * float(c.sum())
    cx, cy = float((x + a) @ c) / (6 * area), float((y + b) @ c) / (6 * area)
    xx = float((x * x + x * a + a * a) @ c) / (12 * area) - cx * cx
    yy = float((y * y + y * b + b * b) @ c) / (12 * area) - cy * cy
    xy = float((x * b + 2 * x * y + 2 * a * b + a * y) @ c) / (24 * area) - cx * cy
    return abs(area), origin + [cx, cy], (xx, yy, xy)


def _crossing(points: NDArray[np.float64]) -> tuple[int, int] | None:
    """Two edges of a polygon (n, 2) that intersect or touch, though they are not neighbours."""
    n, after = len(points), np.roll(points, -1, axis=0)

    def side(i: int, p: NDArray[np.float64]) -> float:
        u, v = after[i] - points[i], p - points[i]
        return float(u[0] * v[1] - u[1] * v[0])

    for i in range(n):
        for j in range(i + 1, n):
            if (j + 1) % n == i or j == i + 1:  # neighbours: one must not turn back on the other
                u, v = after[i] - points[i], after[j] - points[j]
                if u[0] * v[1] == u[1] * v[0] and u @ v <= 0:
                    return i, j
                continue
            across = side(i, points[j]) * side(i, after[j]), side(j, points[i]) * side(j, after[i])
            if max(across) <= 0 and any(across):
                return i, j
    return None


SHAPES: dict[str, type[ShapeSpec]] = {
    "box": BoxShape,
    "cylinder": CylinderShape,
    "sphere": SphereShape,
    "extrusion": ExtrusionShape,
    "mesh": MeshShape,
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
    "black", "gray", "silver", "white", "maroon", "red", "orange", "gold", "yellow", "olive",
    "green", "lime", "teal", "cyan", "blue", "navy", "purple", "magenta", "pink", "brown",
)  # fmt: skip
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
    def _check_velocities(self) -> Self:
        if self.velocity is None and self.angular_velocity is None:
            raise fail(Problem("", 'give "velocity", "angular_velocity" or both'))
        return self


class BodySpec(Spec):
    """Options of all bodies: place, initial velocity, markers, color."""

    position: Position = (0.0, 0.0, 0.0)
    orientation: Orientation = (1.0, 0.0, 0.0, 0.0)
    velocity: Velocity | None = None
    angular_velocity: AngularVelocity | None = None
    initial: dict[str, Annotated[InitialVelocity, Entry()]] = {}
    markers: dict[str, Marker] = {}
    color: Annotated[str, Reader(_color, form=choice(COLORS))] | None = None

    @field_validator("initial", mode="before")
    @classmethod
    def _check_markers(cls, value: Any) -> Any:
        for word in ("velocity", "angular_velocity") if isinstance(value, dict) else ():
            if isinstance(value.get(word), list | tuple):
                what = f'markers are named here; the body\'s own is "{word}" alone'
                raise fail(Problem(word, what))
        return value

    @model_validator(mode="after")
    def _check_origin(self) -> Self:
        words = [key for key in ("velocity", "angular_velocity") if getattr(self, key) is not None]
        if words and "origin" in self.initial:
            what = f'is the body\'s "{words[0]}" already; say it in one place'
            raise fail(Problem("initial.origin", what))
        return self

    @property
    def initial_velocities(self) -> dict[str, InitialVelocity]:
        """Initial velocities by marker, including that of the origin."""
        if self.velocity is None and self.angular_velocity is None:
            return dict(self.initial)
        origin = InitialVelocity(velocity=self.velocity, angular_velocity=self.angular_velocity)
        return {"origin": origin, **self.initial}

    @property
    def flexible(self) -> bool:
        """Whether the body is deformable: its modes come from a mesh or a reduced body."""
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
        self._check_shape()
        return self

    def _check_shape(self) -> None:
        """A mesh must be closed if mass properties follow from it; a shape with a centre sets
        ``center``."""
        if isinstance(self.shape, MeshShape) and (self.mass is None or self.inertia is None):
            edges = open_edges(self.shape.surface[1])
            if edges or self.shape.volume == 0.0:
                what = f"its surface is not closed: {edges} edges have not two triangles. Close it"
                raise fail(Problem("shape", f'{what}, or give "mass" and "inertia"'))
        centroid = None if self.shape is None else self.shape.centroid
        if (
            self.shape is None
            or centroid is None
            or (self.inertia is not None and "center" in self.model_fields_set)
        ):
            return
        apart = float(np.linalg.norm(np.array(self.center) - centroid))
        if "center" in self.model_fields_set and apart > 1e-5 * self.shape.volume ** (1 / 3):
            raise fail(Problem("center", "follows from the shape; leave it out"))
        x, y, z = centroid.tolist()
        object.__setattr__(self, "center", (x, y, z))

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
        inertia = mass * self.shape.inertia
        return MassProperties(mass, np.array(self.center), inertia)
