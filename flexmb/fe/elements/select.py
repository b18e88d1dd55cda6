"""Which elements of a mesh form the body.

In: a mesh and the sections of its beams. Out: :class:`Elements`, the tetrahedra and the beams.
Other elements only define groups (surfaces of solids, edges); a volume element that cannot be used
is refused by name, never skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.elements.beam import local_axes
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.sections.beam import Section
from flexmb.flexbody.arrays import IntArray

__all__ = ["ELEMENTS", "Elements", "select_elements"]

ELEMENTS = {
    "tetra10": "solid: second-order tetrahedron, straight or curved, three displacements a node",
    "line": "beam: straight, two nodes with six motions each, Euler-Bernoulli or Timoshenko; "
    "needs a section",
}
"""Kinds of elements that make up a body, by their names in meshes."""

_ADVICE = {
    "tetra": "linear tetrahedra are too stiff in bending: mesh with second-order elements",
    "line3": "beams have two nodes: mesh them with first-order elements",
}


@dataclass(frozen=True, eq=False)
class Elements:
    """The elements of the body.

    Parameters
    ----------
    tets : (nt, 10) int
        Nodes of the tetrahedra.
    lines : (nb, 2) int
        Nodes of the beams.
    sections : tuple of Section
        Section of each beam element.
    """

    tets: IntArray
    lines: IntArray
    sections: tuple[Section, ...]


def select_elements(mesh: Mesh, sections: Mapping[str, Section] | None) -> Elements:
    """Choose the elements of the body; ``sections`` by group name, or under ``"all"``.

    Raises
    ------
    MeshError
        No volume elements and no beams with a section, an unusable kind, an unknown group, or a
        beam element with two sections.
    """
    problems = [_unusable(mesh, kind) for kind in mesh.kinds(3) if kind != "tetra10"]
    lines, chosen = _beams(mesh, sections or {})
    if sections and len(mesh.blocks.get("line3", ())):
        problems.append(_unusable(mesh, "line3"))
    tets = mesh.blocks.get("tetra10", np.zeros((0, 10), dtype=int))
    if not problems and not len(tets) and not len(lines):
        found = ", ".join(f"{len(c)} {kind}" for kind, c in mesh.blocks.items()) or "no elements"
        what = f"has no volume elements, and no line elements with a section; it has {found}"
        problems.append(Problem(mesh.source, what))
    if problems:
        raise MeshError.from_problems(problems)
    elements = Elements(tets, lines, chosen)
    _check_beams(mesh, elements)
    return elements


def _unusable(mesh: Mesh, kind: str) -> Problem:
    what = f'has {len(mesh.blocks[kind])} elements of kind "{kind}", which cannot be used'
    advice = _ADVICE.get(kind, "mesh with second-order tetrahedra")
    return Problem(mesh.source, f"{what}; {advice}", allowed=("tetra10", "line with a section"))


def _beams(mesh: Mesh, sections: Mapping[str, Section]) -> tuple[IntArray, tuple[Section, ...]]:
    block = mesh.blocks.get("line", np.zeros((0, 2), dtype=int))
    owner = np.full(len(block), -1)
    names = list(sections)
    for number, name in enumerate(names):
        if name == "all" and name not in mesh.element_sets:
            rows = np.flatnonzero(owner < 0) if len(names) > 1 else np.arange(len(block))
        else:
            rows = mesh.group_elements(name, f"sections.{name}").get("line", np.zeros(0, int))
        if not len(rows) and not len(mesh.blocks.get("line3", ())):
            raise MeshError(f"{mesh.source}: sections.{name}: the group has no line elements")
        taken = rows[owner[rows] >= 0]
        if len(taken):
            other = names[owner[taken[0]]]
            what = f"{len(taken)} line elements have a section from {other} already"
            raise MeshError(f"{mesh.source}: sections.{name}: {what}")
        owner[rows] = number
    used = np.flatnonzero(owner >= 0)
    return block[used], tuple(sections[names[number]] for number in owner[used])


def _check_beams(mesh: Mesh, elements: Elements) -> None:
    ends = mesh.points[elements.lines]
    short = np.flatnonzero(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == 0)
    if len(short):
        a, b = elements.lines[short[0]]
        raise MeshError(f"{mesh.source}: the line element between nodes {a} and {b} has no length")
    wrong = np.flatnonzero(np.isnan(local_axes(ends, orientations(elements))).any(axis=(1, 2)))
    if len(wrong):
        a, b = elements.lines[wrong[0]]
        what = f"the line element between nodes {a} and {b} is parallel to its section.orientation"
        raise MeshError(f"{mesh.source}: {what}")


def orientations(elements: Elements) -> np.ndarray:
    """(nb, 3) the sections' orientations, NaN where none is given."""
    none = (np.nan,) * 3
    given = [none if s.orientation is None else s.orientation for s in elements.sections]
    return np.array(given, dtype=float).reshape(-1, 3)
