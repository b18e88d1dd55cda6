"""How a scene is run as a kinematic analysis: span and outputs."""

from __future__ import annotations

from typing import Annotated

from flexmb.model.values.quantities import Integer, Time
from flexmb.model.values.reading import Spec

__all__ = ["KinematicsSpec"]


class KinematicsSpec(Spec):
    """Motion that joints and drivers fix alone, without integration.

    ``duration`` [s]; ``outputs`` intervals of equal length are recorded, each with positions,
    velocities, accelerations and the reactions of that motion, to round-off whatever their number.
    """

    duration: Time
    outputs: Annotated[int, Integer(1)] = 200
