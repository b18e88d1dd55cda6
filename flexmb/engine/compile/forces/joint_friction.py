"""Table of frictions in joints, and where they stand in the iteration matrix."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmb.engine.compile.forces.friction import friction_parameters
from flexmb.engine.kernels.forces.joint_friction import JOINT_FRICTION, JointFrictions
from flexmb.engine.lowering import Lowering, Placement
from flexmb.model.forces.friction import JointFrictionSpec, friction_coordinate

__all__ = ["lower_joint_frictions", "place_joint_frictions"]

_HISTORY = 2  # numbers of history: anchor of the bristle, mode


def lower_joint_frictions(lowering: Lowering) -> JointFrictions | None:
    """JOINT_FRICTION rows of all frictions in joints; `link` is filled in later."""
    model, groups = lowering.model, lowering.groups
    rows: list[tuple[Any, ...]] = []
    for name, spec in model.forces.items():
        if not isinstance(spec, JointFrictionSpec):
            continue
        group = groups.numbers[f"joints.{spec.joint}"]
        k = lowering.coordinate(f"forces.{name}")
        coordinate = friction_coordinate(model, spec)
        along = model.plane is not None and coordinate == "stroke"
        radius = 1.0 if coordinate == "stroke" else spec.radius
        rows.append(
            (
                group, k, -1, 0 if along else 2, radius, spec.length or 0.0, spec.width or 0.0,
                spec.preload, *friction_parameters(spec), lowering.remember(_HISTORY),
            )
        )  # fmt: skip
        lowering.reaction_loads.append((group, k))
        lowering.markers.framed.add(groups.in_group(group)[0].I)  # the reaction is read in its axes
    if not rows:
        return None
    return JointFrictions(np.array(rows, JOINT_FRICTION), lowering.watch(len(rows)))


def place_joint_frictions(frictions: JointFrictions, placement: Placement) -> None:
    """Where the coordinate of each friction stands beside the rows of its joint."""
    links, first = placement.symbolic.coordinate_links, placement.n_bodies
    for row in frictions.rows:
        row["link"] = links[int(row["group"]), first + int(row["coordinate"])]
