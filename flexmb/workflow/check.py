"""Checking a scene without running it: mistakes, counts, mobility."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import AssemblyError, FlexmbError, SceneError
from flexmb.folders import output_folder
from flexmb.units import SI, UnitSystem
from flexmb.workflow.flexible_bodies import bodies_of_surveys, survey_bodies
from flexmb.workflow.part_analysis import part_group_problems

if TYPE_CHECKING:
    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.fe import Survey
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.joints.joint import Counts
    from flexmb.workflow.listings import Table


@dataclass(frozen=True)
class CheckReport:
    """The report on a valid scene.

    Attributes
    ----------
    title : str
        Of the scene.
    counts : dict
        Bodies, joints, drivers and so on.
    notes : list of str
        Units, gravity, findings of meshes and so on.
    bodies : dict
        Elements and coordinates of each flexible body, in words.
    mobility : Mobility or None
        Coordinates, equations, rank and what follows; None for what is too large or never moves.
    definition : tuple
        The tables that define the model, each with its title, on request.
    """

    title: str
    counts: dict[str, int]
    notes: list[str]
    bodies: dict[str, dict[str, str]] = field(default_factory=dict)
    mobility: Mobility | None = None
    definition: tuple[tuple[str, Table], ...] = ()


def check_scene(
    path: str | Path, overrides: Mapping[str, str] | None = None, *, tables: bool = False
) -> CheckReport:
    """Validate a scene and its meshes, count its parts and its degrees of freedom.

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
    from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
    from flexmb.model import load_scene
    from flexmb.model.joints.joint import count
    from flexmb.model.scenes.effects import active_model
    from flexmb.workflow.model_tables import definition_tables

    model = load_scene(Path(path), dict(overrides or {}))
    inconsistent = model.problems()
    model = active_model(model)
    surveys, problems = survey_bodies(model)
    if problems := [*inconsistent, *problems, *part_group_problems(model, surveys)]:
        raise SceneError.from_problems(problems)
    counts = count(model)
    notes = _notes(model)
    for name, survey in surveys.items():
        notes += [f"{name}: {finding.sentence}" for finding in survey.findings]
    bodies, rigid = bodies_of_surveys(model, surveys, output_folder(Path(path)))
    notes += model.warnings(bodies)
    _check_results(model, bodies, rigid)
    moves = None
    if counts.rigid_coordinates > MAX_COORDINATES:
        notes.append(
            f"more than {MAX_COORDINATES} coordinates: equations are counted, not their rank"
        )
    elif model.joints or model.dynamics is not None:
        moves, mobility_notes = _mobility(model, bodies, rigid)
        notes += mobility_notes
    return CheckReport(
        model.title or str(path),
        counts_table(counts),
        notes,
        {
            name: {
                **_survey_table(survey, model.units),
                "effects": model.bodies[name].effects_in_words(),  # type: ignore[attr-defined]
            }
            for name, survey in surveys.items()
        },
        moves,
        definition_tables(model, bodies) if tables else (),
    )


def mobility(model: Model, flexbodies: Mapping[str, FlexBody] | None = None) -> Mobility:
    """Coordinates, equations, rank, redundant equations with their cures, free motions.

    Parameters
    ----------
    model : Model
        The model; it is not changed.
    flexbodies : mapping of str to FlexBody, optional
        Reduced bodies of meshes by name; a mesh that is not given counts as a rigid body.

    Returns
    -------
    Mobility
        In the assembled pose, at t = 0.

    Raises
    ------
    SceneError
        All that does not fit together.
    AssemblyError
        It cannot be assembled, is on a wrong branch, or its drivers contradict each other or the
        joints.
    FlexmbError
        It has too many coordinates.
    """
    from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
    from flexmb.analysis.mobility.degrees_of_freedom import mobility_of
    from flexmb.engine.compile import compile_system

    bodies = dict(flexbodies or {})
    missing = [name for name, spec in model.bodies.items() if spec.flexible and name not in bodies]
    if missing:
        surveys, problems = survey_bodies(model)
        if problems:
            raise SceneError.from_problems(problems)
        bodies = {**bodies_of_surveys(model, surveys)[0], **bodies}
    compiled = compile_system(model, bodies)
    if compiled.layout.nv > MAX_COORDINATES:
        what = f"the model has {compiled.layout.nv} coordinates; the rank of its equations is "
        raise FlexmbError(f"{what}found for up to {MAX_COORDINATES}")
    return mobility_of(compiled, model)


def _check_results(model: Model, bodies: Mapping[str, FlexBody], rigid: Sequence[str]) -> None:
    """Refuse unknown names among the results to store."""
    if model.results is not None and model.results.keep:
        from flexmb.engine.compile import compile_system
        from flexmb.results import Columns, stored_columns

        scene = {"results": {"keep": model.results.keep}, **_reaction_scene(model)}
        stored_columns(Columns.of(compile_system(model, bodies).layout), scene, rigid)


def _reaction_scene(model: Model) -> dict[str, Any]:
    """The sections of a scene that the names of channels are made of."""
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    return {key: scene[key] for key in scene if key not in ("results", "bodies")}


def counts_table(counts: Counts) -> dict[str, int]:
    """What a model consists of, in words."""
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
    model: Model, bodies: Mapping[str, FlexBody], rigid: Sequence[str]
) -> tuple[Mobility | None, list[str]]:
    """Mobility and notes; `rigid` are flexible bodies that are not reduced yet.

    Where only their rigidity prevents assembly, this is a note and no error.
    """
    try:
        moves = mobility(model, bodies)
        if moves.lock and model.dynamics is not None:
            raise AssemblyError(moves.lock)
    except AssemblyError as error:
        if not rigid:
            raise
        return None, [f"if the flexible bodies are rigid: {p}" for p in error.problems]
    notes = list(moves.notes)
    if rigid:
        notes.append(
            f"counted as rigid until reduced: {', '.join(rigid)}; modes add coordinates, and may "
            "take up redundant equations"
        )
    return moves, notes


def _survey_table(survey: Survey, units: UnitSystem) -> dict[str, str]:
    return {
        "elements": ", ".join(f"{count} {kind}" for kind, count in survey.elements.items()),
        "degrees of freedom": str(survey.dofs),
        "kept coordinates": survey.coordinates,
        "mass": units.say(survey.mass, "kg"),
    }


def _notes(model: Model) -> list[str]:
    from flexmb.model.scenes.conversion import gravity_in_words

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
