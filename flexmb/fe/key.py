"""The fingerprint of a reduction: what makes two reductions give the same body.

In: a mesh file and the options of :func:`flexmb.fe.reduce`. Out: a SHA-256 in hexadecimal over the
file's bytes, the options (of the material its values alone), and the version of the method.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flexmb.errors import MeshError
from flexmb.fe.material import MaterialLike, resolve
from flexmb.fe.sections.read import section_from
from flexmb.flexbody.schema import VERSION
from flexmb.units import unit_system

__all__ = ["mesh_hash", "reduction_key"]

_METHOD = 2  # raise it whenever the same input gives another body


def reduction_key(
    mesh: str | os.PathLike[str],
    *,
    units: str = "SI",
    material: MaterialLike,
    interfaces: Mapping[str, str] | None = None,
    modes: int = 20,
    damping: float = 0.0,
    name: str | None = None,
    sections: Mapping[str, Any] | None = None,
    ties: Mapping[str, Any] | None = None,
    masses: Mapping[str, Any] | None = None,
    springs: Mapping[str, Any] | None = None,
    mass_matrix: str = "consistent",
    plane: str | None = None,
) -> str:
    """Hexadecimal fingerprint of a reduction; the parameters are those of ``reduce``.

    Raises
    ------
    MeshError
        The mesh file cannot be read.
    """
    meant = resolve(material)
    chosen = {
        "mesh": mesh_hash(mesh),
        "units": unit_system(units).name,
        "material": [float(meant.E), float(meant.nu), float(meant.density)],
        "interfaces": list((interfaces or {}).items()),
        "modes": modes,
        "damping": float(damping),
        "name": Path(mesh).stem if name is None else name,
        "sections": {key: asdict(section_from(s)) for key, s in (sections or {}).items()},
        "method": _METHOD,
        "file": VERSION,
    }
    extras = {"ties": ties, "masses": masses, "springs": springs, "plane": plane}
    if mass_matrix != "consistent":
        extras["mass_matrix"] = mass_matrix
    chosen |= {key: value for key, value in extras.items() if value}
    text = json.dumps(chosen, sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Arrays as lists, mappings as tables."""
    return value.tolist() if hasattr(value, "tolist") else dict(value)


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
