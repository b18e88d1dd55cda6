"""Flexible bodies of a model: reduced once, reused while mesh, material and options stay."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import BodyFileError, FlexmbWarning
from flexmb.progress import Progress, silent

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model

__all__ = ["flexible_bodies", "reduce_mesh"]


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
    """The reduced bodies of a model by name, their files in `folder`, and notes for the user."""
    from flexmb.flexbody import load, save
    from flexmb.model.bodies import FlexbodySpec, MeshBodySpec

    bodies: dict[str, FlexBody] = {}
    files: dict[str, Path] = {}
    notes: list[str] = []
    for name, spec in model.bodies.items():
        file = folder / f"{name}.flexbody.h5"
        if isinstance(spec, MeshBodySpec):
            bodies[name] = _reduced(model, name, spec, file, fresh, notes, progress)
        elif isinstance(spec, FlexbodySpec):
            held = spec.flexbody
            bodies[name] = load(model.path(held)) if isinstance(held, str) else held
            save(bodies[name], file)
        else:
            continue
        files[name] = file
    return bodies, files, notes


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

    options = {
        "units": spec.units,
        "material": spec.material,
        "interfaces": dict(spec.interfaces),
        "modes": spec.modes,
        "damping": spec.damping,
        "name": name,
        "sections": dict(spec.sections) or None,
    }
    mesh = model.path(spec.mesh)
    if not fresh and file.exists():
        try:
            body = load(file)
        except BodyFileError:
            body = None  # of another version, or cut off: made anew
        if body is not None and body.provenance.get("key") == fe.reduction_key(mesh, **options):
            notes.append(f"{name}: reduction reused from {file} (--fresh makes it anew)")
            return body
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FlexmbWarning)
        body = fe.reduce(mesh, **options, progress=progress)
    notes += [f"{name}: {entry.message}" for entry in caught]
    save(body, file)
    return body
