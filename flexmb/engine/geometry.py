"""The model in its initial pose: markers, size of the model, and size of its parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.bodies.flexible_body import modal_reach
from flexmb.engine.bodies.rigid_body import mass_properties
from flexmb.engine.tables import System
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.body import RigidBodySpec
from flexmb.model.forces.contact import PointsSide, nodes_of
from flexmb.model.forces.load import BodyLoadSpec
from flexmb.model.markers import MarkerSpec, PlacedMarker, place, triad
from flexmb.model.model import Model
from flexmb.model.reading import GROUND, split_reference

Array = NDArray[np.float64]

Ends = tuple[PlacedMarker, PlacedMarker]
"""Markers I and J."""


# Distance of a model from the origin of the ground over its size, and of a body from its frame over
# its radius, from which the equations are about another point.
_FAR_MODEL, _FAR_BODY = 4.0, 2.0


@dataclass(frozen=True)
class Geometry:
    """Markers of a model in its initial pose, by scene path; positions and axes are global."""

    model: Model
    flexbodies: Mapping[str, FlexBody]

    def marker(self, reference: str) -> PlacedMarker:
        """The marker at a scene path."""
        return lookup.place_marker(self.model, reference, self.flexbodies)

    def frames(self, ends: tuple[str, str], axis: Any) -> Ends:
        """Two markers with z along an axis."""
        return lookup.frames(self.model, ends, axis, self.flexbodies)

    def joint_frames(self, joint: str) -> Ends:
        """The triads I and J of a joint."""
        return lookup.joint_frames(self.model, joint, self.flexbodies)

    def position(self, marker: PlacedMarker) -> Array:
        """Position (3,) of a marker [m]."""
        return lookup.global_position(self.model, marker)

    def axes(self, marker: PlacedMarker) -> Array:
        """Axes (3, 3) of a marker."""
        return marker_frame(self.model, marker)[1]

    def turned(self, marker: PlacedMarker, R: Array) -> PlacedMarker:
        """The marker with the global axes R (3, 3)."""
        return replace(marker, R=lookup.body_axes(self.model, marker.body).T @ R)

    def normal_to(self, direction: Array) -> Array:
        """A unit vector (3,) perpendicular to a unit vector."""
        return triad(tuple(direction))[:, 0]

    def load_points(
        self, spec: BodyLoadSpec
    ) -> tuple[PlacedMarker, list[tuple[PlacedMarker, Array]]]:
        """The body frame, and the points of a load case with the wrench (6,) at each."""
        origin, zero, R = place(spec.body, MarkerSpec()), np.zeros(3), np.eye(3)
        load = self.flexbodies[spec.body].load(spec.load)
        return origin, [
            (PlacedMarker(spec.body, p.position, zero, R, p.Phi_t, p.Phi_r, p.bend), p.wrench)
            for p in load.points
        ]

    def contact_points(self, reference: str, side: PointsSide) -> Iterator[PlacedMarker]:
        """Markers at the points or mesh nodes of one side of a contact."""
        body = split_reference(reference)[0]
        flexbody = None
        if body != GROUND:
            flexbody = lookup.flexbody_of(self.model, body, self.flexbodies)
        if side.points is not None:
            for point in side.points:
                yield place(body, MarkerSpec(position=point), flexbody)
            return
        assert flexbody is not None  # checked with the model
        for node in nodes_of(flexbody, side):
            yield place(body, MarkerSpec(node=int(node)), flexbody)


def marker_frame(model: Model, marker: PlacedMarker) -> tuple[Array, Array]:
    """Global position (3,) and axes (3, 3) of a marker in the initial pose."""
    return lookup.global_position(model, marker), lookup.body_axes(model, marker.body) @ marker.R


def model_length(
    model: Model, flexbodies: Mapping[str, FlexBody], ground: Array, references: Array
) -> float:
    """Size of the model [m]: extent of all markers and flexible bodies in the initial pose.

    Of the ground only points (n, 3) to which something is attached count, so that the size does not
    depend on the distance of the model from the origin. The largest radius of gyration is a lower
    bound.
    """
    points = np.concatenate([_points(model, flexbodies, references), ground])
    spread = float(np.linalg.norm(np.ptp(points, axis=0)))
    rigid = [spec for spec in model.bodies.values() if isinstance(spec, RigidBodySpec)]
    mass, _, inertia = mass_properties(rigid)
    gyration = np.sqrt(np.trace(inertia, axis1=1, axis2=2) / mass)
    reach = [body.characteristic_length for body in flexbodies.values()]
    return max([spread, float(gyration.max(initial=0.0)), *reach]) or 1.0


def reference_points(model: Model, flexbodies: Mapping[str, FlexBody]) -> Array:
    """Points (n, 3) of bodies whose motion the equations describe, in their axes [m].

    They are 0, the origins of the frames; near the centre of mass for a body that is far from its
    frame, unless a joint or driver is there.
    """
    points = np.zeros((len(model.bodies), 3))
    joined = {end for spec in (*model.joints.values(), *model.drivers.values())
              for end in getattr(spec, "between", None) or ()}  # fmt: skip
    for k, (name, spec) in enumerate(model.bodies.items()):
        if joined & {name, f"{name}.origin"}:
            continue
        if name in flexbodies:
            body = flexbodies[name]
            points[k] = _far_point(body.center, 0.5 * body.characteristic_length, _FAR_BODY)
        elif isinstance(spec, RigidBodySpec):
            mass = spec.mass_properties
            arms = np.array([*lookup.places(model, name, {})[1:]]) - mass.center
            gyration = np.sqrt(np.trace(mass.inertia) / mass.mass) if mass.mass > 0.0 else 0.0
            reach = max(gyration, float(np.linalg.norm(arms, axis=1).max()))
            points[k] = _far_point(np.asarray(mass.center, dtype=float), reach, _FAR_BODY)
    return points


def coordinate_origin(model: Model, length: float, references: Array) -> Array:
    """Origin (3,) of positions in the equations [m]: amid the bodies of a model that is far from 0;
    `references` (n, 3) are the points of bodies."""
    r, A = lookup.poses(model)
    r = r[:-1] + (A[:-1] @ references[:, :, None])[..., 0]
    return _far_point(0.5 * (r.min(axis=0) + r.max(axis=0)), length, _FAR_MODEL)


def _far_point(x: Array, size: float, far: float) -> Array:
    """A point near x (3,), or 0 if x is not further away than `far` times a size.

    Its components are multiples of a power of two, so that positions relative to it are exact.
    """
    if not size > 0.0 or np.linalg.norm(x) <= far * size:
        return np.zeros(3)
    unit = 2.0 ** np.floor(np.log2(size) - 4.0)
    return np.asarray(unit * np.round(x / unit) + 0.0)


def _points(model: Model, flexbodies: Mapping[str, FlexBody], references: Array) -> Array:
    """Global positions (n, 3) of all markers of bodies in the initial pose; not of far frames."""
    points, counts = [], []
    for body, reference in zip(model.bodies, references, strict=True):
        places = lookup.places(model, body, flexbodies)[1 if reference.any() else 0 :]
        points += places
        counts.append(len(places))
    r, A = lookup.poses(model)
    r, A = (np.repeat(part[:-1], counts, axis=0) for part in (r, A))
    return r + (A @ np.array(points)[:, :, None])[:, :, 0]


def body_weights(
    model: Model, flexbodies: Mapping[str, FlexBody], length: float
) -> NDArray[np.float64]:
    """(nv of bodies,) factors that make velocity coordinates dimensionless.

    1/`length` (size of the model) per metre, 1 per radian, and for modal coordinates the largest
    displacement of the mode over `length`.
    """
    rigid = np.append(np.full(3, 1.0 / length), np.ones(3))
    parts = []
    for name in model.bodies:
        parts.append(rigid)
        if name in flexbodies:
            parts.append(modal_reach(flexbodies[name]) / length)
    return np.concatenate(parts)


def initial_positions(model: Model, bodies: NDArray[np.void]) -> Array:
    """q of the frames of bodies in the initial, undeformed pose."""
    q = np.zeros(int((7 + bodies["m"]).sum()))
    pose = [(*spec.position, *spec.orientation) for spec in model.bodies.values()]
    q[bodies["iq"][:, None] + np.arange(7)] = pose
    return q


def extents_of_parts(system: System, q: Array) -> tuple[Array, Array]:
    """For the part of the model of each coordinate (nv,): its extent and distance from 0 [m].

    A part is a set of bodies that equations connect. Extent and largest distance are the maxima
    over the three axes; they are 0 if the part has no body. If a row of the part follows a function
    of time or scalar coordinates, the extent is at least the largest radius of gyration.
    """
    bodies, markers, of = system.parts.bodies, system.parts.markers, system.part
    spread, mass = np.trace(bodies["S0"], axis1=1, axis2=2), bodies["mass"]
    gyration = np.sqrt(np.divide(spread, mass, out=np.zeros(len(mass)), where=mass > 0.0))
    arms, on = np.zeros(len(bodies)), markers["body"] >= 0
    reach = np.linalg.norm(markers["rho"] + markers["arm"], axis=1)
    np.maximum.at(arms, markers["body"][on], reach[on])
    ends = system.rows[system.rows["fun"] >= 0]
    driven = bodies["iv"][[b for end in "IJ" for b in markers["body"][ends[end]] if b >= 0]]
    n = int(system.kkt.panels["nc"].sum()) + 1
    low, high, wide = np.full((n, 3), np.inf), np.full((n, 3), -np.inf), np.zeros((n, 1))
    r = q[bodies["iq"][:, None] + np.arange(3)]
    own = of[bodies["iv"][:, None] + np.arange(3)]  # parts of their three translations
    np.minimum.at(low, own, (r - arms[:, None])[:, None])
    np.maximum.at(high, own, (r + arms[:, None])[:, None])
    np.maximum.at(wide, own, (gyration[:, None] * np.isin(own, of[driven]))[:, :, None])
    low[low > high], high[high < low] = 0.0, 0.0
    size = np.maximum(high - low, wide).max(axis=1)[of]
    return size, np.maximum(abs(low), abs(high)).max(axis=1)[of]
