"""Flexible bodies of a model: reduced once, reused while mesh, material and options stay.

A mistake in one body does not hide those of the others: all are told, each under its body's name.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
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
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.fe import Survey
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.bodies.body import FlexbodySpec
    from flexmb.model.bodies.mesh_body import MeshBodySpec

__all__ = ["bodies_of_surveys", "flexible_bodies", "surveyed_bodies"]

_PORTS = (f"{port}{number}" for port in ("com", "lpt") for number in range(10))
_DEVICES = ("con", "prn", "aux", "nul", *_PORTS)  # no file names on Windows
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
        Where the files are, and go.
    fresh : bool
        Reduce meshes anew even if an equal reduction is there.
    only : collection of str, optional
        Bodies to take; all by default.
    inspect : callable, optional
        Called with all that a reduction makes, as `flexmb.reduce` does; meshes are reduced anew.
    progress : Progress
        Told every phase.

    Raises
    ------
    MeshError, MaterialError, ReductionError, BodyFileError
        All that is wrong with the bodies; the class is that of the first mistake.
    """
    from flexmb.flexbody import save
    from flexmb.model.bodies.body import FlexbodySpec
    from flexmb.model.bodies.mesh_body import MeshBodySpec

    bodies: dict[str, FlexBody] = {}
    files: dict[str, Path] = {}
    notes: list[str] = []
    errors: list[tuple[str, FlexmbError]] = []

    names = _file_names(model.bodies)
    taken = {name: spec for name, spec in model.bodies.items() if only is None or name in only}
    for name, spec in taken.items():
        file = folder / names[name]
        try:
            if isinstance(spec, MeshBodySpec):
                known = None if fresh or inspect else _reused(model, name, spec, file, notes)
                bodies[name] = known or _reduced(model, name, spec, inspect, notes, progress)
                if known is None:
                    save(bodies[name], file)
            elif isinstance(spec, FlexbodySpec):
                bodies[name] = _held(model, spec)
                save(bodies[name], file)
            else:
                continue
        except _MISTAKES as error:
            errors.append((name, error))
        files[name] = file
    if errors:
        told = [problem for name, error in errors for problem in _under(name, error.problems)]
        raise type(errors[0][1]).from_problems(told)
    return bodies, files, notes


def _file_names(bodies: Iterable[str]) -> dict[str, str]:
    """A file name for each body, apart from the others and allowed on every system.

    Windows and macOS take "Rod" and "rod" for the same file, and Windows keeps some names to
    itself, whatever their ending.
    """
    names: dict[str, str] = {}
    taken = set(_DEVICES)
    for body in bodies:
        stem = body
        while stem.casefold() in taken:
            stem += "_"
        taken.add(stem.casefold())
        names[body] = f"{stem}.flexbody.h5"
    return names


def surveyed_bodies(model: Model) -> tuple[dict[str, Survey], list[Problem]]:
    """What the reduction of each mesh will find, by body, and the problems of all bodies."""
    from flexmb.model.bodies.body import FlexbodySpec
    from flexmb.model.bodies.mesh_body import MeshBodySpec

    problems: list[Problem] = []
    surveys: dict[str, Survey] = {}
    for name, spec in model.bodies.items():
        found: list[Problem] = []
        if isinstance(spec, MeshBodySpec):
            surveys[name] = _survey(model, name, spec)
            found = surveys[name].problems
        elif isinstance(spec, FlexbodySpec):
            try:
                _held(model, spec)
            except (BodyFileError, ReductionError) as error:
                found = list(error.problems)
        problems += _under(name, found)
    return surveys, problems


def bodies_of_surveys(
    model: Model, surveys: Mapping[str, Survey], folder: Path | None = None
) -> tuple[dict[str, FlexBody], list[str]]:
    """The flexible bodies as far as they are known without reducing a mesh, and those that are not.

    What an earlier run left in `folder` is taken if it was made from the same input. In place of
    another mesh stands a rigid body with its interfaces and nodes, which tells where joints are and
    nothing of its inertia; the names of these come second.
    """
    from flexmb.flexbody import Interface, rigid_body
    from flexmb.flexbody.parts import NodeModes
    from flexmb.model.bodies.body import FlexbodySpec
    from flexmb.model.bodies.mesh_body import MeshBodySpec

    bodies: dict[str, FlexBody] = {}
    rigid: list[str] = []
    files = _file_names(model.bodies)
    for name, spec in model.bodies.items():
        if isinstance(spec, FlexbodySpec):
            bodies[name] = _held(model, spec)
        elif isinstance(spec, MeshBodySpec):
            known = None if folder is None else _reused(model, name, spec, folder / files[name], [])
            if known is not None:
                bodies[name] = known
                continue
            rigid.append(name)
            found = surveys[name]
            none, n = np.zeros((3, 0)), len(found.points)
            held = tuple(Interface(k, x, none, none) for k, x in found.interfaces.items())
            modes = np.zeros((n, 3, 0))
            nodes = NodeModes(np.arange(n), found.points, modes, modes, found.groups)
            stand_in = rigid_body(found.mass or 1.0, inertia=found.mass or 1.0, name=name)
            bodies[name] = replace(stand_in, interfaces=held, nodes=nodes)
    return bodies, rigid


def _held(model: Model, spec: FlexbodySpec) -> FlexBody:
    """A body given by its file or as an object; with its modes in the plane of a planar scene."""
    from flexmb.flexbody import load
    from flexmb.flexbody.planar_body import planar_body
    from flexmb.model.plane import normal_in_body

    held = spec.flexbody
    body = load(model.path(held)) if isinstance(held, str) else held
    return body if model.plane is None else planar_body(body, normal_in_body(spec, model.plane))


def _under(name: str, problems: Iterable[Problem]) -> list[Problem]:
    """The problems with their place in the scene in front."""
    from flexmb.model.bodies.mesh_body import MeshBodySpec

    told = []
    for problem in problems:
        place, what = problem.where, problem.what
        if not place:  # a sentence that begins with its place
            front, _, rest = what.partition(": ")
            known = front.split(".")[0] in MeshBodySpec.model_fields
            place, what = (front, rest) if known else ("", what)
        gap = "." if place.split(".")[0] in MeshBodySpec.model_fields else ": " if place else ""
        told.append(Problem(f"bodies.{name}{gap}{place}", what, problem.allowed, problem.nearest))
    return told


def _reduction(model: Model, name: str, spec: MeshBodySpec) -> tuple[Any, dict[str, Any]]:
    """The mesh of a body, a path or a table, and the options of its reduction."""
    from flexmb.model.plane import plane_in_body

    options = spec.words() | {"name": name}
    if model.plane is not None:
        options["plane"] = plane_in_body(spec, model.plane)
    if isinstance(spec.modes, str):
        options["modes"] = str(model.path(spec.modes))
    if isinstance(spec.mesh, str):
        return model.path(spec.mesh), options
    return spec.mesh.model_dump(exclude_none=True), options


def _survey(model: Model, name: str, spec: MeshBodySpec) -> Survey:
    """What the reduction of a mesh will find."""
    from flexmb import fe

    mesh, options = _reduction(model, name, spec)
    return fe.survey(mesh, **options)


def _reused(
    model: Model, name: str, spec: MeshBodySpec, file: Path, notes: list[str]
) -> FlexBody | None:
    """The body in the file, if it was made from the same input."""
    from flexmb import fe
    from flexmb.flexbody import load

    if not file.exists():
        return None
    try:
        body = load(file)
    except BodyFileError:
        return None  # of another version, or cut off: made anew
    mesh, options = _reduction(model, name, spec)
    if body.provenance.get("key") != fe.reduction_key(mesh, **options):
        return None
    notes.append(f"{name}: reduction reused from {file} (--fresh makes it anew)")
    notes += [f"{name}: {told}" for told in body.provenance["warnings"].splitlines()]
    return body


def _reduced(
    model: Model,
    name: str,
    spec: MeshBodySpec,
    inspect: Callable[..., None] | None,
    notes: list[str],
    progress: Progress,
) -> FlexBody:
    """The body of a mesh, reduced."""
    from flexmb import fe

    mesh, options = _reduction(model, name, spec)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(mesh, **options, inspect=inspect, progress=progress)
    notes += [f"{name}: {entry.message}" for entry in caught]
    return body
