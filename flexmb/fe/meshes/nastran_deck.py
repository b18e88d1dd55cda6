"""Input decks of Nastran: nodes, elements, groups and coordinate systems.

Properties are groups of elements. Nastran has no sets of nodes with names: nodes of rigid elements,
of boundary degrees of freedom and of supports are groups, and those with permanent constraints by
their components.

A coordinate system is rectangular, cylindrical or spherical, given by its origin, a point on its z
axis and one in its xz plane, in another system or by three nodes. Angles are in degrees. Source:
MSC Nastran Quick Reference Guide, bulk data formats, CORD1R to CORD2S, and elements.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.fe.meshes.deck import SOLIDS, SURFACES, Deck, among, read_deck, read_real
from flexmb.flexbody.arrays import FloatArray

NASTRAN = (".bdf", ".fem", ".nas")
"""Suffixes of files."""
_BULK = re.compile(rb"^ *(BEGIN +BULK|GRID[ *,])", re.M | re.I)
_INCLUDE = re.compile(r"^INCLUDE\s+(?P<file>[^\n]+)$", re.M | re.I)
_KINDS = {  # index of the first node field, and allowed numbers of nodes
    **dict.fromkeys(("CTRIA3", "CTRIAR"), (3, (3,))),
    **dict.fromkeys(("CQUAD4", "CQUADR", "CSHEAR"), (3, (4,))),
    **dict.fromkeys(("CROD", "CTUBE", "CBAR", "CBEAM", "CBEND"), (3, (2,))),
    "CONROD": (2, (2,)), "CTRIA6": (3, (6,)), "CQUAD8": (3, (8,)), "CTETRA": (3, (4, 10)),
    "CPYRAM": (3, (5, 13)), "CPYRA": (3, (5, 13)), "CPENTA": (3, (6, 15)), "CHEXA": (3, (8, 20)),
}  # fmt: skip
_REFUSED = re.compile(  # elements whose absence would leave a hole in the body
    r"CTRIAX6?|CTRAX[36]|CQUADX?[48]?|CPLST[NS]\d|CRAC[23]D|CBEAM3|CDUM\d|CIF(HEX|PENT|QDX)"
)
_ON_SECTIONS = {  # words of `OTHER_PARTS` for options on an element, and the range of their fields
    **dict.fromkeys(("CBAR", "CBEAM"), (("pin flags", 9, 11), ("offsets", 11, 17))),
    **dict.fromkeys(("CQUAD4", "CQUADR"), (("material angles", 7, 8), ("offsets", 8, 9))),
    **dict.fromkeys(("CTRIA3", "CTRIAR"), (("material angles", 6, 7), ("offsets", 7, 8))),
}
_TO_VTK = {  # Nastran numbers the mid-side nodes between the faces before those of the upper face
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
}
_BOUNDARIES = {  # index of the first node among the fields, and distance to the next one
    **dict.fromkeys(("ASET", "BSET", "CSET"), (0, 2)),
    **dict.fromkeys(("ASET1", "BSET1", "CSET1"), (1, 1)),
    "SPC": (1, 3), "SPC1": (2, 1),
}  # fmt: skip
_SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
_ZERO_SINE = 1e-9  # between the axis and the third point of a system


def is_nastran(source: Path) -> bool:
    """Whether a file is a deck by its suffix, or one ``.dat`` by its text."""
    suffix = source.suffix.lower()
    return suffix in NASTRAN or (suffix == ".dat" and bool(_BULK.search(source.read_bytes())))


def read_nastran(source: Path) -> Any:
    """The mesh of a deck, with ``numbers`` and a ``note``.

    Raises
    ------
    MeshError
        Elements that are not known or name missing nodes, coordinate systems that are missing or
        have no axes, a file that includes itself.
    """
    return read_deck(source, _INCLUDE, _read_cards, "GRID")


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


def _read_cards(deck: Deck, text: str) -> Iterator[str]:
    """Read nodes and elements, properties as groups; give the names of the other entries."""
    entries = [[*entry, *[""] * 8] for entry in _entries(text)]
    defaults = next((entry for entry in entries if entry[0] == "GRDSET"), [""] * 8)
    default, constraint = defaults[2], defaults[7]
    grids = [entry for entry in entries if entry[0] == "GRID"]
    nodes_as_read = {int(entry[1]): (entry[2] or default, entry[3:6]) for entry in grids}
    systems = _Systems(deck, (e for e in entries if e[0] in _SYSTEMS), nodes_as_read)
    for entry in grids:
        deck.add_node(entry[1], systems.place(entry[2] or default, entry[3:6]).tolist())
    for entry in entries:
        word = entry[0]
        if word not in _KINDS:
            if _REFUSED.fullmatch(word):
                cure = "write CTETRA, CPENTA, CHEXA, CQUAD4, CTRIA3 or CBAR"
                raise deck.error(f"elements of type {word} are not read; {cure}")
            yield word
            continue
        for what, first, end in _ON_SECTIONS.get(word, ()):
            yield from [what] * any(x.strip("0.+-ED") for x in entry[first:end])
        start, counts = _KINDS[word]
        nodes = [int(x) for x in entry[start : start + counts[-1]] if x]
        if len(nodes) not in counts:
            allowed = " or ".join(map(str, counts))
            raise deck.error(f"{word} {entry[1]} has {len(nodes)} nodes; allowed: {allowed}")
        solid = word in ("CTETRA", "CPYRAM", "CPYRA", "CPENTA", "CHEXA")
        kind = "line" if counts == (2,) else (SOLIDS if solid else SURFACES)[len(nodes)]
        nodes = [nodes[k] for k in _TO_VTK.get(kind, range(len(nodes)))]
        deck.add_element(entry[1], kind, nodes, entry[2] if start == 3 else "")
    constraints = ((int(entry[1]), int(entry[7] or constraint or 0)) for entry in grids)
    deck.node_sets = _node_groups(entries, deck.nodes) | _constrained(constraints)


def _constrained(constraints: Iterable[tuple[int, int]]) -> dict[str, list[int]]:
    """Groups of nodes with a permanent constraint, by its components: ``PS:123``."""
    groups: dict[str, list[int]] = {}
    for node, components in constraints:
        if components:
            groups.setdefault(f"PS:{components}", []).append(node)
    return groups


def _node_groups(
    entries: Iterable[Sequence[str]], present: Collection[int]
) -> dict[str, list[int]]:
    """Groups of nodes: ``RBE2:12`` and ``RBE2:12:reference`` of a rigid element, ``RBE3:...`` of a
    weighted one, ``ASET`` of boundary degrees of freedom, ``SPC:7`` of supports.

    Of ASET and SPC only nodes that are `present`: ranges leave out some, and scalar points have
    no place.
    """
    groups: dict[str, list[int]] = {}
    for word, *fields in entries:
        if word in ("RBE2", "RBE3"):
            name, own = f"{word}:{fields[0]}", word == "RBE2"
            groups[f"{name}:reference"] = [int(fields[1 if own else 2])]
            lists = [[x for x in fields[3:] if "." not in x]] if own else _weighted(fields[4:])
            groups[name] = [node for part in lists for node in _listed(part, present)]
        elif word in _BOUNDARIES:
            first, step = _BOUNDARIES[word]
            own = f"SPC:{fields[0]}" if word.startswith("SPC") else "ASET"
            nodes = _listed(fields[first:] if step == 1 else fields[first::step], present)
            groups.setdefault(own, []).extend(node for node in nodes if node in present)
    return {name: nodes for name, nodes in groups.items() if nodes}


def _weighted(fields: Iterable[str]) -> list[list[str]]:
    """Lists of nodes of RBE3: behind each weight, a real number, the components and then nodes."""
    parts: list[list[str]] = []
    for field_ in filter(None, fields):
        if field_ in ("UM", "ALPHA"):
            break
        if "." in field_:
            parts.append([])
        elif parts:
            parts[-1].append(field_)
    return [part[1:] for part in parts]


def _listed(fields: Iterable[str], present: Collection[int]) -> list[int]:
    """Numbers of a list; of ranges such as 5 THRU 9, 5 THRU 9 BY 2 and EXCEPT 7, and of ALL, those
    present."""
    words = [x for x in fields if x]
    if words == ["ALL"]:
        return list(present)
    leave = words.index("EXCEPT") if "EXCEPT" in words else len(words)
    out = {int(x) for x in words[leave + 1 :]}
    numbers: dict[int, None] = {}
    k = 0
    while k < leave:
        first, last, step = int(words[k]), int(words[k]), 1
        numbers[first] = None
        if words[k + 1 : k + 2] == ["THRU"]:
            last, k = int(words[k + 2]), k + 2
            if words[k + 1 : k + 2] == ["BY"]:
                step, k = int(words[k + 2]), k + 2
            numbers |= dict.fromkeys(among(present, range(first, last + 1, step)))
        k += 1
    return [number for number in numbers if number not in out]


@dataclass
class _Systems:
    """Places in the basic system.

    Parameters
    ----------
    deck : Deck
        For messages.
    entries : iterable of list of str
        The entries of the deck that define systems: name and fields.
    nodes : mapping of int to (str, list of str)
        System and coordinates of each node, as in the deck.
    """

    deck: Deck
    entries: Iterable[Sequence[str]]
    nodes: Mapping[int, tuple[str, Sequence[str]]]
    _rows: dict[int, tuple[str, Sequence[str]]] = field(init=False, default_factory=dict)
    _frames: dict[int, tuple[FloatArray, FloatArray]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for word, *fields in self.entries:
            rows = [fields[:11]] if word[4] == "2" else [fields[:4], fields[4:8]]
            for row in rows:
                if row[0] and self._rows.setdefault(int(row[0]), (word, row)) != (word, row):
                    raise self.deck.error(f"the coordinate system {row[0]} is given twice")

    def place(self, system: str, fields: Iterable[str], inside: tuple[int, ...] = ()) -> FloatArray:
        """(3,) the point with these coordinates, in the basic system.

        Raises
        ------
        MeshError
            A system that is not defined, depends on itself, or has no axes.
        """
        a, b, c = (read_real(x) for x in fields)
        number = int(system or 0)
        if number == 0:
            return np.array([a, b, c])
        origin, axes = self._frame(number, inside)
        kind = self._rows[number][0][5]
        if kind == "C":
            a, b = a * _cos(b), a * _sin(b)
        elif kind == "S":
            a, b, c = a * _sin(b) * _cos(c), a * _sin(b) * _sin(c), a * _cos(b)
        return origin + axes @ [a, b, c]

    def _frame(self, number: int, inside: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Origin, and axes as columns."""
        if number in self._frames:
            return self._frames[number]
        if number not in self._rows:
            what = f"GRID or a CORD entry names the coordinate system {number}, which the deck"
            raise self.deck.error(f"{what} does not have")
        if number in inside:
            raise self.deck.error(f"the coordinate system {number} is defined by itself")
        word, row = self._rows[number]
        inside = (*inside, number)
        if word[4] == "2":
            base, rows = row[1], (row[2:5], row[5:8], row[8:11])
            points = [self.place(base, fields, inside) for fields in rows]
        else:
            points = [self._node(int(node), number, inside) for node in row[1:4]]
        origin, along, beside = points
        z, x = along - origin, beside - origin
        y = np.cross(z, x)
        if np.linalg.norm(y) <= _ZERO_SINE * np.linalg.norm(z) * np.linalg.norm(x):
            raise self.deck.error(
                f"the three points of the coordinate system {number} lie on a line"
            )
        axes = np.column_stack([np.cross(y, z), y, z])
        self._frames[number] = origin, axes / np.linalg.norm(axes, axis=0)
        return self._frames[number]

    def _node(self, node: int, number: int, inside: tuple[int, ...]) -> FloatArray:
        if node not in self.nodes:
            what = f"the coordinate system {number} names node {node}, which the deck does not have"
            raise self.deck.error(what)
        return self.place(*self.nodes[node], inside)


def _cos(degrees: float) -> float:
    return float(np.cos(np.radians(degrees)))


def _sin(degrees: float) -> float:
    return float(np.sin(np.radians(degrees)))
