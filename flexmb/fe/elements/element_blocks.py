"""All element families, and which elements of a mesh form the body with which section.

Volume elements always belong to the body. Surface and line elements belong to it if a section names
their group; else they only mark groups. :func:`select_elements` returns :class:`Block` objects, the
elements of one kind with one section. An element that cannot be used is refused with its name,
never skipped. The skin of a body consists of the faces of its solids that occur once, its shells
and its beams.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.elements import solid_elements
from flexmb.fe.elements.beam_elements import LINE
from flexmb.fe.elements.element_family import Family
from flexmb.fe.elements.shell_elements import QUAD, TRIANGLE
from flexmb.fe.elements.shell_elements import SHELL_ADVICE as SHELL_ADVICE
from flexmb.fe.meshes.mesh import Mesh, dimension
from flexmb.fe.sections.beam_chain import bind_section
from flexmb.fe.sections.section_tables import SolidSection
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.materials import AnyMaterial
from flexmb.units import say_length

FAMILIES: dict[str, Family] = {
    **solid_elements.SOLIDS,
    **{family.kind: family for family in (LINE, TRIANGLE, QUAD)},
}
"""Family by kind of cells."""

ELEMENTS: dict[str, str] = {kind: family.about for kind, family in FAMILIES.items()}
"""Kinds of elements that make up a body, by their names in meshes, and what they are."""

ADVICE = {
    **solid_elements.SOLID_ADVICE,
    **SHELL_ADVICE,
    "line3": "beams have two nodes: mesh them with first-order elements",
}
"""What to do about kinds that cannot be used."""


_DIMENSION_NAMES = {1: "line", 2: "surface", 3: "volume"}
_CURES = {
    1: 'lines are beams with a section such as { type = "circle", radius = ... }',
    2: 'surfaces are shells with a thickness: { type = "shell", thickness = ... }',
}
_CHUNK = 3e7  # bytes of one batch of element matrices


@dataclass(frozen=True, eq=False)
class Block:
    """Elements of one kind with one section.

    Parameters
    ----------
    kind : str
        Name of the cells in the mesh.
    nodes : (ne, k) int
        Mesh nodes of the elements.
    rows : (ne,) int
        Their row numbers among the mesh's cells of that kind.
    section : SolidSection, ShellSection or BeamSection
        With its material.
    group : str
        The group that the section was given for; ``"all"`` if none.
    """

    kind: str
    nodes: IntArray
    rows: IntArray
    section: Any
    group: str

    @property
    def family(self) -> Family:
        """The element family."""
        return FAMILIES[self.kind]

    @property
    def width(self) -> int:
        """Degrees of freedom of one element."""
        return self.nodes.shape[1] * (6 if self.family.rotations else 3)

    def chunks(self, matrices: int = 1) -> Iterator[IntArray]:
        """Nodes of the elements in batches, such that ``matrices`` (d, d) per element fit into
        `_CHUNK`."""
        size = max(1, int(_CHUNK / (8 * matrices * self.width**2)))
        for start in range(0, len(self.nodes), size):
            yield self.nodes[start : start + size]


def select_elements(
    mesh: Mesh, sections: Mapping[str, Any] | None, material: AnyMaterial | None = None
) -> tuple[Block, ...]:
    """Choose the elements of the body.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    sections : mapping of str to section
        By mesh group; ``"all"`` takes whatever elements of its dimension no other section names.
    material : Material or OrthotropicMaterial, optional
        Material of all sections that name none.

    Raises
    ------
    MeshError
        Unusable kinds, unknown groups, groups without such elements, elements with two sections,
        elements turned inside out, or nothing to make a body of; all at once.
    """
    by_group = dict(sections or {})
    if "all" in by_group and "all" not in mesh.element_sets:
        by_group["all"] = by_group.pop("all")  # moved to the end: it takes what is left
    owners = {kind: np.full(len(cells), -1) for kind, cells in mesh.blocks.items()}
    names, problems = list(by_group), []
    for number, name in enumerate(names):
        problems += _assign(mesh, owners, names, number, by_group[name].dimension)
    problems += _unusable_kinds(mesh, owners)
    used = mesh.kinds(3) or any((owner >= 0).any() for owner in owners.values())
    if not problems and not used:
        problems.append(Problem(mesh.source, _no_elements_text(mesh)))
    if problems:
        raise MeshError.from_problems(problems)
    blocks = [
        block
        for kind in mesh.blocks
        for block in _blocks(mesh, kind, owners[kind], by_group, material)
    ]
    _check_shapes(mesh, blocks)
    return tuple(blocks)


def _assign(
    mesh: Mesh, owners: dict[str, IntArray], names: list[str], number: int, dim: int
) -> list[Problem]:
    """Assign elements to a section; returns what is wrong with it."""
    name = names[number]
    where = f"sections.{name}"
    if name == "all" and name not in mesh.element_sets:
        rows_by_kind = {kind: np.flatnonzero(owners[kind] < 0) for kind in mesh.kinds(dim)}
    else:
        try:
            group = mesh.group_elements(name, where)
        except MeshError as error:
            return list(error.problems)
        rows_by_kind = {kind: rows for kind, rows in group.items() if kind in mesh.kinds(dim)}
    if not any(len(rows) for rows in rows_by_kind.values()):
        return [
            Problem(where, f"the group has no {_DIMENSION_NAMES[dim]} elements in {mesh.source}")
        ]
    problems = []
    for kind, rows in rows_by_kind.items():
        taken = rows[owners[kind][rows] >= 0]
        if len(taken):
            other = names[owners[kind][taken[0]]]
            what = (
                f"{len(taken)} {_DIMENSION_NAMES[dim]} elements have a section from {other} already"
            )
            problems.append(Problem(where, what))
        owners[kind][rows] = number
    return problems


def _unusable_kinds(mesh: Mesh, owners: Mapping[str, IntArray]) -> list[Problem]:
    problems = []
    for kind, owner in owners.items():
        wanted = kind in mesh.kinds(3) or (owner >= 0).any()
        if len(owner) and wanted and kind not in FAMILIES:
            what = f'has {len(owner)} elements of kind "{kind}", which cannot be used'
            advice = ADVICE.get(kind, "mesh with elements of an allowed kind")
            problems.append(Problem(mesh.source, f"{what}; {advice}", allowed=tuple(FAMILIES)))
    return problems


def _no_elements_text(mesh: Mesh) -> str:
    counts = ", ".join(f"{len(cells)} {kind}" for kind, cells in mesh.blocks.items())
    what = "has no volume elements, and no lines or surfaces with a section"
    cures = [cure for dim, cure in _CURES.items() if mesh.kinds(dim)]
    return "; ".join([what, f"it has {counts or 'no elements'}", *cures])


def _blocks(
    mesh: Mesh,
    kind: str,
    owner: IntArray,
    sections: Mapping[str, Any],
    material: AnyMaterial | None,
) -> Iterator[Block]:
    cells, names = mesh.blocks[kind], list(sections)
    plain = np.flatnonzero(owner < 0)
    if kind in mesh.kinds(3) and len(plain):
        yield Block(kind, cells[plain], plain, SolidSection().with_material(material), "all")
    for number in np.unique(owner[owner >= 0]):
        rows = np.flatnonzero(owner == number)
        section = sections[names[number]].with_material(material)
        parts = [(np.arange(len(rows)), section)]
        if section.dimension == 1:
            parts = bind_section(section, mesh.points[cells[rows]], cells[rows])
        for part, bound in parts:
            yield Block(kind, cells[rows[part]], rows[part], bound, names[number])


def _check_shapes(mesh: Mesh, blocks: list[Block]) -> None:
    problems = []
    for block in blocks:
        bad = block.family.defects(mesh.points[block.nodes])
        if len(bad):
            row = block.nodes[bad[0]]
            nodes = ", ".join(str(node) for node in row[:4])
            if mesh.numbers is not None and row.max() < len(mesh.numbers):
                own = ", ".join(str(number) for number in mesh.numbers[row[:4]])
                nodes += f" (numbers {own} of the file)"
            if len(set(row)) < len(row):
                nodes += ", one of them twice; write collapsed elements as what they are"
            wrong = "flat, folded or turned inside out"
            if block.family.dimension == 1:
                wrong = "without length"
            what = f'{len(bad)} of {len(block.nodes)} elements of kind "{block.kind}" are {wrong}'
            what += f", the first with corner nodes {nodes}"
            problems.append(Problem(mesh.source, what))
    if problems:
        raise MeshError.from_problems(problems)


_SPLIT = {  # nodes of a face to the triangles it is drawn as: corners first, then mid-sides, centre
    3: [[0, 1, 2]],
    4: [[0, 1, 2], [0, 2, 3]],
    6: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    8: [[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6], [4, 6, 7]],
    9: [
        [0, 4, 8], [0, 8, 7], [4, 1, 5], [4, 5, 8],
        [8, 5, 2], [8, 2, 6], [7, 8, 6], [7, 6, 3],
    ],
}  # fmt: skip
_CORNERS = {3: 3, 4: 4, 6: 3, 8: 4, 9: 4}
_TURNED = {
    3: [0, 2, 1],
    4: [0, 3, 2, 1],
    6: [0, 2, 1, 5, 4, 3],
    8: [0, 3, 2, 1, 7, 6, 5, 4],
    9: [0, 3, 2, 1, 7, 6, 5, 4, 8],
}


def outer_faces(blocks: Iterable[Block], points: FloatArray) -> list[IntArray]:
    """Faces that belong to one solid element only, turned outwards: (nf, 3|4|6|8|9) by size."""
    faces: dict[int, list[IntArray]] = {}
    centers: dict[int, list[FloatArray]] = {}
    for block in blocks:
        if block.family.dimension != 3:
            continue
        middle = points[block.nodes].mean(axis=1)
        for face in block.family.faces:
            faces.setdefault(len(face), []).append(block.nodes[:, face])
            centers.setdefault(len(face), []).append(middle)
    sizes = list(faces)
    stacked = {k: np.concatenate(faces[k]) for k in sizes}
    single = _once([stacked[k][:, : _CORNERS[k]] for k in sizes])
    return [
        _outwards(stacked[k][rows], np.concatenate(centers[k])[rows], points)
        for k, rows in zip(sizes, single, strict=True)
        if len(rows)
    ]


def skin_triangles(blocks: Iterable[Block], points: FloatArray) -> IntArray:
    """(t, 3) linear triangles of the skin."""
    blocks = list(blocks)
    faces = outer_faces(blocks, points)
    faces += [block.nodes for block in blocks if block.family.dimension == 2]
    parts = [face[:, _SPLIT[face.shape[1]]].reshape(-1, 3) for face in faces]
    return np.concatenate([np.zeros((0, 3), dtype=int), *parts])


def skin_lines(blocks: Iterable[Block]) -> IntArray:
    """(l, 2) lines of the beams."""
    parts = [block.nodes for block in blocks if block.family.dimension == 1]
    return np.concatenate([np.zeros((0, 2), dtype=int), *parts])


def _once(corners: list[IntArray]) -> list[IntArray]:
    """Rows of each list of faces whose corners, in any order, occur once in all of them."""
    if not corners:
        return []
    padded = [
        np.pad(np.sort(part, axis=1), ((0, 0), (0, 4 - part.shape[1])), constant_values=-1)
        for part in corners
    ]
    _, first, count = np.unique(
        np.concatenate(padded), axis=0, return_index=True, return_counts=True
    )
    single = np.sort(first[count == 1])
    ends = np.cumsum([len(part) for part in corners])
    starts = ends - [len(part) for part in corners]
    return [single[(single >= a) & (single < b)] - a for a, b in zip(starts, ends, strict=True)]


def _outwards(faces: IntArray, centers: FloatArray, points: FloatArray) -> IntArray:
    x = points[faces]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, _CORNERS[faces.shape[1]] - 1] - x[:, 0])
    inward = np.sum(normal * (x[:, 0] - centers), axis=1) < 0
    outward = faces.copy()
    outward[inward] = faces[inward][:, _TURNED[faces.shape[1]]]
    return outward


def elements_without_section(mesh: Mesh, blocks: Sequence[Block]) -> Iterator[tuple[bool, str]]:
    """Sentences about elements without a section beside others that have one: of the same kind,
    with the groups that they make up, or of the mesh's highest dimension. The first value says
    whether they are of the latter, so that a part of the body seems to be missing."""
    highest = max((dimension(kind) for kind, cells in mesh.blocks.items() if len(cells)), default=0)
    largest = mesh.kinds(highest) if any(b.family.dimension == highest for b in blocks) else ()
    for kind in dict.fromkeys([*(block.kind for block in blocks), *largest]):
        left = np.ones(len(mesh.blocks[kind]), dtype=bool)
        rows = [block.rows for block in blocks if block.kind == kind]
        left[np.concatenate([np.zeros(0, int), *rows])] = False
        if not left.any():
            continue
        groups = [name for name, rows in mesh.element_sets.items()
                  if set(rows) == {kind} and left[rows[kind]].all()]  # fmt: skip
        what = f"{left.sum()} of {len(left)} {kind} elements have no section and are left out"
        yield dimension(kind) == highest, f"{what}: {', '.join(groups)}" if groups else what


def thick_shells(mesh: Mesh, blocks: Sequence[Block]) -> Iterator[str]:
    """Sentences about shells and beams that are thicker than the extent of their nodes."""
    for block in blocks:
        if block.family.dimension == 1 and isinstance(getattr(block.section, "A", None), float):
            extent = float(np.ptp(mesh.points[block.nodes].reshape(-1, 3), axis=0).max())
            height = np.sqrt(12.0 * max(block.section.Iy, block.section.Iz) / block.section.A)
            if height > extent:
                what = f'the section "{block.group}" is as a bar {say_length(height, 4)} high'
                what += f", and its beams extend over {say_length(extent)}"
                yield f"{what}: are its sizes in their unit?"
        if block.family.dimension == 2:
            extent = float(np.ptp(mesh.points[block.nodes].reshape(-1, 3), axis=0).max())
            if block.section.thickness > extent:
                thick = say_length(block.section.thickness)
                what = f'shells of the section "{block.group}" are {thick} thick and extend over '
                yield f"{what}{say_length(extent)}: is the thickness in its unit?"
