"""What couplers say as equations between joint coordinates, with the signs that follow from places.

Wheels on a common carrier: θ is the angle of a wheel relative to it about its joint's axis u, which
is the joint's angle if the carrier is on side I and its negative otherwise. Wheels that roll on
each other outside turn in opposite senses about parallel u of one direction, and about axes that
meet if both u lead from there to their wheels, or both back; inside, in the same sense. Where a
wheel's marker lies in the meeting point itself, u counts as leading to the wheel. A rack moves with
the point of the pinion below it, s' = R θ' (u × n)·d, d the direction of the rack and n across it
from the pinion's axis. Source: rolling of pitch cones; Willis, Principles of Mechanism, 1841.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.model import lookup
from flexmb.model.joints.couplers import GearSpec, LinearCouplerSpec, RackSpec
from flexmb.model.values.names import GROUND, split_reference
from flexmb.model.values.orientation import rotation_matrix

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = [
    "Equation",
    "Term",
    "acting_names",
    "carriers",
    "equation",
    "known_equations",
    "terms_of",
]

Array = NDArray[np.float64]
_TOUCHING = 1e-6  # a distance this small, relative to those between the axes, is none
_FITS = 1e-2  # share by which radii may miss the distance between the axes


@dataclass(frozen=True)
class Term:
    """One coordinate of a joint in an equation, with its factor (SI)."""

    joint: str
    coordinate: str
    factor: float


@dataclass(frozen=True)
class Equation:
    """Σ factor x = constant; ``relative``: x are counted from the placed pose."""

    terms: tuple[Term, ...]
    constant: float
    relative: bool


@dataclass(frozen=True)
class _Wheel:
    """A wheel or rack beside its carrier: place and axis in the placed pose, global."""

    sense: float  # +1 where the carrier is marker I of its joint
    x: Array
    u: Array


def terms_of(spec: object) -> tuple[tuple[str, str], ...]:
    """Joints and coordinates that a coupler relates, in order."""
    if isinstance(spec, LinearCouplerSpec):
        return tuple((term.joint, term.coordinate) for term in spec.terms)
    assert isinstance(spec, GearSpec | RackSpec)
    second = "angle" if isinstance(spec, GearSpec) else "stroke"
    return (spec.joints[0], "angle"), (spec.joints[1], second)


def acting_names(name: str, spec: object) -> tuple[str, ...]:
    """Names of what a coupler does to each of its joints, ``coupler.joint``.

    With the coordinate behind them where the joint alone does not tell it.
    """
    terms = terms_of(spec)
    joints = [joint for joint, _ in terms]
    plain = [c != "second_angle" and joints.count(joint) == 1 for joint, c in terms]
    return tuple(
        f"{name}.{joint}" + ("" if alone else f".{coordinate}")
        for (joint, coordinate), alone in zip(terms, plain, strict=True)
    )


def carriers(model: Model, joints: tuple[str, str]) -> list[str]:
    """Bodies that two joints share."""
    first, second = ([split_reference(end)[0] for end in model.joints[j].between] for j in joints)
    return [body for body in first if body in second]


def equation(model: Model, name: str, flexbodies: lookup.Bodies | None = None) -> Equation:
    """The equation of a coupler whose joints exist and share a carrier.

    Parameters
    ----------
    model : Model
        The model.
    name : str
        Name of the coupler.
    flexbodies : mapping, optional
        The flexible bodies by name.

    Raises
    ------
    SceneError
        Axes on which the wheels cannot roll, radii that do not fit their distance.
    """
    spec = model.couplers[name]
    keys = terms_of(spec)
    if isinstance(spec, LinearCouplerSpec):
        factors: tuple[float, ...] = tuple(term.factor for term in spec.terms)
        constant, relative = spec.constant, False
    else:
        carrier = carriers(model, spec.joints)[0]
        first, second = (_wheel(model, joint, carrier, flexbodies) for joint in spec.joints)
        try:
            if isinstance(spec, GearSpec):
                a, b = _gear(model, spec, first, second)
            else:
                a, b = _rack(spec, first, second)
        except SceneError as error:
            found = [Problem(f"couplers.{name}", p.what) for p in error.problems]
            raise SceneError.from_problems(found) from None
        factors, constant, relative = (a * first.sense, b * second.sense), 0.0, True
    terms = (Term(*key, factor) for key, factor in zip(keys, factors, strict=True))
    return Equation(tuple(terms), constant, relative)


def _wheel(model: Model, joint: str, carrier: str, flexbodies: lookup.Bodies | None) -> _Wheel:
    I, J = lookup.joint_frames(model, joint, flexbodies)  # noqa: E741
    sense = 1.0 if I.body == carrier else -1.0
    A = np.eye(3) if I.body == GROUND else rotation_matrix(model.bodies[I.body].orientation)
    x = lookup.global_position(model, J if I.body == carrier else I)
    return _Wheel(sense, x, A @ I.R[:, 2])


def _gear(model: Model, spec: GearSpec, one: _Wheel, two: _Wheel) -> tuple[float, float]:
    """Factors of the wheels' angles relative to the carrier."""
    if spec.ratio is not None:
        return spec.ratio, -1.0
    sizes = spec.teeth or spec.radii
    assert sizes is not None  # one of the three is given
    h = two.x - one.x
    if np.linalg.norm(np.cross(one.u, two.u)) < lookup.PARALLEL:
        ends = 1.0, float(np.sign(one.u @ two.u))
        if spec.radii is not None:
            _check_distance(model, spec, float(np.linalg.norm(h - (h @ one.u) * one.u)))
    else:
        ends = _outward(one, two)
    side = -1.0 if spec.internal else 1.0
    return sizes[0] * ends[0], side * sizes[1] * ends[1]


def _check_distance(model: Model, spec: GearSpec, distance: float) -> None:
    assert spec.radii is not None  # the caller knows
    R, r = spec.radii
    needed = abs(R - r) if spec.internal else R + r
    if abs(distance - needed) > _FITS * max(R, r):
        say = model.units.say
        kind = "one inside the other" if spec.internal else "outside"
        raise SceneError(
            f"wheels of the radii {say(R, 'm')} and {say(r, 'm')} roll {kind} with their axes "
            f"{say(needed, 'm')} apart, these are {say(distance, 'm')} apart; mend radii or "
            'places, or give "ratio"'
        )


def _outward(one: _Wheel, two: _Wheel) -> tuple[float, float]:
    """Whether axes that are not parallel lead from their meeting point to the wheels (±1)."""
    h = two.x - one.x
    across = np.cross(one.u, two.u)
    n = across / np.linalg.norm(across)
    size = float(np.linalg.norm(h))
    if abs(h @ n) > _TOUCHING * size:
        raise SceneError(
            "the axes of the wheels are neither parallel nor do they meet, so that the sense of "
            'turning does not follow from them: give "ratio" with its sign'
        )
    # one.x + s one.u = two.x + t two.u
    s, t = np.linalg.lstsq(np.column_stack([one.u, -two.u]), h, rcond=None)[0]
    first = 1.0 if abs(s) <= _TOUCHING * size else -float(np.sign(s))
    second = 1.0 if abs(t) <= _TOUCHING * size else -float(np.sign(t))
    return first, second


def _rack(spec: RackSpec, pinion: _Wheel, rack: _Wheel) -> tuple[float, float]:
    """Factors of the pinion's angle and the rack's stroke relative to the carrier."""
    if abs(pinion.u @ rack.u) > lookup.PARALLEL:
        raise SceneError("the rack must slide at right angles to the axis of its pinion")
    h = rack.x - pinion.x
    n = h - (h @ pinion.u) * pinion.u - (h @ rack.u) * rack.u
    distance = float(np.linalg.norm(n))
    if distance <= _TOUCHING * spec.radius:
        raise SceneError(
            "the joint of the rack lies on the axis of the pinion, so that it is not known on "
            "which side the rack runs: put its markers on the pitch line, one radius away"
        )
    return spec.radius * float(np.cross(pinion.u, n / distance) @ rack.u), -1.0


def known_equations(model: Model, flexbodies: lookup.Bodies) -> Iterator[tuple[str, Equation]]:
    """The equations of screws (by scene path), then of couplers (by name) that are known to fit."""
    for name, joint in model.joints.items():
        if joint.pitch is not None:
            thread = (Term(name, "angle", joint.pitch / (2 * math.pi)), Term(name, "stroke", -1.0))
            yield f"joints.{name}", Equation(thread, 0.0, relative=True)
    for name in model.couplers:
        try:
            yield name, equation(model, name, flexbodies)
        except (FlexmbError, KeyError, IndexError):
            continue  # told by the check of the coupler itself
