"""The reduction methods by name, with one signature, and the fingerprint of a reduction.

:func:`reduce_model` makes a :class:`ReducedBasis` of a model by a method. :func:`reduction_key` is
equal for two reductions that give the same body: a SHA-256 in hexadecimal over the mesh file's
bytes or the table of a simple shape, the options of :func:`flexmb.fe.reduce` (of materials only
their values), and the version of the method. An option at its default counts as left out.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from flexmb.errors import FlexmbError, MeshError, Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import InterfaceLike, ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.mesh_checks import Finding
from flexmb.fe.reduction.component_modes import craig_bampton, free_interface, guyan
from flexmb.fe.reduction.eigenmodes import SymmetryPlane
from flexmb.fe.reduction.fixed_interface import read_modes
from flexmb.fe.reduction.free_body import free_modes
from flexmb.fe.reduction.reduced_basis import ReducedBasis
from flexmb.fe.reduction.user_modes import read_user_modes, user_modes
from flexmb.fe.sections.section_tables import MaterialLike, resolve, sections_from
from flexmb.fe.stress import stress_option
from flexmb.flexbody.body_file import VERSION
from flexmb.flexbody.damping import DampingOptions, plain_options, read_damping
from flexmb.flexbody.mesh_options import RESIDUALS, STIFFENINGS, ModesOptions
from flexmb.materials import AnyMaterial
from flexmb.progress import Progress, silent
from flexmb.units import unit_system


class Method(Protocol):
    """A reduction method."""

    def __call__(
        self,
        fe: FEMatrices,
        interfaces: tuple[ModelInterface, ...],
        modes: Any,
        progress: Progress = silent,
        mirror: SymmetryPlane | None = None,
        loads: tuple[LoadPattern, ...] = (),
        residual: str = "none",
    ) -> ReducedBasis: ...


METHODS: dict[str, Method] = {
    "craig-bampton": craig_bampton,
    "free-interface": free_interface,
    "guyan": guyan,
    "user": user_modes,
}
"""Methods by name."""

_DEFAULT_MODES = {"craig-bampton": 20, "free-interface": 20, "guyan": 0}


def requested_modes(method: str, modes: Any) -> Any:
    """The modes of a method, or its default.

    Raises
    ------
    ReductionError
        An unknown method, a choice that cannot be, or user modes that are not given.
    """
    if method not in METHODS:
        names = tuple(METHODS)
        problem = Problem("reduction", f'unknown "{method}"', names, nearest(str(method), names))
        raise ReductionError.from_problems([problem])
    if method == "user":
        if modes is None or isinstance(modes, int | float | Mapping):
            what = 'reduction = "user" takes modes = an array, or the path of an .npz file'
            raise ReductionError.from_problems([Problem("modes", f"{what}, given {modes!r}")])
        return modes
    return read_modes(_DEFAULT_MODES[method] if modes is None else modes)


def reduce_model(
    fe: FEMatrices,
    interfaces: tuple[ModelInterface, ...],
    method: str = "craig-bampton",
    modes: Any = None,
    *,
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    loads: tuple[LoadPattern, ...] = (),
    residual: str = "none",
) -> ReducedBasis:
    """Reduce a model by a method.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : tuple of RigidInterface or WeightedInterface
        Without any, ``"craig-bampton"`` and ``"free-interface"`` both take free modes.
    method : str
        ``"craig-bampton"``, ``"free-interface"``, ``"guyan"`` (static) or ``"user"``.
    modes
        What the method takes: a number, ``{"frequency": ...}``, ``{"effective_mass": ...}``, and
        for ``"user"`` an array or the path of an .npz file. By default 20, and none for
        ``"guyan"``.
    progress, mirror, loads, residual
        As for :func:`flexmb.fe.craig_bampton`.

    Raises
    ------
    ReductionError
        An unknown method, a static reduction without interfaces, user modes that are not given,
        or what the method refuses.
    """
    modes = requested_modes(method, modes)
    if interfaces or method == "user":
        return METHODS[method](fe, interfaces, modes, progress, mirror, loads, residual)
    if method == "guyan":
        what = "a static reduction needs interfaces: without them the body is rigid"
        raise ReductionError.from_problems([Problem("reduction", what)])
    return free_modes(fe, (), modes, progress, mirror, loads, residual)


def coordinates_text(
    freedoms: int,
    interfaces: int,
    modes: Any,
    reduction: str,
    loads: Mapping[str, Any],
    residual: str = "none",
) -> str:
    """The count of modal coordinates, in words; loads and inertia add at most that many vectors."""
    if reduction == "user":
        return "those of the given modes"
    selection = read_modes(modes)
    count = 0 if reduction == "guyan" else selection.count
    static = freedoms * interfaces
    more = sum(load.get("residual", load.get("type") != "gravity") for load in loads.values())
    more *= 2 if interfaces and reduction != "free-interface" else 1
    extra = f" + up to {more} for loads" if more else ""
    if residual == "inertia":
        inertia = (12 if freedoms == 6 else 7) if interfaces else (6 if freedoms == 6 else 4)
        inertia -= freedoms * (interfaces > 0 and reduction == "free-interface")
        extra, more = f"{extra} + up to {inertia} for inertia", more + inertia
    if count is None:
        by = "frequency" if selection.frequency is not None else "effective mass"
        return f"{static} of {interfaces} interfaces + modes by {by} - {freedoms}{extra}"
    if not interfaces:
        return f"{count} free modes{extra}"
    text = f"{freedoms}*{interfaces} interfaces + {count} modes"
    if reduction == "free-interface":
        return f"up to {static + count + more} = {text}{extra}"
    least = static + count - freedoms
    most = f" to {least + more}" if more else ""
    return f"{least}{most} = {text} - {freedoms}{extra}"


def check_options(
    reduction: str, modes: Any, damping: Any, residual: str, stiffening: Any
) -> tuple[Any, DampingOptions | None]:
    """The requested modes and the damping, after a check of all options together."""
    problems: list[Problem] = []
    requested = ratios = None
    try:
        requested = requested_modes(reduction, modes)
    except ReductionError as error:
        problems += error.problems
    try:
        ratios = read_damping(damping)
    except FlexmbError as error:
        problems += error.problems
    if residual not in RESIDUALS:
        names = tuple(RESIDUALS)
        what = f'unknown "{residual}"'
        problems.append(Problem("residual", what, names, nearest(str(residual), names)))
    if stiffening not in STIFFENINGS:
        what = f"unknown choice {stiffening!r}"
        problems.append(Problem("geometric_stiffening", what, STIFFENINGS))
    if problems:
        raise ReductionError.from_problems(problems)
    return requested, ratios


_METHOD = 18  # version of the method: raise it whenever the same input gives another body
_DEFAULTS: dict[str, Any] = {
    "reduction": "craig-bampton",
    "mass_matrix": "consistent",
    "stress": "surface",
    "geometric_stiffening": "none",
    "residual": "none",
    "refine": 0,
}
_NO_VALUES = ("name", "source")  # keys of a material that are no values


def reduction_key(
    mesh: str | os.PathLike[str] | Mapping[str, Any],
    *,
    units: str = "SI",
    material: MaterialLike,
    interfaces: Mapping[str, Any] | None = None,
    modes: Any = None,
    damping: Any = None,
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
        "damping": plain_options(read_damping(damping)),
        "name": name or (mesh.get("type") if isinstance(mesh, Mapping) else Path(mesh).stem),
        "sections": _plain(sections_from(sections)),
        "method": _METHOD,
        "file": VERSION,
    }
    if options.get("loads"):
        content["load points"] = 1  # bodies store load responses since this entry exists
    options["stress"] = stress_option(options.get("stress", True))
    # the modes are the same; a body whose file lacks some of them is reduced again
    options.pop("load_points", None)
    for key, value in options.items():
        if value is not None and value != {} and value != _DEFAULTS.get(key):
            content[key] = _plain(value)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _modes(reduction: str, modes: Any) -> Any:
    """The modes in a form that is the same however they were written; of user modes their
    values."""
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
    """Data that JSON can store, the same for values that mean the same."""
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


def model_provenance(
    fe: FEMatrices,
    options: Mapping[str, Any],
    interfaces: Mapping[str, InterfaceLike],
    sections: Mapping[str, Any],
    findings: list[Finding],
) -> dict[str, str]:
    """Mesh, material, options, findings and versions as texts."""
    packages = ("numpy", "scipy", "scikit-fem", "meshio")
    return {
        "mesh": fe.mesh.source,
        "material": "" if fe.material is None else json.dumps(asdict(fe.material)),
        "interfaces": json.dumps(dict(interfaces), default=str),
        "sections": json.dumps({name: asdict(section) for name, section in sections.items()}),
        **{name: _option_text(value) for name, value in options.items() if value is not None},
        "degrees of freedom": str(fe.numbering.n),
        "nodes outside the body": str(len(fe.mesh.points) - len(fe.numbering.nodes)),
        "warnings": "\n".join(f.sentence for f in findings if f.level == "warning"),
        "notes": "\n".join(f.sentence for f in findings if f.level == "note"),
        "versions": ", ".join(f"{package} {version(package)}" for package in packages),
    }


def _option_text(value: Any) -> str:
    """An option as text: arrays by their shape."""
    if isinstance(value, np.ndarray):
        return f"array {value.shape}"
    return json.dumps(value, default=str) if isinstance(value, Mapping) else str(value)


def file_provenance(
    mesh: str | os.PathLike[str] | Mapping[str, Any],
    options: Mapping[str, Any],
    material: MaterialLike,
    interfaces: Mapping[str, InterfaceLike] | None,
    name: str | None,
    sections: Mapping[str, Any],
) -> dict[str, str]:
    key = reduction_key(
        mesh, material=material, interfaces=interfaces, name=name, sections=sections, **options
    )
    if isinstance(mesh, Mapping):
        return {"key": key, "mesh": json.dumps(dict(mesh))}
    return {"key": key, "mesh sha256": mesh_hash(mesh)}
