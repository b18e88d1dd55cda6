"""The shapes of forces: springs, dampers, bushings, actuators, contact surfaces.

A spring is a coil, a damper a cylinder with a piston rod, both together are coaxial; on a joint
they are placed along or around its axis. A stop has bumpers where it acts, friction in a joint is a
brake.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import Array
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.forces.contact import CylinderSide, PlaneSide, SphereSide
from flexmb.model.forces.force_characteristic import AnyStop
from flexmb.model.forces.friction import friction_coordinate
from flexmb.model.reading import GROUND, split_reference
from flexmb.view.body_shapes import own_shape
from flexmb.view.content import (
    DAMPER,
    DRIVE,
    FRICTION,
    HOUSING,
    RUBBER,
    SPRING,
    SURFACE,
    Part,
    Place,
    between,
    on_body,
    on_marker,
    toward,
)
from flexmb.view.joint_shapes import joint_sides
from flexmb.view.mechanism import Display, Mechanism, applied
from flexmb.view.shapes import (
    Triangles,
    axes_along,
    box,
    coil,
    cylinder,
    joined,
    ring,
    sphere,
    spiral,
    torus,
    tube,
    turn_arrow,
)

_COILS = 7
_NO_FACES = np.zeros((0, 3), dtype=np.int64)
# radius of a contact point over the size; more points are not drawn
_POINT, _MAX_POINTS = 0.006, 100
_PLANE = 0.5  # edge of a contact plane over the mechanism's size
_SAMPLES = 16  # times at which the way of a body over a plane is searched


def force_parts(
    mechanism: Mechanism, r: float, size: float, lift: dict[str, float]
) -> Iterator[Part]:
    """All force elements; `r` [m]: radius of a pin, `lift`: distance of springs from their
    joints."""
    forces: dict[str, Any] = {**mechanism.model.forces}
    for name, spec in forces.items():
        if spec.type in ("spring-damper", "line-force"):
            length = float(np.linalg.norm(np.subtract(*map(mechanism.point, spec.between))))
            for shape, color in _line_shapes(spec, r, max(length, 4 * r)):
                yield Part(name, shape, color, between(*spec.between), "force")
        elif spec.type == "bushing":
            axes = _toward(mechanism, spec.between[0], spec.between[1])
            place = on_marker(spec.between[0], axes)
            yield Part(name, ring(2.6 * r, 1.5 * r, 2.6 * r), RUBBER, place, "force")
            core = joined([ring(1.5 * r, 0.8 * r, 3.6 * r), ring(3.0 * r, 2.6 * r, 2.0 * r)])
            yield Part(name, core, HOUSING, place, "force")
        elif spec.type == "beam":
            yield Part(
                name, tube((0, 0, 0), (0, 0, 1), 0.7 * r), SPRING, between(*spec.between), "force"
            )
        elif isinstance(spec, AnyStop):
            yield from _stop(mechanism, name, spec, r, lift)
        elif spec.type == "joint-friction":
            yield from _brake(mechanism, name, spec, r, lift)
        elif spec.type in ("rotational-spring-damper", "translational-spring-damper"):
            yield from _joint_spring(mechanism, name, spec, r, lift)
        elif spec.type == "contact":
            yield from _contact(mechanism, name, spec, size)


def _line_shapes(spec: Any, r: float, length: float) -> Iterator[tuple[Triangles, str]]:
    """Shapes between two markers, from z = 0 to 1."""
    if spec.type == "line-force":
        yield tube((0, 0, 0), (0, 0, 0.55), 1.2 * r), DRIVE
        yield tube((0, 0, 0.55), (0, 0, 1), 0.5 * r), HOUSING
        return
    springs = bool(spec.stiffness) or spec.spring_force is not None
    damps = bool(spec.damping) or spec.damper_force is not None
    if springs:
        yield coil(_COILS, 1.9 * r, 0.55 * r, length), SPRING
    if damps:
        wide = 0.95 * r if springs else 1.3 * r
        yield tube((0, 0, 0.0), (0, 0, 0.55), wide), DAMPER
        yield tube((0, 0, 0.55), (0, 0, 1), 0.4 * r), HOUSING
    if spec.value is not None and not damps:
        yield tube((0, 0, 0), (0, 0, 0.5), 0.9 * r), DRIVE
        yield tube((0, 0, 0.5), (0, 0, 1), 0.4 * r), HOUSING


def _joint_spring(
    mechanism: Mechanism, name: str, spec: Any, r: float, lift: dict[str, float]
) -> Iterator[Part]:
    joint = mechanism.model.joints[spec.joint]
    side = int(getattr(spec, "about", "axis") == "second_axis")
    springs = bool(spec.stiffness) or spec.spring_force is not None
    damps = bool(spec.damping) or spec.damper_force is not None
    if spec.type == "translational-spring-damper":
        first, second = joint.between
        length = float(np.linalg.norm(mechanism.point(first) - mechanism.point(second)))
        if length < 3 * r:
            return  # no room: the sleeve of the joint stands there
        shapes = [(coil(_COILS, 2.2 * r, 0.5 * r, length), SPRING)] if springs else []
        if damps and not springs:
            shapes.append((tube((0, 0, 0), (0, 0, 0.55), 1.4 * r), DAMPER))
        for shape, color in shapes:
            yield Part(name, shape, color, between(first, second), "force")
        return
    place = on_marker(joint.between[side], mechanism.joint_axes[spec.joint][side])
    off = (0, 0, lift.get(spec.joint, 2.4 * r))
    if springs:
        yield Part(
            name, spiral(1.0 * r, 3.2 * r, 2.75, 0.45 * r).moved(off), SPRING, place, "force"
        )
    if damps and not springs:
        yield Part(name, ring(2.4 * r, 1.0 * r, 0.8 * r).moved(off), DAMPER, place, "force")
    if spec.value is not None and not springs:
        yield Part(name, turn_arrow(3.0 * r, 0.55 * r).moved(off), DRIVE, place, "force")


def _stop(
    mechanism: Mechanism, name: str, spec: Any, r: float, lift: dict[str, float]
) -> Iterator[Part]:
    """Bumpers at the bounds, and the part they stop: a peg on a rotating part, the sleeve of a
    slide."""
    bounds = [bound for bound in (spec.lower, spec.upper) if bound is not None]
    if spec.type == "rotational-stop":
        joint, first = mechanism.model.joints[spec.joint], spec.about == "axis"
        sides = [on_marker(*pair) for pair in joint_sides(mechanism, spec.joint)]
        off, reach = np.array([0.0, 0.0, lift.get(spec.joint, 2.4 * r)]), 3.4 * r
        blocks = []
        for bound in bounds:
            angle = bound + (-0.18 if bound == spec.lower else 0.18)
            turn = _about_z(angle)
            blocks.append(box((1.8 * r, 0.8 * r, 1.2 * r)).moved(off + turn[:, 0] * reach, turn))
        if len(bounds) == 2 and spec.upper - spec.lower < 2 * np.pi:
            arc = torus(reach, 0.3 * r, spec.upper - spec.lower)
            blocks.append(arc.moved(off, _about_z(spec.lower)))
        yield Part(name, joined(blocks), RUBBER, sides[0 if first else 1], "force")
        if first and joint.type == "revolute":
            peg = box((3.6 * r, 0.7 * r, 0.7 * r)).moved(off + (1.8 * r, 0, 0))
            yield Part(name, peg, HOUSING, sides[1], "force")
        return
    if spec.type == "translational-stop":
        place, other = (on_marker(*pair) for pair in joint_sides(mechanism, spec.joint))
        room = 1.8 * r if mechanism.model.joints[spec.joint].type != "in-line" else 1.2 * r
    else:
        axes = None
        if spec.axis is not None:
            I = lookup.frames(mechanism.model, spec.between, spec.axis, mechanism.flexbodies)[0]  # noqa: E741
            axes = mechanism.marker(spec.between[0]).R.T @ I.R
        place = toward(*spec.between) if axes is None else on_marker(spec.between[0], axes)
        other, room = on_marker(spec.between[1]), 0.9 * r
        yield Part(name, sphere(room), HOUSING, other, "force")
    pads = []
    for bound in bounds:
        z = bound + (room + 0.3 * r) * (-1 if bound == spec.lower else 1)
        pads.append(ring(2.0 * r, 0.5 * r, 0.6 * r).moved((0, 0, z)))
    yield Part(name, joined(pads), RUBBER, place, "force")


def _brake(
    mechanism: Mechanism, name: str, spec: Any, r: float, lift: dict[str, float]
) -> Iterator[Part]:
    """Joint friction: a disc with its caliper about a pin, or two shoes on a sliding part."""
    first, second = (on_marker(*pair) for pair in joint_sides(mechanism, spec.joint))
    if friction_coordinate(mechanism.model, spec) == "angle":
        z = lift.get(spec.joint, 2.4 * r)
        z += 0.8 * r * np.sign(z)  # farther out than a spring about the joint, on its own hub
        disc = ring(3.0 * r, 0.9 * r, 0.3 * r).moved((0, 0, z))
        hub = tube((0, 0, z), (0, 0, z - 1.5 * r * np.sign(z)), 0.9 * r)
        yield Part(name, joined([disc, hub]), DAMPER, second, "force")
        caliper = box((1.5 * r, 2.4 * r, 1.1 * r)).moved((2.7 * r, 0, z))
        yield Part(name, caliper, FRICTION, first, "force")
        return
    shoes = [box((0.5 * r, 1.4 * r, 7.0 * r)).moved((s * 0.9 * r, 0, 0)) for s in (-1, 1)]
    yield Part(name, joined(shoes), FRICTION, second, "force")


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _contact(mechanism: Mechanism, name: str, spec: Any, size: float) -> Iterator[Part]:
    """Contact surfaces, unless a body shows them itself."""
    for reference, side in zip(spec.between, spec.shapes, strict=True):
        axes = np.eye(3)
        if getattr(side, "axis", None) is not None:
            marker = lookup.frames(
                mechanism.model, (reference, reference), side.axis, mechanism.flexbodies
            )[0]
            axes = mechanism.marker(reference).R.T @ marker.R
        place, body = on_marker(reference, axes), split_reference(reference)[0]
        if isinstance(side, PlaneSide):
            thick = 0.01 * size
            if _shows(mechanism, body, Triangles(np.zeros((1, 3)), _NO_FACES), place, size):
                continue
            other = next(one for one in spec.between if one != reference)
            low, high = _way(mechanism, reference, axes, other, 0.5 * _PLANE * size)
            shape = box((*(high - low), thick)).moved((*(0.5 * (low + high)), -0.5 * thick))
            yield Part(name, shape, SURFACE, place, "surface", 0.85)
            continue
        opacity = 0.7
        if isinstance(side, SphereSide):
            shape = sphere(side.radius)
        elif isinstance(side, CylinderSide):
            length = side.length or 4 * side.radius
            shape = cylinder(side.radius, length)
            if side.side == "inside":
                shape, opacity = ring(1.08 * side.radius, side.radius, length), 0.5
        elif side.points is not None and len(side.points) <= _MAX_POINTS:
            shape = joined([sphere(_POINT * size, point) for point in side.points])
            place = on_body(body)
        else:
            continue
        if not _shows(mechanism, body, shape, place, size):
            yield Part(name, shape, SURFACE, place, "force", opacity)


def _shows(mechanism: Mechanism, body: str, surface: Triangles, place: Place, size: float) -> bool:
    """Whether a body's own shape extends as far as one of its contact surfaces."""
    if body == GROUND:
        return False
    flexible = mechanism.flexbodies.get(body)
    own = own_shape(mechanism, body) if flexible is None else flexible.surface
    if own is None or not len(own.points):
        return False
    display = Display(mechanism, 1.0)
    to_body = np.linalg.inv(display.frame(body)) @ place(display)
    points, room = applied(to_body, surface.points), 1.5 * _POINT * size
    low, high = own.points.min(axis=0) - room, own.points.max(axis=0) + room
    spec = getattr(mechanism.model.bodies[body], "shape", None)
    if spec is not None and spec.type == "cylinder":  # a wheel rolls as a ball of its radius
        low["xyz".index(spec.axis)], high["xyz".index(spec.axis)] = -np.inf, np.inf
    return bool(((points > low) & (points < high)).all())


def _way(
    mechanism: Mechanism, reference: str, axes: Array, other: str, room: float
) -> tuple[Array, Array]:
    """Rectangle (smallest and largest x, y) in which a marker moves relative to another one."""
    time, places = mechanism.result.time, [np.zeros(2)]
    for row in np.unique(np.linspace(0, len(time) - 1, _SAMPLES).astype(int)):
        moment = mechanism.at(float(time[row]))
        frame = moment.marker_frame(reference)
        places.append((axes.T @ frame[:3, :3].T @ (moment.point(other) - frame[:3, 3]))[:2])
    return np.min(places, axis=0) - room, np.max(places, axis=0) + room


def _toward(mechanism: Mechanism, first: str, second: str) -> Array:
    """Axes relative to a marker with z towards another one; its own axes if they coincide."""
    frame = mechanism.marker_frame(first)
    line = mechanism.point(second) - frame[:3, 3]
    if np.linalg.norm(line) < 1e-9:
        line = np.array(PLANES[mechanism.model.plane]) if mechanism.model.plane else frame[:3, 2]
    return np.asarray(frame[:3, :3].T @ axes_along(line))
