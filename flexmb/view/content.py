"""The content of a picture, independent of the renderer; and parts, of which drawings consist.

:class:`Content` has shapes with their positions, flexible surfaces with the values that colour
them, names, colour scale, captions and camera, in global axes [m]. All renderers take it and show
the same. Within one :class:`~flexmb.view.drawing.Drawing` the shapes at two times are the same
objects at different positions, so that a film only moves them. A :class:`Part` has a transform (4,
4) from its axes to global ones for each moment. The transform is rigid, except for parts between
two markers: these are stretched along their z axis, from 0 at the first marker to 1 at the second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from flexmb.flexbody.arrays import Array, IntArray
from flexmb.units import SI, UnitSystem
from flexmb.view.camera import Camera
from flexmb.view.mechanism import Display, applied, transform
from flexmb.view.shapes import Triangles, axes_along, sharp_edges

_SUITABLE = {  # by SI unit: (limit, factor, unit) for values below the limit
    "m": ((1e-6, 1e9, "nm"), (1e-3, 1e6, "µm"), (1.0, 1e3, "mm"), (np.inf, 1.0, "m")),
    "Pa": ((1e3, 1.0, "Pa"), (1e6, 1e-3, "kPa"), (1e10, 1e-6, "MPa"), (np.inf, 1e-9, "GPa")),
    "J/m^3": ((1e3, 1.0, "J/m³"), (1e6, 1e-3, "kJ/m³"), (np.inf, 1e-6, "MJ/m³")),
    "N": ((1e3, 1.0, "N"), (1e6, 1e-3, "kN"), (np.inf, 1e-6, "MN")),
    "N m": ((1e3, 1.0, "N m"), (1e6, 1e-3, "kN m"), (np.inf, 1e-6, "MN m")),
}
_NO_MOTION = 1e-13  # displacement over size below which it is round-off
Place = Callable[[Display], Array]
PIN = "#e07b24"
HOUSING = "#4b5260"
SPRING = "#2f6f9f"
DAMPER = "#6b7280"
RUBBER = "#3a3a3f"
FRICTION = "#9f3a26"
DRIVE = "#0f766e"
SURFACE = "#b8a77d"
GROUND = "#8f8b82"


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid shape in one colour; `matrix` (4, 4) transforms its points to global axes."""

    name: str
    triangles: Triangles
    color: str
    opacity: float = 1.0
    matrix: Array = field(default_factory=lambda: np.eye(4))
    role: str = "body"  # body, joint, force, ground, arrow or grid

    @property
    def points(self) -> Array:
        """Global points (n, 3)."""
        return applied(self.matrix, self.triangles.points)


@dataclass(frozen=True, eq=False)
class Deformed:
    """A flexible body: its drawn (exaggerated) and undeformed points, and its true
    displacements."""

    name: str
    points: Array  # (n, 3) with the deformation exaggerated
    undeformed: Array  # (n, 3) undeformed, at the pose of the body's reference
    faces: IntArray  # (t, 3)
    lines: IntArray  # (l, 2)
    displacement: Array  # (n,) magnitude relative to the reference [m], not exaggerated
    color: str  # used if no values are shown
    values: Array | None = None  # (n,) values for the colour scale, SI; NaN where there are none
    opacity: float = 1.0
    sharp: IntArray | None = None  # (e, 2) its sharp edges, if they are known

    @property
    def edges(self) -> IntArray:
        """Point pairs (e, 2) of its sharp edges and borders."""
        return sharp_edges(self.undeformed, self.faces) if self.sharp is None else self.sharp

    @property
    def bends(self) -> bool:
        """Whether it is displaced by more than round-off."""
        size = float(np.linalg.norm(np.ptp(self.undeformed, axis=0)))
        return float(self.displacement.max()) > _NO_MOTION * size


@dataclass(frozen=True, eq=False)
class Trace:
    """The path (n, 3) of a point through a motion."""

    name: str
    points: Array
    color: str


@dataclass(frozen=True)
class Label:
    """A text at a point (3,)."""

    text: str
    point: Array
    color: str


@dataclass(frozen=True)
class Scale:
    """The colour scale of a quantity: SI values times `factor` are shown in `unit`."""

    largest: float  # SI
    factor: float
    unit: str
    quantity: str = "displacement"
    least: float = 0.0  # SI

    @classmethod
    def fitting(
        cls,
        largest: float,
        units: UnitSystem = SI,
        unit: str = "m",
        quantity: str = "displacement",
        least: float = 0.0,
    ) -> Scale:
        """The scale for a largest value; in SI with a suitable unit."""
        if units is not SI:
            return cls(largest, 1.0 / units.scale(unit), units.label(unit), quantity, least)
        size = max(abs(largest), abs(least))
        factor, shown = next(row[1:] for row in _SUITABLE[unit] if size < row[0])
        return cls(largest, factor, shown, quantity, least)

    @property
    def label(self) -> str:
        """The quantity with its unit, for the colour bar."""
        return f"{self.quantity} [{self.unit}]" if self.unit else self.quantity

    @property
    def top(self) -> float:
        """The largest value shown, in `unit`."""
        return self.largest * self.factor

    @property
    def limits(self) -> tuple[float, float]:
        """The values at both ends of the colours, in `unit`."""
        low, high = self.least * self.factor, self.top
        return (low, high) if high > low else (low, low + 1.0)

    def shares(self, values: Array) -> Array:
        """Values (n,) in SI as fractions of the scale, 0 to 1."""
        low, high = self.limits
        return np.asarray((values * self.factor - low) / (high - low))


@dataclass(frozen=True, eq=False)
class Content:
    """Everything that one picture shows."""

    title: str
    caption: str
    solids: tuple[Solid, ...]
    deformed: tuple[Deformed, ...]
    scale: Scale | None  # None: no colours by values
    camera: Camera
    bar: bool = True  # whether a colour bar is drawn, if there is a scale
    labels: tuple[Label, ...] = ()
    traces: tuple[Trace, ...] = ()
    extent: Array | None = None  # (n, 3) points the view is fitted to; None: all drawn points
    zoom: float = 1.0
    font_scale: float = 1.0
    outline: bool = True  # whether the undeformed bodies are shown

    def __post_init__(self) -> None:
        shown = any(body.values is not None for body in self.deformed)
        object.__setattr__(self, "bar", self.bar and self.scale is not None and shown)

    def all_points(self) -> Array:
        """Every drawn point (n, 3)."""
        parts = [solid.points for solid in self.solids if solid.role != "grid"]
        parts += [body.points for body in self.deformed]
        parts += [trace.points for trace in self.traces]
        return np.vstack(parts) if parts else np.zeros((1, 3))

    def fitted_points(self) -> Array:
        """Points (n, 3) that the view is fitted to."""
        if self.extent is None:
            return self.all_points()
        return np.vstack([self.extent, *(trace.points for trace in self.traces)])


@dataclass(frozen=True, eq=False)
class Part:
    """A shape with its position, colour, and the name of the body, joint or force that it shows."""

    name: str
    shape: Triangles
    color: str
    place: Place
    role: str = "body"
    opacity: float = 1.0

    def solid(self, display: Display) -> Solid:
        """The part at a moment, as a solid."""
        place = self.place(display)
        return Solid(self.name, self.shape, self.color, self.opacity, place, self.role)


def at_rest(display: Display) -> Array:
    """The transform of a part in global axes."""
    return np.eye(4)


def on_body(body: str) -> Place:
    """The transform of a part in the axes of an undeformed body."""
    return lambda display: display.frame(body)


def on_marker(reference: str, axes: Array | None = None) -> Place:
    """The transform of a part in the axes of a marker, or in axes (3, 3) relative to the marker."""
    T = np.eye(4) if axes is None else transform(axes, np.zeros(3))
    return lambda display: np.asarray(display.marker(reference) @ T)


def between(first: str, second: str) -> Place:
    """The transform of a part from one marker to another, stretched along z."""

    def place(display: Display) -> Array:
        a, b = display.point(first), display.point(second)
        axes = axes_along(b - a)
        axes[:, 2] = b - a
        return transform(axes, a)

    return place


def toward(first: str, second: str) -> Place:
    """The transform of a part at one marker, with z towards another one, not stretched."""

    def place(display: Display) -> Array:
        a = display.point(first)
        return transform(axes_along(display.point(second) - a), a)

    return place
