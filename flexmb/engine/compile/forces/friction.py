"""Parameters of dry friction as rows of contacts and of frictions in joints hold them."""

from __future__ import annotations

import math

from flexmb.engine.kernels.forces.friction import BRISTLE, NO_FRICTION, SMOOTH
from flexmb.model.forces.friction import BaseFriction

__all__ = ["friction_parameters"]


def friction_parameters(spec: BaseFriction | None) -> tuple[float, ...]:
    """Numbers of `friction.FRICTION_FIELDS` but the place of the history; None: no friction."""
    if spec is None:
        return NO_FRICTION, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0, 1.0
    static = spec.static_coefficient
    stribeck = spec.stribeck_speed if static > spec.dynamic else math.inf
    return (
        SMOOTH if spec.model == "smooth" else BRISTLE, static, spec.dynamic, stribeck,
        spec.viscous, spec.stiffness or 0.0, spec.damping, spec.creep_speed or 1.0,
    )  # fmt: skip
