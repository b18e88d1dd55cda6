"""Table of scalar coordinates beside the bodies; None where the model has none.

A joint spring has one, without mass, that follows the angle or stroke of its joint: so its angle
counts turns, and its damper and spring are linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import COORDINATE
from flexmb.model.contact_checks import friction_coordinate
from flexmb.model.forces import JointSpringSpec
from flexmb.model.friction import JointFrictionSpec
from flexmb.model.model import Model

__all__ = [
    "Scalar",
    "coordinate_table",
    "followers",
    "joint_coordinate",
    "joint_springs",
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


def joint_springs(model: Model) -> dict[str, JointSpringSpec]:
    """The springs on joint coordinates, by name."""
    return {n: spec for n, spec in model.forces.items() if isinstance(spec, JointSpringSpec)}


def followers(model: Model) -> dict[str, JointSpringSpec | JointFrictionSpec]:
    """Forces on joint coordinates by name, in the order of the scalars that follow these."""
    frictions = {n: spec for n, spec in model.forces.items() if isinstance(spec, JointFrictionSpec)}
    return {**joint_springs(model), **frictions}


def joint_coordinate(model: Model, spec: JointSpringSpec | JointFrictionSpec) -> str:
    """The coordinate of its joint that a force acts on."""
    if isinstance(spec, JointFrictionSpec):
        return friction_coordinate(model, spec)
    return spec.coordinate


def scalars(model: Model, functions: Functions) -> list[Scalar]:
    """The scalar coordinates of a model."""
    found = []
    for name, spec in followers(model).items():
        angular = joint_coordinate(model, spec) == "angle"
        if isinstance(spec, JointFrictionSpec):
            found.append(Scalar(f"forces.{name}", angular=angular))
            continue
        function = -1 if spec.value is None else functions.add(spec.value.expression)
        found.append(
            Scalar(
                f"forces.{name}",
                damping=spec.damping,
                stiffness=spec.stiffness,
                free=spec.free,
                function=function,
                angular=angular,
            )
        )
    return found


def coordinate_table(found: list[Scalar], nq: int, nv: int) -> NDArray[np.void] | None:
    """COORDINATE rows behind the nq, nv coordinates of the bodies; panels are filled in later."""
    if not found:
        return None
    rows = [
        (nq + k, nv + k, s.mass, s.damping, s.stiffness, s.free, s.function, -1)
        for k, s in enumerate(found)
    ]
    return np.array(rows, COORDINATE)
