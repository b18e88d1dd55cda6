"""Flexible bodies of a model: reduced once, reused while mesh, material and options stay.

A mistake in one body does not hide those of the others: all are told, each under its body's name.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.bodies import FlexbodySpec

__all__ = ["body_problems", "flexible_bodies"]

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
    from flexmb.model.bodies import FlexbodySpec
    from flexmb.model.meshbody import MeshBodySpec

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
                options = _options(model, name, spec)
                known = None if fresh or inspect else _reused(model, spec, options, file)
                bodies[name] = known or _reduced(model, spec, options, inspect, notes, progress)
                if known is None:
                    save(bodies[name], file)
                else:
                    notes.append(f"{name}: reduction reused from {file} (--fresh makes it anew)")
                    warned = known.provenance["warnings"].splitlines()
                    notes += [f"{name}: {sentence}" for sentence in warned]
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


def body_problems(model: Model) -> list[Problem]:
    """What is wrong with the meshes and body files of a model, as far as reading them can tell."""
    from flexmb import fe
    from flexmb.model.bodies import FlexbodySpec
    from flexmb.model.meshbody import MeshBodySpec

    problems: list[Problem] = []
    for name, spec in model.bodies.items():
        found: list[Problem] = []
        if isinstance(spec, MeshBodySpec):
            found = fe.mesh_problems(model.path(spec.mesh), spec.interfaces, spec.sections)
        elif isinstance(spec, FlexbodySpec):
            try:
                _held(model, spec)
            except (BodyFileError, ReductionError) as error:
                found = list(error.problems)
        problems += _under(name, found)
    return problems


def _held(model: Model, spec: FlexbodySpec) -> FlexBody:
    """A body given by its file or as an object; with its modes in the plane of a planar scene."""
    from flexmb.flexbody import load
    from flexmb.flexbody.planar import planar_body
    from flexmb.model.plane import normal_in_body

    held = spec.flexbody
    body = load(model.path(held)) if isinstance(held, str) else held
    return body if model.plane is None else planar_body(body, normal_in_body(spec, model.plane))


def _under(name: str, problems: Iterable[Problem]) -> list[Problem]:
    """The problems with their place in the scene in front."""
    told = []
    for problem in problems:
        field = problem.where.split(".")[0] in ("interfaces", "sections", "material")
        where = f"bodies.{name}{'.' if field else ': '}{problem.where}"
        told.append(Problem(where, problem.what, problem.allowed, problem.nearest))
    return told


def _options(model: Model, name: str, spec: Any) -> dict[str, Any]:
    """What `flexmb.reduce` is told besides the mesh."""
    from flexmb.model.plane import plane_in_body

    plane = None if model.plane is None else plane_in_body(spec, model.plane)
    return {**spec.words(), "plane": plane, "name": name}


def _reused(model: Model, spec: Any, options: dict[str, Any], file: Path) -> FlexBody | None:
    """The body in the file, if it was made from the same input."""
    from flexmb import fe
    from flexmb.flexbody import load

    if not file.exists():
        return None
    try:
        body = load(file)
    except BodyFileError:
        return None  # of another version, or cut off: made anew
    key = fe.reduction_key(model.path(spec.mesh), **options)
    return body if body.provenance.get("key") == key else None


def _reduced(
    model: Model,
    spec: Any,
    options: dict[str, Any],
    inspect: Callable[..., None] | None,
    notes: list[str],
    progress: Progress,
) -> FlexBody:
    """The body of a mesh, reduced."""
    from flexmb import fe

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(model.path(spec.mesh), **options, inspect=inspect, progress=progress)
    notes += [f"{options['name']}: {entry.message}" for entry in caught]
    return body
