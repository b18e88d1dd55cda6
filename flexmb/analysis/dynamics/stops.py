"""Stops that a run begins inside of: what the user should know of the first state."""

from __future__ import annotations

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.engine.forces.force_characteristic import (
    COORDINATE_OF,
    DISTANCE_OF,
    FORCE_CHARACTERISTICS,
)
from flexmb.engine.state import State, Work
from flexmb.model.forces.stops import JointStopSpec
from flexmb.model.model import Model

__all__ = ["stop_notes"]

_LEAST = 1e-9  # penetration over the model size (or radians) that round-off does not leave


def stop_notes(compiled: Compiled, model: Model, state: State, work: Work) -> list[str]:
    """A sentence for every stop that pushes from the start.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The compiled model and the model.
    state, work : State, Work
        The first state, and the scratch with its markers.
    """
    notes = []
    for name, element in compiled.elements.items():
        if element.kind != FORCE_CHARACTERISTICS.name:
            continue
        row = compiled.system.kinds[element.kind].rows[element.row]
        if not row["stop"]:
            continue
        place = _measure(compiled, row, state, work)
        depth = max(place - row["upper"], row["lower"] - place)
        spec = model.forces[name.partition(".")[2]]
        angular = isinstance(spec, JointStopSpec) and spec.coordinate != "stroke"
        if depth > _LEAST * (1.0 if angular else compiled.length):
            text = model.units.say(depth, "rad" if angular else "m", 4)
            notes.append(f"{name} is {text} inside the stop at the start: it pushes from there on")
    return notes


def _measure(compiled: Compiled, row: np.void, state: State, work: Work) -> float:
    """Distance, displacement or joint coordinate that a stop limits."""
    if row["measure"] == COORDINATE_OF:
        return float(state.q[compiled.system.parts.coordinates[row["coordinate"]]["iq"]])
    markers = work.now.marker
    h = markers["x"][row["J"]] - markers["x"][row["I"]]
    if row["measure"] == DISTANCE_OF:
        return float(np.linalg.norm(h))
    return float(markers["R"][row["I"]][:, 2] @ h)
