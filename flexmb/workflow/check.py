"""Validating a scene without running it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import SceneError
from flexmb.units import SI
from flexmb.workflow.reports import CheckReport

if TYPE_CHECKING:
    from flexmb.model import Model
    from flexmb.model.counts import Counts

__all__ = ["check_scene"]


def check_scene(path: str | Path, overrides: Mapping[str, str] | None = None) -> CheckReport:
    """Validate a scene, the groups of its meshes too, and count what it holds.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    from flexmb.model import load_scene
    from flexmb.model.counts import count
    from flexmb.workflow.bodies import body_problems

    model = load_scene(Path(path), dict(overrides or {}))
    problems = model.problems() + body_problems(model)
    if problems:
        raise SceneError.from_problems(problems)
    counts = count(model)
    told = {
        "rigid bodies": counts.rigid_bodies,
        "flexible bodies": counts.flexible_bodies,
        **{f"{row.type} joints": row.joints for row in counts.joints},
        "drivers": counts.drivers,
        "forces": counts.forces,
        "sensors": counts.sensors,
        "coordinates of the bodies, without modes": counts.rigid_coordinates,
        "equations of the joints": counts.equations,
        "freedoms left by joints and drivers": counts.mobility,
    }
    return CheckReport(model.title or str(path), told, _notes(model, counts))


def _notes(model: Model, counts: Counts) -> list[str]:
    """What is worth knowing of a valid scene."""
    from flexmb.model.head import gravity_in_words

    gravity = None
    if model.gravity is not None:
        gravity = [model.units.outward(g, "m/s^2") for g in model.gravity]
    notes = [gravity_in_words(gravity, model.units)]
    if model.plane is not None:
        notes.append(
            f"everything moves in the plane {model.plane}: three coordinates for each body"
        )
    if model.units is not SI:
        notes.append(f"units: {model.units.name}, for all numbers in and out")
    if counts.flexible_bodies:
        notes.append("modes of flexible bodies add coordinates that are not counted here")
    if counts.mobility < 0:
        notes.append(
            "joints and drivers hold more than rigid bodies can move: flexible bodies must give "
            "way, or reactions are not unique"
        )
    return notes
