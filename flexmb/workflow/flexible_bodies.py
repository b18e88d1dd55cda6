"""Flexible bodies of a scene: reduced once, reused while their input stays.

In: a scene. Out: bodies and their files, or a survey of bodies that are not reduced. Mistakes are
collected over all bodies, each under the name of its body.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import (
    BodyFileError,
    FlexmbError,
    FlexmbWarning,
    MaterialError,
    MeshError,
    Problem,
    ReductionError,
)
from flexmb.flexbody.static_response import load_nodes
from flexmb.model.excitation import load_points, needs_inertia_residuals
from flexmb.model.flexible_body import FlexbodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.plane import simulated_body
from flexmb.progress import Progress, silent
from flexmb.units import lengths_in

if TYPE_CHECKING:
    from flexmb.fe import Survey
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

_PORTS = (f"{port}{number}" for port in ("com", "lpt") for number in range(10))
_DEVICES = ("con", "prn", "aux", "nul", *_PORTS)  # reserved file names on Windows
REUSED = "reduction reused from"
"""Start of a note of a run about a reused reduction, which says nothing about the motion."""
AUDIT = "audit"
"""Folder beside a result with the runs and reductions of its audit."""
SIMULATED = ".simulated."
"""Part of a file name: the body as a run uses it, unlike the body as it was reduced."""
# smallest extent of a body across a line or plane of nodes, over its whole extent
_THICKNESS = 1e-3
_MISTAKES = (MeshError, MaterialError, ReductionError, BodyFileError)


def flexible_bodies(
    model: Model,
    folder: Path,
    *,
    fresh: bool = False,
    only: Collection[str] | None = None,
    inspect: Callable[..., None] | None = None,
    progress: Progress = silent,
) -> tuple[dict[str, FlexBody], dict[str, Path], list[str]]:
    """The reduced bodies of a model by name, their files in `folder`, and notes for the user.

    Parameters
    ----------
    model : Model
        The scene.
    folder : Path
        Folder of the files.
    fresh : bool
        Reduce meshes again even if an equal reduction exists.
    only : collection of str, optional
        Names of the bodies; all by default.
    inspect : callable, optional
        Called with the intermediate results of a reduction, as in `flexmb.reduce`; then no body is
        reused.
    progress : Progress
        Called for every phase.

    Raises
    ------
    MeshError, MaterialError, ReductionError, BodyFileError
        All that is wrong with the bodies; the class is that of the first mistake.
    """
    from flexmb.flexbody import save

    bodies: dict[str, FlexBody] = {}
    files: dict[str, Path] = {}
    notes: list[str] = []
    errors: list[tuple[str, FlexmbError]] = []
    for name, file in _body_files(model, folder).items():
        spec = model.bodies[name]
        if only is not None and name not in only:
            continue
        try:
            if isinstance(spec, MeshBodySpec):
                anew = fresh or inspect is not None
                stored, at = (None, file) if anew else _stored_body(model, name, file, notes)
                look = None if spec.deformation == "rigid" else inspect
                reduced = stored or _reduce_body(model, name, look, notes, progress)
            elif isinstance(spec, FlexbodySpec):
                stored, at, reduced = None, file, _source_body(model, name)
            else:
                continue
            if stored is None or at != file:
                save(reduced, file)
            bodies[name] = simulated_body(model, name, reduced)
            if bodies[name] is not reduced:  # the reduction remains for runs with other effects
                files[name] = _simulated(file)
                save(bodies[name], files[name])
        except _MISTAKES as error:
            errors.append((name, error))
        files.setdefault(name, file)
    if errors:
        problems = [p for name, error in errors for p in under_body(name, error.problems)]
        raise type(errors[0][1]).from_problems(problems)
    return bodies, files, notes


def _simulated(file: Path) -> Path:
    return file.with_name(file.name.replace(".", SIMULATED, 1))


def _body_files(model: Model, folder: Path) -> dict[str, Path]:
    """A file for each body, with names that differ and are allowed on every operating system.

    Windows and macOS do not distinguish "Rod" and "rod", and Windows reserves some names with any
    suffix. If a mesh body is rigid, the file of its modes is kept under another name for runs with
    other effects.
    """
    files: dict[str, Path] = {}
    taken = set(_DEVICES)
    for body, spec in model.bodies.items():
        stem = body
        while stem.casefold() in taken:
            stem += "_"
        taken.add(stem.casefold())
        file = folder / f"{stem}.flexbody.h5"
        rigid = isinstance(spec, MeshBodySpec) and spec.deformation == "rigid"
        files[body] = _simulated(file) if rigid else file
    return files


def survey_bodies(model: Model) -> tuple[dict[str, Survey], list[Problem]]:
    """The survey of each mesh by body, without reduction, and the problems of all bodies."""
    from flexmb import fe

    problems: list[Problem] = []
    surveys: dict[str, Survey] = {}
    for name, spec in model.bodies.items():
        if isinstance(spec, MeshBodySpec):
            mesh, options = reduction_input(model, name)
            with lengths_in(model.units):
                surveys[name] = fe.survey(mesh, **options)
            problems += under_body(name, surveys[name].problems)
        elif isinstance(spec, FlexbodySpec):
            try:
                _loaded_body(model, name)
            except (BodyFileError, ReductionError) as error:
                problems += under_body(name, error.problems)
    return surveys, problems


def bodies_of_surveys(
    model: Model, surveys: Mapping[str, Survey], folder: Path | None = None
) -> tuple[dict[str, FlexBody], list[str]]:
    """The flexible bodies without any reduction, and names of those that are only stood in for.

    A body in `folder` is used if it was made from the same input. Any other mesh is replaced by a
    rigid body with its interfaces and nodes, with the mass spread evenly over the nodes, and with
    loads of its names that are zero.
    """
    from flexmb.flexbody import Interface
    from flexmb.flexbody.parts import LoadPoint, LoadVector, NodeModes

    bodies: dict[str, FlexBody] = {}
    rigid: list[str] = []
    for name, file in _body_files(model, folder or Path()).items():
        spec = model.bodies[name]
        if isinstance(spec, FlexbodySpec):
            bodies[name] = _loaded_body(model, name)
        elif isinstance(spec, MeshBodySpec):
            stored = None if folder is None else _stored_body(model, name, file, [])[0]
            if stored is not None:
                bodies[name] = simulated_body(model, name, stored)
                continue
            rigid.append(name)
            survey = surveys[name]
            no_modes, n = np.zeros((3, 0)), len(survey.points)
            interfaces = tuple(
                Interface(k, x, no_modes, no_modes) for k, x in survey.interfaces.items()
            )
            modes = np.zeros((n, 3, 0))
            nodes = NodeModes(np.arange(n), survey.points, modes, modes, survey.groups)
            body, zero = _stand_in(survey, name), np.zeros(3)
            point = LoadPoint("middle", survey.points.mean(axis=0), no_modes, no_modes)
            loads = (LoadVector(k, zero, zero, np.zeros(0), (point,)) for k in spec.loads)
            bodies[name] = replace(body, interfaces=interfaces, nodes=nodes, loads=tuple(loads))
    return bodies, rigid


def _stand_in(survey: Survey, name: str) -> FlexBody:
    """A rigid body with the extent of a mesh; a flat one gets some thickness."""
    from flexmb.flexbody import rigid_body

    mass, center = survey.mass or 1.0, survey.points.mean(axis=0)
    spread = np.cov(survey.points.T, bias=True)
    spread += _THICKNESS * np.trace(spread) * np.eye(3)
    inertia = mass * (np.trace(spread) * np.eye(3) - spread)
    return rigid_body(mass, center, inertia, name)


def _loaded_body(model: Model, name: str) -> FlexBody:
    """A body from its file or an object, with the effects of a run."""
    return simulated_body(model, name, _source_body(model, name))


def _source_body(model: Model, name: str) -> FlexBody:
    """A body from its file or an object."""
    from flexmb.flexbody import load

    source: Any = model.bodies[name].flexbody  # type: ignore[attr-defined]
    return load(model.path(source)) if isinstance(source, str) else source


def under_body(name: str, problems: Iterable[Problem]) -> list[Problem]:
    """The problems with their scene path put first."""
    fields = MeshBodySpec.model_fields
    full = []
    for problem in problems:
        place, what = problem.where, problem.what
        if place.startswith(f"bodies.{name}"):  # complete
            full.append(problem)
            continue
        if not place:  # a sentence that begins with its place
            front, _, rest = what.partition(": ")
            place, what = (front, rest) if front.split(".")[0] in fields else ("", what)
        gap = "." if place.split(".")[0] in fields else ": " if place else ""
        full.append(Problem(f"bodies.{name}{gap}{place}", what, problem.allowed, problem.nearest))
    return full


def reduction_input(
    model: Model, name: str, residual: str | Callable[[FlexBody], str] = "none"
) -> tuple[Any, dict[str, Any]]:
    """The mesh of a body, as a path or a table, and the options of its reduction.

    `residual` replaces the scene's "auto".
    """
    from flexmb.model.plane import plane_in_body

    spec: MeshBodySpec = model.bodies[name]  # type: ignore[assignment]
    options = spec.words() | {"name": name}
    if spec.deformation != "rigid":
        if model.plane is not None:
            options["plane"] = plane_in_body(spec, model.plane)
        options["residual"] = residual if spec.residual == "auto" else spec.residual
        options["load_points"] = load_points(model, name)
        if isinstance(spec.modes, str):
            options["modes"] = str(model.path(spec.modes))
    if isinstance(spec.mesh, str):
        return model.path(spec.mesh), options
    return spec.mesh.model_dump(exclude_none=True), options


def _stored_body(
    model: Model, name: str, file: Path, notes: list[str]
) -> tuple[FlexBody | None, Path]:
    """The body in the file, or in one that an audit left, and which; None if of other input."""
    root = file.parent.parent.parent if file.parent.parent.name == AUDIT else file.parent
    for path in (file, *sorted(root.glob(f"{AUDIT}/*/{file.name}"))):
        body = _equal_body(model, name, path)
        if body is not None:
            notes.append(f"{name}: {REUSED} {path}")
            notes += [f"{name}: {warning}" for warning in body.provenance["warnings"].splitlines()]
            return body, path
    return None, file


def _equal_body(model: Model, name: str, file: Path) -> FlexBody | None:
    """The body in a file, if it was made from the same input; else None."""
    from flexmb.fe.reduction.methods import reduction_key
    from flexmb.flexbody import load

    if not file.exists():
        return None
    try:
        body = load(file)
    except BodyFileError:
        return None  # of another version, or cut off: reduced again
    mesh, options = reduction_input(model, name, body.provenance.get("residual", "none"))
    if body.provenance.get("key") != reduction_key(mesh, **options):
        return None
    if options.get("residual", "none") != _selected_residual(model, name, body):
        return None
    nodes = () if body.load_response is None else body.load_response.nodes
    has_all = np.isin(load_nodes(body.nodes, options.get("load_points", ())), nodes).all()
    return body if has_all else None


def _selected_residual(model: Model, name: str, body: FlexBody) -> str:
    """The residual vectors that a reduced body needs if the scene leaves them open."""
    spec: MeshBodySpec = model.bodies[name]  # type: ignore[assignment]
    if spec.deformation == "rigid":
        return "none"
    if spec.residual != "auto":
        return spec.residual
    needed = spec.reduction != "user" and needs_inertia_residuals(model, name, {name: body})
    return "inertia" if needed else "none"


def _reduce_body(
    model: Model,
    name: str,
    inspect: Callable[..., None] | None,
    notes: list[str],
    progress: Progress,
) -> FlexBody:
    from flexmb import fe

    selected = partial(_selected_residual, model, name)
    mesh, options = reduction_input(model, name, selected)
    with warnings.catch_warnings(record=True) as caught, lengths_in(model.units):
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(mesh, **options, inspect=inspect, progress=progress)
    notes += [f"{name}: {entry.message}" for entry in caught]
    return body
