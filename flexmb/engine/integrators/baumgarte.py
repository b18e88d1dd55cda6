"""The augmented equations with Baumgarte's stabilisation, by explicit Runge–Kutta.

Every stage solves [[M, Cqᵀ], [Cq, −ε]] (v̇; λ) = (Q; γ − 2α (Cq v + C_t) − β² C), so that violations
of the constraints obey C̈ + 2α Ċ + β² C = 0 and die out with critical damping for α = β (Baumgarte,
Comput. Methods Appl. Mech. Eng. 1 (1972) 1). Nothing is projected, neither after a step nor for the
outputs: joints drift by what steps and gains leave. With α = β = 0 it is the plain augmented
method, whose drift grows with t². Gains are rates of the motion like any other: a step must be
short beside 1/α, and the order of the method holds for steps that are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexmb.engine.integrators.explicit_rk import interpolate, step
from flexmb.engine.integrators.runge_kutta import explicit_method, tableau_of
from flexmb.engine.method import Method

if TYPE_CHECKING:
    from flexmb.model.scenes.dynamics import DynamicsSpec

# Violations fall to 1/e within this share of the run by default, and within a fixed step at least.
_SHARE = 0.05


def make_method(spec: DynamicsSpec) -> Method:
    """The method for a scene, by its `order`, `baumgarte_alpha` and `baumgarte_beta`."""
    usual = 1.0 / max(_SHARE * spec.duration, spec.step or 0.0)
    alpha = usual if spec.baumgarte_alpha is None else spec.baumgarte_alpha
    beta = usual if spec.baumgarte_beta is None else spec.baumgarte_beta
    return explicit_method(
        tableau_of(spec), step, interpolate, stabilised=1, alpha=alpha, beta=beta
    )


METHODS = {"baumgarte": make_method}
