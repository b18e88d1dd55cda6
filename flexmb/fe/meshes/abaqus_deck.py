"""Input decks of Abaqus: parts, instances and the assembly, nodes, elements, sets and surfaces.

Numbers and names of sets belong to a part. An instance is a copy of a part that is translated and
then turned; the assembly has nodes, sets and surfaces of its own, such as reference points. A deck
without parts is one of its own. Of several instances groups are called ``instance.set``; of a
single one they keep their names, except those that a set of the assembly has too. Source: Abaqus
Keywords Reference Guide; Abaqus Elements Guide, faces of solids.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from flexmb.errors import nearest
from flexmb.fe.elements.solid_elements import SOLIDS as SOLID_ELEMENTS
from flexmb.fe.meshes.abaqus_sets import Card, Sets, read_cards
from flexmb.fe.meshes.deck import OTHER_PARTS, SOLIDS, SURFACES, Deck, read_deck, read_real
from flexmb.flexbody.arrays import FloatArray

ABAQUS = (".inp",)
"""Suffixes of files."""
_INCLUDE = re.compile(  # a card whose lines are in a file; of INCLUDE itself nothing remains
    r"^(?:\*INCLUDE|(?P<card>\*(?:NODE|ELEMENT|NSET|ELSET|SURFACE)\b[^*\n]*?))"
    r"\s*,\s*INPUT\s*=\s*(?P<file>[^,\n]+)(?P<rest>[^\n]*)$",
    re.M | re.I,
)
_GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
_KINDS = (  # by the first letters of a type and the number of nodes that follows
    (re.compile(r"C3D(\d+)"), SOLIDS),
    (re.compile(r"(?:S|STRI|M3D|SFM3D|CPS|CPE)(\d)"), SURFACES),
    (re.compile(r"T[23]D(\d)"), {2: "line", 3: "line3"}),
    (re.compile(r"(?:B|PIPE)[23](\d)"), {1: "line", 2: "line3", 3: "line"}),
)
_OTHERS = re.compile(r"MASS|ROTARYI|SPRING|DASHPOT|CONN|DCOUP|DIST|GAP|JOINT|R[23AB]")
_FACETS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
_FACES = {  # corners of the faces S1, S2, ...
    "tetra": ("012", "013", "123", "023"),
    "wedge": ("012", "345", "0134", "1245", "0235"),
    "hexahedron": ("0123", "4567", "0145", "1256", "2367", "0347"),
}
_ROTATION = 7  # numbers of a rotation: two points of the axis, and an angle [degrees]


def read_abaqus(source: Path) -> Any:
    """The mesh of a deck, with ``numbers`` and a ``note``.

    Raises
    ------
    MeshError
        Nodes that are generated or in other coordinate systems, instances of parts that are not in
        the deck, elements that are not known or name missing nodes, a file that includes itself.
    """
    return read_deck(source, _INCLUDE, _read_cards, "*NODE")


def _read_cards(deck: Deck, text: str) -> Iterator[str]:
    """Read all instances and the assembly; give the other keywords and types of elements."""
    cards = read_cards(text)
    words = {card.word for card in cards}
    if word := next((word for word in _GENERATORS if word in words), ""):
        raise deck.error(f"*{word} is not read: write all nodes and elements into the deck")
    assembly = _Assembly(deck)
    assembly.divide(cards)
    whole = _Part(deck)
    if not assembly.instances:
        if len(assembly.parts) > 1:
            what = f"the deck has {len(assembly.parts)} parts and no *INSTANCE that says where"
            raise deck.error(f"{what} they are: write one part, or the assembly too")
        own = [card for part in assembly.parts.values() for card in part]
        yield from whole.read([*own, *assembly.cards], _has_shells(deck, own + assembly.cards))
    else:
        used = [card for name in assembly.instances for card in assembly.cards_of(name)]
        shells = _has_shells(deck, used + assembly.cards)
        for name in assembly.instances:
            part = _Part(Deck(deck.source))
            yield from part.read(assembly.cards_of(name), shells)
            whole.add_instance(name, part, assembly.motion(name))
        yield from whole.read(assembly.cards, shells)
        whole.name_sets_of_instances([*assembly.instances])
        deck.numbered = len(assembly.instances) == 1
    deck.node_sets, deck.element_sets = whole.nodes.members, whole.elements.members


class _Motion(NamedTuple):
    """A translation, and a turn about an axis through a point that follows."""

    shift: FloatArray  # (3,)
    point: FloatArray = np.zeros(3)
    turn: Rotation | None = None

    def places(self, points: FloatArray) -> FloatArray:
        """(n, 3) the points, moved."""
        moved = points + self.shift
        return moved if self.turn is None else self.point + self.turn.apply(moved - self.point)


@dataclass
class _Assembly:
    """The cards of a deck by part, by instance, and the others."""

    deck: Deck
    parts: dict[str, list[Card]] = field(default_factory=dict)
    instances: dict[str, list[Card]] = field(default_factory=dict)  # the first is *INSTANCE
    cards: list[Card] = field(default_factory=list)

    def divide(self, cards: Iterable[Card]) -> None:
        """Sort the cards by where they stand."""
        into = self.cards
        for card in cards:
            if card.word == "PART":
                into = self.parts.setdefault(card.options.get("NAME", ""), [])
            elif card.word == "INSTANCE":
                self._check_instance(card)
                into = self.instances[card.options["NAME"]] = [card]
            elif card.word in ("END PART", "END INSTANCE"):
                into = self.cards
            else:
                into.append(card)

    def _check_instance(self, card: Card) -> None:
        name, part = card.options.get("NAME", ""), card.options.get("PART", "")
        if not name or not part:
            cure = "write its nodes and elements into the deck"
            raise self.deck.error(f'the instance "{name}" comes from another analysis: {cure}')
        if self._part(part) is None:
            near = nearest(part, self.parts)
            hint = f', nearest: "{near[0]}"' if near else ""
            what = f'the instance "{name}" is of the part "{part}", which the deck does not have'
            raise self.deck.error(what + hint)
        if name.upper() in map(str.upper, self.instances):
            raise self.deck.error(f'the instance "{name}" is given twice')

    def _part(self, name: str) -> list[Card] | None:
        """The cards of a part; capitals do not matter."""
        return next((part for own, part in self.parts.items() if own.upper() == name.upper()), None)

    def cards_of(self, name: str) -> list[Card]:
        """The cards of an instance: those of its part, and its own."""
        first, *own = self.instances[name]
        return [*(self._part(first.options["PART"]) or ()), *own]

    def motion(self, name: str) -> _Motion:
        """Where an instance is: translated, then turned about an axis through two points."""
        rows = [[read_real(x) for x in line.split(",")] for line in self.instances[name][0].lines]
        shift = np.array([*(rows[0] if rows else ()), 0.0, 0.0, 0.0])[:3]
        if len(rows) <= 1:
            return _Motion(shift)
        turn = np.array(rows[1])
        axis = turn[3:6] - turn[:3] if len(turn) >= _ROTATION else np.zeros(3)
        if not axis.any():
            what = f'the rotation of the instance "{name}" has no axis: it is given by two points'
            raise self.deck.error(f"{what} and an angle")
        angle = np.radians(turn[6]) / np.linalg.norm(axis)
        return _Motion(shift, turn[:3], Rotation.from_rotvec(angle * axis))


class _Part:
    """A part, or the whole deck, with the instances that were added."""

    def __init__(self, deck: Deck) -> None:
        self.deck = deck
        self.nodes = Sets(deck, "node", deck.nodes)
        self.elements = Sets(deck, "element", deck.elements)

    def add_instance(self, name: str, part: _Part, motion: _Motion) -> None:
        """Add a part, moved, with its sets as ``instance.set``."""
        part.deck.check_nodes(part.nodes.members)
        before = self.nodes.add_instance(name, part.nodes)
        first = self.elements.add_instance(name, part.elements)
        self.deck.first_nodes |= {before: f"{name}.", self.nodes.own: ""}
        self.deck.first_elements |= {first: f"{name}.", self.elements.own: ""}
        places = motion.places(np.array([*part.deck.nodes.values()]).reshape(-1, 3)).tolist()
        for number, place in zip(part.deck.nodes, places, strict=True):
            self.deck.nodes[before + number] = tuple(place)
        for number, (kind, nodes, tag) in part.deck.elements.items():
            self.deck.elements[first + number] = kind, [before + node for node in nodes], tag

    def name_sets_of_instances(self, instances: Sequence[str]) -> None:
        """Groups of several instances, and plain names for the sets of a single one."""
        both = self.nodes, self.elements
        prefix = f"{instances[0]}."
        if len(instances) > 1:
            for name in instances:
                if not any(sets.has(name) for sets in both):
                    self.elements.add(name, self.elements.of_instance(name))
            return
        names = {name for sets in both for name in sets.members if name.startswith(prefix)}
        plain = {name: name.removeprefix(prefix) for name in names}
        taken = {name for name in names if any(sets.has(plain[name]) for sets in both)}
        for sets in both:
            for name in [name for name in sets.members if name in names - taken]:
                sets.rename(name, plain[name])

    def read(self, cards: Sequence[Card], shells: bool) -> Iterator[str]:
        """Read nodes, elements, sets and surfaces; give the other keywords and types of elements.

        If there are `shells` too, faces of solids are groups of nodes: a section of "all" shells is
        not for them.
        """
        deck, nodes, elements = self.deck, self.nodes, self.elements
        for card in cards:
            if card.word == "NODE":
                numbers = self._read_nodes(card)
                if "NSET" in card.options:
                    nodes.add(card.options["NSET"], numbers)
        for card in cards:
            options = card.options
            if card.word == "ELEMENT":
                yield from self._read_elements(card)
            elif card.word == "NSET" and "NSET" in options:
                if "ELSET" not in options:
                    nodes.read(options["NSET"], card)
                whole, instance = options.get("ELSET", ""), options.get("INSTANCE", "")
                if whole and not elements.find(whole, instance):
                    what = f'the node set "{options["NSET"]}" is that of the element set "{whole}"'
                    raise deck.error(f"{what}, which is not above it, or in no such instance")
                for number in deck.elements.keys() & elements.of(whole, instance):
                    nodes.add(options["NSET"], deck.elements[number][1])
            elif card.word == "ELSET" and "ELSET" in options:
                elements.read(options["ELSET"], card)
            elif card.word not in ("SURFACE", "NODE"):
                yield card.word
                yield from ["offsets"] * ("OFFSET" in options)
        for card in (card for card in cards if card.word == "SURFACE"):
            if not self._read_surface(card, shells):
                yield card.word

    def _read_nodes(self, card: Card) -> list[int]:
        """Read the nodes of a card; returns their numbers."""
        system = card.options.get("SYSTEM", "R").upper()
        if system not in ("R", "C"):
            raise self.deck.error("*NODE has spherical coordinates: write x, y, z")
        numbers = []
        for line in card.lines:
            own, *fields = (x.strip() for x in line.split(","))
            a, b, c = (read_real(x) for x in [*fields, "", "", ""][:3])
            if system == "C":
                a, b = a * math.cos(math.radians(b)), a * math.sin(math.radians(b))
            numbers.append(self.nodes.number(own))
            self.deck.add_node(numbers[-1], (a, b, c))
        return numbers

    def _read_elements(self, card: Card) -> Iterator[str]:
        """Read the elements of a card; give its type, for each, if it makes a tie."""
        from meshio._common import num_nodes_per_cell

        if "TYPE" not in card.options:
            raise self.deck.error("*ELEMENT has no TYPE, such as C3D4")
        name = card.options["TYPE"].upper()
        kind, values = _kind(self.deck, name), card.numbers()
        if not kind and name in OTHER_PARTS["ties"]:
            yield from [name] * len(card.lines)
        step = int(num_nodes_per_cell.get(kind, 0)) + 1
        if len(values) % step:
            what = f"elements of type {card.options['TYPE']} have {step - 1} nodes, but the block "
            raise self.deck.error(f"{what}of element {values[0]} has lines of other lengths")
        numbers = [self.elements.number(number) for number in values[::step] if kind]
        if not kind:
            firsts = (line.split(",")[0].strip() for line in card.lines)
            left_out = (self.elements.number(x) for x in firsts if x.isdigit())
            self.elements.left_out.update(left_out)
        for k, number in enumerate(numbers):
            row = values[k * step + 1 : (k + 1) * step]
            self.deck.add_element(number, kind, [self.nodes.number(x) for x in row])
        if "ELSET" in card.options:
            self.elements.add(card.options["ELSET"], numbers)

    def _read_surface(self, card: Card, shells: bool) -> bool:
        """Make a group of a surface: of faces, sides of shells or nodes; False if it is not read.

        Where a set has its name it is ``name.surface``. With `shells`, faces of solids are nodes.
        """
        deck, nodes, elements = self.deck, self.nodes, self.elements
        name = own = card.options.get("NAME", "")
        name += ".surface" if elements.has(own) or nodes.has(own) else ""
        rows = [[x.replace('"', "").strip() for x in line.split(",")] + [""] for line in card.lines]
        if not own or not rows or elements.has(name) or nodes.has(name):
            return False
        if card.options.get("TYPE", "ELEMENT").upper() == "NODE":
            parts = [list(nodes.of(row[0])) or nodes.one(row[0]) for row in rows]
            if all(parts):
                nodes.add(name, [number for part in parts for number in part])
            return all(parts)
        sides: list[int] = []
        faces: list[tuple[str, list[int]]] = []
        for where, side, *_ in rows:
            members = list(elements.of(where)) or elements.one(where)
            if not members:
                return False
            for number in members:
                kind, corners, _ = deck.elements[number]
                if side.upper() in ("SPOS", "SNEG", "") and kind in SURFACES.values():
                    sides.append(number)
                elif (part := _face(kind, corners, side)) is not None:
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


def _has_shells(deck: Deck, cards: Iterable[Card]) -> bool:
    """Whether elements of a surface are among the cards."""
    types = {card.options.get("TYPE", "") for card in cards if card.word == "ELEMENT"}
    return any(name and _kind(deck, name.upper()) in SURFACES.values() for name in types)


def _kind(deck: Deck, name: str) -> str:
    """meshio's name of an element type; empty for masses, springs, connectors and the like."""
    for pattern, kinds in _KINDS:
        if (match := pattern.match(name)) and int(match[1]) in kinds:
            return kinds[int(match[1])]
    if _OTHERS.match(name):
        return ""
    raise deck.error(f"elements of type {name} are not read; write C3D, S, B or T elements")


def _face(kind: str, nodes: list[int], name: str) -> tuple[str, list[int]] | None:
    """Kind and nodes of the face S1, S2, ... of a solid; None if there is no such face."""
    family, corners = SOLID_ELEMENTS.get(kind), _FACES.get(kind.rstrip("0123456789"), ())
    number = int(name[1:]) if name[:1].upper() == "S" and name[1:].isdigit() else 0
    if family is None or not 1 <= number <= len(corners):
        return None
    plane = {int(corner) for corner in corners[number - 1]}
    for own in family.faces:
        if set(own[: len(plane)]) == plane:
            return _FACETS[len(own)], [nodes[k] for k in own]
    return None
