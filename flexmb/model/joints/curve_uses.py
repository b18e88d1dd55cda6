"""Whether curves and the joints that slide along them fit together.

In: a model under check. Out: problems, with scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.joints.curve_shape import CurveShape, curve_shape
from flexmb.model.joints.joint import JointSpec
from flexmb.model.values.names import GROUND
from flexmb.model.values.orientation import rotation_matrix

if TYPE_CHECKING:
    from flexmb.model.model import Model
    from flexmb.model.scenes.scope import Scope
    from flexmb.model.sensors.sensor import PlaceSensorSpec

__all__ = ["in_plane", "of_joint", "of_sensor", "shapes"]

_ALIGNED = 1e-9


def shapes(scope: Scope) -> Iterator[Problem]:
    """Every curve by itself."""
    for name in scope.model.curves:
        try:
            curve_shape(scope.model, name)
        except SceneError as error:
            yield from error.problems


def of_joint(scope: Scope, name: str, joint: JointSpec) -> Iterator[Problem]:
    """The curves of a joint: that they exist and lie in a plane, and where it begins."""
    starts = (joint.start, joint.second_start)
    words = ("curve", "second_curve"), ("start", "second_start")
    for word, begin, curve, start in zip(*words, joint.curves, starts, strict=False):
        where = f"joints.{name}.{word}"
        if not scope.has("curves", curve):
            known = scope.names("curves")
            yield Problem(where, f'unknown curve "{curve}"', known, nearest(curve, known))
            continue
        shape = _known(scope.model, curve)
        if shape is None:
            continue
        if not shape.in_plane and joint.type != "point-on-curve":
            what = f'a {joint.type} joint needs a plane curve; "{curve}" has three coordinates'
            yield Problem(where, what, ("point-on-curve",))
        length = _length(shape)
        if start is not None and not shape.closed and not 0.0 <= start <= length:
            units = scope.model.units
            what = f'lies beyond the curve "{curve}", which is {units.say(length, "m")} long'
            yield Problem(f"joints.{name}.{begin}", what)


def of_sensor(scope: Scope, where: str, spec: PlaceSensorSpec) -> Iterator[Problem]:
    """The joint of a sensor of places: that it is on a curve, on that side."""
    if not scope.has("joints", spec.joint):
        names = scope.names("joints")
        what = f'unknown joint "{spec.joint}"'
        yield Problem(f"{where}.joint", what, names, nearest(spec.joint, names))
    elif spec.joint in scope.model.joints:
        joint = scope.model.joints[spec.joint]
        if not joint.curves:
            known = tuple(name for name, other in scope.model.joints.items() if other.curves)
            what = f'the {joint.type} joint "{spec.joint}" is on no curve'
            yield Problem(f"{where}.joint", what, known)
        elif spec.on == "J" and len(joint.curves) < 2:
            what = f'the {joint.type} joint "{spec.joint}" has a curve on I only'
            yield Problem(f"{where}.on", what)


def in_plane(model: Model, name: str, flexbodies: lookup.Bodies, plane: str) -> Iterator[Problem]:
    """The curves and the flat of a joint in a planar scene."""
    joint = model.joints[name]
    try:
        frames = lookup.joint_frames(model, name, flexbodies)
    except FlexmbError:
        return  # its markers are told elsewhere
    normal = np.array(PLANES[plane])
    for i, (marker, curve) in enumerate(zip(frames, joint.curves, strict=False)):
        z = _turned(model, marker)[:, 2]
        if np.linalg.norm(np.cross(z, normal)) > _ALIGNED:
            what = f"carries a curve in its plane x, y, which must lie in the plane {plane}"
            yield Problem(
                f"joints.{name}.between[{i}]", f"{what}: turn the marker, or take another"
            )
        shape = _known(model, curve)
        if shape is not None and not shape.in_plane:
            what = f'the curve "{curve}" with three coordinates has no meaning in a plane'
            yield Problem(f"joints.{name}.{('curve', 'second_curve')[i]}", what)
    if joint.type == "cam-flat" and abs(_turned(model, frames[1])[:, 2] @ normal) > _ALIGNED:
        yield Problem(f"joints.{name}.axis", f"across the flat, it must lie in the plane {plane}")


def _turned(model: Model, marker: PlacedMarker) -> NDArray[np.float64]:
    """Axes (3, 3) of a placed marker, global."""
    if marker.body == GROUND:
        return marker.R
    turned: NDArray[np.float64] = rotation_matrix(model.bodies[marker.body].orientation) @ marker.R
    return turned


def _known(model: Model, curve: str) -> CurveShape | None:
    """The shape of a curve, None for one that is wrong: told elsewhere."""
    if curve not in model.curves:
        return None
    try:
        return curve_shape(model, curve)
    except SceneError:
        return None


def _length(shape: CurveShape) -> float:
    return float(np.linalg.norm(np.diff(shape.points, axis=0), axis=1).sum())
