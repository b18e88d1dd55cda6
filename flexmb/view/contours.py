"""Cams, slots, rollers and flats of joints on curves, as shapes to draw.

In: a :class:`Mechanism`. Out: triangles in global axes: a plate along a closed curve, a wire along
an open one, a disk for a roller, a pad for a flat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.model.joints.curve import curve_shape
from flexmb.model.joints.joint import JointSpec
from flexmb.model.lookup import joint_frames
from flexmb.model.values.names import split_reference
from flexmb.view.geometry import Triangles, box, cylinder, joined, plate, tube
from flexmb.view.mechanism import Mechanism

__all__ = ["contours", "followed"]

Array = NDArray[np.float64]

_THICK, _WIRE, _PAD = 0.06, 0.006, 0.16  # shares of the mechanism's size
_SEGMENTS = 90


def contours(mechanism: Mechanism, body: str, size: float) -> list[Triangles]:
    """What joints on curves give a body to show: its curves, rollers and flats."""
    found = []
    for name, joint in mechanism.model.joints.items():
        if not joint.curves:
            continue
        frames = joint_frames(mechanism.model, name, mechanism.flexbodies)
        for side, (reference, marker) in enumerate(zip(joint.between, frames, strict=True)):
            if split_reference(reference)[0] != body:
                continue
            shape = _shape(mechanism, joint, side, size)
            if shape is not None:
                A = mechanism.pose(body).A @ marker.R
                found.append(shape.moved(mechanism.point(reference), A))
    return found


def followed(joint: JointSpec) -> tuple[str, ...]:
    """The markers of a joint on a curve where a ball shows it: none where more is drawn."""
    points = ("pin-in-slot", "point-on-curve", "cam-knife")
    return joint.between[1:] if joint.type in points else ()


def _shape(mechanism: Mechanism, joint: JointSpec, side: int, size: float) -> Triangles | None:
    """The shape of one side of a joint in the axes of its marker."""
    thick = _THICK * size
    if side < len(joint.curves):
        shape = curve_shape(mechanism.model, joint.curves[side])
        points = shape.points[:: max(1, len(shape.samples) // _SEGMENTS)]
        if shape.closed:
            return plate(points[:-1], thick)
        ends = zip(points[:-1], points[1:], strict=True)
        return joined([tube(a, b, _WIRE * size) for a, b in ends])
    if joint.radius is not None:
        return cylinder(joint.radius, 1.2 * thick)
    if joint.type == "cam-flat":
        return box((_PAD * size, _PAD * size, 0.1 * thick))
    return None
