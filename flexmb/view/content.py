"""What a picture shows, apart from how it is drawn.

In: nothing but numbers. Out: :class:`Content`: rigid shapes, flexible surfaces with their
displacements, joints, ground, colour scale, captions and camera, in global axes [m]. Both ways of
drawing, VTK and matplotlib, take it and show the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmb.units import SI, UnitSystem
from flexmb.view.geometry import Triangles

__all__ = ["Camera", "Content", "Deformed", "Scale", "Solid"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solid:
    """A rigid shape in one colour."""

    name: str
    triangles: Triangles
    color: str
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Deformed:
    """A flexible body: its drawn (exaggerated) and undeformed points, true displacements."""

    name: str
    points: Array  # (n, 3) with the deformation exaggerated
    undeformed: Array  # (n, 3) moved rigidly with the body frame
    faces: NDArray[np.int64]  # (t, 3)
    lines: NDArray[np.int64]  # (l, 2)
    displacement: Array  # (n,) magnitude relative to the body frame [m], not exaggerated
    color: str  # where the displacement is not shown by colour


@dataclass(frozen=True)
class Scale:
    """The colour scale of displacements: true [m] times `factor` is shown in `unit`."""

    largest: float  # m
    factor: float
    unit: str

    @classmethod
    def fitting(cls, largest: float, units: UnitSystem = SI) -> Scale:
        """The scale for a largest displacement [m]; in SI its unit is the one that suits it."""
        if units is not SI:
            return cls(largest, 1.0 / units.length, units.label("m"))
        for limit, factor, unit in ((1e-6, 1e9, "nm"), (1e-3, 1e6, "µm"), (1.0, 1e3, "mm")):
            if largest < limit:
                return cls(largest, factor, unit)
        return cls(largest, 1.0, "m")

    @property
    def top(self) -> float:
        """The largest value shown, in `unit`."""
        return self.largest * self.factor


@dataclass(frozen=True)
class Camera:
    """From where the scene is seen, in global axes."""

    direction: tuple[float, float, float]  # from the scene towards the eye, unit length
    up: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Content:
    """Everything in one picture."""

    title: str
    caption: str
    solids: tuple[Solid, ...]
    deformed: tuple[Deformed, ...]
    joints: Array  # (j, 3)
    joint_radius: float
    scale: Scale | None  # None: no colour by displacement
    camera: Camera
    notes: tuple[str, ...] = field(default=())

    def all_points(self) -> Array:
        """Every drawn point (n, 3), to fit the view."""
        parts = [solid.triangles.points for solid in self.solids]
        parts += [body.points for body in self.deformed]
        if len(self.joints):
            parts.append(self.joints)
        return np.vstack(parts) if parts else np.zeros((1, 3))
