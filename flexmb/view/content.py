"""What a picture shows, apart from how it is drawn.

:class:`Content` holds rigid shapes, flexible surfaces with the values that colour them, joints,
ground, colour scale, captions and camera, in global axes [m]. Both renderers, VTK and matplotlib,
take it and show the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.units import SI, UnitSystem
from flexmb.view.camera import Camera
from flexmb.view.shapes import Triangles

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
    color: str  # where no values are shown
    values: Array | None = None  # (n,) what the scale colours, SI; NaN where there is none


_SUITABLE = {  # units by the SI unit: below the limit, times the factor
    "m": ((1e-6, 1e9, "nm"), (1e-3, 1e6, "µm"), (1.0, 1e3, "mm"), (np.inf, 1.0, "m")),
    "Pa": ((1e3, 1.0, "Pa"), (1e6, 1e-3, "kPa"), (1e10, 1e-6, "MPa"), (np.inf, 1e-9, "GPa")),
}


@dataclass(frozen=True)
class Scale:
    """The colour scale of a quantity from 0: its SI value times `factor` is shown in `unit`."""

    largest: float  # SI
    factor: float
    unit: str
    quantity: str = "displacement"

    @classmethod
    def fitting(
        cls, largest: float, units: UnitSystem = SI, unit: str = "m", quantity: str = "displacement"
    ) -> Scale:
        """The scale for a largest value; in SI its unit is the one that suits it."""
        if units is not SI:
            return cls(largest, 1.0 / units.scale(unit), units.label(unit), quantity)
        factor, shown = next(row[1:] for row in _SUITABLE[unit] if largest < row[0])
        return cls(largest, factor, shown, quantity)

    @property
    def label(self) -> str:
        """The quantity with its unit, for the colour bar."""
        return f"{self.quantity} [{self.unit}]" if self.unit else self.quantity

    @property
    def top(self) -> float:
        """The largest value shown, in `unit`."""
        return self.largest * self.factor


@dataclass(frozen=True, eq=False)
class Content:
    """Everything in one picture."""

    title: str
    caption: str
    solids: tuple[Solid, ...]
    deformed: tuple[Deformed, ...]
    joints: Array  # (j, 3)
    joint_radius: float
    scale: Scale | None  # None: no colour by values
    camera: Camera
    bar: bool = True  # whether the scale has its colour bar, if there is one

    def __post_init__(self) -> None:
        shown = any(body.values is not None for body in self.deformed)
        object.__setattr__(self, "bar", self.bar and self.scale is not None and shown)

    def all_points(self) -> Array:
        """Every drawn point (n, 3), to fit the view."""
        parts = [solid.triangles.points for solid in self.solids]
        parts += [body.points for body in self.deformed]
        if len(self.joints):
            parts.append(self.joints)
        return np.vstack(parts) if parts else np.zeros((1, 3))
