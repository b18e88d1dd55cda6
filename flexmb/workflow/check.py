"""Validating a scene without running it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from flexmb.errors import SceneError
from flexmb.units import SI, UnitSystem
from flexmb.workflow.reports import CheckReport

if TYPE_CHECKING:
    from flexmb.fe import Survey
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
    from flexmb.workflow.bodies import surveyed_bodies

    model = load_scene(Path(path), dict(overrides or {}))
    surveys, problems = surveyed_bodies(model)
    problems = model.problems() + problems
    if problems:
        raise SceneError.from_problems(problems)
    counts = count(model)
    told = {
        "rigid bodies": counts.rigid_bodies,
        "flexible bodies": counts.flexible_bodies,
        **{f"{row.type} joints": row.joints for row in counts.joints},
        **({"couplers": counts.couplers} if counts.couplers else {}),
        "drivers": counts.drivers,
        "forces": counts.forces,
        "sensors": counts.sensors,
        "coordinates of the bodies, without modes": counts.rigid_coordinates,
        "equations of the joints" + (" and couplers" if counts.couplers else ""): counts.equations,
        "freedoms left by joints and drivers": counts.mobility,
    }
    notes = _notes(model, counts)
    for name, found in surveys.items():
        notes += [f"{name}: {finding.sentence}" for finding in found.findings]
    bodies = {name: _told(found, model.units) for name, found in surveys.items()}
    return CheckReport(model.title or str(path), told, notes, bodies)


def _told(found: Survey, units: UnitSystem) -> dict[str, str]:
    """What a body will be made of and what is kept of it."""
    return {
        "elements": ", ".join(f"{count} {kind}" for kind, count in found.elements.items()),
        "degrees of freedom": str(found.dofs),
        "kept coordinates": found.coordinates,
        "mass": units.say(found.mass, "kg"),
    }


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
    if counts.mobility < 0:
        notes.append(
            "joints and drivers hold more than rigid bodies can move: flexible bodies must give "
            "way, or reactions are not unique"
        )
    return notes
