"""Reading and writing flexible-body files (HDF5, no code objects inside).

A file is HDF5 with the attributes format, version, name and mass at its root, and the datasets of
``TABLE``. Lengths are symbols: m modal coordinates, c candidate modes, i interfaces, n surface
points, t triangles, l lines, k nodes, e places with stress, g parts and y layers of these, b beams,
h places of shells, j parts of these, d loads, r nodes with w loads, o omitted modes under v loads,
F fields left out, L loads and R motions of these, u groups of nodes with x entries, f nodes with a
bend, s entries of provenance. All in SI, body frame; a group may be empty only where it says so.

In: a body and a path, or a path. Out: a file, or the body with exactly the same numbers. A file of
another program or version, or that is incomplete or not finite, is refused with one sentence.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.errors import BodyFileError, OutputError, ReductionError
from flexmb.flexbody import static_response as responses
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.damping import plain_options, read_damping
from flexmb.flexbody.membrane_stiffness import MembraneStiffness
from flexmb.flexbody.parts import Interface, LoadPoint, LoadVector, ModeInfo, NodeModes, Surface
from flexmb.flexbody.stress_modes import (
    OmittedStress,
    SectionForceModes,
    ShellForceModes,
    StressModes,
)
from flexmb.folders import whole_file
from flexmb.untrusted import USER_BLOCK, open_hdf5, seal

if TYPE_CHECKING:
    import h5py

FORMAT = "flexmb-flexbody"
VERSION = 3
_NOUN = "the flexible body"
FRAME = "mean-axis"  # Rigid motions are mass-orthogonal to all modes.


class Dataset(NamedTuple):
    """One dataset: its path, its content, and whether a body may be without it."""

    path: str
    kind: str  # "f8", "f4", "i8", "bool" or "text"
    shape: tuple[str | int, ...]
    meaning: str
    optional: bool = False


TABLE = (
    Dataset("inertia/S1", "f8", (3,), "int rho s [kg m]"),
    Dataset("inertia/S0", "f8", (3, 3), "int rho s s^T [kg m^2]"),
    Dataset("inertia/p", "f8", (3, "m"), "int rho N_b Phi"),
    Dataset("inertia/P", "f8", (3, 3, "m"), "int rho s_a N_b Phi"),
    Dataset("inertia/Mab", "f8", (3, 3, "m", "m"), "Phi^T int rho N_a^T N_b Phi"),
    Dataset("stiffness/K", "f8", ("m", "m"), "modal stiffness"),
    Dataset("stiffness/D", "f8", ("m", "m"), "modal damping"),
    Dataset("damping/ratios", "text", (1,), "of its modes in a scene, JSON", True),
    Dataset("stiffness/centrifugal_stiffness", "f8", (3, 3, "m", "m"), "of rho (e_a s_b)", True),
    Dataset("interfaces/bend", "f8", ("i", 6, "m", "m"), "of unit forces and moments", True),
    Dataset("interfaces/name", "text", ("i",), "names of the markers"),
    Dataset("interfaces/position", "f8", ("i", 3), "reference points [m]"),
    Dataset("interfaces/Phi_t", "f8", ("i", 3, "m"), "translation per unit eta [m]"),
    Dataset("interfaces/Phi_r", "f8", ("i", 3, "m"), "rotation per unit eta [rad]"),
    Dataset("modes/index", "i8", ("c",), "modal coordinate, -1 if dropped"),
    Dataset("modes/kind", "text", ("c",), "rigid or elastic"),
    Dataset("modes/frequency", "f8", ("c",), "of the free body [Hz]"),
    Dataset("modes/kept", "bool", ("c",), "is a modal coordinate"),
    Dataset("modes/why", "text", ("c",), "why kept or dropped"),
    Dataset("modes/mostly", "text", ("c",), "largest Craig-Bampton contribution"),
    Dataset("modes/interface_share", "f8", ("c",), "of the constraint modes in strain energy"),
    Dataset("modes/kinetic_share", "f8", ("c", 3), "of motion along x, y, z in kinetic energy"),
    Dataset("surface/points", "f8", ("n", 3), "undeformed [m]", True),
    Dataset("surface/faces", "i8", ("t", 3), "triangles", True),
    Dataset("surface/lines", "i8", ("l", 2), "beam lines", True),
    Dataset("surface/modes", "f8", ("n", 3, "m"), "displacement per unit eta [m]", True),
    Dataset("surface/node_ids", "i8", ("n",), "mesh node of each point", True),
    Dataset("nodes/ids", "i8", ("k",), "mesh nodes, ascending", True),
    Dataset("nodes/position", "f8", ("k", 3), "undeformed [m]", True),
    Dataset("nodes/Phi_t", "f8", ("k", 3, "m"), "displacement per unit eta [m]", True),
    Dataset("nodes/Phi_r", "f8", ("k", 3, "m"), "rotation per unit eta [rad]", True),
    Dataset("nodes/bend_nodes", "i8", ("f",), "mesh nodes with a bend", True),
    Dataset("nodes/bend", "f8", ("f", 6, "m", "m"), "as of interfaces", True),
    Dataset("groups/name", "text", ("u",), "named groups of mesh nodes", True),
    Dataset("groups/count", "i8", ("u",), "how many nodes each holds", True),
    Dataset("groups/nodes", "i8", ("x",), "their mesh nodes, group by group", True),
    Dataset("stress_recovery/ids", "i8", ("e",), "mesh node of each place, ascending", True),
    Dataset("stress_recovery/part", "i8", ("e",), "its section, among the parts", True),
    Dataset("stress_recovery/layer", "i8", ("e",), "its place across, among the layers", True),
    Dataset("stress_recovery/parts", "text", ("g",), "sections by mesh group", True),
    Dataset("stress_recovery/layers", "text", ("y",), "places across sections", True),
    Dataset("stress_recovery/modes", "f4", ("e", 6, "m"), "xx yy zz yz zx xy, body [Pa]", True),
    Dataset("section_forces/elements", "i8", ("b", 2), "mesh nodes of the beams", True),
    Dataset("section_forces/axes", "f8", ("b", 3, 3), "local axes as columns", True),
    Dataset("section_forces/modes", "f8", ("b", 2, 6, "m"), "N Vy Vz T My Mz [N, N m]", True),
    Dataset("shell_forces/ids", "i8", ("h",), "mesh node of each place, ascending", True),
    Dataset("shell_forces/part", "i8", ("h",), "its section, among the parts", True),
    Dataset("shell_forces/parts", "text", ("j",), "sections by mesh group", True),
    Dataset("shell_forces/axes", "f8", ("h", 3, 3), "local axes as columns", True),
    Dataset("shell_forces/modes", "f4", ("h", 8, "m"), "Nx Ny Nxy Mx My Mxy Qx Qy", True),
    Dataset("omitted_stress/stress", "f4", ("e", 6, 12), "stress that the modes lack", True),
    Dataset("omitted_stress/section_forces", "f8", ("b", 2, 6, 12), "likewise", True),
    Dataset("omitted_stress/shell_forces", "f4", ("h", 8, 12), "likewise", True),
    Dataset("inertia_response/energy", "f8", (12, 12), "to inertia loads, full [J]", True),
    Dataset("inertia_response/missing", "f8", (12, 12), "of it the modes lack [J]", True),
    Dataset("inertia_response/motion", "f8", (12, 12), "and move by [kg m^2]", True),
    Dataset("inertia_response/missing_without", "f8", (12, 12), "without residuals [J]", True),
    Dataset("inertia_response/motion_without", "f8", (12, 12), "likewise [kg m^2]", True),
    Dataset("load_response/nodes", "i8", ("r",), "mesh nodes with loads", True),
    Dataset("load_response/energy", "f8", ("w", "w"), "to unit loads there, full [J]", True),
    Dataset("load_response/missing", "f8", ("w", "w"), "of it the modes lack [J]", True),
    Dataset("load_response/motion", "f8", ("w", "w"), "and move by [kg m^2]", True),
    Dataset("omitted_modes/frequency", "f8", ("o",), "of the lowest that are left out [Hz]", True),
    Dataset("omitted_modes/inertia", "f8", ("o", 12), "force by inertia loads", True),
    Dataset("omitted_modes/modes", "f8", ("o", "m"), "force by modal accelerations", True),
    Dataset("omitted_modes/loads", "f8", ("o", "v"), "force by loads at mesh nodes", True),
    Dataset("membrane_stiffness/shapes", "f8", ("a", "m"), "their coordinates per eta", True),
    Dataset("membrane_stiffness/linear", "f8", ("m", "p"), "energy, by pairs of shapes [J]", True),
    Dataset("membrane_stiffness/quadratic", "f8", ("p", "p"), "of products of pairs [J]", True),
    Dataset("omitted_modes/rest", "f8", ("z", "z"), "to accelerations, beyond these [J]", True),
    Dataset("omitted_stiffening/turns", "f8", ("L", "F", 3), "of fields left out", True),
    Dataset("omitted_stiffening/modes", "f8", ("L", "F", "m"), "and modes, per load", True),
    Dataset("omitted_stiffening/own", "f8", ("L", "F", "F"), "and each other", True),
    Dataset("omitted_stiffening/mass", "f8", (3, 3, "F", "R"), "and of all motions [kg m^2]", True),
    Dataset("load_vectors/name", "text", ("d",), "names of the loads", True),
    Dataset("load_vectors/force", "f8", ("d", 3), "resultant [N]", True),
    Dataset("load_vectors/moment", "f8", ("d", 3), "about the body frame's origin [N m]", True),
    Dataset("load_vectors/modal", "f8", ("d", "m"), "work per unit eta", True),
    Dataset("load_vectors/missing_share", "f8", ("d",), "of the static response", True),
    Dataset("load_points/name", "text", ("q",), "sign and component of a load", True),
    Dataset("load_points/load", "i8", ("q",), "number of the load", True),
    Dataset("load_points/position", "f8", ("q", 3), "mean of its nodes [m]", True),
    Dataset("load_points/Phi_t", "f8", ("q", 3, "m"), "translation per unit eta", True),
    Dataset("load_points/Phi_r", "f8", ("q", 3, "m"), "rotation per unit eta [rad]", True),
    Dataset("load_points/wrench", "f8", ("q", 6), "force [N] and moment [N m] there", True),
    Dataset("load_points/bend", "f8", ("q", 6, "m", "m"), "as of interfaces", True),
    Dataset("provenance/key", "text", ("s",), "names of entries"),
    Dataset("provenance/value", "text", ("s",), "their values"),
)

# groups that hold one part: the field of the body and its class
_PARTS: dict[str, tuple[str, type]] = {
    "surface": ("surface", Surface),
    "nodes": ("nodes", NodeModes),
    "stress_recovery": ("stress", StressModes),
    "section_forces": ("section_forces", SectionForceModes),
    "shell_forces": ("shell_forces", ShellForceModes),
    "omitted_stress": ("omitted_stress", OmittedStress),
    "inertia_response": ("inertia_response", responses.InertiaResponse),
    "load_response": ("load_response", responses.LoadResponse),
    "omitted_modes": ("omitted_modes", responses.OmittedModes),
    "omitted_stiffening": ("omitted_stiffening", responses.OmittedStiffening),
    "membrane_stiffness": ("membrane_stiffness", MembraneStiffness),
}
_NAN_ALLOWED = ("modes/interface_share", "modes/kinetic_share")  # shares that are unknown


def to_datasets(body: FlexBody) -> dict[str, Any]:
    """Arrays and lists of text by path in the file."""
    c = len(body.modes)
    datasets = part_datasets(body, body.interfaces, body.m)
    datasets |= {f"inertia/{name}": getattr(body, name) for name in ("S1", "S0", "p", "P", "Mab")}
    datasets |= {"stiffness/K": body.K, "stiffness/D": body.D}
    if body.damping is not None:
        datasets["damping/ratios"] = [json.dumps(plain_options(body.damping))]
    if body.centrifugal_stiffness is not None:
        datasets["stiffness/centrifugal_stiffness"] = body.centrifugal_stiffness
    if body.interfaces and all(part.bend is not None for part in body.interfaces):
        datasets["interfaces/bend"] = np.array([part.bend for part in body.interfaces])
    for name, kind in (("index", int), ("frequency", float), ("kept", bool)):
        datasets[f"modes/{name}"] = np.array([getattr(mode, name) for mode in body.modes], kind)
    for name, sizes in (("interface_share", [c]), ("kinetic_share", [c, 3])):
        values = [getattr(mode, name) for mode in body.modes]
        datasets[f"modes/{name}"] = np.array(values, dtype=float).reshape(sizes)
    for name in ("kind", "why", "mostly"):
        datasets[f"modes/{name}"] = [getattr(mode, name) for mode in body.modes]
    for name in ("name", "force", "moment", "modal", "missing_share") if body.loads else ():
        values = [getattr(load, name) for load in body.loads]
        datasets[f"load_vectors/{name}"] = values if name == "name" else np.array(values)
    points = [(k, point) for k, load in enumerate(body.loads) for point in load.points]
    for name in ("name", "position", "Phi_t", "Phi_r", "wrench", "bend") if points else ():
        values = [getattr(point, name) for _, point in points]
        if all(value is not None for value in values):
            datasets[f"load_points/{name}"] = values if name == "name" else np.array(values)
    if points:
        datasets["load_points/load"] = np.array([k for k, _ in points])
    return datasets


def part_datasets(body: Any, interfaces: Sequence[Interface], m: int) -> dict[str, Any]:
    """The datasets of interfaces, groups, provenance and the parts that a body or result has."""
    datasets: dict[str, Any] = {"interfaces/name": [part.name for part in interfaces]}
    i = len(interfaces)
    for name, shape in (("position", (i, 3)), ("Phi_t", (i, 3, m)), ("Phi_r", (i, 3, m))):
        rows = [getattr(part, name) for part in interfaces]
        datasets[f"interfaces/{name}"] = np.array(rows, dtype=float).reshape(shape)
    for row in TABLE:
        owner, _, name = row.path.partition("/")
        part = getattr(body, _PARTS[owner][0], None) if owner in _PARTS else None
        value = getattr(part, name, None)
        if value is not None:
            datasets[row.path] = list(value) if row.kind == "text" else value
    groups = {} if body.nodes is None else body.nodes.groups
    if groups:
        datasets["groups/name"] = list(groups)
        datasets["groups/count"] = np.array([len(nodes) for nodes in groups.values()], dtype=int)
        datasets["groups/nodes"] = np.concatenate(list(groups.values())).astype(int)
    datasets["provenance/key"] = list(body.provenance)
    datasets["provenance/value"] = list(body.provenance.values())
    return datasets


def from_datasets(name: str, mass: float, datasets: Mapping[str, Any]) -> FlexBody:
    """The body that these arrays describe; validated as any other."""
    group = {owner: _members(datasets, owner) for owner in ("inertia", "stiffness")}
    return FlexBody(
        name=name,
        mass=mass,
        **group["inertia"],
        **group["stiffness"],
        modes=tuple(ModeInfo(**row) for row in _rows(_members(datasets, "modes"))),
        loads=_loads(datasets),
        damping=read_damping(json.loads(*datasets.get("damping/ratios", ["null"]))),
        **parts_of(datasets),
    )


def parts_of(datasets: Mapping[str, Any]) -> dict[str, Any]:
    """Interfaces, provenance and parts, by the field that takes them, from datasets by path."""
    parts: dict[str, Any] = {
        "interfaces": tuple(Interface(**row) for row in _rows(_members(datasets, "interfaces"))),
        "provenance": dict(
            zip(datasets["provenance/key"], datasets["provenance/value"], strict=True)
        ),
    }
    for owner, (name, kind) in _PARTS.items():
        members = _members(datasets, owner)
        if owner == "nodes" and members:
            members["groups"] = _groups(datasets)
        required = {one.name for one in fields(kind) if one.default is one.default_factory}
        if members and (absent := sorted(required - set(members))):
            raise ValueError(f"the dataset {owner}/{absent[0]} is missing")
        if members:
            parts[name] = kind(**members)
    return parts


def _loads(datasets: Mapping[str, Any]) -> tuple[LoadVector, ...]:
    """The loads with their points."""
    loads, points = (_members(datasets, owner) for owner in ("load_vectors", "load_points"))
    owners = points.pop("load", np.zeros(0)).tolist()
    made = [LoadPoint(**row) for row in _rows(points)] if owners else []
    return tuple(
        LoadVector(**row, points=tuple(p for p, o in zip(made, owners, strict=True) if o == k))
        for k, row in enumerate(_rows(loads) if loads else ())
    )


def _groups(datasets: Mapping[str, Any]) -> dict[str, Any]:
    """Nodes of each named group."""
    if "groups/name" not in datasets:
        return {}
    ends = np.cumsum(datasets["groups/count"])[:-1]
    return dict(zip(datasets["groups/name"], np.split(datasets["groups/nodes"], ends), strict=True))


def may_hold_nan(path: str) -> bool:
    """Whether the dataset may contain NaN, which means unknown there."""
    return path in _NAN_ALLOWED


def _members(datasets: Mapping[str, Any], owner: str) -> dict[str, Any]:
    prefix = owner + "/"
    return {
        path[len(prefix) :]: value for path, value in datasets.items() if path.startswith(prefix)
    }


def _rows(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    plain = {
        name: values.tolist() if isinstance(values, np.ndarray) and values.ndim == 1 else values
        for name, values in columns.items()
    }
    return [dict(zip(plain, row, strict=True)) for row in zip(*plain.values(), strict=True)]


def save(body: FlexBody, path: str | os.PathLike[str]) -> Path:
    """Write a body; the file appears under its name only when it is complete.

    Parameters
    ----------
    body : FlexBody
        What to write.
    path : path
        Where; customarily ``<name>.flexbody.h5``.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    marks = {"format": FORMAT, "version": VERSION, "name": body.name, "mass": body.mass}
    marks["frame/choice"] = FRAME
    return save_datasets(Path(path), marks, TABLE, to_datasets(body), _NOUN)


def save_datasets(
    target: Path,
    marks: Mapping[str, Any],
    table: tuple[Dataset, ...],
    datasets: Mapping[str, Any],
    noun: str,
) -> Path:
    """Write datasets and the attributes of a file; it appears only when it is complete.

    Parameters
    ----------
    target : Path
        The file.
    marks : mapping
        Attributes by name, those of a group as ``"group/name"``.
    table, datasets, noun
        The datasets that may occur, those to write, and what they are: "the flexible body".

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    import h5py  # importing h5py takes 20 ms, which a check of a scene does not need

    content = BytesIO()  # HDF5 ends the process if a disk fails, so it writes into memory
    with h5py.File(content, "w", userblock_size=USER_BLOCK) as file:
        for row in table:
            file.require_group(row.path.partition("/")[0])
        for mark, value in marks.items():
            owner, _, name = mark.rpartition("/")
            file.require_group(owner or "/").attrs[name] = value
        for place, value in datasets.items():
            kind = h5py.string_dtype() if isinstance(value, list) else None
            file.create_dataset(place, data=value, dtype=kind)
    line = seal(content)
    try:
        with whole_file(target) as partial, partial.open("wb") as disk:
            disk.write(line)
            disk.write(content.getbuffer()[USER_BLOCK:])
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else error
        raise OutputError(f"{target}: cannot write {noun}: {why}") from error
    return target


def load(path: str | os.PathLike[str]) -> FlexBody:
    """Read a body.

    Raises
    ------
    BodyFileError
        No such file, not HDF5, not a flexible body, of another version, incomplete, or with
        numbers that cannot be.
    """
    source = Path(path)
    marks, datasets = load_datasets(source, FORMAT, VERSION, TABLE, "a flexible body")
    if marks.get("frame/choice") != FRAME:
        what = f"holds what this flexmb does not know (frame {marks.get('frame/choice')})"
        raise BodyFileError(f"{source}: {what}")
    try:
        return from_datasets(str(marks["name"]), float(marks["mass"]), datasets)
    except (LookupError, ValueError, AttributeError) as error:
        raise BodyFileError(f"{source}: is damaged; make it again ({error})") from error
    except (ReductionError, TypeError) as error:
        raise BodyFileError(f"{source}: the body inside is not valid\n{error}") from error


def load_datasets(
    source: Path, form: str, version: int, table: tuple[Dataset, ...], noun: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The attributes of a file, and its datasets by path.

    Parameters
    ----------
    source : Path
        The file.
    form, version, table
        Format, version and table of datasets that it must have.
    noun : str
        What the file contains, for messages: "a flexible body".

    Raises
    ------
    BodyFileError
        No such file, not HDF5, another format or version, incomplete.
    """
    try:
        with open_hdf5(source, BodyFileError, f"{noun} of flexmb") as file:
            marks = dict(file.attrs)
            for owner in file:
                marks |= {f"{owner}/{name}": v for name, v in file[owner].attrs.items()}
            if marks.get("format") != form:
                raise BodyFileError(f"{source}: is an HDF5 file, but not {noun} of flexmb")
            if marks.get("version") != version:
                what = f"is {noun} of file version {marks.get('version')}; this flexmb reads "
                raise BodyFileError(f"{source}: {what}{version}: make it again")
            datasets = {row.path: _read_dataset(file, row, source) for row in table}
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise BodyFileError(f"{source}: is damaged; make it again ({error})") from error
    present = {key: value for key, value in datasets.items() if value is not None}
    _check_lengths(present, source, table)
    return marks, present


def _read_dataset(file: h5py.File, row: Dataset, source: Path) -> Any:
    item = file.get(row.path)
    if item is None:
        if row.optional:
            return None
        raise BodyFileError(f"{source}: the dataset {row.path} is missing; write the body again")
    values = np.asarray(item.asstr()[()]).tolist() if row.kind == "text" else item[()]
    if row.kind != "text":
        values = np.asarray(values, dtype=row.kind)
        unknown = may_hold_nan(row.path) and np.isnan(values)
        if row.kind[0] == "f" and not (np.isfinite(values) | unknown).all():
            raise BodyFileError(f"{source}: the dataset {row.path} has entries that are not finite")
    return values


def _check_lengths(datasets: dict[str, Any], source: Path, table: tuple[Dataset, ...]) -> None:
    lengths: dict[str, int] = {}
    for row in table:
        if row.path not in datasets:
            continue
        shape = np.shape(datasets[row.path])
        if len(shape) != len(row.shape) or any(
            lengths.setdefault(want, have) != have if isinstance(want, str) else want != have
            for want, have in zip(row.shape, shape, strict=True)
        ):
            raise BodyFileError(
                f"{source}: the dataset {row.path} has shape {shape}, not {row.shape}: make the "
                "file again"
            )
