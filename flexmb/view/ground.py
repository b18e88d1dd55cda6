"""What ground looks like: a pedestal under what turns on it, a rail along what slides on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.model.values.names import GROUND, split_reference
from flexmb.view.content import Camera
from flexmb.view.contours import contours
from flexmb.view.geometry import Triangles, box, joined, tube
from flexmb.view.mechanism import Mechanism

__all__ = ["ground", "is_ground"]

# as shares of the mechanism's size: radius of a rail, how far behind a cam its pedestal stands
_RAIL, _BEHIND = 0.005, 0.08


def ground(mechanism: Mechanism, size: float, camera: Camera) -> list[Triangles]:
    """The shapes of ground, its curves among them."""
    shapes = contours(mechanism, GROUND, size)
    for name, spec in mechanism.model.joints.items():
        grounded = [ref for ref in spec.between if is_ground(ref)]
        if not grounded or spec.curves:
            continue
        if spec.type in ("prismatic", "cylindrical"):
            shapes.append(_rail(mechanism, name, size))
        else:
            point = mechanism.point(grounded[0])
            held = [ref for ref in spec.between if not is_ground(ref)]
            if held and contours(mechanism, split_reference(held[0])[0], size):  # behind a cam
                point = point - _BEHIND * size * np.array(camera.direction)
            shapes.append(_pedestal(point, size, camera))
    return shapes


def _rail(mechanism: Mechanism, joint: str, size: float) -> Triangles:
    """A bar along the axis, over all the way that the sliding body goes."""
    spec, axis = mechanism.model.joints[joint], mechanism.axes[joint]
    moving = next((ref for ref in spec.between if not is_ground(ref)), spec.between[0])
    low, high = mechanism.travel(moving, axis)
    start = next(mechanism.point(ref) for ref in spec.between if is_ground(ref))
    start = start - (start @ axis) * axis
    over = 0.08 * size
    return tube(start + (low - over) * axis, start + (high + over) * axis, _RAIL * size)


def _pedestal(point: NDArray[np.float64], size: float, camera: Camera) -> Triangles:
    """A post and a plate under a point."""
    up = np.array(camera.up)
    across = np.cross(up, camera.direction)
    across /= np.linalg.norm(across)
    axes = np.stack([across, up, np.cross(across, up)], axis=1)
    post = box(np.array([0.03, 0.07, 0.03]) * size).moved([0, -0.035 * size, 0], np.eye(3))
    plate = box(np.array([0.14, 0.012, 0.09]) * size).moved([0, -0.076 * size, 0], np.eye(3))
    return joined([post, plate]).moved(point, axes)


def is_ground(reference: str) -> bool:
    """Whether a marker is on ground."""
    return split_reference(reference)[0] == GROUND
