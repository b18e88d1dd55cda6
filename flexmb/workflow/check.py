"""Checking a scene without running it: mistakes, counts, mobility, tables of the model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import AssemblyError, FlexmbError, SceneError
from flexmb.folders import output_folder
from flexmb.model.reading import GROUND, Spec
from flexmb.units import SI, UnitSystem
from flexmb.workflow.flexible_bodies import bodies_of_surveys, survey_bodies
from flexmb.workflow.listings import Table, scene_text
from flexmb.workflow.part_analysis import part_group_problems

if TYPE_CHECKING:
    from flexmb.analysis.mobility.degrees_of_freedom import Mobility
    from flexmb.fe import Survey
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.joints.joint import Counts
    from flexmb.workflow.listings import Table


Titled = tuple[str, Table]
# these sections have tables of their own, or none
_TABLES_OF_THEIR_OWN = ("bodies", "joints", "drivers", "sensors")


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
        Coordinates, equations, rank and conclusions; None if the model is too large or has no
        analysis of motion.
    definition : tuple
        The tables that define the model, each with its title; on request.
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
        Whether to make the tables that define the model.

    Raises
    ------
    SceneError
        All mistakes in it.
    AssemblyError
        It cannot be assembled, or its drivers contradict each other or the joints.
    """
    from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
    from flexmb.model import load_scene
    from flexmb.model.joints.joint import count
    from flexmb.model.scenes.effects import active_model

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


def mobility(
    model: Model | str | Path, flexbodies: Mapping[str, FlexBody] | None = None
) -> Mobility:
    """Coordinates, equations, rank, redundant equations with their cures, and free motions.

    Parameters
    ----------
    model : Model or path
        The model, which is not changed, or a scene file.
    flexbodies : mapping of str to FlexBody, optional
        Reduced bodies of meshes by name; a mesh without one counts as a rigid body.

    Returns
    -------
    Mobility
        In the assembled pose, at t = 0.

    Raises
    ------
    SceneError
        Parts that do not fit together.
    AssemblyError
        It cannot be assembled, is on a wrong branch, or its drivers contradict each other or the
        joints.
    FlexmbError
        It has too many coordinates.
    """
    from flexmb.analysis.assembly.jacobian import MAX_COORDINATES
    from flexmb.analysis.mobility.degrees_of_freedom import mobility_of
    from flexmb.engine.compile import compile_system
    from flexmb.model import as_model

    model = as_model(model)
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
    """Refuse unknown names in ``[results] keep``."""
    if model.results is not None and model.results.keep:
        from flexmb.engine.compile import compile_system
        from flexmb.results.channels import Columns, stored_columns

        scene = {"results": {"keep": model.results.keep}, **_reaction_scene(model)}
        stored_columns(Columns.of(compile_system(model, bodies).layout), scene, rigid)


def _reaction_scene(model: Model) -> dict[str, Any]:
    """The sections of a scene from which the names of channels are formed."""
    scene = model.to_scene_dict(model.folder, dict.fromkeys(model.bodies, ""))
    return {key: scene[key] for key in scene if key not in ("results", "bodies")}


def counts_table(counts: Counts) -> dict[str, int]:
    """The numbers of parts of a model, with their names."""
    others = " and couplers" * bool(counts.couplers) + " and drivers" * bool(counts.drivers)
    return {
        "rigid bodies": counts.rigid_bodies,
        "flexible bodies": counts.flexible_bodies,
        **{f"{row.type} joints": row.joints for row in counts.joints},
        **({"couplers": counts.couplers} if counts.couplers else {}),
        "drivers": counts.drivers,
        "forces": counts.forces,
        "sensors": counts.sensors,
        "coordinates of the bodies, without modes": counts.rigid_coordinates,
        f"equations of the joints{others}": counts.equations + counts.drivers,
        "coordinates less equations": counts.mobility,
    }


def _mobility(
    model: Model, bodies: Mapping[str, FlexBody], rigid: Sequence[str]
) -> tuple[Mobility | None, list[str]]:
    """Mobility and notes; `rigid` are flexible bodies that are not reduced yet, taken as rigid.

    If assembly fails only because they are rigid, this is a note and not an error.
    """
    from flexmb.analysis.assembly.positions import is_misplaced
    from flexmb.engine.compile import compile_system

    try:
        moves = mobility(model, bodies)
        if moves.lock and model.dynamics is not None:
            raise AssemblyError(moves.lock)
    except AssemblyError as error:
        if not rigid or is_misplaced(compile_system(model, bodies), model):
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
        "modal coordinates": survey.coordinates,
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


def definition_tables(model: Model, flexbodies: Mapping[str, FlexBody]) -> tuple[Titled, ...]:
    """All tables of a model that have rows, each with its title.

    Parameters
    ----------
    model : Model
        A valid model.
    flexbodies : mapping of str to FlexBody
        Its flexible bodies.
    """
    tables = (
        _places(model),
        _inertia(model, flexbodies),
        _joints(model),
        _markers(model, flexbodies),
        _drivers(model),
        *_other_elements(model),
        _velocities(model),
    )
    return tuple((title, table) for title, table in tables if table.rows)


def _places(model: Model) -> Titled:
    units = model.units
    rows = [
        (name, units.components(spec.position, "m"), units.components(spec.orientation, ""))
        for name, spec in model.bodies.items()
    ]
    columns = ("body", f"origin r [{units.label('m')}]", "Euler parameters, scalar first")
    return "bodies: frames in the placed pose, global axes", Table(columns, rows)


def _inertia(model: Model, flexbodies: Mapping[str, FlexBody]) -> Titled:
    units = model.units
    rows = []
    for name, spec in model.bodies.items():
        if spec.flexible and name not in flexbodies:
            continue
        if spec.flexible:
            body = flexbodies[name]
            mass, center, J, m = body.mass, body.center, body.inertia_about_center, str(body.m)
        else:
            of = spec.mass_properties  # type: ignore[attr-defined]
            mass, center, J, m = of.mass, of.center, of.inertia, ""
        products = (J[0, 1], J[0, 2], J[1, 2])
        rows.append(
            (
                name,
                f"{units.outward(mass, 'kg'):.6g}",
                units.components(center, "m"),
                units.components(J.diagonal(), "kg m^2"),
                units.components(products, "kg m^2", float(abs(J).max())),
                m,
            )
        )
    columns = (
        "body",
        f"mass [{units.label('kg')}]",
        f"centre [{units.label('m')}]",
        f"about it xx, yy, zz [{units.label('kg m^2')}]",
        "xy, xz, yz",
        "modes",
    )
    return "bodies: inertia, body axes", Table(columns, rows)


def _joints(model: Model) -> Titled:
    from flexmb.model.joints.joint import JOINT_TYPES

    rows = []
    for name, joint in model.joints.items():
        row = JOINT_TYPES[joint.type]
        count = row.equations if model.plane is None else row.planar_equations or 0
        axes = (model.units.components(axis or (), "") for axis in (joint.axis, joint.second_axis))
        rows.append((name, joint.type, *joint.between, str(count), *axes))
    columns = ("joint", "type", "marker I", "marker J", "equations", "axis", "second axis")
    return "joints: axes global, in the placed pose", Table(columns, rows)


def _markers(model: Model, flexbodies: Mapping[str, FlexBody]) -> Titled:
    """Both markers of every joint with the triads that the equations use."""
    from flexmb.engine.compile import compile_system

    compiled = compile_system(model, flexbodies)
    bodies = (*model.bodies, GROUND)  # ground comes last, for index -1
    rows = []
    for path, group in zip(compiled.layout.reactions, compiled.system.groups, strict=True):
        section, _, name = path.partition(".")
        first = compiled.system.rows[group["row"]]
        # the markers I and J of the joint in the order of its rows
        ends = "JI" if group["reversed"] else "IJ"
        for side, end in zip("IJ", ends, strict=True) if section == "joints" else ():
            marker = compiled.system.parts.markers[first[end]]
            axes = (model.units.components(marker["R"][:, k], "") for k in (0, 2))
            place = model.units.components(marker["rho"] + marker["arm"], "m")
            rows.append((name, side, bodies[marker["body"]], place, *axes))
    columns = ("joint", "", "body", f"place [{model.units.label('m')}]", "x axis", "z axis")
    return "markers of the joints, body axes", Table(columns, rows)


def _drivers(model: Model) -> Titled:
    rows = _entry_rows(model, model.drivers, "joint")
    return "drivers", Table(("driver", "joint", "coordinate = function of t"), rows)


def _other_elements(model: Model) -> Iterator[Titled]:
    """Tables of forces, couplers and all other named entries, with the options of the scene."""
    for section, entries in vars(model).items():
        if section not in _TABLES_OF_THEIR_OWN and isinstance(entries, dict) and entries:
            rows = _entry_rows(model, entries, "type")
            yield section, Table((section.removesuffix("s"), "type", "values"), rows)


def _entry_rows(model: Model, entries: Mapping[str, Any], field: str) -> list[tuple[str, ...]]:
    """Name, one selected field, and all other fields of each entry."""
    rows: list[tuple[str, ...]] = []
    for name, spec in entries.items():
        if isinstance(spec, Spec):
            words = spec.model_dump(mode="json", exclude_defaults=True, context=model.context)
            first = str(words.pop(field, ""))
            others = ", ".join(f"{key} = {scene_text(value)}" for key, value in words.items())
            rows.append((name, first, others))
    return rows


def _velocities(model: Model) -> Titled:
    units, rows = model.units, []
    for name, spec in model.bodies.items():
        for marker, initial in spec.initial_velocities.items():
            pairs = ((initial.velocity, "m/s"), (initial.angular_velocity, "rad/s"))
            cells = (units.components(vector or (), unit) for vector, unit in pairs)
            rows.append((f"{name}.{marker}", *cells, initial.axes))
    columns = (
        "marker",
        f"velocity [{units.label('m/s')}]",
        f"angular velocity [{units.label('rad/s')}]",
        "axes",
    )
    return "initial velocities requested", Table(columns, rows)
