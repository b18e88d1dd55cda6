"""A part of a drawing: a shape that never changes, and where it is at each moment.

The place is a transform (4, 4) from the axes of the shape to global ones. It is rigid, but for what
lies between two markers: that is stretched along its z axis, from 0 at the first to 1 at the
second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.view.content import Solid
from flexmb.view.mechanism import Display, transform
from flexmb.view.shapes import Triangles, axes_along

Array = NDArray[np.float64]
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
class Part:
    """A shape with its place, colour, and the name of the body, joint or force that it shows."""

    name: str
    shape: Triangles
    color: str
    place: Place
    role: str = "body"
    opacity: float = 1.0

    def solid(self, display: Display) -> Solid:
        """The part at a moment."""
        place = self.place(display)
        return Solid(self.name, self.shape, self.color, self.opacity, place, self.role)


def at_rest(display: Display) -> Array:
    """The place of what is drawn in global axes."""
    return np.eye(4)


def on_body(body: str) -> Place:
    """In the axes of a body, undeformed."""
    return lambda display: display.frame(body)


def on_marker(reference: str, axes: Array | None = None) -> Place:
    """In the axes of a marker, or in others (3, 3) relative to them."""
    T = np.eye(4) if axes is None else transform(axes, np.zeros(3))
    return lambda display: np.asarray(display.marker(reference) @ T)


def between(first: str, second: str) -> Place:
    """From one marker to another, stretched."""

    def place(display: Display) -> Array:
        a, b = display.point(first), display.point(second)
        axes = axes_along(b - a)
        axes[:, 2] = b - a
        return transform(axes, a)

    return place


def toward(first: str, second: str) -> Place:
    """At one marker, the z axis towards another, not stretched."""

    def place(display: Display) -> Array:
        a = display.point(first)
        return transform(axes_along(display.point(second) - a), a)

    return place
