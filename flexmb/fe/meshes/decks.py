"""Input decks of Abaqus and Nastran: what they say of nodes and groups, and meshio leaves out.

meshio keeps the last of several ``*NODE`` blocks and of several blocks of one element set, leaves
names out of node sets, and reads parts, instances and coordinate systems as if they were not there.
:func:`flat_abaqus_deck` writes the deck anew, in the words that meshio reads, or refuses it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from flexmb.errors import MeshError

ABAQUS = (".inp",)
NASTRAN = (".bdf", ".fem", ".nas")
_GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
_PARTS = {  # of the model, which a mesh does not have, and where a body has them
    "masses": ("MASS", "ROTARY INERTIA", "CONM1", "CONM2"),
    "springs": ("SPRING", "CELAS1", "CELAS2", "CBUSH"),
    "ties": ("RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "TIE", "MPC", "EQUATION",
             "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "RBE2", "RBE3", "RBAR"),
}  # fmt: skip
_INCLUDE = re.compile(r"^\*INCLUDE\s*,\s*INPUT\s*=\s*([^,\n]+)[^\n]*$", re.M | re.I)


def abaqus_text(source: Path, inside: tuple[Path, ...] = ()) -> str:
    """A deck, and in their places the files of its folder that it includes.

    Raises
    ------
    MeshError
        A file that includes itself, or that is not there.
    """
    if source.resolve() in inside:
        raise MeshError(f"{source}: the deck includes itself")
    inside = (*inside, source.resolve())
    try:
        text = source.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError as error:
        raise MeshError(f"{source}: no such file, named by *INCLUDE of {inside[-2]}") from error

    def included(line: re.Match[str]) -> str:
        return abaqus_text(inside[0].parent / line[1].strip().strip('"'), inside)

    return _INCLUDE.sub(included, text)


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
    """Sets by name, in small or capital letters alike; a second card of one name adds to it."""

    def __init__(self, source: Path, noun: str) -> None:
        self._source, self._noun = source, noun
        self.members: dict[str, dict[int, None]] = {}
        self._names: dict[str, str] = {}

    def add(self, name: str, numbers: Iterable[int]) -> None:
        own = self._names.setdefault(name.upper(), name)
        self.members.setdefault(own, {}).update(dict.fromkeys(numbers))

    def read(self, name: str, card: _Card, present: Iterable[int]) -> None:
        if "GENERATE" in card.options:
            for line in card.lines:
                first, last, *step = (int(x) for x in line.split(",") if x.strip())
                numbers = range(first, last + 1, *step)
                self.add(name, [number for number in present if number in numbers])
            return
        for entry in card.numbers():
            if entry.lstrip("+-").isdigit():
                self.add(name, [int(entry)])
            elif entry.strip('"').upper() in self._names:
                self.add(name, list(self.members[self._names[entry.strip('"').upper()]]))
            else:
                what = f'the {self._noun} "{name}" has the member "{entry}", which is neither a '
                raise MeshError(f"{self._source}: {what}number nor a set above it")

    def lines(self, word: str) -> Iterable[str]:
        for name, numbers in self.members.items():
            yield f"*{word}, {word}={name}"
            yield from (f"{number}," for number in numbers)


def flat_abaqus_deck(source: Path, text: str) -> str:
    """The nodes, elements and sets of a deck, each node block and set once.

    Raises
    ------
    MeshError
        Nodes that are generated or in another file, several parts or instances, an instance that is
        moved, cylindrical coordinates.
    """
    from meshio._common import num_nodes_per_cell
    from meshio.abaqus._abaqus import abaqus_to_meshio_type

    cards = _cards(text)
    _refuse_assembly(source, cards)
    points: dict[int, list[str]] = {}
    nodes, elements = _Sets(source, "node set"), _Sets(source, "element set")
    body: list[str] = []
    present: dict[int, None] = {}
    for card in cards:
        options = card.options
        if card.word == "NODE":
            rows = [[x.strip() or "0" for x in line.split(",")] for line in card.lines]
            points |= {int(row[0]): ([*row[1:4], "0", "0", "0"])[:3] for row in rows}
            if "NSET" in options:
                nodes.add(options["NSET"], [int(row[0]) for row in rows])
        elif card.word == "ELEMENT":
            if "TYPE" not in options:
                raise MeshError(f"{source}: *ELEMENT has no TYPE, such as C3D4")
            body += [f"*ELEMENT, TYPE={options['TYPE'].upper()}", *card.lines]
            kind = abaqus_to_meshio_type.get(options["TYPE"].upper())
            step = 1 if kind is None else num_nodes_per_cell[kind] + 1
            numbers = [int(number) for number in card.numbers()[::step]]
            present |= dict.fromkeys(numbers)
            if "ELSET" in options:
                elements.add(options["ELSET"], numbers)
        elif card.word == "NSET" and "NSET" in options:
            nodes.read(options["NSET"], card, points)
        elif card.word == "ELSET" and "ELSET" in options:
            elements.read(options["ELSET"], card, present)
    flat = ["*NODE", *(f"{number}, {', '.join(x)}" for number, x in points.items()), *body]
    return "\n".join([*flat, *nodes.lines("NSET"), *elements.lines("ELSET"), ""])


def _refuse_assembly(source: Path, cards: list[_Card]) -> None:
    count = Counter(card.word for card in cards)
    moved = any(card.word == "INSTANCE" and card.lines for card in cards)
    word = next((word for word in _GENERATORS if count[word]), "")
    if word:
        what = f"*{word} is not read: write all nodes and elements into the deck"
        raise MeshError(f"{source}: {what}")
    if count["INSTANCE"] > 1 or count["PART"] > 1 or moved:
        what = f"the deck has {count['PART']} parts in {count['INSTANCE']} instances"
        what = "the deck has an instance that is moved" if moved else what
        cure = "write one part, or a flat deck (Abaqus/CAE: Model, Edit attributes, no parts)"
        raise MeshError(f"{source}: {what}: {cure}")
    systems = {card.options.get("SYSTEM", "R").upper() for card in cards if card.word == "NODE"}
    if systems - {"R"}:
        raise MeshError(f"{source}: *NODE has cylindrical or spherical coordinates: write x, y, z")


def refuse_nastran_systems(source: Path, text: str, systems: Iterable[int]) -> None:
    """Refuse a deck with nodes in ``systems`` of coordinates of their own, or with other files."""
    lines = text.upper().splitlines()
    if any(line.startswith("INCLUDE") for line in lines):
        raise MeshError(f"{source}: INCLUDE is not read: write all entries into one deck")
    default = [_field(line, 2) for line in lines if line.startswith("GRDSET")]
    numbers = [str(number) for number in (*systems, *default) if str(number) not in ("", "0")]
    if numbers:
        what = f"GRID gives coordinates in the system {numbers[0]}, which is not read: "
        raise MeshError(f"{source}: {what}write them in the basic system")


def _field(line: str, number: int) -> str:
    """A field of a line in free or small format, from 0."""
    fields = line.split(",") if "," in line else [line[k : k + 8] for k in range(0, len(line), 8)]
    return fields[number].strip() if number < len(fields) else ""


def unread_entries(text: str) -> str:
    """A sentence about masses, springs and ties of a deck, which a mesh does not have."""
    words = Counter(card.word for card in _cards(text))
    words += Counter(_field(line, 0).rstrip("*") for line in text.upper().splitlines())
    counts = {kind: {word: words[word] for word in among if words[word]}
              for kind, among in _PARTS.items()}  # fmt: skip
    entries = [f"{n} {word}" for numbers in counts.values() for word, n in numbers.items()]
    if not entries:
        return ""
    homes = ", ".join(kind for kind, numbers in counts.items() if numbers)
    return f"the mesh file also has {', '.join(entries)}, not read: the body takes its own {homes}"
