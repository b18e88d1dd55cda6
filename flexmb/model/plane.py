"""Planar scenes: everything moves in parallel planes, and what does not lie in them is refused.

A planar model is the spatial one with coordinates and equations left out. Bodies keep two
translations, the rotation about the normal and modes in the plane; joints keep the equations in it.
Reactions out of the plane are not computed: they are no part of the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.bodies.body import BodySpec
from flexmb.model.forces.force import JointSpringSpec, LoadSpec
from flexmb.model.forces.stops import JointStopSpec, StopSpec
from flexmb.model.functions.function import Function
from flexmb.model.joints import curve_uses
from flexmb.model.joints.drivers import DriverSpec
from flexmb.model.joints.gearing import terms_of
from flexmb.model.joints.joint import JOINT_TYPES, JointSpec
from flexmb.model.values.names import GROUND
from flexmb.model.values.orientation import rotation_matrix
from flexmb.model.values.reading import given

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = [
    "across",
    "axis_of_joint",
    "in_plane_triad",
    "keeps_plane",
    "normal_in_body",
    "plane_axes",
    "plane_in_body",
    "planar_problems",
    "read_plane",
]

Array = NDArray[np.float64]
_ALIGNED = 1e-9  # sine of the angle that round-off of an orientation leaves


def read_plane(value: Any) -> tuple[str | None, list[Problem]]:
    """The plane of a scene, None for a spatial one; or the problem."""
    if value is None or (isinstance(value, str) and value in PLANES):
        return value, []
    names = tuple(PLANES)
    near = nearest(str(value), names)
    return None, [Problem("plane", f"unknown plane {given(value)}", names, near)]


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


def plane_in_body(spec: BodySpec, plane: str) -> str:
    """Name of the plane in the axes of a placed body that lies in it."""
    about = int(np.argmax(np.abs(normal_in_body(spec, plane))))
    return next(name for name, normal in PLANES.items() if normal[about])


def axis_of_joint(model: Model, name: str, flexbodies: lookup.Bodies) -> Array:
    """Global direction (3,) of the axis of a joint in the placed pose."""
    I = lookup.joint_frames(model, name, flexbodies)[0]  # noqa: E741
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    direction: Array = A @ I.R[:, 2]
    return direction


def across(vector: Iterable[float], plane: str) -> bool:
    """Whether a vector is along the normal (or zero)."""
    v = np.array(list(vector))
    return bool(np.linalg.norm(np.cross(v, PLANES[plane])) <= _ALIGNED * np.linalg.norm(v))


def keeps_plane(vector: Iterable[float], plane: str) -> bool:
    """Whether a vector lies in the plane (or is zero)."""
    v = np.array(list(vector))
    return bool(abs(v @ np.array(PLANES[plane])) <= _ALIGNED * np.linalg.norm(v))


def planar_problems(model: Model, flexbodies: lookup.Bodies) -> Iterator[Problem]:
    """What a planar scene cannot hold, with scene paths."""
    plane = model.plane
    if plane is None:
        return
    if model.gravity is not None and not keeps_plane(model.gravity, plane):
        yield Problem("gravity", f"leads out of the plane {plane}")
    for name, spec in model.bodies.items():
        yield from _body(f"bodies.{name}", spec, plane)
    for name, joint in model.joints.items():
        yield from _joint(model, name, joint, flexbodies, plane)
    yield from _coordinates(model, flexbodies, plane)
    for name, driver in model.drivers.items():
        if driver.marker is not None:
            yield from _driver(model, f"drivers.{name}", driver, flexbodies, plane)
    for name, force in model.forces.items():
        if isinstance(force, LoadSpec):
            yield from _load(model, f"forces.{name}", force, flexbodies, plane)
        elif isinstance(force, StopSpec) and not keeps_plane(force.axis or (0.0,) * 3, plane):
            yield Problem(f"forces.{name}.axis", f"must lie in the plane {plane}")


def _body(where: str, spec: BodySpec, plane: str) -> Iterator[Problem]:
    normal = np.abs(normal_in_body(spec, plane))
    if np.sort(normal)[1] > _ALIGNED:
        what = f"no axis of the body is normal to the plane {plane}; turn it within the plane only"
        yield Problem(f"{where}.orientation", what)
    for marker, asked in spec.asked_velocities.items():
        at = where if marker == "origin" and not spec.initial else f"{where}.initial.{marker}"
        if asked.velocity is not None and not keeps_plane(asked.velocity, plane):
            yield Problem(f"{at}.velocity", f"leads out of the plane {plane}")
        if asked.angular_velocity is not None and not across(asked.angular_velocity, plane):
            yield Problem(f"{at}.angular_velocity", f"is not about the normal of {plane}")


_ABOUT = ("revolute", "revolute-revolute")
_ALONG = ("prismatic", "in-line", "in-plane", "prismatic-spherical")


def _joint(
    model: Model, name: str, joint: JointSpec, flexbodies: lookup.Bodies, plane: str
) -> Iterator[Problem]:
    where = f"joints.{name}"
    if JOINT_TYPES[joint.type].planar_equations is None:
        names = tuple(row.name for row in JOINT_TYPES.values() if row.planar_equations is not None)
        yield Problem(f"{where}.type", f"a {joint.type} joint has no meaning in a plane", names)
        return
    if JOINT_TYPES[joint.type].curves:
        yield from curve_uses.in_plane(model, name, flexbodies, plane)
        return
    if not JOINT_TYPES[joint.type].has_axis:
        return
    try:
        axis = axis_of_joint(model, name, flexbodies)
    except FlexmbError:
        return  # its markers are told elsewhere
    about, along = across(axis, plane), keeps_plane(axis, plane)
    if joint.type in _ABOUT and not about:
        yield Problem(f"{where}.axis", f"must be normal to the plane {plane}")
    elif joint.type in _ALONG and not along:
        yield Problem(f"{where}.axis", f"must lie in the plane {plane}")
    elif not (about or along):
        yield Problem(f"{where}.axis", f"must lie in the plane {plane} or be normal to it")


def _coordinates(model: Model, flexbodies: lookup.Bodies, plane: str) -> Iterator[Problem]:
    """A cylindrical joint keeps one of its two coordinates."""
    used = [
        (f"drivers.{n}", d.joint, d.coordinate)
        for n, d in model.drivers.items()
        if d.joint is not None
    ]
    for n, force in model.forces.items():
        if isinstance(force, JointSpringSpec | JointStopSpec):
            used.append((f"forces.{n}", force.joint, force.coordinate))
    for n, coupler in model.couplers.items():
        used += [(f"couplers.{n}", *term) for term in terms_of(coupler)]
    for where, name, coordinate in used:
        joint = model.joints.get(name)
        if joint is None or joint.type != "cylindrical":
            continue
        about = across(axis_of_joint(model, name, flexbodies), plane)
        if coordinate != ("angle" if about else "stroke"):
            yield Problem(where, f'in the plane {plane} the joint "{name}" has no {coordinate}')


def _driver(
    model: Model, where: str, driver: DriverSpec, flexbodies: lookup.Bodies, plane: str
) -> Iterator[Problem]:
    """Coordinates of a marker: along the plane, and about its normal."""
    if driver.axis is not None and not across(driver.axis, plane):
        yield Problem(f"{where}.axis", f"must be normal to the plane {plane}")
    if driver.position is not None and len(driver.position) != 2:
        what = f"a point has 2 coordinates in the plane {plane}, given {len(driver.position)}"
        yield Problem(f"{where}.position", what)
        return
    I = lookup.placed(model, driver.ends[0], flexbodies)  # noqa: E741
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    for coordinate, _ in driver.motions(plane):
        if coordinate in "xyz" and not keeps_plane((A @ I.R)[:, "xyz".index(coordinate)], plane):
            axis = f"{coordinate} of {driver.relative_to}" if driver.relative_to else coordinate
            yield Problem(f"{where}.{coordinate}", f"{axis} leads out of the plane {plane}")


def _load(
    model: Model, where: str, force: LoadSpec, flexbodies: lookup.Bodies, plane: str
) -> Iterator[Problem]:
    """Components out of the plane must be the number zero."""
    normal = np.array(PLANES[plane])
    if force.axes != "global":
        reference = force.at if force.axes == "body" else force.axes
        body = reference.partition(".")[0]
        try:
            marker = lookup.placed(model, reference, flexbodies)
        except FlexmbError:
            return
        if body in model.bodies:
            normal = normal_in_body(model.bodies[body], plane)
        normal = marker.R.T @ normal
    for i, function in enumerate(force.value):
        inside = abs(normal[i]) <= _ALIGNED
        wanted = inside if force.type == "force" else not inside
        if not wanted and not _zero(function):
            what = "leads out of" if force.type == "force" else "turns out of"
            yield Problem(f"{where}.value[{i}]", f"{what} the plane {plane}")


def _zero(function: Function) -> bool:
    return function.expression.constant == 0.0
