"""How large a model is, and what one unit of each velocity coordinate counts for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import bodies as body_tables
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.model import Model

__all__ = ["body_weights", "model_length"]


def model_length(model: Model, flexbodies: Mapping[str, FlexBody]) -> float:
    """Size of the model [m]: spread of all markers and flexible bodies in the placed pose."""
    points = []
    for body in (*model.bodies, "ground"):
        for name in lookup.marker_names(model, body, flexbodies):
            marker = lookup.placed(model, f"{body}.{name}", flexbodies)
            points.append(lookup.global_position(model, marker))
    spread = float(np.linalg.norm(np.ptp(np.array(points), axis=0)))
    gyration = [
        float(np.sqrt(np.trace(spec.mass_properties.inertia) / spec.mass_properties.mass))
        for spec in model.bodies.values()
        if not spec.flexible
    ]
    reach = [body.characteristic_length for body in flexbodies.values()]
    return max([spread, *gyration, *reach]) or 1.0


def body_weights(
    model: Model, flexbodies: Mapping[str, FlexBody], length: float
) -> NDArray[np.float64]:
    """Size of one unit of every velocity coordinate: metres over the model size, radians, modal
    coordinates by the largest displacement their mode makes, over the model size."""
    parts = []
    for name in model.bodies:
        parts += [np.full(3, 1.0 / length), np.ones(3)]
        if name in flexbodies:
            parts.append(body_tables.modal_reach(flexbodies[name]) / length)
    return np.concatenate(parts)
