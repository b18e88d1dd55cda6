"""A part by itself: one mesh with supports and loads, solved and recovered.

In: a mesh with its material, supports, loads. Out: a :class:`PartResult`. All mistakes that can be
seen in the mesh and the options are raised together, before anything is assembled.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import FlexmbWarning, MaterialError, MeshError, Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices, MeshModel, ProblemCollector, assemble_model
from flexmb.fe.assembly.interfaces import InterfaceLike, ModelInterface
from flexmb.fe.assembly.loads import condensed_load, load_vector
from flexmb.fe.assembly.supports import Supports, make_supports
from flexmb.fe.mesh_checks import Finding
from flexmb.fe.meshes.mesh_shapes import MeshLike
from flexmb.fe.model_checks import check_releases, mass_sentence, point_mass
from flexmb.fe.multifrontal import blas_threads
from flexmb.fe.reduce import prepare_model
from flexmb.fe.reduction.methods import model_provenance
from flexmb.fe.sections.section_tables import MaterialLike, sections_from
from flexmb.fe.supported_model import SupportedModel, spin_field
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.options import kind_of, read_options, require_tables
from flexmb.flexbody.part_options import (
    PART_LOADS,
    FrequenciesOptions,
    InterfaceLoad,
    PartAnalysisOptions,
    SpinLoad,
    SupportOptions,
    is_static,
)
from flexmb.flexbody.part_result import PartResult
from flexmb.progress import Progress, silent
from flexmb.units import say_length, say_place, unit_system

Words = Mapping[str, Mapping[str, Any]]


@blas_threads()
def part(
    mesh: MeshLike,
    *,
    units: str = "SI",
    material: MaterialLike | None = None,
    sections: Mapping[str, Any] | None = None,
    interfaces: Mapping[str, InterfaceLike] | None = None,
    ties: Words | None = None,
    masses: Words | None = None,
    springs: Words | None = None,
    mass_matrix: str = "consistent",
    supports: Words | None = None,
    loads: Words | None = None,
    frequencies: Any = None,
    buckling: int = 0,
    preload: bool = False,
    name: str | None = None,
    progress: Progress = silent,
) -> PartResult:
    """Solve a part by itself: one mesh with supports and loads.

    Parameters
    ----------
    mesh, units, material, sections, interfaces, ties, masses, springs, mass_matrix
        As for :func:`flexmb.fe.reduce`. Nodes of a rigid interface (rbe2) move as one rigid body.
    supports : mapping of str to mapping, optional
        What is held: ``interface``, or nodes by ``group``, ``node``, ``nodes`` or ``center`` and
        ``radius``; ``type`` ``"clamped"``, ``"hinged"`` (``axis``), ``"sliding"``,
        ``"symmetric"``, ``"antisymmetric"`` (``normal``), or ``hold``, a list of ux, uy, uz, rx,
        ry, rz; ``displacement`` [m] and ``rotation`` [rad] that are imposed. Each node of a group
        is held by itself, an interface at its reference point.
    loads : mapping of str to mapping, optional
        As for :func:`flexmb.fe.make_loads`, and ``{type = "interface", interface, force, moment}``
        and ``{type = "spin", angular_velocity, angular_acceleration, position}`` [rad/s, rad/s^2,
        m]. They act together.
    frequencies : int or mapping, optional
        Number of natural frequencies, or ``{"band": [f1, f2]}`` [Hz]. Also for a part that can
        move as a whole; its rigid motions are not counted.
    buckling : int
        Number of buckling load factors: the part buckles at these multiples of its loads.
    preload : bool
        Whether loads and spin stiffen or soften the part for its natural frequencies; Coriolis
        forces are left out.
    name : str, optional
        Name of the part; the file's by default.
    progress : Progress
        Called with the phases read, assemble, factor, modes, recovery, stress.

    Raises
    ------
    MeshError, MaterialError, ReductionError
        All mistakes in mesh, supports and loads at once; a rigid motion that the supports leave
        free; a preload beyond buckling.
    """
    tables = {"sections": sections, "interfaces": interfaces, "ties": ties, "masses": masses}
    tables |= {"springs": springs, "supports": supports, "loads": loads}
    require_tables(MeshError, tables)
    collector = ProblemCollector()
    words = (supports or {}, loads or {}, frequencies, buckling, preload)
    options = _read_part(collector, *words)
    scale = unit_system(units).factor(L=1)
    if material is None:
        collector.errors.append(MaterialError.from_problems([Problem("material", "is missing")]))
    progress("read", 0.0)
    model, ends, findings = prepare_model(
        collector, mesh, scale, material, sections, interfaces or {}, _mesh_loads(loads or {}),
        ties=ties, masses=masses, springs=springs,
    )  # fmt: skip
    _check_names(collector, model, supports or {}, loads or {}, tuple(interfaces or {}))
    collector.raise_errors()
    assert options is not None and model is not None
    fe = assemble_model(model, mass_matrix, progress)
    if sentence := mass_sentence(fe, point_mass(masses)):
        findings.append(Finding("warning", sentence))
    for finding in findings:
        if finding.level == "warning":
            warnings.warn(finding.sentence, FlexmbWarning, stacklevel=2)
    constraints = collector(make_supports, fe, ends, options.supports)
    parts = {k: collector(part_load, fe, ends, k, load) for k, load in options.loads.items()}
    collector.raise_errors()
    assert constraints is not None
    free = np.setdiff1d(np.arange(constraints.G.shape[1]), constraints.fixed)
    check_releases(fe, [end.nodes for end in ends], constraints.G[:, free])
    vectors = {k: f for k, f in parts.items() if f is not None}
    collector(_check_loads, fe, constraints, vectors)
    notes = [finding.sentence for finding in findings if finding.level == "note"]
    notes += collector(_check_motions, fe, constraints, options) or []
    collector.raise_errors()
    progress("read", 1.0)
    solved = SupportedModel(fe, ends, constraints, options, progress)
    return solved.result(
        name or Path(fe.mesh.source).stem,
        vectors,
        notes,
        model_provenance(
            fe,
            {"units": units, "ties": ties, "masses": masses, "springs": springs,
             "mass_matrix": mass_matrix, "supports": supports, "loads": loads},
            interfaces or {},
            sections_from(sections),
            findings,
        ),
    )  # fmt: skip


def _read_part(
    collector: ProblemCollector,
    supports: Words,
    loads: Words,
    frequencies: Any,
    buckling: int,
    preload: bool,
) -> PartAnalysisOptions | None:
    """The options of a part analysis; mistakes in them go to ``collector``."""
    errors = len(collector.errors)
    supported = {
        name: collector(read_options, SupportOptions, words, f"supports.{name}", ReductionError)
        for name, words in supports.items()
    }
    acting = {name: collector(_load_options, name, words) for name, words in loads.items()}
    if isinstance(frequencies, int) and not isinstance(frequencies, bool):
        frequencies = {"count": frequencies}
    wanted = None
    if frequencies is not None:
        table = (FrequenciesOptions, frequencies, "frequencies", ReductionError)
        wanted = collector(read_options, *table)
    if len(collector.errors) > errors:
        return None
    every = {"supports": supported, "loads": acting, "frequencies": wanted}
    every |= {"buckling": buckling, "preload": preload}
    return collector(read_options, PartAnalysisOptions, every, "part", ReductionError)


def _load_options(name: str, words: Mapping[str, Any]) -> Any:
    where = f"loads.{name}"
    kind = kind_of("type", tuple(PART_LOADS), words, where, ReductionError)
    return read_options(PART_LOADS[kind], words, where, ReductionError)


def _mesh_loads(loads: Words) -> dict[str, Any]:
    """The loads whose nodes and groups must exist in the mesh."""
    own = ("interface", "spin")
    return {k: w for k, w in loads.items() if isinstance(w, Mapping) and w.get("type") not in own
            and w.get("type") in PART_LOADS}  # fmt: skip


def _check_names(
    collector: ProblemCollector,
    model: MeshModel | None,
    supports: Words,
    loads: Words,
    interfaces: tuple[str, ...],
) -> None:
    """Check groups of supports, and interfaces of supports and loads, even if there are other
    errors."""
    tables = {f"supports.{k}": w for k, w in supports.items() if isinstance(w, Mapping)}
    acting = {f"loads.{k}": w for k, w in loads.items() if isinstance(w, Mapping)}
    for where, words in tables.items():
        if model is not None and isinstance(words.get("group"), str):
            collector(model.mesh.group_nodes, words["group"], f"{where}.group")
    problems = [
        Problem(f"{where}.interface", f'there is no interface "{name}"', interfaces, near)
        for where, words in {**tables, **acting}.items()
        if isinstance(name := words.get("interface"), str) and name not in interfaces
        for near in [nearest(name, interfaces)]
    ]
    if problems:
        collector.errors.append(MeshError.from_problems(problems))


def part_load(
    fe: FEMatrices, ends: tuple[ModelInterface, ...], name: str, options: Any
) -> FloatArray:
    """(n_all,) nodal forces and moments of one load on a part."""
    if isinstance(options, SpinLoad):
        A, p = spin_field(options)
        return -fe.load_per_mass(np.column_stack([A, -A @ p]))
    if isinstance(options, InterfaceLoad):
        end = next(end for end in ends if end.name == options.interface)
        load = np.array([*(options.force or (0.0,) * 3), *(options.moment or (0.0,) * 3)])
        dofs, values = end.loads()
        f = np.zeros(fe.numbering.n_all)
        np.add.at(f, dofs, values @ load)
        return f
    return load_vector(fe, f"loads.{name}", options)


def _check_loads(fe: FEMatrices, constraints: Supports, vectors: Mapping[str, FloatArray]) -> None:
    """Refuse a load that acts on supported degrees of freedom only: it does nothing to the part."""
    problems = []
    for name, f in vectors.items():
        z = constraints.G.T @ condensed_load(fe, f)
        if f.any() and np.abs(z[constraints.free]).max(initial=0.0) <= 1e-12 * np.abs(z).max():
            loaded = constraints.shares[:, np.abs(z[constraints.fixed]) > 0].any(axis=1)
            owners = sorted(n for n, one in zip(constraints.names, loaded, strict=True) if one)
            what = f"acts on held motions alone: it goes straight into {', '.join(owners)}"
            problems.append(Problem(f"loads.{name}", what))
    if problems:
        raise MeshError.from_problems(problems)


def _check_motions(
    fe: FEMatrices, constraints: Supports, options: PartAnalysisOptions
) -> list[str]:
    """Refuse rigid motions if they make the analysis impossible; else name them in a note."""
    size = float(np.ptp(fe.mesh.points[fe.numbering.nodes], axis=0).max())
    free = constraints.free_motions(size)
    if not free.shape[1]:
        return []
    names = "; ".join(_motions_in_words(free, fe.center, size))
    needs = [k for k in ("loads", "buckling", "preload") if getattr(options, k)]
    if needs or is_static(options):
        what = f"leave the part free to move as a whole: {names}"
        problem = Problem("supports", f"{what}; hold it, or ask for frequencies without loads")
        raise ReductionError.from_problems([problem])
    if constraints.W.shape[0]:
        what = "an interface of type rbe3 holds a part that can still move as a whole"
        problem = Problem("supports", f"{what} ({names}): take rbe2, or hold the rest")
        raise ReductionError.from_problems([problem])
    return [f"free to move as a whole: {names}; frequencies are those of the deformation"]


def _motions_in_words(N: FloatArray, center: FloatArray, size: float) -> list[str]:
    """Sentences that describe the rigid motions N (6, r) of a part of a given size [m].

    Rows of N: translations [m] and rotations [rad] about the centre of mass.
    """
    rows = (N * np.array([1.0] * 3 + [size] * 3)[:, None]).T[:, [3, 4, 5, 0, 1, 2]]
    words = []
    for row in _echelon(rows):
        w, t = row[:3], row[3:]
        if np.abs(w).max() < 1e-6 * np.abs(t).max():
            words.append(f"translation along {_direction(t)}")
            continue
        w = w / size
        rate = float(np.linalg.norm(w))
        point = center + np.cross(w, t) / rate**2
        pitch = float(w @ t) / rate**2
        point[np.abs(point) < 1e-9 * size] = 0.0
        slide = f", sliding {say_length(pitch, 3)} along it per rad"
        screw = slide if abs(pitch) > 1e-6 * size else ""
        words.append(f"rotation about {_direction(w)} through {say_place(point)}{screw}")
    return words


def _echelon(rows: FloatArray) -> FloatArray:
    """Reduced row echelon form; each pivot is the entry of largest magnitude."""
    rows, at = rows.copy(), 0
    for column in range(rows.shape[1]):
        if at == len(rows):
            break
        pivot = at + int(np.abs(rows[at:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-6:
            rows[at:, column] = 0.0
            continue
        rows[[at, pivot]] = rows[[pivot, at]]
        rows[at] /= rows[at, column]
        others = np.arange(len(rows)) != at
        rows[others] -= np.outer(rows[others, column], rows[at])
        at += 1
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def _direction(vector: FloatArray) -> str:
    unit = vector / np.linalg.norm(vector)
    unit *= np.sign(unit[np.abs(unit).argmax()])
    axis = int(np.abs(unit).argmax())
    if np.abs(np.delete(unit, axis)).max() < 1e-6:
        return "xyz"[axis]
    return "(" + ", ".join(f"{x:.4g}" for x in unit) + ")"
