"""The integrators that a scene can name: their words, and what each is good for.

What a method does is the file of its name in `flexmb.engine.integrators`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

__all__ = ["METHODS", "MethodName"]

METHODS: dict[str, str] = {
    "generalized-alpha": "implicit, second order, numerical damping by spectral_radius: "
    "the choice for flexible bodies and stiff springs",
    "explicit-rk": "Bogacki-Shampine 3(2) with projection onto the joints: for rigid bodies "
    "without stiff parts",
}
"""What each integrator is good for."""

if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[*METHODS]
    """Words of `dynamics.method`."""
