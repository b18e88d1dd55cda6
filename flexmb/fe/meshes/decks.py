"""Input decks of Abaqus and Nastran: nodes with their own numbers, elements and groups.

meshio skips elements in large fields, keeps only the last of several blocks of one set, and refuses
decks with springs, masses, shell angles or automatic continuations. So decks are read here.
:func:`read_deck` returns a :class:`meshio.Mesh` in basic coordinates, with the ``numbers`` of
its nodes and a ``note`` about what the deck has besides a mesh; a deck that would be read wrongly
is refused. Source: Abaqus Keywords Reference Guide; MSC Nastran Quick Reference Guide, sections on
bulk data formats and on elements.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import MeshError
from flexmb.fe.meshes.deck_coordinates import SYSTEMS, Systems
from flexmb.fe.meshes.deck_surfaces import face

ABAQUS = (".inp",)
NASTRAN = (".bdf", ".fem", ".nas")
_GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
# parts of a deck that a mesh does not have, by the option of a body that takes their place
_PARTS = {
    "interfaces": ("SURFACE",),
    "sections": ("offsets", "pin flags", "material angles"),
    "masses": ("MASS", "ROTARY INERTIA", "CONM1", "CONM2", "CMASS1", "CMASS2"),
    "springs": ("SPRING", "DASHPOT", "CELAS1", "CELAS2", "CBUSH", "CBUSH1D", "CGAP", "CDAMP1",
                "CDAMP2", "CVISC"),
    "ties": ("RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "TIE", "MPC", "EQUATION",
             "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "CONNECTOR SECTION", "RBE1", "RBE2",
             "RBE3", "RBAR", "CWELD", "CFAST", "CSEAM", "R3D3", "R3D4", "DCOUP3D"),
}  # fmt: skip
_INCLUDES = (
    re.compile(r"^\*INCLUDE\s*,\s*INPUT\s*=\s*([^,\n]+)[^\n]*$", re.M | re.I),
    re.compile(r"^INCLUDE\s+([^\n]+)$", re.M | re.I),
)
_SOLIDS = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 13: "pyramid13",
           15: "wedge15", 20: "hexahedron20"}  # fmt: skip
_SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_ABAQUS_KINDS = (  # by the first letters of a type and the number of nodes that follows
    (re.compile(r"C3D(\d+)"), _SOLIDS),
    (re.compile(r"(?:S|STRI|M3D|SFM3D|CPS|CPE)(\d)"), _SURFACES),
    (re.compile(r"T[23]D(\d)"), {2: "line", 3: "line3"}),
    (re.compile(r"(?:B|PIPE)[23](\d)"), {1: "line", 2: "line3", 3: "line"}),
)
_ABAQUS_OTHERS = re.compile(r"MASS|ROTARYI|SPRING|DASHPOT|CONN|DCOUP|DIST|GAP|JOINT|R[23AB]")
_NASTRAN_KINDS = {  # index of the first node field, and allowed numbers of nodes
    **dict.fromkeys(("CTRIA3", "CTRIAR"), (3, (3,))),
    **dict.fromkeys(("CQUAD4", "CQUADR", "CSHEAR"), (3, (4,))),
    **dict.fromkeys(("CROD", "CTUBE", "CBAR", "CBEAM", "CBEND"), (3, (2,))),
    "CONROD": (2, (2,)), "CTRIA6": (3, (6,)), "CQUAD8": (3, (8,)), "CTETRA": (3, (4, 10)),
    "CPYRAM": (3, (5, 13)), "CPYRA": (3, (5, 13)), "CPENTA": (3, (6, 15)), "CHEXA": (3, (8, 20)),
}  # fmt: skip
_NASTRAN_REFUSED = re.compile(  # elements whose absence would leave a hole in the body
    r"CTRIAX6?|CTRAX[36]|CQUADX?[48]?|CPLST[NS]\d|CRAC[23]D|CBEAM3|CDUM\d|CIF(HEX|PENT|QDX)"
)
_ON_SECTIONS = {  # words of `_PARTS` for options on an element, and the range of their fields
    **dict.fromkeys(("CBAR", "CBEAM"), (("pin flags", 9, 11), ("offsets", 11, 17))),
    **dict.fromkeys(("CQUAD4", "CQUADR"), (("material angles", 7, 8), ("offsets", 8, 9))),
    **dict.fromkeys(("CTRIA3", "CTRIAR"), (("material angles", 6, 7), ("offsets", 7, 8))),
}
_TO_VTK = {  # Nastran numbers the mid-side nodes between the faces before those of the upper face
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
}


@dataclass
class _Deck:
    """Nodes, elements and sets read from a deck, by their numbers in it."""

    source: Path
    nodes: dict[int, tuple[float, ...]] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int], int]] = field(default_factory=dict)
    node_sets: dict[str, Iterable[int]] = field(default_factory=dict)
    element_sets: dict[str, Iterable[int]] = field(default_factory=dict)

    def add_node(self, number: str, place: Iterable[float]) -> None:
        point = tuple(place)
        if self.nodes.setdefault(int(number), point) != point:
            raise self.error(f"node {number} is given twice, at different places")

    def add_element(self, number: str, kind: str, nodes: list[int], tag: str = "") -> None:
        if (count := sum(node not in self.nodes for node in nodes)) > 0:
            missing = next(node for node in nodes if node not in self.nodes)
            what = f"element {number} names node {missing}, which the deck does not have"
            raise self.error(what if count == 1 else f"{what}, nor {count - 1} others")
        new = (kind, nodes, int(tag or 0))
        if self.elements.setdefault(int(number), new) != new:
            raise self.error(f"element {number} is given twice, with different nodes")

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
        point_sets, cell_sets = {}, {}
        for name, members in self.node_sets.items():
            if missing := [node for node in members if node not in row]:
                raise self.error(f'the node set "{name}" names node {missing[0]}, which is absent')
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
        mesh.numbers, mesh.note = np.array([*self.nodes]), note
        return mesh


def read_deck(source: Path) -> Any:
    """The mesh of a deck, with ``numbers`` and a ``note``.

    Raises
    ------
    MeshError
        Nodes that are generated, coordinate systems of Abaqus, several parts or instances,
        elements that are not known or name missing nodes, a file that includes itself.
    """
    abaqus = source.suffix.lower() in ABAQUS
    text = _text(source, _INCLUDES[0 if abaqus else 1])
    deck = _Deck(source)
    try:
        others = Counter(_read_abaqus(deck, text) if abaqus else _read_nastran(deck, text))
    except (ValueError, IndexError) as error:
        raise deck.error(_wrong_number(text, str(error))) from error
    if not deck.nodes:
        what = "*NODE" if abaqus else "GRID"
        raise deck.error(
            f"there is no {what} in it: the deck is empty, damaged or of another format"
        )
    counts = {home: [f"{others[w]} {w}" for w in words if others[w]]
              for home, words in _PARTS.items()}  # fmt: skip
    entries = [entry for names in counts.values() for entry in names]
    homes = [home for home, names in counts.items() if names]
    note = f"the mesh file also has {', '.join(entries)}, not read: the body takes its own "
    return deck.mesh(note + ", ".join(homes) if entries else "")


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
        name = line[1].strip().strip("\"'").replace("\\", "/")
        return _text(inside[0].parent / name, include, inside)

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


def _real(text: str) -> float:
    """A number, also in Fortran's forms 1.5-3 and 1.D0; an empty field is zero."""
    with suppress(ValueError):
        return float(text)
    plain = text.upper().replace("D", "E")
    return float(re.sub(r"(?<=[\d.])([+-])", r"E\1", plain) or 0.0)


@dataclass
class _Card:
    word: str
    options: dict[str, str]  # in capitals
    lines: list[str]

    def numbers(self) -> list[str]:
        return [x for line in self.lines for x in (x.strip() for x in line.split(",")) if x]


def _cards(text: str) -> list[_Card]:
    cards: list[_Card] = []
    joined = re.sub(r"^(\*[^*\n].*),[ \t]*\n", r"\1, ", text, flags=re.M)
    for line in joined.splitlines():
        if line.startswith("*") and not line.startswith("**"):
            word, *rest = (part.strip() for part in line[1:].split(","))
            pairs = (part.partition("=") for part in rest if part)
            options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
            cards.append(_Card(" ".join(word.upper().split()), options, []))
        elif cards and line.strip() and not line.startswith("**"):
            cards[-1].lines.append(line)
    return cards


class _Sets:
    """Sets by name, case-insensitive; a second card with the same name adds to the set."""

    def __init__(self, deck: _Deck, noun: str) -> None:
        self._deck, self._noun = deck, noun
        self.members: dict[str, dict[int, None]] = {}
        self._names: dict[str, str] = {}

    def add(self, name: str, numbers: Iterable[int]) -> None:
        own = self._names.setdefault(name.upper(), name)
        self.members.setdefault(own, {}).update(dict.fromkeys(numbers))

    def of(self, name: str) -> dict[int, None]:
        return self.members.get(self._names.get(name.upper(), ""), {})

    def read(self, name: str, card: _Card, present: Iterable[int]) -> None:
        if "GENERATE" in card.options:
            for line in card.lines:
                first, last, *step = (int(x) for x in line.split(",") if x.strip())
                numbers = range(first, last + 1, *step)
                self.add(name, [number for number in present if number in numbers])
            return
        for entry in card.numbers():
            own = entry.strip('"').upper()
            number = own.rpartition(".")[2]  # the number in an instance
            if own in self._names:
                self.add(name, list(self.of(own)))
            elif number.lstrip("+-").isdigit():
                self.add(name, [int(number)])
            else:
                what = f'the {self._noun} "{name}" has the member "{entry}", which is neither a '
                raise self._deck.error(f"{what}number nor a set above it")


def _read_abaqus(deck: _Deck, text: str) -> Iterator[str]:
    """Read nodes, elements and sets; give the keywords and the types of other elements."""
    cards = _cards(text)
    _refuse_assembly(deck, cards)
    nodes, elements = _Sets(deck, "node set"), _Sets(deck, "element set")
    for card in cards:
        if card.word == "NODE":
            rows = [[x.strip() for x in line.split(",")] for line in card.lines]
            for number, *place in rows:
                deck.add_node(number, [_real(x) for x in [*place, "", "", ""][:3]])
            if "NSET" in card.options:
                nodes.add(card.options["NSET"], [int(row[0]) for row in rows])
    for card in cards:
        options = card.options
        if card.word == "ELEMENT":
            if "TYPE" not in options:
                raise deck.error("*ELEMENT has no TYPE, such as C3D4")
            kind, values = _abaqus_kind(deck, options["TYPE"].upper()), card.numbers()
            step = _nodes_of(kind) + 1
            if kind and len(values) % step:
                what = f"elements of type {options['TYPE']} have {step - 1} nodes, but the "
                raise deck.error(f"{what}block of element {values[0]} has lines of other lengths")
            numbers = [int(number) for number in values[::step]] if kind else []
            if not kind and options["TYPE"].upper() in _PARTS["ties"]:
                yield from [options["TYPE"].upper()] * len(card.lines)
            for k, number in enumerate(numbers):
                row = values[k * step + 1 : (k + 1) * step]
                deck.add_element(str(number), kind, [int(x) for x in row])
            if "ELSET" in options:
                elements.add(options["ELSET"], numbers)
        elif card.word == "NSET" and "NSET" in options:
            nodes.read(options["NSET"], card, deck.nodes)
            for number in deck.elements.keys() & elements.of(options.get("ELSET", "")):
                nodes.add(options["NSET"], deck.elements[number][1])
        elif card.word == "ELSET" and "ELSET" in options:
            elements.read(options["ELSET"], card, deck.elements)
        elif card.word != "SURFACE":
            yield card.word
            yield from ["offsets"] * ("OFFSET" in options)
    shells = any(kind in _SURFACES.values() for kind, _, _ in deck.elements.values())
    for card in (card for card in cards if card.word == "SURFACE"):
        if not _read_surface(deck, card, nodes, elements, shells):
            yield card.word
    deck.node_sets, deck.element_sets = dict(nodes.members), dict(elements.members)


def _read_surface(deck: _Deck, card: _Card, nodes: _Sets, elements: _Sets, shells: bool) -> bool:
    """Make a group of a surface: of faces, sides of shells or nodes; False if it is not read.

    In a deck that has shells too, faces of solids are groups of nodes: a section of "all" shells is
    not for them.
    """
    name = card.options.get("NAME", "")
    rows = [[x.strip().strip('"') for x in line.split(",")] + [""] for line in card.lines]
    if not name or not rows or name in elements.members or name in nodes.members:
        return False
    if card.options.get("TYPE", "ELEMENT").upper() == "NODE":
        parts = [list(nodes.of(row[0])) or _one(row[0], deck.nodes) for row in rows]
        nodes.add(name, [number for part in parts for number in part])
        return all(parts)
    sides: list[int] = []
    faces: list[tuple[str, list[int]]] = []
    for where, side, *_ in rows:
        members = list(elements.of(where)) or _one(where, deck.elements)
        if not members:
            return False
        for number in members:
            kind, corners, _ = deck.elements[number]
            if side.upper() in ("SPOS", "SNEG", "") and kind in _SURFACES.values():
                sides.append(number)
            elif (part := face(kind, corners, side)) is not None:
                faces.append(part)
            else:
                return False
    if shells and faces:
        nodes.add(name, [node for _, part in faces for node in part])
        nodes.add(name, [node for number in sides for node in deck.elements[number][1]])
        return True
    first = max(deck.elements) + 1
    deck.elements |= {first + k: (*part, 0) for k, part in enumerate(faces)}
    elements.add(name, [*sides, *range(first, first + len(faces))])
    return True


def _one(text: str, among: Iterable[int]) -> list[int]:
    """The number of an element or node, perhaps in an instance, if there is such a one."""
    number = text.rpartition(".")[2]
    return [int(number)] if number.isdigit() and int(number) in among else []


def _nodes_of(kind: str) -> int:
    from meshio._common import num_nodes_per_cell

    return int(num_nodes_per_cell.get(kind, 0))


def _abaqus_kind(deck: _Deck, name: str) -> str:
    """meshio's name of an element type; empty for masses, springs, connectors and rigid
    surfaces."""
    for pattern, kinds in _ABAQUS_KINDS:
        if (match := pattern.match(name)) and int(match[1]) in kinds:
            return kinds[int(match[1])]
    if _ABAQUS_OTHERS.match(name):
        return ""
    raise deck.error(f"elements of type {name} are not read; write C3D, S, B or T elements")


def _refuse_assembly(deck: _Deck, cards: list[_Card]) -> None:
    count = Counter(card.word for card in cards)
    moved = any(card.word == "INSTANCE" and card.lines for card in cards)
    word = next((word for word in _GENERATORS if count[word]), "")
    if word:
        raise deck.error(f"*{word} is not read: write all nodes and elements into the deck")
    if count["INSTANCE"] > 1 or count["PART"] > 1 or moved:
        what = f"the deck has {count['PART']} parts in {count['INSTANCE']} instances"
        what = "the deck has an instance that is moved" if moved else what
        cure = "write one part, or a flat deck (Abaqus/CAE: Model, Edit attributes, no parts)"
        raise deck.error(f"{what}: {cure}")
    systems = {card.options.get("SYSTEM", "R").upper() for card in cards if card.word == "NODE"}
    if systems - {"R"}:
        raise deck.error("*NODE has cylindrical or spherical coordinates: write x, y, z")


def _entries(text: str) -> Iterator[list[str]]:
    """Bulk data entries: name and all fields, with continuations joined and blanks as padding."""
    upper = text.upper()
    begin = re.search(r"^ *BEGIN\b.*$", upper, re.M)
    entry: list[str] = []
    for whole in upper[begin.end() if begin else 0 :].splitlines():
        line = whole.partition("$")[0].rstrip().expandtabs(8)
        if not line.strip():
            continue
        free = "," in line
        first = (line.split(",")[0] if free else line[:8]).strip()
        if first == "ENDDATA":
            break
        large = first.endswith("*") or first.startswith("*")
        count = 4 if large else 8
        if free:
            data = [x.strip() for x in line.split(",")[1:]]
            if len(data) == count + 1 or re.match(r"[+*]([A-Z]|$)", data[-1]):
                del data[-1]  # the last field is the name of a continuation
        else:
            width = 64 // count
            data = [line[k : k + width].strip() for k in range(8, 72, width)]
        data += [""] * (count - len(data))
        if first[:1] in ("+", "*", ""):
            entry += data
            continue
        if entry:
            yield entry
        entry = [first.rstrip("*").strip(), *data]
    if entry:
        yield entry


def _read_nastran(deck: _Deck, text: str) -> Iterator[str]:
    """Read nodes and elements, properties as groups; give the names of the other entries."""
    entries = [[*entry, *[""] * 8] for entry in _entries(text)]
    default = next((entry[2] for entry in entries if entry[0] == "GRDSET"), "")
    grids = [entry for entry in entries if entry[0] == "GRID"]
    nodes_as_read = {int(entry[1]): (entry[2] or default, entry[3:6]) for entry in grids}
    systems = Systems((e for e in entries if e[0] in SYSTEMS), nodes_as_read, _real, deck.error)
    for entry in grids:
        deck.add_node(entry[1], systems.place(entry[2] or default, entry[3:6]).tolist())
    for entry in entries:
        word = entry[0]
        if word not in _NASTRAN_KINDS:
            if _NASTRAN_REFUSED.fullmatch(word):
                cure = "write CTETRA, CPENTA, CHEXA, CQUAD4, CTRIA3 or CBAR"
                raise deck.error(f"elements of type {word} are not read; {cure}")
            yield word
            continue
        for what, first, end in _ON_SECTIONS.get(word, ()):
            yield from [what] * any(x.strip("0.+-ED") for x in entry[first:end])
        start, counts = _NASTRAN_KINDS[word]
        nodes = [int(x) for x in entry[start : start + counts[-1]] if x]
        if len(nodes) not in counts:
            allowed = " or ".join(map(str, counts))
            raise deck.error(f"{word} {entry[1]} has {len(nodes)} nodes; allowed: {allowed}")
        solid = word in ("CTETRA", "CPYRAM", "CPYRA", "CPENTA", "CHEXA")
        kind = "line" if counts == (2,) else (_SOLIDS if solid else _SURFACES)[len(nodes)]
        nodes = [nodes[k] for k in _TO_VTK.get(kind, range(len(nodes)))]
        deck.add_element(entry[1], kind, nodes, entry[2] if start == 3 else "")
