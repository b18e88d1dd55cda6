"""Planar scenes: everything moves in parallel planes; what does not lie in them is refused.

A planar model is the spatial one without the coordinates and equations out of the plane. Bodies
keep two translations, the rotation about the normal and the modes in the plane; joints keep the
equations in the plane. Reactions out of the plane are not part of the model and not computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.planar_body import PLANES, planar_body
from flexmb.model import lookup
from flexmb.model.body import BodySpec
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.lookup import Bodies, ModelData, Scope
from flexmb.model.markers import rotation_matrix
from flexmb.model.reading import quote, under

ALIGNED = 1e-9  # sine of the angle that round-off of an orientation may leave


def read_plane(value: Any) -> tuple[str | None, list[Problem]]:
    """The plane of a scene, None for a spatial one; or the problem."""
    if value is None or (isinstance(value, str) and value in PLANES):
        return value, []
    names = tuple(PLANES)
    near = nearest(str(value), names)
    return None, [Problem("plane", f"unknown plane {quote(value)}", names, near)]


def plane_axes(plane: str) -> tuple[int, int, int]:
    """Global axes of a plane: two in it and its normal, right-handed (x, y, z = 0, 1, 2)."""
    n = int(np.argmax(PLANES[plane]))
    return (n + 1) % 3, (n + 2) % 3, n


def in_plane_triad(plane: str) -> Array:
    """Axes (3, 3) in columns: the two of the plane and its normal."""
    triad: Array = np.eye(3)[:, list(plane_axes(plane))]
    return triad


def normal_in_body(spec: BodySpec, plane: str) -> Array:
    """Normal (3,) of the plane in the axes of a placed body."""
    turned: Array = rotation_matrix(spec.orientation).T @ np.array(PLANES[plane])
    return turned


def simulated_body(model: ModelData, name: str, body: FlexBody) -> FlexBody:
    """A reduced body as a run uses it: with the requested effects and only its motions in the
    plane.

    Raises
    ------
    ReductionError
        Effects without data, or motions out of the plane; with paths in the scene.
    """
    spec = model.bodies[name]
    if isinstance(spec, FlexibleBodySpec):
        if model.plane is not None and spec.deformation != "rigid":
            body = planar_body(body, normal_in_body(spec, model.plane))
        try:
            body = spec.simulated(body)
        except ReductionError as error:
            raise ReductionError.from_problems(under(f"bodies.{name}", error.problems)) from None
    return body


def plane_in_body(spec: BodySpec, plane: str) -> str:
    """Name of the plane in the axes of a placed body that lies in it."""
    about = int(np.argmax(np.abs(normal_in_body(spec, plane))))
    return next(name for name, normal in PLANES.items() if normal[about])


def axis_of_joint(model: ModelData, name: str, flexbodies: Bodies) -> Array:
    """Global direction (3,) of the axis of a joint in the placed pose."""
    direction: Array = lookup.global_axes(model, lookup.joint_frames(model, name, flexbodies)[0])[
        :, 2
    ]
    return direction


def across(vector: Iterable[float], plane: str) -> bool:
    """Whether a vector is along the normal (or zero)."""
    v = np.array(list(vector))
    return bool(np.linalg.norm(np.cross(v, PLANES[plane])) <= ALIGNED * np.linalg.norm(v))


def keeps_plane(vector: Iterable[float], plane: str) -> bool:
    """Whether a vector lies in the plane (or is zero)."""
    v = np.array(list(vector))
    return bool(abs(v @ np.array(PLANES[plane])) <= ALIGNED * np.linalg.norm(v))


def planar_problems(scope: Scope) -> Iterator[Problem]:
    """All problems of a planar scene, with scene paths."""
    model, plane = scope.model, scope.model.plane
    if plane is None:
        return
    if model.gravity is not None and not keeps_plane(model.gravity, plane):
        yield Problem("gravity", f"has a component normal to the plane {plane}")
    for name, spec in model.bodies.items():
        yield from _body_problems(f"bodies.{name}", spec, plane)
    for name, joint in model.joints.items():
        yield from joint.planar_problems(scope, f"joints.{name}", plane)
    yield from _coordinate_problems(model, scope.flexbodies, plane)
    for section in ("drivers", "forces"):
        for name, spec in getattr(model, section).items():
            yield from spec.planar_problems(scope, f"{section}.{name}", plane)


def _body_problems(where: str, spec: BodySpec, plane: str) -> Iterator[Problem]:
    normal = np.abs(normal_in_body(spec, plane))
    if np.sort(normal)[1] > ALIGNED:
        what = f"no axis of the body is normal to the plane {plane}; turn it within the plane only"
        yield Problem(f"{where}.orientation", what)
    for marker, initial in spec.initial_velocities.items():
        at = where if marker == "origin" and not spec.initial else f"{where}.initial.{marker}"
        if initial.velocity is not None and not keeps_plane(initial.velocity, plane):
            yield Problem(f"{at}.velocity", f"has a component normal to the plane {plane}")
        if initial.angular_velocity is not None and not across(initial.angular_velocity, plane):
            yield Problem(f"{at}.angular_velocity", f"is not about the normal of {plane}")


def _coordinate_problems(model: ModelData, flexbodies: Bodies, plane: str) -> Iterator[Problem]:
    """A problem if a cylindrical joint has none of its two coordinates in the plane."""
    used = [
        (f"{section}.{name}", spec.joint, spec.coordinate)
        for section in ("drivers", "forces")
        for name, spec in getattr(model, section).items()
        if getattr(spec, "joint", None) is not None
        and getattr(spec, "type", "") != "joint-friction"
    ]
    for name, coupler in model.couplers.items():
        used += [(f"couplers.{name}", *coordinate) for coordinate in coupler.coordinates]
    for where, name, coordinate in used:
        if name in model.joints and model.joints[name].type == "cylindrical":
            about = across(axis_of_joint(model, name, flexbodies), plane)
            if coordinate != ("angle" if about else "stroke"):
                yield Problem(where, f'in the plane {plane} the joint "{name}" has no {coordinate}')
