"""Whether contacts and frictions fit the model they are in.

In: a model under check. Out: problems with scene paths.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.model import lookup
from flexmb.model.bodies.markers import MarkerSpec, place
from flexmb.model.forces.contacts import (
    ContactSpec,
    CylinderSide,
    PlaneSide,
    PointsSide,
    SphereSide,
)
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.plane import across, keeps_plane
from flexmb.model.scenes.scope import Scope
from flexmb.model.values.names import GROUND, split_reference
from flexmb.model.values.orientation import rotation_matrix
from flexmb.model.values.reading import under

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model.model import Model

__all__ = ["contact_problems", "friction_coordinate", "joint_friction_problems", "nodes_of"]

Array = NDArray[np.float64]
_RUBBING = ("revolute", "prismatic", "cylindrical")
_DEEP = 0.1  # of the radius, or of the spread of the points


def contact_problems(scope: Scope, where: str, spec: ContactSpec) -> Iterator[Problem]:
    """Everything that is wrong with a contact."""
    model = scope.model
    first, second = (split_reference(reference)[0] for reference in spec.between)
    if first == second:
        what = f'a contact is between two bodies, both markers are on "{first}"'
        yield Problem(f"{where}.between", what)
    for k, (reference, side) in enumerate(zip(spec.between, spec.shapes, strict=True)):
        if isinstance(side, PointsSide):
            yield from _points(scope, f"{where}.shapes[{k}]", reference, side)
        else:
            yield from scope.material(f"{where}.between[{k}]", reference)
        if model.plane is not None:
            yield from _in_plane(model, f"{where}.shapes[{k}]", reference, side)
    k = spec.round_side
    surface = spec.shapes[1 - k]
    inside = isinstance(surface, CylinderSide) and surface.side == "inside"
    if inside and getattr(spec.shapes[k], "radius", 0.0) >= surface.radius:
        what = f"a sphere of this radius does not fit into the bore of shapes[{1 - k}]"
        yield Problem(f"{where}.shapes[{k}].radius", what)
        return
    yield from _deep(scope, where, spec)


def _points(scope: Scope, where: str, reference: str, side: PointsSide) -> Iterator[Problem]:
    """Mesh nodes need a body that has them."""
    body = split_reference(reference)[0]
    if side.points is not None or body in scope.broken.get("bodies", {}):
        return
    key = "nodes" if side.group is None else "group"
    spec = scope.model.bodies.get(body)
    if spec is None or not spec.flexible:
        yield Problem(f"{where}.{key}", f'"{body}" has no mesh, so no nodes: give points')
        return
    flexbody = lookup.flexbody_of(scope.model, body, scope.flexbodies)
    if flexbody is None:
        return
    try:
        nodes = nodes_of(flexbody, side)
    except SceneError as error:
        yield from under(where, error.problems)
        return
    assert flexbody.nodes is not None  # they were found there
    for node in nodes:
        if flexbody.nodes.row(int(node)) < 0:
            known = f"{flexbody.nodes.ids[0]} to {flexbody.nodes.ids[-1]}"
            yield Problem(f"{where}.{key}", f"there is no node {node}; there are {known}")
            return


def nodes_of(flexbody: FlexBody, side: PointsSide) -> NDArray[np.int64]:
    """Mesh nodes (n,) that make contact.

    Raises
    ------
    SceneError
        The body holds no nodes, no surface or no such group; its place is relative to the side.
    """
    held = flexbody.nodes
    if held is None:
        what = "the body holds no nodes, only its interfaces: give points"
        raise SceneError.from_problems([Problem("nodes", what)])
    if side.group is not None:
        names = tuple(held.groups)
        if side.group not in names:
            near = nearest(side.group, names)
            problem = Problem("group", f'the mesh has no group "{side.group}"', names, near)
            raise SceneError.from_problems([problem])
        return np.asarray(held.groups[side.group])
    if side.nodes == "surface":
        if flexbody.surface is None:  # not reduced yet: those of the mesh stand for them
            return np.asarray(held.ids)
        return np.unique(flexbody.surface.node_ids)
    return np.array(side.nodes, dtype=int)


def _in_plane(model: Model, where: str, reference: str, side: Any) -> Iterator[Problem]:
    """In a planar scene a plane stands on it, and cylinders are circles in it."""
    if not isinstance(side, PlaneSide | CylinderSide) or model.plane is None:
        return
    try:
        axis = _frame(model, reference, side, {})[1][:, 2]
    except FlexmbError:
        return
    if isinstance(side, PlaneSide) and not keeps_plane(axis, model.plane):
        yield Problem(f"{where}.axis", f"must lie in the plane {model.plane}")
    if isinstance(side, CylinderSide) and not across(axis, model.plane):
        yield Problem(f"{where}.axis", f"must be normal to the plane {model.plane}")


def _frame(model: Model, reference: str, side: Any, known: Any) -> tuple[Array, Array]:
    """Global place (3,) and axes (3, 3) of one side."""
    axis = getattr(side, "axis", None)
    marker = lookup.frames(model, (reference, reference), axis, known)[0]
    A = np.eye(3)
    if marker.body != GROUND:
        A = rotation_matrix(model.bodies[marker.body].orientation)
    return lookup.global_position(model, marker), A @ marker.R


def _deep(scope: Scope, where: str, spec: ContactSpec) -> Iterator[Problem]:
    """Shapes that overlap by much in the placed pose, as far as it is known."""
    k = spec.round_side
    try:
        x, R = _frame(scope.model, spec.between[1 - k], spec.shapes[1 - k], scope.flexbodies)
        points = _places(scope, spec.between[k], spec.shapes[k])
    except (FlexmbError, KeyError):
        return  # its markers are told elsewhere, or not known yet
    mine = spec.shapes[k].radius if isinstance(spec.shapes[k], SphereSide) else 0.0
    other = spec.shapes[1 - k]
    scale = min(r for r in (mine, getattr(other, "radius", 0.0), math.inf) if r > 0.0)
    if math.isinf(scale):
        scale = float(np.linalg.norm(np.ptp(points, axis=0))) or math.inf
    depth = max((_depth(other, R, point - x) for point in points), default=0.0) + mine
    if depth > _DEEP * scale:
        say = scope.model.units.say
        what = f"the shapes overlap by {say(depth, 'm', 3)} in the placed pose, more than a contact"
        what += f" ever would ({say(_DEEP * scale, 'm', 3)}): place the bodies apart"
        yield Problem(f"{where}.between", what)


def _places(scope: Scope, reference: str, side: Any) -> Array:
    """(n, 3) global places of a sphere's centre or of points, in the placed pose."""
    model, known = scope.model, scope.flexbodies
    if isinstance(side, SphereSide):
        return np.array([lookup.global_position(model, lookup.placed(model, reference, known))])
    body = split_reference(reference)[0]
    if side.points is not None:
        return np.array([_moved(model, body, np.array(p)) for p in side.points])
    flexbody = lookup.flexbody_of(model, body, known)
    if flexbody is None or flexbody.nodes is None:
        raise KeyError(body)
    rows = [flexbody.nodes.row(int(node)) for node in nodes_of(flexbody, side)]
    return np.array([_moved(model, body, flexbody.nodes.position[row]) for row in rows])


def _moved(model: Model, body: str, point: Array) -> Array:
    marker = place(body, MarkerSpec(position=tuple(point)))
    return lookup.global_position(model, marker)


def _depth(side: Any, R: Array, u: Array) -> float:
    """Depth of a point at u from a surface with axes R."""
    if isinstance(side, PlaneSide):
        return float(-R[:, 2] @ u)
    if isinstance(side, SphereSide):
        return float(side.radius - np.linalg.norm(u))
    along = float(R[:, 2] @ u)
    if side.length is not None and abs(along) > 0.5 * side.length:
        return -math.inf
    distance = float(np.linalg.norm(u - along * R[:, 2]))
    depth = distance - side.radius
    return float(depth if side.side == "inside" else -depth)


def friction_coordinate(model: Model, spec: JointFrictionSpec) -> str:
    """The coordinate that friction acts on: the one given, or the only one of the joint."""
    return spec.coordinate or JOINT_TYPES[model.joints[spec.joint].type].coordinates[0]


def joint_friction_problems(scope: Scope, where: str, spec: JointFrictionSpec) -> Iterator[Problem]:
    """Everything that is wrong with friction in a joint."""
    joint = scope.model.joints.get(spec.joint)
    if joint is None or spec.coordinate is not None:
        found = list(scope.coordinate(where, spec.joint, spec.coordinate or "angle"))
        yield from found
        if joint is None or found:
            return
    if joint.type not in _RUBBING:
        what = f'there is no friction in {joint.type} joints such as "{spec.joint}"'
        yield Problem(f"{where}.joint", what, _RUBBING)
        return
    if spec.coordinate is None and joint.type == "cylindrical":
        what = "is missing: a cylindrical joint both turns and slides"
        yield Problem(f"{where}.coordinate", what, ("angle", "stroke"))
        return
    turning = friction_coordinate(scope.model, spec) == "angle"
    if turning and spec.radius is None:
        yield Problem(f"{where}.radius", "is missing: friction acts on the surface of a pin")
    if not turning and spec.radius is not None:
        yield Problem(f"{where}.radius", "friction along a stroke needs none; leave it out")
    if spec.width is not None and joint.type != "prismatic":
        what = "only a prismatic joint carries a torque about its axis; leave it out"
        yield Problem(f"{where}.width", what)
