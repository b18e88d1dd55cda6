"""Checks of a finite-element model before it is reduced: releases, mass, units, unconnected parts.

A release is a hinge only if something else at its node holds the motion: another element, a tie, or
an interface of several nodes. An interface of that node alone would get a coordinate without mass
or stiffness. The nominal mass is the sum of volumes (areas, lengths) times density.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, MeshModel
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.fe.elements.element_blocks import Block
from flexmb.fe.material import plausibility
from flexmb.fe.meshes.mesh_checks import Finding, mesh_report, size_sentence
from flexmb.fe.reduction.fixed_interface import read_modes
from flexmb.fe.reduction.user_modes import read_user_modes
from flexmb.fe.sections.beam_chain import BoundBeam
from flexmb.flexbody.arrays import FloatArray, IntArray

_NO_STIFFNESS = 1e-12  # smallest over largest stiffness of what moves without any


def check_releases(fe: FEMatrices, interfaces: Sequence[IntArray]) -> None:
    """Refuse a model in which a released motion of a node meets no stiffness at all.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : sequence of (k,) int
        Their nodes.

    Raises
    ------
    MeshError
        With all such nodes, and about or along what they move.
    """
    ends = [
        block.nodes.ravel()
        for block in fe.blocks
        if isinstance(block.section, BoundBeam) and block.section.released
    ]
    groups = [nodes for nodes in interfaces if len(nodes) > 1]
    supported = np.concatenate([fe.numbering.tied, *groups])
    problems = []
    for node in np.setdiff1d(np.concatenate(ends) if ends else [], supported).astype(int):
        for first, what in ((0, "moves along"), (3, "turns about")):
            dofs = fe.numbering.table[node, first : first + 3]
            values, axes = np.linalg.eigh(fe.K[dofs][:, dofs].toarray())
            if values[0] <= _NO_STIFFNESS * values[-1]:
                problems.append(_free_motion_problem(fe.mesh.source, int(node), what, axes[:, 0]))
    if problems:
        raise MeshError.from_problems(problems)


def _free_motion_problem(source: str, node: int, what: str, axis: FloatArray) -> Problem:
    place = ", ".join(f"{value:.3g}" for value in axis * np.sign(axis[np.argmax(np.abs(axis))]))
    sentence = f"node {node} {what} ({place}) without any stiffness: only released ends meet there"
    return Problem(
        source, f"{sentence}; release one less; between bodies a joint of the scene turns freely"
    )


_DIFFERENCE = 1e-3  # relative; curved elements are measured by another quadrature than their mass
_SIMPSON = ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6))  # exact for an area that varies as a square


def nominal_mass(blocks: Iterable[Block], points: FloatArray) -> float:
    """Volumes, areas or lengths of all elements times their density, and mass per area or length
    that adds no stiffness [kg]; the materials of all blocks are known."""
    total = 0.0
    for block in blocks:
        size = block.family.measure(points[block.nodes], block.section)
        total += float(np.sum(size * _density(block.section, block.family.dimension)))
    return total


def point_mass(masses: Mapping[str, Mapping[str, Any]] | None) -> float:
    """Sum of the masses at nodes and groups [kg]."""
    return float(sum(words["mass"] for words in (masses or {}).values()))


def mass_sentence(fe: FEMatrices, points: float = 0.0) -> str:
    """What is wrong with the assembled mass; empty if nothing is.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    points : float
        Masses at nodes [kg].
    """
    expected = nominal_mass(fe.blocks, fe.mesh.points) + points
    R = fe.rigid[:, :3]
    masses = np.einsum("ij,ij->j", R, fe.M @ R)
    worst = float(masses[np.argmax(np.abs(masses - expected))])
    if abs(worst - expected) <= _DIFFERENCE * expected:
        return ""
    return (
        f"the mass matrix holds {worst:.6g} kg, but volumes times density of the elements and the "
        f"masses at nodes are {expected:.6g} kg"
    )


def _density(section: Any, dimension: int) -> float | FloatArray:
    """Mass per volume, area or length."""
    if dimension == 3:
        return float(section.material.density)
    if dimension == 2:
        layers = sum(layer.thickness * layer.material.density for layer in section.layers)
        return float(layers + section.nonstructural)
    span = getattr(section, "span", None)
    if span is None:
        return float(section.material.density * section.A + section.nonstructural)
    return np.array([_mean_line_mass(section.section, *ends) for ends in span])


def _mean_line_mass(section: Any, start: float, end: float) -> float:
    """Mean mass per length of a section that varies, from one fraction of its chain to another."""
    parts = [(section.at(start + s * (end - start)), weight) for s, weight in _SIMPSON]
    return float(
        sum(w * (part.A * section.material.density + part.nonstructural) for part, w in parts)
    )


def model_findings(
    model: MeshModel | FEMatrices, interfaces: tuple[ModelInterface, ...]
) -> list[Finding]:
    """What is worth reporting of a model: notes, and what hints at a slip in mesh or units; errors
    where the mesh falls into parts that neither nodes nor an interface, a tie or a spring join."""
    linked = [part.nodes for part in (*interfaces, *model.springs)]
    linked += [np.append(tie.nodes, tie.reference) for tie in model.ties]
    sentences = [] if model.material is None else plausibility(model.material)
    sentences.append(size_sentence(model.mesh.points[model.numbering.nodes]))
    return [
        *(Finding("warning", sentence) for sentence in sentences if sentence),
        *mesh_report(model.mesh, model.blocks, linked),
    ]


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


def check_mode_count(
    model: MeshModel, ends: tuple[ModelInterface, ...], modes: Any, reduction: str
) -> None:
    """Refuse more modes than there are degrees of freedom that the interfaces leave free.

    Raises
    ------
    ReductionError
        Both numbers.
    """
    if reduction == "user":
        read_user_modes(modes)
    if reduction not in ("craig-bampton", "free-interface"):
        return
    count = read_modes(modes).count
    fixed = sum(len(part.dofs) if isinstance(part, RigidInterface) else 6 for part in ends)
    free = model.numbering.n - fixed
    if not ends or reduction == "free-interface":
        free += 6 * len(ends) - 6
    if count is not None and count > free:
        what = f"{count} requested, but the model has only {free}"
        raise ReductionError.from_problems([Problem("modes", what)])


def coordinates_text(
    freedoms: int, interfaces: int, modes: Any, reduction: str, loads: Mapping[str, Any]
) -> str:
    """Kept coordinates, in words; loads add at most that many residual vectors."""
    if reduction == "user":
        return "those of the given modes"
    selection = read_modes(modes)
    count = 0 if reduction == "guyan" else selection.count
    static = freedoms * interfaces
    more = sum(load.get("residual", load.get("type") != "gravity") for load in loads.values())
    more *= 2 if interfaces and reduction != "free-interface" else 1
    extra = f" + up to {more} for loads" if more else ""
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
