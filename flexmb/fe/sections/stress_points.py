"""Places across a beam's section where stress is told.

In: a place and what a torque and shear forces cause there. Out: :class:`StressPoint`. The axial
stress follows from the place alone: N/A + My z/Iy - Mz y/Iz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Place", "StressPoint", "rotated"]

Place = tuple[float, float]
Three = tuple[float, float, float]


@dataclass(frozen=True)
class StressPoint:
    """One place.

    Parameters
    ----------
    name : str
        Name of the stress layer.
    y, z : float
        From the centroid, principal axes [m].
    xy, xz : (3,) float
        Shear stress along y and z per torque T [1/m^3] and per shear forces Vy, Vz [1/m^2].
    """

    name: str
    y: float
    z: float
    xy: Three = (0.0, 0.0, 0.0)
    xz: Three = (0.0, 0.0, 0.0)


def rotated(place: Place, angle: float) -> Place:
    """A place in axes turned by ``angle`` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return c * place[0] + s * place[1], c * place[1] - s * place[0]
