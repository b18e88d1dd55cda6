"""Table of scalar coordinates beside the bodies.

A joint spring has one, without mass, that follows the angle or stroke of its joint: so its angle
counts turns, and its damper and spring are linear in it. A force along a line has one that follows
the distance. Couplers have those that tell how their joints move together. Each state has one with
mass one, whose velocity is the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.joints.couplers import coupled_scalars
from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import COORDINATE
from flexmb.model.forces.friction import JointFrictionSpec, friction_coordinate
from flexmb.model.forces.load import LineForceSpec
from flexmb.model.forces.spring_damper import JointSpringSpec
from flexmb.model.forces.stops import JointStopSpec
from flexmb.model.model import Model
from flexmb.model.sensors.control import State

__all__ = [
    "Scalar",
    "coordinate_table",
    "followers",
    "joint_coordinate",
    "joint_springs",
    "line_forces",
    "scalars",
]


@dataclass(frozen=True)
class Scalar:
    """m s'' + c s' + k (s − s0) = u(t); `function` is u in `Functions`, −1 for none."""

    name: str
    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    free: float = 0.0
    function: int = -1
    angular: bool = True  # counted in radians, else in metres
    size: float = 0.0  # of a state: from where on it is large; 0: a motion


def joint_springs(model: Model) -> dict[str, JointSpringSpec]:
    """The springs on joint coordinates, by name."""
    return {n: spec for n, spec in model.forces.items() if isinstance(spec, JointSpringSpec)}


OnJoint = JointSpringSpec | JointStopSpec | JointFrictionSpec
"""Forces on a coordinate of a joint."""


def followers(model: Model) -> dict[str, OnJoint]:
    """Forces on joint coordinates by name, in the order of the scalars that follow these."""
    forces = model.forces.items()
    stops = {n: spec for n, spec in forces if isinstance(spec, JointStopSpec)}
    frictions = {n: spec for n, spec in forces if isinstance(spec, JointFrictionSpec)}
    return {**joint_springs(model), **stops, **frictions}


def joint_coordinate(model: Model, spec: OnJoint) -> str:
    """The coordinate of its joint that a force acts on."""
    if isinstance(spec, JointFrictionSpec):
        return friction_coordinate(model, spec)
    return spec.coordinate


def line_forces(model: Model) -> dict[str, LineForceSpec]:
    """The forces along lines, by name."""
    return {n: spec for n, spec in model.forces.items() if isinstance(spec, LineForceSpec)}


def scalars(model: Model, functions: Functions, states: tuple[State, ...]) -> list[Scalar]:
    """The scalar coordinates of a model: of joint forces, lines of forces, couplers, states.

    Laws and stops on joints are elements of their own.
    """
    joints = [_follower(model, name, spec, functions) for name, spec in followers(model).items()]
    lines = [
        Scalar(f"forces.{name}", function=functions.add(spec.value.expression), angular=False)
        for name, spec in line_forces(model).items()
    ]
    coupled = [Scalar(name, angular=angular) for name, angular in coupled_scalars(model)]
    own = [
        Scalar(f"states.{s.name}", 1.0, function=functions.put(s.rate), size=s.scale)
        for s in states
    ]
    return [*joints, *lines, *coupled, *own]


def _follower(model: Model, name: str, spec: OnJoint, functions: Functions) -> Scalar:
    angular = joint_coordinate(model, spec) != "stroke"
    if isinstance(spec, JointFrictionSpec | JointStopSpec):
        return Scalar(f"forces.{name}", angular=angular)
    return Scalar(
        f"forces.{name}",
        damping=spec.damping,
        stiffness=spec.stiffness,
        free=spec.free,
        function=-1 if spec.value is None else functions.add(spec.value.expression),
        angular=angular,
    )


def unit_weight(scalar: Scalar, length: float) -> float:
    """What one unit of a scalar coordinate counts for: radians, metres over the model size."""
    if scalar.size > 0.0:
        return 1.0 / scalar.size
    return 1.0 if scalar.angular else 1.0 / length


def coordinate_table(found: list[Scalar], nq: int, nv: int) -> NDArray[np.void]:
    """COORDINATE rows behind the nq, nv coordinates of the bodies; panels are filled in later."""
    rows = [
        (nq + k, nv + k, s.mass, s.damping, s.stiffness, s.free, s.function, -1, s.size > 0.0)
        for k, s in enumerate(found)
    ]
    return np.array(rows, COORDINATE)
