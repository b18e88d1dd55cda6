"""Tables of loads in foreign axes, or with their opposite on another body."""

from __future__ import annotations

import numpy as np

from flexmb.engine.kernels.forces.action_reaction_load import (
    ACTION_REACTION_LOAD,
    ACTION_REACTION_LOADS,
    ActionReactionLoads,
)
from flexmb.engine.lowering import Action, Element, Lowering
from flexmb.model.forces.load import LoadSpec

__all__ = ["lower_action_reaction_loads"]


def lower_action_reaction_loads(lowering: Lowering) -> ActionReactionLoads | None:
    """ACTION_REACTION_LOAD rows; None if the model has none. Links are filled in later."""
    rows: list[tuple[object, ...]] = []
    kind = ACTION_REACTION_LOADS.name
    for name, spec in lowering.model.forces.items():
        if not isinstance(spec, LoadSpec) or (spec.reaction is None and spec.axes_marker is None):
            continue
        axes = spec.at if spec.axes == "body" else spec.axes_marker
        marker, other, turning = (
            -1 if reference is None else lowering.marker(reference)
            for reference in (spec.at, spec.reaction, axes)
        )
        programs = tuple(lowering.functions.add(f.expression) for f in spec.value)
        lowering.elements[f"forces.{name}"] = Element(kind, len(rows))
        lowering.actions += [
            Action(program, kind, len(rows), on, a, end)
            for a, program in enumerate(programs)
            for on, end in enumerate((marker, other))
            if end >= 0
        ]
        rows.append((marker, other, turning, spec.type == "torque", programs, -1, -1, -1))
    return ActionReactionLoads(np.array(rows, ACTION_REACTION_LOAD)) if rows else None
