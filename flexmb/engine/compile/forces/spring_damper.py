"""Tables of linear spring–dampers along lines."""

from __future__ import annotations

import numpy as np

from flexmb.engine.kernels.forces.spring_damper import SPRING, SPRINGS, Springs
from flexmb.engine.lowering import Element, Lowering
from flexmb.model import lookup
from flexmb.model.forces.spring_damper import SpringDamperSpec

__all__ = ["line_ends", "lower_springs"]


def lower_springs(lowering: Lowering) -> Springs | None:
    """SPRING rows; None if the model has none."""
    rows: list[tuple[object, ...]] = []
    for name, spec in lowering.model.forces.items():
        if isinstance(spec, SpringDamperSpec) and spec.linear:
            lowering.elements[f"forces.{name}"] = Element(SPRINGS.name, len(rows))
            i, j, length = line_ends(lowering, spec)
            rows.append((i, j, spec.stiffness, spec.damping, length, -1))
    return Springs(np.array(rows, SPRING)) if rows else None


def line_ends(lowering: Lowering, spec: SpringDamperSpec) -> tuple[int, int, float]:
    """Markers and free length [m] of a spring-damper along a line."""
    model, flexbodies = lowering.model, lowering.flexbodies
    ends = [lookup.place_marker(model, reference, flexbodies) for reference in spec.between]
    length = spec.free_length
    if length == "placed":
        I, J = (lookup.global_position(model, marker) for marker in ends)  # noqa: E741
        length = float(np.linalg.norm(J - I))
    i, j = (lowering.markers.add(marker) for marker in ends)
    return i, j, float(length)
