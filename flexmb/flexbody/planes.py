"""Names of the coordinate planes and of the plane a normal belongs to."""

from __future__ import annotations

__all__ = ["PLANES"]

PLANES: dict[str, tuple[float, float, float]] = {
    "xy": (0.0, 0.0, 1.0),
    "yz": (1.0, 0.0, 0.0),
    "zx": (0.0, 1.0, 0.0),
}
"""Coordinate planes of a frame and their normals."""
