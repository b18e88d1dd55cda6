"""Table of contacts: a row for each point or sphere that may touch a surface."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from flexmb.engine.compile.forces.friction import friction_parameters
from flexmb.engine.compile.forces.hertz import hertz_stiffness, plane_modulus
from flexmb.engine.kernels.forces.contact_force import (
    BALL,
    BORE,
    CONTACT,
    CYLINDER,
    PLANE,
    Contacts,
)
from flexmb.engine.lowering import Element, Lowering
from flexmb.model import lookup
from flexmb.model.bodies.markers import MarkerSpec, PlacedMarker, place
from flexmb.model.forces.contact import (
    ContactSpec,
    CylinderSide,
    PlaneSide,
    PointsSide,
    SphereSide,
    damping_factor,
    nodes_of,
)
from flexmb.model.model import Model
from flexmb.model.values.names import GROUND, split_reference

__all__ = ["lower_contacts"]

# Numbers of history of a point: speed of approach; with friction its mode and bristle too.
_HISTORY, _FRICTION_HISTORY = 1, 5


def lower_contacts(lowering: Lowering) -> Contacts | None:
    """CONTACT rows of all contacts, one for each point."""
    rows: list[tuple[Any, ...]] = []
    for name, spec in lowering.model.forces.items():
        if isinstance(spec, ContactSpec):
            first = len(rows)
            rows += _rows(lowering, spec)
            swapped = spec.round_side == 1
            lowering.elements[f"forces.{name}"] = Element(
                "contacts", first, len(rows) - first, swapped
            )
    if not rows:
        return None
    table = np.array(rows, CONTACT)
    return Contacts(table, lowering.watch(2 * len(table)))


def _rows(lowering: Lowering, spec: ContactSpec) -> Iterator[tuple[Any, ...]]:
    """Rows of one contact; `couple` is filled in later."""
    k = spec.round_side
    J = lowering.markers.add(_surface(lowering, spec.between[1 - k], spec.shapes[1 - k]))
    law = _law(lowering.model, spec)
    friction = friction_parameters(spec.friction)
    kind, rj, half = _geometry(spec.shapes[1 - k])
    side = spec.shapes[k]
    ri = side.radius if isinstance(side, SphereSide) else 0.0
    for marker in _round_side(lowering, spec.between[k], side):
        I = lowering.markers.add(marker)  # noqa: E741
        history = lowering.remember(_HISTORY if spec.friction is None else _FRICTION_HISTORY)
        yield I, J, kind, ri, rj, half, *law, -1, *friction, history


def _geometry(side: Any) -> tuple[int, float, float]:
    """Kind, radius and half length of the side J."""
    if isinstance(side, SphereSide):
        return BALL, side.radius, 0.0
    if isinstance(side, PlaneSide):
        return PLANE, 0.0, 0.0
    assert isinstance(side, CylinderSide)  # all other pairs are refused
    half = math.inf if side.length is None else 0.5 * side.length
    return BORE if side.side == "inside" else CYLINDER, side.radius, half


def _surface(lowering: Lowering, reference: str, side: Any) -> PlacedMarker:
    """Marker of the side J, z being its normal or axis."""
    axis = getattr(side, "axis", None)
    return lookup.frames(lowering.model, (reference, reference), axis, lowering.flexbodies)[0]


def _round_side(lowering: Lowering, reference: str, side: Any) -> Iterator[PlacedMarker]:
    """Markers of the side I: the centre of a sphere, or all points."""
    model, flexbodies = lowering.model, lowering.flexbodies
    if isinstance(side, SphereSide):
        yield lookup.place_marker(model, reference, flexbodies)
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
    first, second = ((material.E, material.nu) for material in spec.materials)
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
