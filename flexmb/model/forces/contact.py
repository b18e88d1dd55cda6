"""Contacts: pairs of simple shapes on two markers that push each other apart when they overlap.

Normal force K d^n (1 + chi d'/d0') >= 0, with the depth of penetration d and its rate d0' at the
start of the impact (Hunt and Crossley 1975). The damping factor chi follows from the coefficient of
restitution e:

- exact: chi (1 + e) = ln((1 + chi)/(1 - chi e)), with which the restitution is e at all speeds
  (Gonthier, McPhee, Lange & Piedboeuf, Multibody Syst. Dyn. 11 (2004) 209);
- flores: chi = 8 (1 - e)/(5 e) (Flores, Machado, Silva & Martins, Multibody Syst. Dyn. 25 (2011)
  357), a few percent off below e = 0.8;
- lankarani-nikravesh: chi = 3 (1 - e^2)/4 (J. Mech. Design 112 (1990) 369), for e near 1.

If K is computed by Hertz, the shapes must be round and their materials given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.model import lookup
from flexmb.model.forces.friction import Friction
from flexmb.model.lookup import Bodies, Component, ModelData, Scope
from flexmb.model.markers import MarkerSpec, place
from flexmb.model.option_specs import MaterialField
from flexmb.model.plane import across, keeps_plane
from flexmb.model.quantities import Axis, Integer, Pair, Position, Quantity, Size, Text
from flexmb.model.reading import Spec, Variant, fail, fail_if, only_one, split_reference, under

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody

# largest overlap in the placed pose, over the radius or the extent of the points
_LARGEST_OVERLAP = 0.1


class SphereSide(Spec):
    """A sphere about the marker."""

    type: Literal["sphere"] = "sphere"
    radius: Size


class PlaneSide(Spec):
    """A plane through the marker; other bodies are on the side to which its normal ``axis`` points.

    ``axis`` is a global direction in the placed pose, by default z of the marker.
    """

    type: Literal["plane"] = "plane"
    axis: Axis | None = None


class CylinderSide(Spec):
    """A round cylinder about the marker, touched from outside, or a bore, touched from inside.

    ``axis`` is a global direction in the placed pose, by default z of the marker. ``length``
    extends half to each side of the marker; without it the cylinder is infinite. Its end faces do
    not touch anything.
    """

    type: Literal["cylinder"] = "cylinder"
    radius: Size
    axis: Axis | None = None
    length: Size | None = None
    side: Literal["outside", "inside"] = "outside"


class PointsSide(Spec):
    """Points of the marker's body, each of which makes contact independently.

    ``points`` are positions in the body frame. Or they are mesh nodes of a flexible body: ``nodes``
    by their numbers, ``"surface"`` for all that are drawn, or the nodes of a named ``group``.
    """

    type: Literal["points"] = "points"
    points: tuple[Position, ...] | None = None
    nodes: tuple[Annotated[int, Integer(0)], ...] | Literal["surface"] | None = None
    group: Text | None = None

    @model_validator(mode="after")
    def _check_selection(self) -> Self:
        word = only_one(self, "points", "nodes", "group")
        if not getattr(self, word):
            raise fail(Problem(word, "is an empty list"))
        return self


CONTACT_SHAPES: dict[str, type[Spec]] = {
    "sphere": SphereSide,
    "plane": PlaneSide,
    "cylinder": CylinderSide,
    "points": PointsSide,
}
PAIRS = (
    ("sphere", "sphere"),
    ("sphere", "plane"),
    ("sphere", "cylinder"),
    ("points", "plane"),
    ("points", "sphere"),
    ("points", "cylinder"),
)
"""Pairs of shapes that can touch, in either order."""

_Side = Annotated[Any, Variant("contact shape", lambda: CONTACT_SHAPES)]


class ContactSpec(Component):
    """Contact between ``shapes`` on the markers ``between``.

    The stiffness is ``stiffness`` K with the ``exponent`` n (K d^n, numbers in the units of the
    scene), or follows by Hertz from the ``materials`` of both sides and the radii. ``restitution``
    sets the damping by the law ``damping``. Impacts slower than ``least_speed`` are damped like
    impacts at that speed.
    """

    type: Literal["contact"]
    between: Pair
    shapes: tuple[_Side, _Side]
    stiffness: Annotated[float, Quantity("N/m", "positive")] | None = None
    exponent: Annotated[float, Quantity(limits=(1, 5))] = 1.5
    materials: tuple[MaterialField, MaterialField] | None = None
    restitution: Annotated[float, Quantity(limits=(0, 1))] = 1.0
    damping: Literal["exact", "flores", "lankarani-nikravesh"] = "exact"
    least_speed: Annotated[float, Quantity("m/s", "positive")] = 1e-3
    friction: Friction | None = None

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        problems = [*self._pair_problems(), *self._stiffness_problems()]
        if self.restitution == 0 and self.damping != "lankarani-nikravesh":
            what = f'"{self.damping}" damping of no rebound at all is infinite'
            cure = 'give a small restitution, or damping = "lankarani-nikravesh"'
            problems.append(Problem("restitution", f"{what}: {cure}"))
        fail_if(problems)
        return self

    def _pair_problems(self) -> list[Problem]:
        kinds = self.kinds
        if kinds in PAIRS or kinds[::-1] in PAIRS:
            return []
        what = f"there is no contact between {kinds[0]} and {kinds[1]}"
        return [Problem("shapes", what, tuple(f"{a} - {b}" for a, b in PAIRS))]

    def _stiffness_problems(self) -> list[Problem]:
        if (self.stiffness is None) == (self.materials is None):
            return [Problem("", 'give either "stiffness" or "materials" (for Hertz\' law)')]
        if self.materials is None:
            return []
        problems = []
        if "points" in self.kinds:
            what = "a point has no radius, so Hertz' law says nothing: give stiffness"
            problems.append(Problem("materials", what))
        if self.exponent != 1.5:
            problems.append(Problem("exponent", "is 1.5 in Hertz' law; leave it out"))
        for k, material in enumerate(self.materials):
            if not hasattr(material, "nu") or isinstance(material.nu, tuple):
                what = "Hertz' law needs a material that is the same in all directions"
                problems.append(Problem(f"materials[{k}]", what))
        return problems

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        model = scope.model
        first, second = (split_reference(reference)[0] for reference in self.between)
        if first == second:
            what = f'a contact is between two bodies, both markers are on "{first}"'
            yield Problem(f"{where}.between", what)
            return
        for k, (reference, side) in enumerate(zip(self.between, self.shapes, strict=True)):
            if isinstance(side, PointsSide):
                yield from _node_problems(scope, f"{where}.shapes[{k}]", reference, side)
            else:
                yield from scope.material(f"{where}.between[{k}]", reference)
            if model.plane is not None:
                yield from _plane_problems(model, f"{where}.shapes[{k}]", reference, side)
        k = self.round_side
        surface = self.shapes[1 - k]
        bore = isinstance(surface, CylinderSide) and surface.side == "inside"
        if bore and getattr(self.shapes[k], "radius", 0.0) >= surface.radius:
            what = f"a sphere of this radius does not fit into the bore of shapes[{1 - k}]"
            yield Problem(f"{where}.shapes[{k}].radius", what)
            return
        yield from _overlap_problems(scope, where, self)

    @property
    def kinds(self) -> tuple[str, str]:
        """Names of the two shapes."""
        return self.shapes[0].type, self.shapes[1].type

    @property
    def round_side(self) -> int:
        """The side that is a sphere or a set of points, 0 or 1; of two spheres the first."""
        return 0 if self.kinds in PAIRS else 1


def _node_problems(scope: Scope, where: str, reference: str, side: PointsSide) -> Iterator[Problem]:
    """Problems of mesh nodes that the marker's body does not have."""
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
    assert flexbody.nodes is not None  # nodes were found in it above
    for node in nodes:
        if flexbody.nodes.row(int(node)) < 0:
            span = f"{flexbody.nodes.ids[0]} to {flexbody.nodes.ids[-1]}"
            yield Problem(f"{where}.{key}", f"there is no node {node}; there are {span}")
            return


def nodes_of(flexbody: FlexBody, side: PointsSide) -> NDArray[np.int64]:
    """Mesh nodes (n,) that make contact.

    Raises
    ------
    SceneError
        The body has no nodes, no surface or no such group; the path is relative to the side.
    """
    nodes = flexbody.nodes
    if nodes is None:
        what = "the body has no nodes, only its interfaces: give points"
        raise SceneError.from_problems([Problem("nodes", what)])
    if side.group is not None:
        names = tuple(nodes.groups)
        if side.group not in names:
            near = nearest(side.group, names)
            problem = Problem("group", f'the mesh has no group "{side.group}"', names, near)
            raise SceneError.from_problems([problem])
        return np.asarray(nodes.groups[side.group])
    if side.nodes == "surface":
        if flexbody.surface is None:  # not reduced yet: those of the mesh stand for them
            return np.asarray(nodes.ids)
        return np.unique(flexbody.surface.node_ids)
    return np.array(side.nodes, dtype=int)


def _plane_problems(model: ModelData, where: str, reference: str, side: Any) -> Iterator[Problem]:
    """In a planar scene planes must be normal to it, and cylinders must have their axis normal to
    it."""
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


def _frame(model: ModelData, reference: str, side: Any, flexbodies: Bodies) -> tuple[Array, Array]:
    """Global position (3,) and axes (3, 3) of one side in the placed pose."""
    axis = getattr(side, "axis", None)
    marker = lookup.frames(model, (reference, reference), axis, flexbodies)[0]
    return lookup.global_position(model, marker), lookup.global_axes(model, marker)


def _overlap_problems(scope: Scope, where: str, spec: ContactSpec) -> Iterator[Problem]:
    """The problem of shapes that overlap by much in the placed pose, if that is known."""
    k = spec.round_side
    try:
        x, R = _frame(scope.model, spec.between[1 - k], spec.shapes[1 - k], scope.flexbodies)
        points = _positions(scope, spec.between[k], spec.shapes[k])
    except (FlexmbError, KeyError):
        return  # its markers are reported elsewhere, or come with the reduced body
    mine = spec.shapes[k].radius if isinstance(spec.shapes[k], SphereSide) else 0.0
    other = spec.shapes[1 - k]
    scale = min(r for r in (mine, getattr(other, "radius", 0.0), math.inf) if r > 0.0)
    if math.isinf(scale):
        scale = float(np.linalg.norm(np.ptp(points, axis=0))) or math.inf
    depth = max((_depth(other, R, point - x) for point in points), default=0.0) + mine
    if depth > _LARGEST_OVERLAP * scale:
        say = scope.model.units.say
        what = (
            f"the shapes overlap by {say(depth, 'm', 3)} in the placed pose, more than the limit of"
        )
        what += f" {say(_LARGEST_OVERLAP * scale, 'm', 3)}: place the bodies apart"
        yield Problem(f"{where}.between", what)


def _positions(scope: Scope, reference: str, side: Any) -> Array:
    """(n, 3) global positions of a sphere's centre or of points in the placed pose."""
    model = scope.model
    if isinstance(side, SphereSide):
        marker = lookup.place_marker(model, reference, scope.flexbodies)
        return np.array([lookup.global_position(model, marker)])
    body = split_reference(reference)[0]
    if side.points is not None:
        return np.array([_global_point(model, body, np.array(p)) for p in side.points])
    flexbody = lookup.flexbody_of(model, body, scope.flexbodies)
    if flexbody is None or flexbody.nodes is None:
        raise KeyError(body)
    rows = [flexbody.nodes.row(int(node)) for node in nodes_of(flexbody, side)]
    return np.array([_global_point(model, body, flexbody.nodes.position[row]) for row in rows])


def _global_point(model: ModelData, body: str, point: Array) -> Array:
    marker = place(body, MarkerSpec(position=tuple(point)))
    return lookup.global_position(model, marker)


def _depth(side: Any, R: Array, u: Array) -> float:
    """Depth of a point at u, relative to the side, below a surface with axes R; negative
    outside."""
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
