"""The integrators that a scene can name: their words, and what each is good for.

What a method does is one file of `flexmb.engine.integrators`.
"""

from __future__ import annotations

from typing import Literal

__all__ = ["METHODS", "MethodName"]

MethodName = Literal["generalized-alpha", "explicit-rk"]
"""Words of `dynamics.method`."""

METHODS: dict[MethodName, str] = {
    "generalized-alpha": "implicit, second order, numerical damping by spectral_radius: "
    "the choice for flexible bodies and stiff springs",
    "explicit-rk": "Bogacki-Shampine 3(2) with projection onto the joints: for rigid bodies "
    "without stiff parts",
}
"""What each integrator is good for."""
