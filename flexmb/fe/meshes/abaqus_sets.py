"""Cards of an Abaqus deck, and its sets of nodes and elements by name.

Numbers of an instance follow those of the instance before, those of the assembly the last one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from flexmb.fe.meshes.deck import Deck, among


@dataclass
class Card:
    """A keyword with its options and the lines below it."""

    word: str
    options: dict[str, str]  # in capitals
    lines: list[str]

    def numbers(self) -> list[str]:
        return [x for line in self.lines for x in (x.strip() for x in line.split(",")) if x]


def _range(line: str) -> range:
    """A line of a set that is generated: first, last, and perhaps a step."""
    first, last, *step = (int(x) for x in line.split(",") if x.strip())
    return range(first, last + 1, *step)


def read_cards(text: str) -> list[Card]:
    """The cards of a deck; a keyword may go on in the next line."""
    cards: list[Card] = []
    joined = re.sub(r"^(\*[^*\n].*),[ \t]*\n", r"\1, ", text, flags=re.M)
    for line in joined.splitlines():
        if line.startswith("*") and not line.startswith("**"):
            word, *rest = (part.strip() for part in line[1:].split(","))
            pairs = (part.partition("=") for part in rest if part)
            options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
            cards.append(Card(" ".join(word.upper().split()), options, []))
        elif cards and line.strip() and not line.startswith("**"):
            cards[-1].lines.append(line)
    return cards


class Sets:
    """Sets of numbers by name, case-insensitive; a second card with the same name adds to the set.

    Parameters
    ----------
    deck : Deck
        Whose nodes or elements they are.
    noun : str
        ``"node"`` or ``"element"``, for messages.
    present : mapping
        The nodes or elements of the deck by number.
    """

    def __init__(self, deck: Deck, noun: str, present: Mapping[int, Any]) -> None:
        self._deck, self._noun, self._present = deck, noun, present
        self.members: dict[str, dict[int, None]] = {}
        self.left_out: set[int] = set()  # elements that a mesh does not have, such as masses
        self._names: dict[str, str] = {}
        self._instances: list[str] = []
        self._spans: dict[str, tuple[int, int]] = {}  # last number before an instance, and of it
        self.own = 0  # last number before those without an instance

    def add(self, name: str, numbers: Iterable[int]) -> None:
        own = self._names.setdefault(name.upper(), name)
        self.members.setdefault(own, {}).update(dict.fromkeys(numbers))

    def has(self, name: str) -> bool:
        return name.upper() in self._names

    def of(self, name: str, instance: str = "") -> dict[int, None]:
        """The members of a set of the instance, or of the deck and the only instance."""
        return self.members.get(self.find(name, instance), {})

    def find(self, name: str, instance: str = "") -> str:
        """A set as it was first named; empty if there is none."""
        places = [f"{instance}.{name}", name]
        places += [f"{only}.{name}" for only in self._instances if len(self._instances) == 1]
        return next((self._names[x.upper()] for x in places if x.upper() in self._names), "")

    def rename(self, name: str, new: str) -> None:
        members = self.members.pop(self._names.pop(name.upper()))
        self.add(new, members)

    def add_instance(self, name: str, own: Sets) -> int:
        """Add the sets of an instance; returns the last number before its own."""
        last = max(self._present, default=0)
        self.own = last + max(own._present, default=0)
        self._spans[name.upper()] = last, self.own
        self._instances.append(name)
        for set_name, members in own.members.items():
            self.add(f"{name}.{set_name}", [last + k for k in members if k in own._present])
        return last

    def of_instance(self, name: str) -> list[int]:
        """All numbers of an instance."""
        before, last = self._spans[name.upper()]
        return [number for number in self._present if before < number <= last]

    def read(self, name: str, card: Card) -> None:
        """Add what a card of a set has: numbers and names of sets, or ranges.

        Raises
        ------
        MeshError
            A member that is neither a number nor a set; numbers of no instance in an assembly of
            several.
        """
        instance = card.options.get("INSTANCE", "")
        entries = [] if "GENERATE" in card.options else card.numbers()
        ranges = [_range(line) for line in card.lines] if not entries else []
        numbers = [*ranges, *(range(int(x), int(x) + 1) for x in entries if x.isdigit())]
        instance = instance or self._home(name, numbers)
        before, end = self._span(instance)
        for part in ranges:
            inside = range(before + part.start, min(before + part.stop, end + 1), part.step)
            self.add(name, [k for k in among(self._present, inside) if k > before])
        for entry in entries:
            own = entry.replace('"', "")
            if whole := self.find(own, instance):
                self.add(name, list(self.members[whole]))
            elif own.rpartition(".")[2].lstrip("+-").isdigit():
                self.add(name, [self.number(own, instance)])
            else:
                what = (
                    f'the {self._noun} set "{name}" has the member "{entry}", which is neither a '
                )
                raise self._deck.error(f"{what}number nor a set above it")

    def _home(self, name: str, numbers: list[range]) -> str:
        """The instance that a set of the assembly is of, if it names none.

        Where the assembly itself has none of these numbers, they are those of the only instance.
        """
        parts = [range(self.own + x.start, self.own + x.stop, x.step) for x in numbers]
        if (
            not self._spans
            or not numbers
            or any(among(own, part) for part in parts for own in (self._present, self.left_out))
        ):
            return ""
        if len(self._instances) == 1:
            return self._instances[0]
        what = f'the {self._noun} set "{name}" names {self._noun} {numbers[0].start}, which the '
        cure = " or ".join(f"INSTANCE={instance}" for instance in self._instances)
        raise self._deck.error(f"{what}assembly does not have; if it is of a part, add {cure}")

    def number(self, text: str, instance: str = "") -> int:
        """The number in the whole deck of an entry such as ``12`` or ``Rod-1.12``."""
        if "." not in text and not instance:
            return self.own + int(text)
        where, _, number = text.replace('"', "").rpartition(".")
        where = where or instance
        before, last = self._span(where)
        if self._spans and not 0 < int(number) <= last - before:
            what = f'a set or surface names number {number} of the instance "{where}"'
            raise self._deck.error(f"{what}, which it does not have")
        return before + int(number)

    def one(self, text: str) -> list[int]:
        """The number of an element or node, perhaps in an instance, if there is such a one.

        A number that the assembly itself does not have is that of the only instance.
        """
        number = self.number(text) if text.rpartition(".")[2].isdigit() else 0
        if text.isdigit() and len(self._instances) == 1 and not self._has(number):
            before, last = self._span(self._instances[0])
            number = before + int(text) if before + int(text) <= last else 0
        return [number] if number in self._present else []

    def _has(self, number: int) -> bool:
        return number in self._present or number in self.left_out

    def _span(self, instance: str) -> tuple[int, int]:
        if not instance or not self._spans:
            return self.own, max(self._present, default=0)
        if instance.upper() not in self._spans:
            what = f'a set or surface names the instance "{instance}", which the deck does not have'
            raise self._deck.error(what)
        return self._spans[instance.upper()]
