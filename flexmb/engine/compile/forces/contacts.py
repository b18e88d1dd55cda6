"""Tables of contacts and of friction in joints; None where the model has none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.forces.hertz import hertz_stiffness, plane_modulus
from flexmb.engine.compile.joints.coordinates import followers
from flexmb.engine.compile.joints.joint import Groups
from flexmb.engine.compile.markers import Markers
from flexmb.engine.tables import (
    BALL,
    BORE,
    BRISTLE,
    CONTACT,
    CYLINDER,
    JOINT_FRICTION,
    NO_FRICTION,
    PLANE,
    SMOOTH,
)
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.bodies.markers import MarkerSpec, PlacedMarker, place
from flexmb.model.forces.contact_checks import friction_coordinate, nodes_of
from flexmb.model.forces.contacts import (
    ContactSpec,
    CylinderSide,
    PlaneSide,
    PointsSide,
    SphereSide,
    damping_factor,
)
from flexmb.model.forces.friction import BaseFriction, JointFrictionSpec
from flexmb.model.model import Model
from flexmb.model.values.names import GROUND, split_reference

__all__ = ["contact_rows", "contact_table", "joint_friction_table", "memory_of"]

Bodies = Mapping[str, FlexBody]
Table = NDArray[np.void]
_FRICTIONLESS = (NO_FRICTION, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0, 1.0)
_JOINT_MEMORY = 2


def memory_of(contact: Any) -> int:
    """How many numbers a contact keeps from step to step."""
    return 1 if contact["model"] == NO_FRICTION else 5


def contact_table(model: Model, flexbodies: Bodies, markers: Markers) -> Table | None:
    """CONTACT rows, one for each point; `couple` is filled in later."""
    rows: list[tuple[Any, ...]] = []
    kept = 1
    for spec in model.forces.values():
        if isinstance(spec, ContactSpec):
            k = spec.round_side
            surface = _surface(model, spec.between[1 - k], spec.shapes[1 - k], flexbodies)
            J = markers.add(surface)
            law = _law(model, spec)
            friction = _FRICTIONLESS if spec.friction is None else _parameters(spec.friction)
            kind, rj, half = _geometry(spec.shapes[1 - k])
            side = spec.shapes[k]
            ri = side.radius if isinstance(side, SphereSide) else 0.0
            for marker in _round(model, spec.between[k], side, flexbodies):
                I = markers.add(marker)  # noqa: E741
                rows.append((I, J, kind, ri, rj, half, *law, -1, *friction, kept))
                kept += 1 if spec.friction is None else 5
    return np.array(rows, CONTACT) if rows else None


def contact_rows(model: Model, name: str, flexbodies: Bodies) -> tuple[int, int]:
    """First row and number of rows of a contact in its table."""
    first = 0
    for other, spec in model.forces.items():
        if isinstance(spec, ContactSpec):
            k = spec.round_side
            n = sum(1 for _ in _round(model, spec.between[k], spec.shapes[k], flexbodies))
            if other == name:
                return first, n
            first += n
    raise KeyError(name)


def _parameters(spec: BaseFriction) -> tuple[Any, ...]:
    static = spec.static_coefficient
    stribeck = spec.stribeck_speed if static > spec.dynamic else math.inf
    smooth = spec.model == "smooth"
    return (
        SMOOTH if smooth else BRISTLE, static, spec.dynamic, stribeck, spec.viscous,
        spec.stiffness or 0.0, spec.damping, spec.creep_speed or 1.0,
    )  # fmt: skip


def _geometry(side: Any) -> tuple[int, float, float]:
    """Kind, radius and half length of the side J."""
    if isinstance(side, SphereSide):
        return BALL, side.radius, 0.0
    if isinstance(side, PlaneSide):
        return PLANE, 0.0, 0.0
    assert isinstance(side, CylinderSide)  # all other pairs are refused
    half = math.inf if side.length is None else 0.5 * side.length
    return BORE if side.side == "inside" else CYLINDER, side.radius, half


def _surface(model: Model, reference: str, side: Any, flexbodies: Bodies) -> PlacedMarker:
    """Marker of the side J, z being its normal or axis."""
    axis = getattr(side, "axis", None)
    return lookup.frames(model, (reference, reference), axis, flexbodies)[0]


def _round(model: Model, reference: str, side: Any, flexbodies: Bodies) -> Iterator[PlacedMarker]:
    """Markers of the side I: the centre of a sphere, or all points."""
    if isinstance(side, SphereSide):
        yield lookup.placed(model, reference, flexbodies)
        return
    assert isinstance(side, PointsSide)  # the other kind that may stand there
    body = split_reference(reference)[0]
    flexbody = None if body == GROUND else lookup.flexbody_of(model, body, flexbodies)
    if side.points is None:
        assert flexbody is not None  # checked with the model
        for node in nodes_of(flexbody, side):
            yield place(body, MarkerSpec(node=int(node)), flexbody)
    for point in side.points or ():
        yield place(body, MarkerSpec(position=point), flexbody)


def _law(model: Model, spec: ContactSpec) -> tuple[float, float, float, float]:
    """K in SI, exponent, damping, least speed."""
    damping = damping_factor(spec.restitution, spec.damping)
    if spec.stiffness is not None:  # the number counts depths in units of length of the scene
        K = spec.stiffness * model.units.length ** (1.0 - spec.exponent)
        return K, spec.exponent, damping, spec.least_speed
    assert spec.materials is not None  # one of the two is given
    first, second = ((found.E, found.nu) for found in spec.materials)
    K = hertz_stiffness(plane_modulus(first, second), _curvatures(spec))  # type: ignore[arg-type]
    return K, 1.5, damping, spec.least_speed


def _curvatures(spec: ContactSpec) -> tuple[float, float]:
    """Principal relative curvatures of a sphere and the other side [1/m]."""
    k = spec.round_side
    mine, other = 1.0 / spec.shapes[k].radius, spec.shapes[1 - k]
    if isinstance(other, PlaneSide):
        return mine, mine
    theirs = 1.0 / other.radius
    if isinstance(other, SphereSide):
        return mine + theirs, mine + theirs
    return mine, mine + (-theirs if other.side == "inside" else theirs)


def joint_friction_table(model: Model, groups: Groups, kept: int) -> Table | None:
    """JOINT_FRICTION rows with memory from `kept` on."""
    rows: list[tuple[Any, ...]] = []
    for k, (name, spec) in enumerate(followers(model).items()):
        if not isinstance(spec, JointFrictionSpec):
            continue
        coordinate = friction_coordinate(model, spec)
        along = model.plane is not None and coordinate == "stroke"
        place = kept + _JOINT_MEMORY * len(rows)
        rows.append(
            (
                groups.owners.index(f"joints.{spec.joint}"), k,
                groups.groups[groups.owners.index(f"forces.{name}")][0], -1, 0 if along else 2,
                1.0 if coordinate == "stroke" else spec.radius, spec.length or 0.0,
                spec.width or 0.0, spec.preload, *_parameters(spec), place,
            )
        )  # fmt: skip
    return np.array(rows, JOINT_FRICTION) if rows else None
