"""From where to look: along the joint axes of a planar mechanism, slightly from above.

In: a :class:`Mechanism`, a direction, or the points of a body alone. Out: a :class:`Camera`. Up is
against gravity where there is any, else z, else (for a mechanism seen along z) y; a body alone is
seen from aside and above z, or lengthwise above its thinnest extent if it is slender.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ViewError
from flexmb.view.mechanism import Mechanism

Array = NDArray[np.float64]

_ABOVE, _ASIDE = 0.32, 0.22  # slopes by which the eye leaves the joint axis
_PARALLEL = 0.999  # cosine above which two directions count as one
_SLENDER = 2.0  # times its next extent from which a body lies lengthwise
_SPATIAL = np.array([0.45, 0.42, 0.79])  # aside, above, towards, where no plane is preferred


@dataclass(frozen=True)
class Camera:
    """From where the scene is seen, in global axes."""

    direction: tuple[float, float, float]  # from the scene towards the eye, unit length
    up: tuple[float, float, float]

    @property
    def axes(self) -> Array:
        """Rows (3, 3): right, above and towards the eye in the picture."""
        towards = np.array(self.direction)
        right = np.cross(self.up, towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(towards, right), towards])


def mechanism_camera(mechanism: Mechanism, direction: tuple[float, float, float] | None) -> Camera:
    """The camera for a direction from the scene towards the eye, or by the joint axes.

    Raises
    ------
    ViewError
        The direction has no length.
    """
    direction = direction if direction is not None else mechanism.model.view.direction
    if direction is not None:
        towards = _unit_direction(direction)
        return _camera(towards, _up(mechanism, towards))
    normal = _common_axis(mechanism)
    up = _up(mechanism, normal)
    if normal is None:
        back = np.array([0.0, -1.0, 0.0] if abs(up[1]) < _PARALLEL else [0.0, 0.0, 1.0])
        back -= (back @ up) * up
        aside = np.cross(up, back / np.linalg.norm(back))
        frame = np.stack([aside, up, np.cross(aside, up)], axis=1)
        return _camera(frame @ _SPATIAL, up)
    right = np.cross(up, normal) / np.linalg.norm(np.cross(up, normal))
    if right[int(np.argmax(np.abs(right)))] < 0:  # axes usually grow to the right
        normal, right = -normal, -right
    return _camera(normal + _ABOVE * up + _ASIDE * right, up)


def body_camera(points: Array, direction: tuple[float, float, float] | None) -> Camera:
    """The camera for a body alone, points (n, 3), in its own axes.

    Raises
    ------
    ViewError
        The direction has no length.
    """
    if direction is not None:
        towards = _unit_direction(direction)
        ups = (np.eye(3)[axis] for axis in (2, 1))
        return _camera(towards, next(up for up in ups if abs(up @ towards) < _PARALLEL))
    extent = np.ptp(points, axis=0)
    right = int(np.argmax(extent))
    if extent[right] < _SLENDER * np.sort(extent)[1]:
        return _camera(np.array([1.0, -1.0, 1.0]) * _SPATIAL[[0, 2, 1]], np.eye(3)[2])
    others = [axis for axis in (2, 1, 0) if axis != right]  # of equal ones z is up
    up = min(others, key=lambda axis: extent[axis])
    aside, above = np.eye(3)[right], np.eye(3)[up]
    frame = np.stack([aside, above, np.cross(aside, above)], axis=1)
    return _camera(frame @ _SPATIAL, above)


def _unit_direction(direction: tuple[float, float, float]) -> Array:
    towards = np.array(direction, dtype=float)
    length = float(np.linalg.norm(towards))
    if not (np.isfinite(length) and length > 0):
        raise ViewError(f"the direction {tuple(direction)} has no length")
    return np.asarray(towards / length)


def _common_axis(mechanism: Mechanism) -> Array | None:
    """The direction that all turning joints share; None if they share none."""
    turning = [
        mechanism.axes[name]
        for name, spec in mechanism.model.joints.items()
        if spec.type in ("revolute", "cylindrical")
    ]
    if not turning or any(abs(axis @ turning[0]) < _PARALLEL for axis in turning):
        return None
    return turning[0]


def _up(mechanism: Mechanism, towards: Array | None) -> Array:
    candidates = [np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])]
    gravity = mechanism.model.gravity
    if gravity is not None and np.linalg.norm(gravity) > 0:
        candidates.insert(0, -np.array(gravity) / np.linalg.norm(gravity))
    if towards is None:
        return candidates[0]
    return next(up for up in candidates if abs(up @ towards) < _PARALLEL)


def _camera(towards: Array, up: Array) -> Camera:
    t = towards / np.linalg.norm(towards)
    return Camera(
        (float(t[0]), float(t[1]), float(t[2])), (float(up[0]), float(up[1]), float(up[2]))
    )
