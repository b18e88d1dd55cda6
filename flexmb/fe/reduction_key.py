"""The fingerprint of a reduction: what makes two reductions give the same body.

In: a mesh file, or the table of a simple shape, and the options of :func:`flexmb.fe.reduce`. Out: a
SHA-256 in hexadecimal over the file's bytes or the table, the options (of materials their values
alone), and the version of the method. An option at its default counts as left out.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.material import MaterialLike, resolve
from flexmb.fe.reduction.methods import requested_modes
from flexmb.fe.reduction.user_modes import read_user_modes
from flexmb.fe.sections.section_tables import sections_from
from flexmb.fe.stress import stress_option
from flexmb.flexbody.body_file import VERSION
from flexmb.flexbody.mesh_options import ModesOptions
from flexmb.materials import AnyMaterial
from flexmb.units import unit_system

_METHOD = 4  # raise it whenever the same input gives another body
_DEFAULTS: dict[str, Any] = {
    "reduction": "craig-bampton",
    "mass_matrix": "consistent",
    "stress": "surface",
    "geometric_stiffening": False,
}
_NO_VALUES = ("name", "source")  # of materials


def reduction_key(
    mesh: str | os.PathLike[str] | Mapping[str, Any],
    *,
    units: str = "SI",
    material: MaterialLike,
    interfaces: Mapping[str, Any] | None = None,
    modes: Any = None,
    damping: float = 0.0,
    name: str | None = None,
    sections: Mapping[str, Any] | None = None,
    **options: Any,
) -> str:
    """Hexadecimal fingerprint of a reduction; the parameters are those of ``reduce``.

    Raises
    ------
    MeshError
        A file cannot be read.
    ReductionError, MaterialError
        A section or a material that cannot be.
    """
    content = {
        "mesh": _plain(mesh) if isinstance(mesh, Mapping) else mesh_hash(mesh),
        "units": unit_system(units).name,
        "material": _plain(resolve(material)),
        "interfaces": list(_plain(interfaces or {}).items()),
        "modes": _modes(options.get("reduction", "craig-bampton"), modes),
        "damping": float(damping),
        "name": name or (mesh.get("type") if isinstance(mesh, Mapping) else Path(mesh).stem),
        "sections": _plain(sections_from(sections)),
        "method": _METHOD,
        "file": VERSION,
    }
    options["stress"] = stress_option(options.get("stress", True))
    for key, value in options.items():
        if value is not None and value != {} and value != _DEFAULTS.get(key):
            content[key] = _plain(value)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _modes(reduction: str, modes: Any) -> Any:
    """What the modes are, whichever way it was said; of the user's own a hash of their values."""
    requested = requested_modes(reduction, modes)
    return _plain(requested if isinstance(requested, ModesOptions) else read_user_modes(requested))


def mesh_hash(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a mesh file's bytes.

    Raises
    ------
    MeshError
        The file cannot be read.
    """
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise MeshError(f"{path}: there is no such mesh file, or it cannot be read") from error


def _plain(value: Any) -> Any:
    """Data that JSON can hold, the same for values that mean the same."""
    if is_dataclass(value) and not isinstance(value, type):
        items = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        left_out = _NO_VALUES if isinstance(value, AnyMaterial) else ()
        named = {key: item for key, item in items.items() if key not in left_out}
        return {"class": type(value).__name__, **named}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, str | bool | int | float | None) else str(value)
