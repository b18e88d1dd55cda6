"""The result of a part by itself: displacements, reactions, stresses, frequencies, mode shapes.

In: the solution of :func:`flexmb.fe.part`. Out: :class:`PartResult`, and its HDF5 file. Its fields
are the static solution, the vibration modes and the buckling modes; each has one column in all
arrays of motion and stress. All in SI, axes of the mesh. Vibration modes have unit modal mass;
buckling modes have a largest displacement of one metre.

Quantities have names, by which scenes state known answers: ``frequency.1``, ``load_factor.1``,
``displacement.tip.z`` and ``rotation.tip.x`` (interface, mesh group or node), ``reaction.root.Fz``,
``von_mises`` (the largest), ``von_mises.17`` and ``von_mises.17.top`` (at mesh node 17),
``stress.17.top.xx``, ``stress.17.top.skin.xx`` (of a section), ``principal.17.1``,
``section_force.3.2.Mz`` (beam element 3, second end), ``shell_force.17.Mx``. All but the first two
are those of the static solution.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import BodyFileError, FlexmbError, ReductionError
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.body_file import (
    TABLE,
    Dataset,
    load_datasets,
    part_datasets,
    parts_of,
    save_datasets,
)
from flexmb.flexbody.parts import Interface, NodeModes, Surface
from flexmb.flexbody.stress_modes import (
    SECTION_FORCES,
    SHELL_FORCES,
    STRESS,
    SectionForceModes,
    ShellForceModes,
    StressModes,
    principal_stresses,
    von_mises,
)

STATIC = "static"
"""Name of the field of the static solution."""
_FORMAT, _VERSION = "flexmb-part", 1
_FORCES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
_OWNERS = ("interfaces", "surface", "nodes", "groups", "stress_recovery", "section_forces",
           "shell_forces", "provenance")  # fmt: skip
_TABLE = (
    *(row for row in TABLE if row.path.partition("/")[0] in _OWNERS),
    Dataset("fields/name", "text", ("m",), "static, mode 1, ..., buckling 1, ..."),
    Dataset("frequencies/number", "i8", ("v",), "numbers of the modes of vibration"),
    Dataset("frequencies/value", "f8", ("v",), "natural frequencies [Hz]"),
    Dataset("frequencies/mass", "f8", ("v", 3), "effective masses along x, y, z [kg]"),
    Dataset("buckling/factor", "f8", ("w",), "load factors"),
    Dataset("supports/name", "text", ("r",), "names of the supports"),
    Dataset("supports/position", "f8", ("r", 3), "their reference points [m]"),
    Dataset("supports/force", "f8", ("r", 3), "reactions on the part [N]"),
    Dataset("supports/moment", "f8", ("r", 3), "about the reference points [N m]"),
    Dataset("loads/name", "text", ("f",), "names of the loads"),
    Dataset("loads/position", "f8", ("f", 3), "the centre of mass [m]"),
    Dataset("loads/force", "f8", ("f", 3), "their resultants [N]"),
    Dataset("loads/moment", "f8", ("f", 3), "about the centre of mass [N m]"),
    Dataset("notes/text", "text", ("o",), "what the run says"),
)


@dataclass(frozen=True, eq=False)
class Resultant:
    """Force and moment (3,) on the part, about ``position`` (3,), axes of the mesh [N, N m, m]."""

    name: str
    position: FloatArray
    force: FloatArray
    moment: FloatArray


@dataclass(frozen=True, eq=False)
class PartResult:
    """The results of a part analysis.

    Parameters
    ----------
    name : str
        Name of the part.
    mass : float
        kg.
    fields : tuple of str
        Names of the m columns: ``"static"``, ``"mode 1"``, ..., ``"buckling 1"``, ...
    numbers : (v,) int
        Numbers of the modes of vibration, from 1.
    frequencies : (v,) float
        Natural frequencies [Hz].
    effective_mass : (v, 3) float
        Mass that each mode moves along x, y and z of a shaken support [kg].
    load_factors : (w,) float
        Factors on the loads at which the part buckles, ascending.
    supports : tuple of Resultant
        Reactions.
    loads : tuple of Resultant
        Applied loads.
    interfaces : tuple of Interface
        Motion of the reference points.
    surface, nodes, stress, section_forces, shell_forces
        What is drawn, motion of the nodes, stress at the nodes, section forces of beams, force and
        moment resultants of shells; None where there is none.
    notes : tuple of str
        Sentences on the model and the analysis.
    provenance : mapping of str to str
        Mesh, material, options, versions.
    """

    name: str
    mass: float
    fields: tuple[str, ...]
    numbers: IntArray
    frequencies: FloatArray
    effective_mass: FloatArray
    load_factors: FloatArray
    supports: tuple[Resultant, ...]
    loads: tuple[Resultant, ...]
    interfaces: tuple[Interface, ...]
    surface: Surface | None
    nodes: NodeModes
    stress: StressModes | None = None
    section_forces: SectionForceModes | None = None
    shell_forces: ShellForceModes | None = None
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    def column(self, name: str = STATIC) -> FloatArray:
        """(m,) one at the field of this name, else zero: modal coordinates that select the field.

        Raises
        ------
        FlexmbError
            There is none; says which there are.
        """
        if name not in self.fields:
            what = f'{self.name}: has no field "{name}"'
            if name == STATIC:
                what = f"{self.name}: has no static solution, since nothing loads it"
            raise FlexmbError.unknown(what, name, self.fields)
        return np.asarray(np.arange(len(self.fields)) == self.fields.index(name), dtype=float)

    def displacements(self, name: str = STATIC) -> FloatArray:
        """(k, 3) displacement of the nodes ``nodes.ids`` in a field [m]."""
        return np.asarray(self.nodes.Phi_t @ self.column(name))

    def stresses(self, name: str = STATIC) -> FloatArray:
        """(e, 6) stress at the places of ``stress``, xx yy zz yz zx xy [Pa]."""
        return self._stress().at(self.column(name))

    def von_mises(self, name: str = STATIC) -> FloatArray:
        """(e,) von Mises stress at the places of ``stress`` [Pa]."""
        return von_mises(self.stresses(name))

    def principal(self, name: str = STATIC) -> FloatArray:
        """(e, 3) principal stresses there, the largest first [Pa]."""
        return principal_stresses(self.stresses(name))

    @property
    def reactions(self) -> dict[str, Resultant]:
        """Reactions by support."""
        return {part.name: part for part in self.supports}

    @property
    def imbalance(self) -> float:
        """Largest component of the sum of loads and reactions, over the largest force or moment.

        Moments are divided by the size of the part.
        """
        center = self.nodes.position.mean(axis=0)
        size = float(np.ptp(self.nodes.position, axis=0).max()) or 1.0
        forces = [part.force for part in (*self.supports, *self.loads)]
        moments = [
            (part.moment + np.cross(part.position - center, part.force)) / size
            for part in (*self.supports, *self.loads)
        ]
        rows = np.array([*forces, *moments]).reshape(-1, 3)
        largest = float(np.abs(rows).max(initial=0.0)) or 1.0
        sums = np.sum(rows.reshape(2, -1, 3), axis=1)
        return float(np.abs(sums).max(initial=0.0)) / largest

    def _stress(self) -> StressModes:
        if self.stress is None:
            raise FlexmbError(f"{self.name}: holds no stress; its elements have none")
        return self.stress

    def quantity(self, name: str) -> float:
        """The value [SI] of a quantity by its name; see the module.

        Raises
        ------
        FlexmbError
            No such quantity; says which there are.
        """
        kind, *words = name.split(".")
        if kind not in QUANTITIES:
            raise FlexmbError.unknown(f"{name}: no such quantity", kind, QUANTITIES)
        form, _, read = QUANTITIES[kind]
        try:
            return float(read(self, words))
        except (ValueError, IndexError):
            raise FlexmbError(f"{name}: is not of the form {form}") from None


def unit_of_quantity(name: str) -> str | None:
    """SI unit of a quantity; None where there is no such kind."""
    kind, *words = name.split(".")
    if kind not in QUANTITIES:
        return None
    unit = QUANTITIES[kind][1]
    last = words[-1] if words else ""
    if kind == "reaction":
        return "N m" if last.startswith("M") else "N"
    if kind == "section_force":
        return "N" if last in SECTION_FORCES[:3] else "N m"
    return "N" if kind == "shell_force" and last.startswith("M") else unit


def _numbered(result: PartResult, values: FloatArray, numbers: Sequence[int], what: str) -> float:
    wanted, (have) = numbers[0], [int(k) for k in numbers[1:]]
    if wanted not in have:
        raise FlexmbError(f"{result.name}: has no {what} {wanted}; it has {len(have)}")
    return float(values[have.index(wanted)])


def _frequency(result: PartResult, words: list[str]) -> float:
    (number,) = map(int, words)
    return _numbered(result, result.frequencies, [number, *result.numbers], "natural frequency")


def _load_factor(result: PartResult, words: list[str]) -> float:
    (number,) = map(int, words)
    count = range(1, len(result.load_factors) + 1)
    return _numbered(result, result.load_factors, [number, *count], "load factor")


def _motion(rotation: bool) -> Callable[[PartResult, list[str]], float]:
    def read(result: PartResult, words: list[str]) -> float:
        place, axis = words
        e, interfaces = result.column(), {part.name: part for part in result.interfaces}
        if place in interfaces:
            part = interfaces[place]
            return float(((part.Phi_r if rotation else part.Phi_t) @ e)["xyz".index(axis)])
        groups = result.nodes.groups
        ids = [int(place)] if place.isdecimal() and place not in groups else groups.get(place)
        if ids is None:
            what = f'{result.name}: there is no interface, group or node "{place}"'
            raise FlexmbError.unknown(what, place, [*interfaces, *groups])
        rows = [result.nodes.row(int(node)) for node in ids]
        modes = result.nodes.Phi_r if rotation else result.nodes.Phi_t
        if min(rows) < 0 or modes is None:
            raise FlexmbError(f"{result.name}: node {place} belongs to no element of the part")
        return float((modes[rows] @ e)[:, "xyz".index(axis)].mean())

    return read


def _reaction(result: PartResult, words: list[str]) -> float:
    name, component = words
    if name not in result.reactions:
        what = f'{result.name}: there is no support "{name}"'
        raise FlexmbError.unknown(what, name, result.reactions)
    part = result.reactions[name]
    return float(np.concatenate([part.force, part.moment])[_FORCES.index(component)])


def _at_node(result: PartResult, values: FloatArray, words: Sequence[str]) -> FloatArray:
    """Values (rows) at a node, perhaps of a layer, a section or both."""
    stress = result._stress()
    layer, part = stress.layer_and_part(words[1:])
    if layer is not None and layer not in stress.layers:
        what = f'{result.name}: has no stress in a layer or section "{layer}"'
        raise FlexmbError.unknown(what, layer, [*stress.layers, *stress.parts])
    rows = stress.rows(int(words[0]) if words else None, layer, part)
    if not len(rows):
        raise FlexmbError(f"{result.name}: has no stress at node {'.'.join(words)}")
    return np.asarray(values[rows])


def _von_mises(result: PartResult, words: list[str]) -> float:
    return float(_at_node(result, result.von_mises(), words).max())


_EQUAL_STRESS = 1e-5  # relative difference; stress is stored in single precision


def _stress_component(result: PartResult, words: list[str]) -> float:
    rows = _at_node(result, result.stresses(), words[:-1])[:, STRESS.index(words[-1])]
    if np.ptp(rows) > _EQUAL_STRESS * np.abs(rows).max():
        stress = result._stress()
        layer, part = stress.layer_and_part(words[1:-1])
        names = stress.place_names(stress.rows(int(words[0]), layer, part))
        what = f"{result.name}: has {len(rows)} stresses at node {words[0]} ({names})"
        cure = "name a layer, a section or both, as stress.17.top.skin.xx"
        raise FlexmbError(f"{what}; {cure}; stresses() has all of them")
    return float(rows[0])


def _principal(result: PartResult, words: list[str]) -> float:
    values = _at_node(result, result.principal(), words[:-1])[:, ("1", "2", "3").index(words[-1])]
    return float(values[np.abs(values).argmax()])


def _section_force(result: PartResult, words: list[str]) -> float:
    element, end, component = words
    if result.section_forces is None:
        raise FlexmbError(f"{result.name}: has no beams")
    forces = result.section_forces.at(result.column())
    if not element.isdecimal():
        raise ValueError
    return float(forces[int(element), ("1", "2").index(end), SECTION_FORCES.index(component)])


def _shell_force(result: PartResult, words: list[str]) -> float:
    node, component = words
    if result.shell_forces is None:
        raise FlexmbError(f"{result.name}: has no shells")
    rows = np.flatnonzero(result.shell_forces.ids == int(node))
    if not len(rows):
        raise FlexmbError(f"{result.name}: has no shell at node {node}")
    values = result.shell_forces.at(result.column(), rows)
    return float(values[:, SHELL_FORCES.index(component)].mean())


QUANTITIES: dict[str, tuple[str, str, Callable[[PartResult, list[str]], float]]] = {
    "frequency": ("frequency.1", "Hz", _frequency),
    "load_factor": ("load_factor.1", "", _load_factor),
    "displacement": ("displacement.tip.z: interface, group or node", "m", _motion(False)),
    "rotation": ("rotation.tip.x: interface, group or node", "rad", _motion(True)),
    "reaction": ("reaction.root.Fx, ... or .Mz", "N", _reaction),
    "von_mises": ("von_mises, von_mises.17 or von_mises.17.top", "Pa", _von_mises),
    "stress": ("stress.17.xx, stress.17.top.xx or stress.17.top.skin.xx", "Pa", _stress_component),
    "principal": ("principal.17.1 or principal.17.top.1, 1 to 3", "Pa", _principal),
    "section_force": ("section_force.3.1.Mz: element, end 1 or 2", "N m", _section_force),
    "shell_force": ("shell_force.17.Mx: node", "N/m", _shell_force),
}  # fmt: skip
"""By first word of a quantity's name: its form, SI unit, and the function that reads it."""


def save_part(result: PartResult, path: str | os.PathLike[str]) -> Path:
    """Write a result; customarily ``<name>.part.h5``.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    m = len(result.fields)
    datasets = part_datasets(result, result.interfaces, m)
    datasets |= {
        "fields/name": list(result.fields),
        "frequencies/number": result.numbers,
        "frequencies/value": result.frequencies,
        "frequencies/mass": result.effective_mass,
        "buckling/factor": result.load_factors,
        "notes/text": list(result.notes),
    }
    for owner, parts in (("supports", result.supports), ("loads", result.loads)):
        datasets[f"{owner}/name"] = [part.name for part in parts]
        for key in ("position", "force", "moment"):
            rows = [getattr(part, key) for part in parts]
            datasets[f"{owner}/{key}"] = np.array(rows, dtype=float).reshape(-1, 3)
    marks = {"format": _FORMAT, "version": _VERSION, "name": result.name, "mass": result.mass}
    return save_datasets(Path(path), marks, _TABLE, datasets, "the result of the part")


def load_part(path: str | os.PathLike[str]) -> PartResult:
    """Read a result.

    Raises
    ------
    BodyFileError
        No such file, another kind of file, incomplete, or with numbers that cannot be.
    """
    source = Path(path)
    marks, data = load_datasets(source, _FORMAT, _VERSION, _TABLE, "the result of a part")
    keys = ("name", "position", "force", "moment")
    try:
        resultants: dict[str, Any] = {
            owner: tuple(
                Resultant(*row)
                for row in zip(*(data[f"{owner}/{key}"] for key in keys), strict=True)
            )
            for owner in ("supports", "loads")
        }
        return PartResult(
            str(marks["name"]),
            float(marks["mass"]),
            tuple(data["fields/name"]),
            data["frequencies/number"],
            data["frequencies/value"],
            data["frequencies/mass"],
            data["buckling/factor"],
            **resultants,
            notes=tuple(data["notes/text"]),
            **parts_of(data),
        )
    except (ReductionError, TypeError, KeyError, ValueError) as error:
        raise BodyFileError(f"{source}: the result inside is not valid\n{error}") from error
