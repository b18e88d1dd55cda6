"""The integrators that a scene can name: their words, what each is good for, and their options.

What a method does is said by the files in `flexmb.engine.integrators`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

__all__ = ["METHODS", "OPTIONS", "MethodName"]

METHODS: dict[str, str] = {
    "auto": "explicit-rk, or radau for flexible bodies and where stiffness limits its steps; "
    "generalized-alpha for fixed steps",
    "generalized-alpha": "implicit, second order, numerical damping by spectral_radius: "
    "the choice for flexible bodies and stiff springs",
    "explicit-rk": "Dormand-Prince 8(5,3) or 5(4), by order, with projection onto the joints: for "
    "what is not stiff",
    "radau": "Radau IIA, implicit, fifth order, damps stiff modes: for stiff parts",
    "hht": "Hilber-Hughes-Taylor, generalized-alpha with the damping of alpha: as other programs "
    "know it",
    "newmark": "Newmark's method with its beta and gamma: for teaching; of first order unless "
    "gamma is 1/2",
    "trapezoidal": "trapezoidal rule, Newmark's method with 1/4 and 1/2: second order without "
    "numerical damping",
    "baumgarte": "explicit, augmented equations with Baumgarte's stabilization in place of "
    "projection: for teaching; joints drift, and the summary says how far",
    "coordinate-partitioning": "explicit, integrates independent coordinates and solves the "
    "joints for the dependent ones: for teaching",
}
"""What each integrator is good for."""

_EXPLICIT = ("explicit-rk", "baumgarte", "coordinate-partitioning")
_IMPLICIT = ("generalized-alpha", "hht", "newmark", "trapezoidal", "radau")

OPTIONS: dict[str, tuple[str, ...]] = {
    "order": _EXPLICIT,
    "spectral_radius": ("generalized-alpha",),
    "newton_tolerance": _IMPLICIT,
    "alpha": ("hht",),
    "beta": ("newmark",),
    "gamma": ("newmark",),
    "baumgarte_alpha": ("baumgarte",),
    "baumgarte_beta": ("baumgarte",),
}
"""Fields of `[dynamics]` that only some methods have: which."""


if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[*METHODS]
    """Words of `dynamics.method`."""
