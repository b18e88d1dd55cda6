"""What a planar model keeps: columns of the bodies, and rows and triads of the joints.

Triads in a plane have the normal for z and, if the joint slides, its axis for x; the orientation is
then one angle row, which has no second branch at 180°, and sliding leaves one offset row.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmb.engine.tables import ANGLE, DOT2, POINT
from flexmb.flexbody.planes import PLANES
from flexmb.model.bodies import BodySpec
from flexmb.model.joints import JointSpec
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model
from flexmb.model.names import GROUND
from flexmb.model.orientation import rotation_matrix
from flexmb.model.plane import across, normal_in_body, plane_axes

__all__ = ["STROKE", "planar_columns", "planar_joint"]

X, Y = 0, 1
_ORIENTATION = (ANGLE, X, X)
_OFFSET = (DOT2, Y, Y)
STROKE = (DOT2, X, X)
"""The stroke of a joint on its planar triads."""

Rows = tuple[tuple[int, int, int], ...]


def planar_columns(spec: BodySpec, plane: str, m: int) -> list[int]:
    """Column of each velocity coordinate of a body with m modes, −1 out of the plane."""
    first, second, _ = plane_axes(plane)
    about = int(np.argmax(np.abs(normal_in_body(spec, plane))))
    columns = [-1] * 6
    for k, coordinate in enumerate((first, second, 3 + about)):
        columns[coordinate] = m + k
    return [*columns, *range(m)]


def planar_joint(
    model: Model,
    joint: JointSpec,
    I: PlacedMarker,  # noqa: E741
    J: PlacedMarker,
) -> tuple[PlacedMarker, PlacedMarker, Rows]:
    """Triads and rows of a joint in the plane, from those in space."""
    plane = model.plane
    assert plane is not None  # the caller knows
    first, second, _ = plane_axes(plane)
    together = ((POINT, first, first), (POINT, second, second))
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    triad = A @ I.R
    if joint.type == "fixed":
        lies = [k for k in range(3) if not across(triad[:, k], plane)]
        turn = _turn(triad, triad[:, lies[0]], plane)
        return _turned(I, turn), _turned(J, turn), (*together, _ORIENTATION)
    slides = joint.type == "prismatic" or (
        joint.type == "cylindrical" and not across(triad[:, 2], plane)
    )
    if slides:
        turn = _turn(triad, triad[:, 2], plane)
        return _turned(I, turn), _turned(J, turn), (_ORIENTATION, _OFFSET)
    return I, J, together


def _turn(triad: np.ndarray, axis: np.ndarray, plane: str) -> np.ndarray:
    """Turn (3, 3) of a triad in its own axes that leads z to the normal and x along the axis."""
    z = np.array(PLANES[plane])
    x = axis - (axis @ z) * z
    x /= np.linalg.norm(x)
    turn: np.ndarray = triad.T @ np.column_stack([x, np.cross(z, x), z])
    return turn


def _turned(marker: PlacedMarker, turn: np.ndarray) -> PlacedMarker:
    return replace(marker, R=marker.R @ turn)
