"""Validating a scene without running it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import AssemblyError, SceneError
from flexmb.units import SI, UnitSystem
from flexmb.workflow.reports import CheckReport

if TYPE_CHECKING:
    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.fe import Survey
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.counts import Counts

__all__ = ["check_scene"]


def check_scene(
    path: str | Path, overrides: Mapping[str, str] | None = None, *, tables: bool = False
) -> CheckReport:
    """Validate a scene, the groups of its meshes too; count what it holds and what can move.

    Parameters
    ----------
    path : path
        The scene.
    overrides : mapping of str to str, optional
        Parameters or knobs to change, such as `{"r": "0.1", "dynamics.step": "1e-4"}`.
    tables : bool
        Whether to write out the tables that define the model.

    Raises
    ------
    SceneError
        All that is wrong with it.
    AssemblyError
        It cannot be assembled, or its drivers contradict each other or the joints.
    """
    from flexmb.analysis.assembly.rank import MAX_COORDINATES
    from flexmb.model import load_scene
    from flexmb.model.counts import count
    from flexmb.workflow.bodies import bodies_of_surveys, surveyed_bodies
    from flexmb.workflow.definition import definition_tables
    from flexmb.workflow.place import output_folder

    model = load_scene(Path(path), dict(overrides or {}))
    surveys, problems = surveyed_bodies(model)
    problems = model.problems() + problems
    if problems:
        raise SceneError.from_problems(problems)
    counts = count(model)
    notes = _notes(model)
    for name, found in surveys.items():
        notes += [f"{name}: {finding.sentence}" for finding in found.findings]
    known, rigid = bodies_of_surveys(model, surveys, output_folder(Path(path)))
    _check_results(model, known, rigid)
    moves = None
    if counts.rigid_coordinates > MAX_COORDINATES:
        notes.append(
            f"more than {MAX_COORDINATES} coordinates: equations are counted, not their rank"
        )
    elif model.joints or model.dynamics is not None:
        moves, told = _mobility(model, known, rigid)
        notes += told
    return CheckReport(
        model.title or str(path),
        _counted(counts),
        notes,
        {name: _told(found, model.units) for name, found in surveys.items()},
        moves,
        definition_tables(model, known) if tables else (),
    )


def _check_results(model: Model, known: Mapping[str, FlexBody], rigid: Sequence[str]) -> None:
    """Refuse names of nothing in what is to be stored."""
    from flexmb.engine.compile import compile_system
    from flexmb.results import Columns, stored_columns

    if model.results is not None and model.results.keep:
        scene = {"results": {"keep": model.results.keep}, **_reacting(model)}
        stored_columns(Columns.of(compile_system(model, known).layout), scene, rigid)


def _reacting(model: Model) -> dict[str, Any]:
    """The sections of a scene that the names of channels are made of."""
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    return {key: scene[key] for key in scene if key not in ("results", "bodies")}


def _counted(counts: Counts) -> dict[str, int]:
    """What a model consists of."""
    coupled = " and couplers" if counts.couplers else ""
    return {
        "rigid bodies": counts.rigid_bodies,
        "flexible bodies": counts.flexible_bodies,
        **{f"{row.type} joints": row.joints for row in counts.joints},
        **({"couplers": counts.couplers} if counts.couplers else {}),
        "drivers": counts.drivers,
        "forces": counts.forces,
        "sensors": counts.sensors,
        "coordinates of the bodies, without modes": counts.rigid_coordinates,
        f"equations of the joints{coupled}": counts.equations,
        "coordinates less equations": counts.mobility,
    }


def _mobility(
    model: Model, known: Mapping[str, FlexBody], rigid: Sequence[str]
) -> tuple[Mobility | None, list[str]]:
    """What can move, and notes; `rigid` are flexible bodies that are not reduced yet.

    What keeps those together only because they are rigid is a note and no error.
    """
    from flexmb.workflow.mobility import mobility

    try:
        moves = mobility(model, known)
    except AssemblyError as error:
        if not rigid:
            raise
        return None, [f"if the flexible bodies do not give way: {p}" for p in error.problems]
    notes = list(moves.notes)
    if rigid:
        notes.append(
            f"counted as rigid until reduced: {', '.join(rigid)}; modes add coordinates, and may "
            "take up redundant equations"
        )
    return moves, notes


def _told(found: Survey, units: UnitSystem) -> dict[str, str]:
    """What a body will be made of and what is kept of it."""
    return {
        "elements": ", ".join(f"{count} {kind}" for kind, count in found.elements.items()),
        "degrees of freedom": str(found.dofs),
        "kept coordinates": found.coordinates,
        "mass": units.say(found.mass, "kg"),
    }


def _notes(model: Model) -> list[str]:
    """What is worth knowing of a valid scene."""
    from flexmb.model.scenes.head import gravity_in_words

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
    return notes
