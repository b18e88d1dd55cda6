"""Tables of springs (None where the model has none) and of loads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.markers import Markers
from flexmb.engine.compile.pool import Functions
from flexmb.engine.tables import LOAD, SPRING
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.forces.force import LoadSpec, SpringDamperSpec
from flexmb.model.model import Model

Bodies = Mapping[str, FlexBody]
Table = NDArray[np.void]


def spring_table(model: Model, flexbodies: Bodies, markers: Markers) -> Table | None:
    """SPRING rows; `couple` is filled in later."""
    rows: list[tuple[object, ...]] = []
    for spec in model.forces.values():
        if isinstance(spec, SpringDamperSpec) and spec.linear:
            i, j, length = line_ends(model, spec, flexbodies, markers)
            rows.append((i, j, spec.stiffness, spec.damping, length, -1))
    return np.array(rows, SPRING) if rows else None


def line_ends(
    model: Model, spec: SpringDamperSpec, flexbodies: Bodies, markers: Markers
) -> tuple[int, int, float]:
    """Markers and free length [m] of a spring-damper along a line."""
    ends = [lookup.placed(model, ref, flexbodies) for ref in spec.between]
    length = spec.free_length
    if length == "placed":
        I, J = (lookup.global_position(model, marker) for marker in ends)  # noqa: E741
        length = float(np.linalg.norm(J - I))
    i, j = (markers.add(marker) for marker in ends)
    return i, j, float(length)


def load_table(model: Model, flexbodies: Bodies, markers: Markers, functions: Functions) -> Table:
    """LOAD rows, of loads in global axes or their own marker's that act on one body."""
    rows: list[tuple[object, ...]] = []
    for spec in model.forces.values():
        if isinstance(spec, LoadSpec) and spec.reaction is None and spec.axes_marker is None:
            marker = markers.add(lookup.placed(model, spec.at, flexbodies))
            programs = tuple(functions.add(f.expression) for f in spec.value)
            rows.append((marker, spec.type == "torque", spec.axes == "body", programs))
    return np.array(rows, LOAD)
