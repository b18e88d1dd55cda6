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

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.interfaces.make import InterfaceLike
from flexmb.fe.material import MaterialLike, resolve
from flexmb.fe.recovery.stress import stress_option
from flexmb.fe.reduction.choice import ModeChoice
from flexmb.fe.reduction.methods import asked_modes
from flexmb.fe.reduction.user import read_user_modes
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
    interfaces: Mapping[str, InterfaceLike] | None = None,
    reduction: str = "craig-bampton",
    modes: Any = None,
    loads: Mapping[str, Mapping[str, Any]] | None = None,
    damping: float = 0.0,
    name: str | None = None,
    sections: Mapping[str, Any] | None = None,
    plane: str | None = None,
    stress: bool | str = True,
) -> str:
    """Hexadecimal fingerprint of a reduction; the parameters are those of ``reduce``.

    Raises
    ------
    MeshError
        The mesh file cannot be read.
    ReductionError
        A method or modes that cannot be.
    """
    meant = resolve(material)
    chosen = {
        "mesh": mesh_hash(mesh),
        "units": unit_system(units).name,
        "material": [float(meant.E), float(meant.nu), float(meant.density)],
        "interfaces": list((interfaces or {}).items()),
        "reduction": reduction,
        "modes": _modes(reduction, modes),
        "loads": dict(loads or {}),
        "damping": float(damping),
        "stress": stress_option(stress),
        "name": Path(mesh).stem if name is None else name,
        "sections": {key: asdict(section_from(s)) for key, s in (sections or {}).items()},
        "method": _METHOD,
        "file": VERSION,
    }
    if plane is not None:
        chosen["plane"] = plane
    return hashlib.sha256(json.dumps(chosen, sort_keys=True, default=_plain).encode()).hexdigest()


def _modes(reduction: str, modes: Any) -> Any:
    """What the modes are, whichever way it was said; of the user's own a hash of their values."""
    asked = asked_modes(reduction, modes)
    if isinstance(asked, ModeChoice):
        return asdict(asked)
    values = read_user_modes(asked)
    return [list(values.shape), hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()]


def _plain(value: Any) -> Any:
    """Arrays and their numbers as lists and numbers."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


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
