"""Input decks: nodes with their own numbers, elements and groups, in the text of Abaqus or Nastran.

meshio skips elements in large fields, keeps only the last of several blocks of one set, and refuses
decks with springs, masses, shell angles or automatic continuations. So decks are read here, by
`abaqus_deck` and `nastran_deck`. A deck becomes a :class:`meshio.Mesh` in basic coordinates, with
the ``numbers`` of its nodes and a ``note`` about what it has besides a mesh; a deck that would be
read wrongly is refused.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError

# parts of a deck that a mesh does not have, by the option of a body that takes their place
OTHER_PARTS = {
    "interfaces": ("SURFACE",),
    "sections": ("offsets", "pin flags", "material angles"),
    "masses": ("MASS", "ROTARY INERTIA", "CONM1", "CONM2", "CMASS1", "CMASS2"),
    "springs": ("SPRING", "DASHPOT", "CELAS1", "CELAS2", "CBUSH", "CBUSH1D", "CGAP", "CDAMP1",
                "CDAMP2", "CVISC"),
    "ties": ("RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "TIE", "MPC", "EQUATION",
             "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "CONNECTOR SECTION", "RBE1", "RBE2",
             "RBE3", "RBAR", "CWELD", "CFAST", "CSEAM", "R3D3", "R3D4", "DCOUP3D"),
}  # fmt: skip
SOLIDS = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 13: "pyramid13",
           15: "wedge15", 20: "hexahedron20"}  # fmt: skip
SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}


@dataclass
class Deck:
    """Nodes, elements and sets read from a deck, by number.

    `numbered` says whether these are the numbers in the file: those of several instances are not.
    `first_nodes` and `first_elements` have the last number before each instance, and its name with
    a dot.
    """

    source: Path
    nodes: dict[int, tuple[float, ...]] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int], int]] = field(default_factory=dict)
    node_sets: dict[str, Iterable[int]] = field(default_factory=dict)
    element_sets: dict[str, Iterable[int]] = field(default_factory=dict)
    numbered: bool = True
    first_nodes: dict[int, str] = field(default_factory=dict)
    first_elements: dict[int, str] = field(default_factory=dict)

    def add_node(self, number: int | str, place: Iterable[float]) -> None:
        point = tuple(place)
        if self.nodes.setdefault(int(number), point) != point:
            own = _own_number(int(number), self.first_nodes)
            raise self.error(f"node {own} is given twice, at different places")

    def add_element(self, number: int | str, kind: str, nodes: list[int], tag: str = "") -> None:
        if (count := sum(node not in self.nodes for node in nodes)) > 0:
            missing = next(node for node in nodes if node not in self.nodes)
            own = _own_number(int(number), self.first_elements)
            what = f"element {own} names node {_own_number(missing, self.first_nodes)}"
            what += ", which the deck does not have"
            raise self.error(what if count == 1 else f"{what}, nor {count - 1} others")
        new = (kind, nodes, int(tag or 0))
        if self.elements.setdefault(int(number), new) != new:
            own = _own_number(int(number), self.first_elements)
            raise self.error(f"element {own} is given twice, with different nodes")

    def check_nodes(self, sets: Mapping[str, Iterable[int]]) -> None:
        """Refuse sets with nodes that are absent."""
        for name, members in sets.items():
            if missing := [node for node in members if node not in self.nodes]:
                own = _own_number(missing[0], self.first_nodes)
                raise self.error(f'the node set "{name}" names node {own}, which is absent')

    def error(self, what: str) -> MeshError:
        return MeshError(f"{self.source}: {what}")

    def mesh(self, note: str) -> Any:
        """The deck as a mesh of meshio."""
        import meshio

        row = {number: k for k, number in enumerate(self.nodes)}
        cells: dict[str, list[list[int]]] = {}
        tags: dict[str, list[int]] = {}
        place = {}
        for number, (kind, nodes, tag) in self.elements.items():
            place[number] = (kind, len(cells.setdefault(kind, [])))
            cells[kind].append([row[node] for node in nodes])
            tags.setdefault(kind, []).append(tag)
        self.check_nodes(self.node_sets)
        point_sets, cell_sets = {}, {}
        for name, members in self.node_sets.items():
            point_sets[name] = np.array([row[node] for node in members], dtype=int)
        for name, members in self.element_sets.items():
            rows: dict[str, list[int]] = {kind: [] for kind in cells}
            for number in members:
                if number in place:
                    rows[place[number][0]].append(place[number][1])
            cell_sets[name] = [np.array(part, dtype=int) for part in rows.values()]
        mesh = meshio.Mesh(
            np.array([*self.nodes.values()]),
            [(kind, np.array(part)) for kind, part in cells.items()],
            point_sets=point_sets,
            cell_sets=cell_sets,
            cell_data={"nastran:ref": [np.array(part) for part in tags.values()]},
        )
        mesh.numbers, mesh.note = np.array([*self.nodes]) if self.numbered else None, note
        return mesh


def read_deck(
    source: Path,
    include: re.Pattern[str],
    read_cards: Callable[[Deck, str], Iterable[str]],
    node_card: str,
) -> Any:
    """The mesh of a deck.

    Parameters
    ----------
    source : Path
        The file.
    include : re.Pattern
        A line that names another file, as the group ``file``; of it the groups ``card`` and
        ``rest`` remain, if there are some.
    read_cards : callable
        Fills the deck from its text; gives the names of the cards that a mesh does not have.
    node_card : str
        Name of the card of nodes, for messages.

    Returns
    -------
    meshio.Mesh
        With ``numbers`` and a ``note``.

    Raises
    ------
    MeshError
        A deck without nodes, damaged or truncated, or one that includes itself.
    """
    text = _text(source, include)
    deck = Deck(source)
    try:
        others = Counter(read_cards(deck, text))
    except (ValueError, IndexError) as error:
        raise deck.error(_wrong_number(text, str(error))) from error
    if not deck.nodes:
        what = f"there is no {node_card} in it: the deck is empty, damaged or of another format"
        raise deck.error(what)
    counts = {home: [f"{others[w]} {w}" for w in words if others[w]]
              for home, words in OTHER_PARTS.items()}  # fmt: skip
    entries = [entry for names in counts.values() for entry in names]
    homes = [home for home, names in counts.items() if names]
    note = f"the mesh file also has {', '.join(entries)}, not read: the body takes its own "
    return deck.mesh(note + ", ".join(homes) if entries else "")


def _own_number(number: int, first: Mapping[int, str]) -> str:
    """A number as the deck has it, such as ``12`` or ``Rod-1.12``."""
    before = max((last for last in first if last < number), default=0)
    return f"{first.get(before, '')}{number - before}"


def among(present: Collection[int], numbers: range) -> list[int]:
    """The numbers of a range that are present; in time of the shorter of both."""
    if len(numbers) < len(present):
        return [number for number in numbers if number in present]
    return [number for number in present if number in numbers]


def _text(source: Path, include: re.Pattern[str], inside: tuple[Path, ...] = ()) -> str:
    """The text of a deck, with the files that it includes in their places."""
    if source.resolve() in inside:
        raise MeshError(f"{source}: the deck includes itself")
    inside = (*inside, source.resolve())
    try:
        data = source.read_bytes()
    except FileNotFoundError as error:
        raise MeshError(f"{source}: no such file, named by an include of {inside[-2]}") from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")

    def included(line: re.Match[str]) -> str:
        groups = line.groupdict()
        name = groups["file"].strip().strip("\"'").replace("\\", "/")
        text = _text(inside[0].parent / name, include, inside)
        return f"{groups['card']}{groups['rest']}\n{text}" if groups.get("card") else text

    return include.sub(included, text)


def _wrong_number(text: str, words: str) -> str:
    """What a deck has in place of a number, and the first line with it."""
    match = re.search(r"'([^'\n]+)'", words)
    if match is None:
        return "the deck is damaged or truncated: a line has too few fields; export it again"
    word = match[1].strip()
    lines = [k for k, line in enumerate(text.splitlines(), 1) if word.upper() in line.upper()]
    where = f"line {lines[0]}" if lines else "a line"
    return f'{where} has "{word}" for a number: the deck is damaged or truncated'


def read_real(text: str) -> float:
    """A number, also in Fortran's forms 1.5-3 and 1.D0; an empty field is zero."""
    with suppress(ValueError):
        return float(text)
    plain = text.upper().replace("D", "E")
    return float(re.sub(r"(?<=[\d.])([+-])", r"E\1", plain) or 0.0)
