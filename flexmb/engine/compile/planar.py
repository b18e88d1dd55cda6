"""What a planar model keeps: columns of the bodies, and rows and triads of the joints.

Triads in a plane have the normal for z and, if the joint slides, its axis for x; the orientation is
then one angle row, which has no second branch at 180°, and sliding leaves one offset row.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmb.engine.row_kinds import ANGLE, DISTANCE, DOT2, POINT
from flexmb.flexbody.planar_body import PLANES
from flexmb.model.bodies.body import BodySpec
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.joints.joint import JointSpec
from flexmb.model.model import Model
from flexmb.model.plane import across, normal_in_body, plane_axes
from flexmb.model.values.names import GROUND
from flexmb.model.values.orientation import rotation_matrix

__all__ = ["STROKE", "normal_axis", "planar_columns", "planar_joint"]

X, Y = 0, 1
_ORIENTATION = (ANGLE, X, X, False)
_OFFSET = (DOT2, Y, Y, False)
_LINK = ((DISTANCE, X, X, True),)
_SLIDING = {  # with their axis in the plane, which becomes x
    "prismatic": (_ORIENTATION, _OFFSET),
    "cylindrical": (_ORIENTATION, _OFFSET),
    "in-line": (_OFFSET,),
    "prismatic-spherical": ((DOT2, Y, Y, True),),
    "in-plane": ((DOT2, X, X, False),),
}
_LINKED = {"distance": _LINK, "revolute-revolute": _LINK}
STROKE = (DOT2, X, X)
"""The stroke of a joint on its planar triads."""

Rows = tuple[tuple[int, int, int, bool], ...]


def normal_axis(spec: BodySpec, plane: str) -> int:
    """The axis of a body that points along the normal of the plane, or against it."""
    return int(np.argmax(np.abs(normal_in_body(spec, plane))))


def planar_columns(spec: BodySpec, plane: str, m: int) -> list[int]:
    """Column of each velocity coordinate of a body with m modes, −1 out of the plane."""
    first, second, _ = plane_axes(plane)
    about = normal_axis(spec, plane)
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
    together = ((POINT, first, first, False), (POINT, second, second, False))
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    triad = A @ I.R
    if joint.type in ("fixed", "orientation"):
        lies = [k for k in range(3) if not across(triad[:, k], plane)]
        turn = _turn(triad, triad[:, lies[0]], plane)
        rows = (*together, _ORIENTATION) if joint.type == "fixed" else (_ORIENTATION,)
        return _turned(I, turn), _turned(J, turn), rows
    slides = _SLIDING.get(joint.type)
    if joint.type == "cylindrical" and across(triad[:, 2], plane):
        slides = None
    if slides is not None:
        turn = _turn(triad, triad[:, 2], plane)
        return _turned(I, turn), _turned(J, turn), slides
    return I, J, _LINKED.get(joint.type, together)


def _turn(triad: np.ndarray, axis: np.ndarray, plane: str) -> np.ndarray:
    """Turn (3, 3) of a triad in its own axes that leads z to the normal and x along the axis."""
    z = np.array(PLANES[plane])
    x = axis - (axis @ z) * z
    x /= np.linalg.norm(x)
    turn: np.ndarray = triad.T @ np.column_stack([x, np.cross(z, x), z])
    return turn


def _turned(marker: PlacedMarker, turn: np.ndarray) -> PlacedMarker:
    return replace(marker, R=marker.R @ turn)
