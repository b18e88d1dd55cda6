"""Tables of loads on one marker, in global axes or its own."""

from __future__ import annotations

import numpy as np

from flexmb.engine.kernels.forces.load import LOAD, LOADS, Loads
from flexmb.engine.lowering import Action, Element, Lowering
from flexmb.model.forces.load import LoadSpec

__all__ = ["lower_loads"]


def lower_loads(lowering: Lowering) -> Loads | None:
    """LOAD rows; None if the model has none."""
    rows: list[tuple[object, ...]] = []
    for name, spec in lowering.model.forces.items():
        if isinstance(spec, LoadSpec) and spec.reaction is None and spec.axes_marker is None:
            k, marker = len(rows), lowering.marker(spec.at)
            programs = tuple(lowering.functions.add(f.expression) for f in spec.value)
            rows.append((marker, spec.type == "torque", spec.axes == "body", programs))
            lowering.elements[f"forces.{name}"] = Element(LOADS.name, k)
            lowering.actions += [
                Action(program, LOADS.name, k, 0, a, marker) for a, program in enumerate(programs)
            ]
    return Loads(np.array(rows, LOAD)) if rows else None
