"""The integrators that a scene can name: their words, and what each is good for.

What a method does is the file of its name in `flexmb.engine.integrators`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

__all__ = ["METHODS", "MethodName"]

METHODS: dict[str, str] = {
    "auto": "explicit-rk, or radau for flexible bodies and where stiffness limits its steps; "
    "generalized-alpha for fixed steps",
    "generalized-alpha": "implicit, second order, numerical damping by spectral_radius: "
    "the choice for flexible bodies and stiff springs",
    "explicit-rk": "Dormand-Prince 8(5,3) or 5(4), by order, with projection onto the joints: for "
    "what is not stiff",
    "radau": "Radau IIA, implicit, fifth order, damps stiff modes: for stiff parts",
}
"""What each integrator is good for."""

if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[*METHODS]
    """Words of `dynamics.method`."""
