"""What is wrong or suspicious about a finite-element model, in sentences.

An end release is a hinge only if something else supports the released motion of its node: another
element, a tie, or an interface with several nodes. An interface of that node alone would get a
coordinate without mass or stiffness. The nominal mass is the sum of volumes (areas, lengths) times
density.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from scipy.sparse import csr_array

from flexmb.errors import MeshError, Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, MeshModel
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.fe.elements.element_blocks import Block, elements_without_section, thick_shells
from flexmb.fe.elements.shell_fields import STEEP, flatten, opposed_edges
from flexmb.fe.linear_solver import require_memory
from flexmb.fe.mesh_checks import Finding, mesh_report, size_sentence
from flexmb.fe.reduction.fixed_interface import read_modes
from flexmb.fe.reduction.user_modes import read_user_modes
from flexmb.fe.sections.beam_chain import BoundBeam
from flexmb.flexbody.arrays import FloatArray, IntArray, is_nonzero
from flexmb.materials import plausibility
from flexmb.units import say_length

# largest |n_x| of element normals that reaches the switch of the default axis at `STEEP` without
# hinting at a curved shell; flat walls at 0 or 90 degrees pass
_CURVED_SHARE = 0.7
_MAX_FULL = 3000  # degrees of freedom above which modes from full matrices would take minutes
_LENGTHS = {1.0: "m", 1e-2: "cm", 1e-3: "mm", 1e-6: "µm", 0.0254: "in", 0.3048: "ft"}
_VECTORS_PER_MODE = 4  # Lanczos vectors stored for each mode, with their copies
# implausible mass of a part [kg]: a bracket of 90 mm that is read as metres is heavier
_MAX_MASS = 1e7
# relative difference from the nominal mass; for curved elements the quadratures differ
_MASS_TOLERANCE = 1e-3
# (fraction, weight): exact for an area that varies quadratically
_SIMPSON = ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6))


def check_releases(
    fe: FEMatrices, interfaces: Sequence[IntArray], motions: csr_array | None = None
) -> None:
    """Refuse released motions without stiffness.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    interfaces : sequence of (k,) int
        Nodes of each interface.
    motions : (n, k) csr_array, optional
        Motions that supports leave free; all without it.

    Raises
    ------
    MeshError
        Names each node and the axis.
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
            K, free = fe.K[dofs][:, dofs].toarray(), np.eye(3)
            free = free if motions is None else scipy.linalg.orth(motions[dofs].toarray())
            values, axes = np.linalg.eigh(free.T @ K @ free)
            if is_nonzero(np.append(values, np.trace(K)))[0]:
                continue
            axis = free @ axes[:, 0]
            axis *= np.sign(axis[np.argmax(np.abs(axis))])
            place = ", ".join(f"{value:.3g}" for value in axis)
            text = f"node {node} {what} ({place}) "
            text += "without any stiffness: only released ends meet there; "
            text += "release one less; between bodies a joint of the scene turns freely"
            problems.append(Problem(fe.mesh.source, text))
    if problems:
        raise MeshError.from_problems(problems)


def nominal_mass(blocks: Iterable[Block], points: FloatArray) -> float:
    """Mass [kg] of all elements from volume, area or length times density.

    Includes mass per area or length that adds no stiffness; the materials of all blocks must be
    known.
    """
    total = 0.0
    for block in blocks:
        size = block.family.measure(points[block.nodes], block.section)
        total += float(np.sum(size * _density(block.section, block.family.dimension)))
    return total


def point_mass(masses: Mapping[str, Mapping[str, Any]] | None) -> float:
    """Sum of the masses at nodes and groups [kg]."""
    return float(sum(words["mass"] for words in (masses or {}).values()))


def mass_sentence(fe: FEMatrices, points: float = 0.0) -> str:
    """A sentence if the mass of the matrices is not plausible; else empty.

    ``points`` [kg] is the sum of masses at nodes.
    """
    expected = nominal_mass(fe.blocks, fe.mesh.points) + points
    R = fe.rigid[:, :3]
    masses = np.einsum("ij,ij->j", R, fe.M @ R)
    worst = float(masses[np.argmax(np.abs(masses - expected))])
    if abs(worst - expected) <= _MASS_TOLERANCE * expected:
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
    """Mean mass per length [kg/m] of a section that varies, between two fractions of its chain."""
    parts = [(section.at(start + s * (end - start)), weight) for s, weight in _SIMPSON]
    return float(
        sum(w * (part.A * section.material.density + part.nonstructural) for part, w in parts)
    )


def model_findings(
    model: MeshModel | FEMatrices, interfaces: tuple[ModelInterface, ...], unit: float
) -> list[Finding]:
    """Findings about a model: notes, and hints at mistakes in the mesh or its units.

    They are errors where the mesh falls into parts that no node, interface, tie or spring joins.
    `unit` [m] is the mesh's unit of length, in which places are stated.
    """
    length = (_LENGTHS[unit], unit) if unit in _LENGTHS else ("m", 1.0)
    linked = [part.nodes for part in (*interfaces, *model.springs)]
    linked += [np.append(tie.nodes, tie.reference) for tie in model.ties]
    of = {model.material: ""}
    for block in model.blocks:
        for part in getattr(block.section, "layers", (block.section,)):
            of.setdefault(part.material, f'section "{block.group}": ')
    sentences = [
        f"{w}{text}" for one, w in of.items() if one is not None for text in plausibility(one)
    ]
    sentences.append(size_sentence(model.mesh.points[model.numbering.nodes], unit))
    if not sentences[-1] and None not in of:
        mass = nominal_mass(model.blocks, model.mesh.points)
        extent = float(np.ptp(model.mesh.points[model.numbering.nodes], axis=0).max())
        what = f"the mesh extends over {say_length(extent, 4)} and has a mass of {mass:.3g} kg"
        sentences += [f"{what}: is its unit system the right one?"] * (mass > _MAX_MASS)
    return [
        *(Finding("warning", sentence) for sentence in sentences if sentence),
        *mesh_report(model.mesh, model.blocks, linked, *length),
        *(
            Finding("warning" if is_part else "note", text)
            for is_part, text in elements_without_section(model.mesh, model.blocks)
        ),
        *_opposed(model),
        *_turned_axes(model),
        *(Finding("warning", text) for text in thick_shells(model.mesh, model.blocks)),
    ]


def _opposed(model: MeshModel | FEMatrices) -> Iterator[Finding]:
    sided = [b for b in model.blocks if b.family.dimension == 2 and b.section.has_sides]
    edges = opposed_edges([block.nodes for block in sided]) if sided else ()
    if len(edges):
        a, b = edges[0]
        what = f"the normals of neighbouring shells point to opposite sides at {len(edges)} edges, "
        what += f"the first between the nodes {a} and {b}: offset and layers change sides there; "
        yield Finding("warning", f"{what}number the nodes of all elements in one sense")


def _turned_axes(model: MeshModel | FEMatrices) -> Iterator[Finding]:
    for b in model.blocks:
        if b.family.dimension != 2 or b.section.orientation or not b.section.has_directions:
            continue
        # |n_x| of the element normals
        along = np.abs(flatten(model.mesh.points[b.nodes]).axes[:, 0, 2])
        if ((along > _CURVED_SHARE) & (along <= STEEP)).any() and (
            (along > STEEP) & (along < 0.999)
        ).any():
            what = f'section "{b.group}": material axis 1 is that of x, but of y where the normal '
            yield Finding(
                "warning", f"{what}nears x, as here on a curved shell: give an orientation"
            )


@dataclass(frozen=True)
class Survey:
    """What is known of a body before its reduction.

    If there are ``problems``, the other fields are empty. ``coordinates`` says in words how the
    modal coordinates are counted; ``mass`` is in kg; ``interfaces`` are positions and ``points``
    (n, 3) nodes in the mesh frame [m].
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
    """Refuse (ReductionError) more modes than the model has with its interfaces fixed."""
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
    if count is None or free <= _MAX_FULL:
        return
    if 2 * count >= free:
        what = f"{count} of {free} requested: so many are computed from full matrices, and of "
        what += f"more than {_MAX_FULL} degrees of freedom that takes too long; ask for fewer than "
        raise ReductionError.from_problems([Problem("modes", f"{what}{free // 2}")])
    needed = 8.0 * _VECTORS_PER_MODE * count * free
    require_memory(needed, f"the computation of {count} modes", "ask for fewer modes")
