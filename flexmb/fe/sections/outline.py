"""The outline of a beam's section, for pictures.

In: a section. Out: convex polygons that make it up, about its centroid along its principal axes; a
section that is known by its values alone is drawn as the rectangle with its radii of gyration.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flexmb.fe.sections.angle import Angle
from flexmb.fe.sections.beam_shapes import Rectangle, Tube
from flexmb.fe.sections.thin_walls import Box, ISection
from flexmb.flexbody.arrays import FloatArray

__all__ = ["outline"]

_AROUND = 16  # corners of a drawn circle


def outline(section: Any) -> list[FloatArray]:
    """Polygons (p, 2), y and z from the centroid along the principal axes [m], anticlockwise."""
    shape = section.shape
    if isinstance(shape, Tube):
        angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
        return [shape.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)]
    if isinstance(shape, ISection | Box | Angle):
        parts = [_rectangle(*part) for part in _walls(shape)]
    elif isinstance(shape, Rectangle):
        parts = [_rectangle(-shape.y / 2, -shape.z / 2, shape.y, shape.z)]
    else:
        y, z = (math.sqrt(12 * value / section.A) for value in (section.Iz, section.Iy))
        return [_rectangle(-y / 2, -z / 2, y, z)]
    areas = np.array([np.prod(np.ptp(part, axis=0)) for part in parts])
    middle = areas @ [part.mean(axis=0) for part in parts] / areas.sum()
    c, s = math.cos(section.angle), math.sin(section.angle)
    return [(part - middle) @ np.array([[c, -s], [s, c]]) for part in parts]


def _walls(shape: ISection | Box | Angle) -> list[tuple[float, float, float, float]]:
    """Least y and z and the sizes of the rectangles that a thin-walled section is made of."""
    if isinstance(shape, ISection):
        clear = shape.height - shape.flange - shape.bottom_flange
        return [
            (-shape.bottom_width / 2, 0.0, shape.bottom_width, shape.bottom_flange),
            (-shape.web / 2, shape.bottom_flange, shape.web, clear),
            (-shape.width / 2, shape.height - shape.flange, shape.width, shape.flange),
        ]
    y, z, web, flange = shape.y, shape.z, shape.web, shape.flange
    if isinstance(shape, Angle):
        return [(0.0, 0.0, y, flange), (0.0, flange, web, z - flange)]
    inner = z - 2 * flange
    return [
        (0.0, 0.0, y, flange),
        (0.0, z - flange, y, flange),
        (0.0, flange, web, inner),
        (y - web, flange, web, inner),
    ]


def _rectangle(y: float, z: float, width: float, height: float) -> FloatArray:
    return np.array([[y, z], [y + width, z], [y + width, z + height], [y, z + height]])
