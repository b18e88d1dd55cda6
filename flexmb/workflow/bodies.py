"""Flexible bodies of a model: reduced once, reused while mesh, material and options stay.

A mistake in one body does not hide those of the others: all are told, each under its body's name.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
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

__all__ = ["body_problems", "flexible_bodies", "reduce_mesh"]

_PORTS = (f"{port}{number}" for port in ("com", "lpt") for number in range(10))
_DEVICES = ("con", "prn", "aux", "nul", *_PORTS)  # no file names on Windows
_TABLES = ("interfaces", "sections", "material", "ties", "masses", "springs")
_MISTAKES = (MeshError, MaterialError, ReductionError, BodyFileError)


def reduce_mesh(
    mesh: str | Path,
    *,
    material: Any,
    interfaces: Mapping[str, str] | None = None,
    sections: Mapping[str, Any] | None = None,
    output: str | Path | None = None,
    progress: Progress = silent,
    **options: Any,
) -> tuple[FlexBody, Path]:
    """Reduce a mesh to a flexible body and save it (`<mesh>.flexbody.h5` by default)."""
    from flexmb import fe
    from flexmb.flexbody import save

    body = fe.reduce(
        mesh,
        material=material,
        interfaces=interfaces or {},
        sections=sections or None,
        progress=progress,
        **options,
    )
    path = Path(output) if output is not None else Path(f"{Path(mesh).stem}.flexbody.h5")
    return body, save(body, path)


def flexible_bodies(
    model: Model, folder: Path, *, fresh: bool = False, progress: Progress = silent
) -> tuple[dict[str, FlexBody], dict[str, Path], list[str]]:
    """The reduced bodies of a model by name, their files in `folder`, and notes for the user.

    Raises
    ------
    MeshError, MaterialError, ReductionError, BodyFileError
        All that is wrong with the bodies; the class is that of the first mistake.
    """
    from flexmb.flexbody import save
    from flexmb.model.bodies import FlexbodySpec, MeshBodySpec

    bodies: dict[str, FlexBody] = {}
    files: dict[str, Path] = {}
    notes: list[str] = []
    errors: list[tuple[str, FlexmbError]] = []

    names = _file_names(model.bodies)
    for name, spec in model.bodies.items():
        file = folder / names[name]
        try:
            if isinstance(spec, MeshBodySpec):
                bodies[name] = _reduced(model, name, spec, file, fresh, notes, progress)
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
    from flexmb.model.bodies import FlexbodySpec, MeshBodySpec

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
        field = problem.where.split(".")[0] in _TABLES
        where = f"bodies.{name}{'.' if field else ': '}{problem.where}"
        told.append(Problem(where, problem.what, problem.allowed, problem.nearest))
    return told


def _reduced(
    model: Model,
    name: str,
    spec: Any,
    file: Path,
    fresh: bool,
    notes: list[str],
    progress: Progress,
) -> FlexBody:
    """The body of a mesh, reused if its file was made from the same input."""
    from flexmb import fe
    from flexmb.flexbody import load, save
    from flexmb.model.plane import plane_in_body

    options = {
        "plane": None if model.plane is None else plane_in_body(spec, model.plane),
        "units": spec.units,
        "material": spec.material,
        "interfaces": dict(spec.interfaces),
        "modes": spec.modes,
        "damping": spec.damping,
        "name": name,
        "sections": dict(spec.sections) or None,
        "mass_matrix": spec.mass_matrix,
    }
    for kind in ("ties", "masses", "springs"):
        tables = getattr(spec, kind).items()
        options[kind] = {key: one.model_dump(exclude_none=True) for key, one in tables}
    mesh = model.path(spec.mesh)
    if not fresh and file.exists():
        try:
            body = load(file)
        except BodyFileError:
            body = None  # of another version, or cut off: made anew
        if body is not None and body.provenance.get("key") == fe.reduction_key(mesh, **options):
            notes.append(f"{name}: reduction reused from {file} (--fresh makes it anew)")
            notes += [f"{name}: {told}" for told in body.provenance["warnings"].splitlines()]
            return body
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(mesh, **options, progress=progress)
    notes += [f"{name}: {entry.message}" for entry in caught]
    save(body, file)
    return body
