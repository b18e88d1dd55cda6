"""Table of scalar coordinates beside the bodies; None where the model has none.

A joint spring has one, without mass, that follows the angle or stroke of its joint: so its angle
counts turns, and its damper and spring are linear in it. Couplers have those that tell how their
joints move together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.couplers import coupled_scalars
from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import COORDINATE
from flexmb.model.forces import JointSpringSpec
from flexmb.model.model import Model
from flexmb.model.stops import JointStopSpec

__all__ = ["Scalar", "coordinate_table", "joint_springs", "scalars"]


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


def joint_springs(model: Model) -> dict[str, JointSpringSpec | JointStopSpec]:
    """The springs and stops on joint coordinates, by name."""
    kinds = JointSpringSpec | JointStopSpec
    return {name: spec for name, spec in model.forces.items() if isinstance(spec, kinds)}


def scalars(model: Model, functions: Functions) -> list[Scalar]:
    """The scalar coordinates of a model; laws and stops on them are elements of their own."""
    springs = [
        _scalar(f"forces.{name}", spec, functions) for name, spec in joint_springs(model).items()
    ]
    coupled = [Scalar(name, angular=angular) for name, angular in coupled_scalars(model)]
    return springs + coupled


def _scalar(name: str, spec: JointSpringSpec | JointStopSpec, functions: Functions) -> Scalar:
    angular = spec.coordinate == "angle"
    if isinstance(spec, JointStopSpec):
        return Scalar(name, angular=angular)
    return Scalar(
        name,
        damping=spec.damping,
        stiffness=spec.stiffness,
        free=spec.free,
        function=-1 if spec.value is None else functions.add(spec.value.expression),
        angular=angular,
    )


def coordinate_table(found: list[Scalar], nq: int, nv: int) -> NDArray[np.void] | None:
    """COORDINATE rows behind the nq, nv coordinates of the bodies; panels are filled in later."""
    if not found:
        return None
    rows = [
        (nq + k, nv + k, s.mass, s.damping, s.stiffness, s.free, s.function, -1)
        for k, s in enumerate(found)
    ]
    return np.array(rows, COORDINATE)
