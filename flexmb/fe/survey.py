"""What a reduction will make of a mesh, and what keeps it from doing so, told before any assembly.

In: a mesh and the options of :func:`flexmb.fe.reduce`. Out: a :class:`Survey`: the problems, what
is suspicious, elements by kind, degrees of freedom, kept coordinates and mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from flexmb.errors import FlexmbError, Problem
from flexmb.fe.assembly.assemble import number_model
from flexmb.fe.assembly.connections import Spring, Tie, make_springs, make_ties, spring_stiffness
from flexmb.fe.assembly.interfaces import (
    ModelInterface,
    RigidInterface,
    make_interfaces,
    select_interface,
)
from flexmb.fe.assembly.mass import nodal_masses
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.elements.blocks import Block, select_elements
from flexmb.fe.material import MaterialLike, plausibility, resolve
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.meshes.mesh_checks import Finding, mesh_report, size_sentence
from flexmb.fe.meshes.mesh_shapes import MeshLike, mesh_from
from flexmb.fe.model_checks import nominal_mass, point_mass
from flexmb.fe.reduction.mode_selection import mode_selection
from flexmb.fe.reduction.user_modes import read_user_modes
from flexmb.fe.sections.section_tables import sections_from
from flexmb.units import unit_system

__all__ = ["Survey", "mesh_problems", "survey"]

T = TypeVar("T")
Words = Mapping[str, Any]


@dataclass(frozen=True)
class Survey:
    """What is known of a body before it is reduced.

    Parameters
    ----------
    problems : list of Problem
        What keeps it from being reduced; where there are some, the rest is missing.
    findings : list of Finding
        Notes and warnings.
    elements : dict of str to int
        Elements of the body by kind.
    dofs : int
        Degrees of freedom of the finite-element model.
    coordinates : str
        Kept coordinates and how they are counted.
    mass : float
        kg.
    interfaces : dict of str to (3,) float
        Places of the interfaces, mesh frame [m].
    points : (n, 3) float
        Nodes of the mesh [m].
    groups : dict of str to (g,) int
        Nodes of its named groups.
    """

    problems: list[Problem]
    findings: list[Finding] = field(default_factory=list)
    elements: dict[str, int] = field(default_factory=dict)
    dofs: int = 0
    coordinates: str = ""
    mass: float = 0.0
    interfaces: dict[str, np.ndarray] = field(default_factory=dict)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    groups: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Model:
    """The part of a finite-element model that is there before its matrices."""

    mesh: Mesh
    numbering: Numbering


def survey(
    mesh: MeshLike,
    *,
    units: str = "SI",
    material: MaterialLike | None = None,
    sections: Words | None = None,
    interfaces: Words | None = None,
    ties: Words | None = None,
    masses: Words | None = None,
    springs: Words | None = None,
    loads: Words | None = None,
    modes: Any = 20,
    reduction: str = "craig-bampton",
    plane: str | None = None,
    **others: Any,
) -> Survey:
    """Look at a mesh as :func:`flexmb.fe.reduce` would; the parameters are the same."""
    problems: list[Problem] = []
    read = _attempt(problems, mesh_from, mesh)
    chosen = _attempt(problems, sections_from, sections)
    matter = None if material is None else _attempt(problems, resolve, material)
    if read is None:
        return Survey(problems)
    read = read.scaled(unit_system(units).factor(L=1))
    tied = _attempt(problems, make_ties, read, ties or {}) or ()
    joined = _attempt(problems, make_springs, read, springs or {}) or ()
    blocks = None
    if chosen is not None:
        blocks = _attempt(problems, select_elements, read, chosen, matter)
    if blocks is None:
        problems += _group_problems(read, interfaces or {}, loads or {})
        return Survey(problems)
    model = _Model(read, number_model(read, blocks, tied))
    held = _attempt(problems, make_interfaces, model, interfaces or {}) or ()
    _attempt(problems, nodal_masses, read, model.numbering, masses or {})
    for spring in joined:
        _attempt(problems, spring_stiffness, spring, model.numbering, read.points)
    problems += _load_problems(model, loads or {})
    problems += _mode_problems(model, held, modes, reduction)
    findings = _findings(read, blocks, (held, tied, joined))
    problems += [Problem(read.source, f.sentence) for f in findings if f.level == "error"]
    if problems:
        return Survey(problems)
    mass = 0.0
    if matter is not None:
        findings += [Finding("warning", sentence) for sentence in plausibility(matter)]
        mass = nominal_mass(blocks, read.points) + point_mass(masses)
    kept = {"modes": modes, "reduction": reduction}
    coordinates = _coordinates(6 if plane is None else 3, len(held), kept, loads or {})
    places = {part.name: part.position for part in held}
    counts, n = _counts(blocks), model.numbering.n
    return Survey(
        [], findings, counts, n, coordinates, mass, places, read.points, dict(read.node_sets)
    )


def mesh_problems(
    mesh: MeshLike, interfaces: Words | None = None, sections: Words | None = None, **options: Any
) -> list[Problem]:
    """Everything that keeps a mesh from becoming the body, as far as looking at it can tell.

    Parameters
    ----------
    mesh, interfaces, sections, options
        As for :func:`flexmb.fe.reduce`.
    """
    return survey(mesh, interfaces=interfaces, sections=sections, **options).problems


def _attempt(problems: list[Problem], function: Callable[..., T], *arguments: Any) -> T | None:
    """The function's value; None with the problems noted where it refuses."""
    try:
        return function(*arguments)
    except FlexmbError as error:
        problems += error.problems
        return None


def _group_problems(mesh: Mesh, interfaces: Words, loads: Words) -> list[Problem]:
    """Unknown groups, where the elements of the body are not known."""
    problems: list[Problem] = []
    for name, words in interfaces.items():
        group = words if isinstance(words, str) else words.get("group")
        if group is not None:
            _attempt(problems, mesh.group_nodes, group, f"interfaces.{name}")
    for name, words in loads.items():
        if "group" in words:
            _attempt(problems, mesh.group_nodes, words["group"], f"loads.{name}.group")
    return problems


def _load_problems(model: _Model, loads: Words) -> list[Problem]:
    problems: list[Problem] = []
    for name, words in loads.items():
        if words.get("type") == "force":
            kept = ("group", "node", "nodes", "center", "radius", "position", "weights")
            chosen = {key: words[key] for key in kept if key in words} | {"type": "rbe3"}
            _attempt(problems, select_interface, model, f"loads.{name}", chosen)
        elif "group" in words:
            _attempt(problems, model.mesh.group_nodes, words["group"], f"loads.{name}.group")
    return problems


def _mode_problems(
    model: _Model, held: tuple[ModelInterface, ...], modes: Any, reduction: str
) -> list[Problem]:
    """More modes asked for than there are degrees of freedom that the interfaces leave free."""
    problems: list[Problem] = []
    if reduction == "user":
        _attempt(problems, read_user_modes, modes)
    if reduction not in ("craig-bampton", "free-interface"):
        return problems
    choice = _attempt(problems, mode_selection, modes)
    if choice is None or choice.count is None:
        return problems
    tied = sum(len(part.dofs) if isinstance(part, RigidInterface) else 6 for part in held)
    free = model.numbering.n - tied
    if not held or reduction == "free-interface":
        free += 6 * len(held) - 6
    if choice.count > free:
        what = f"{choice.count} asked, but the model has only {free}"
        problems.append(Problem("modes", what))
    return problems


def _counts(blocks: tuple[Block, ...]) -> dict[str, int]:
    """Elements by kind."""
    counts: dict[str, int] = {}
    for block in blocks:
        counts[block.kind] = counts.get(block.kind, 0) + len(block.nodes)
    return counts


def _findings(
    mesh: Mesh,
    blocks: tuple[Block, ...],
    joints: tuple[tuple[ModelInterface, ...], tuple[Tie, ...], tuple[Spring, ...]],
) -> list[Finding]:
    held, tied, joined = joints
    linked = [part.nodes for part in (*held, *joined)]
    linked += [np.append(tie.nodes, tie.reference) for tie in tied]
    told = [size_sentence(mesh.points)]
    told += [
        f'{len(block.nodes)} elements of kind "{block.kind}": {block.family.warning}'
        for block in blocks
        if block.family.warning
    ]
    return [
        *mesh_report(mesh, blocks, linked),
        *(Finding("warning", sentence) for sentence in told if sentence),
    ]


def _coordinates(freedoms: int, interfaces: int, words: Words, loads: Words) -> str:
    """Kept coordinates, in words; residual vectors of loads are as many at most as told."""
    reduction = words["reduction"]
    if reduction == "user":
        return "those of the given modes"
    choice = mode_selection(words["modes"])
    count = 0 if reduction == "guyan" else choice.count
    static = freedoms * interfaces
    more = sum(load.get("residual", load.get("type") != "gravity") for load in loads.values())
    more *= 2 if interfaces and reduction != "free-interface" else 1
    extra = f" + up to {more} for loads" if more else ""
    if count is None:
        by = "frequency" if choice.frequency is not None else "effective mass"
        return f"{static} of {interfaces} interfaces + modes by {by} - {freedoms}{extra}"
    if not interfaces:
        return f"{count} free modes{extra}"
    told = f"{freedoms}*{interfaces} interfaces + {count} modes"
    if reduction == "free-interface":
        return f"up to {static + count + more} = {told}{extra}"
    least = static + count - freedoms
    most = f" to {least + more}" if more else ""
    return f"{least}{most} = {told} - {freedoms}{extra}"
