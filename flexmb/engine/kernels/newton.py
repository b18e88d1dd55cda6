"""Simplified Newton iteration of the implicit methods: what its measured contraction asks for."""

from __future__ import annotations

from flexmb.engine.jit import kernel

REFACTOR_ABOVE = 0.3
"""Contraction by an old factor above which it is renewed within a step."""
# By a new one: above which the unsymmetric matrix is factored instead, and the step given up.
_UNSYMMETRIC_ABOVE = 0.2
_GIVE_UP_ABOVE = 0.9


@kernel
def give_up(memory, contraction):
    """Let the factor be renewed, or be that of the unsymmetric matrix; true: give the step up."""
    fresh = memory["factor_age"] == 0.0
    if contraction > _UNSYMMETRIC_ABOVE and memory["symmetric"] == 1.0 and fresh:
        memory["symmetric"] = 0.0
        memory["factor_age"] = -1.0
    elif contraction > REFACTOR_ABOVE and not fresh:
        memory["factor_age"] = -1.0
    return contraction > _GIVE_UP_ABOVE and fresh and memory["factor_age"] == 0.0
