"""Constraint rows in groups: what two markers share of them, and their tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexmb.engine.compile.joints.curves import Sliders
from flexmb.engine.compile.markers import Markers
from flexmb.engine.row_kinds import ROW_KINDS
from flexmb.engine.tables import FOLLOW, ROW

__all__ = [
    "Entry",
    "Groups",
    "check_ends",
    "couples",
    "follow_table",
    "row_table",
    "row_weights",
]


class Entry(NamedTuple):
    """One row on two markers, as `tables.ROW` says."""

    kind: int
    a: int
    b: int
    offset: float = 0.0
    fun: int = -1
    follows: tuple[tuple[int, float], ...] = ()  # scalar coordinates and their factors


def _word(row: Entry) -> str:
    """What a row is."""
    if row.fun >= 0:
        return "driven"
    if row.follows:
        return "coordinate"
    return ROW_KINDS[row.kind].word.format(a="xyz"[row.a], b="xyz"[row.b])


class PlacedEntry(NamedTuple):
    """A row with its markers."""

    entry: Entry
    I: int  # noqa: E741
    J: int


@dataclass
class Groups:
    """Constraint rows, group by group."""

    rows: list[PlacedEntry] = field(default_factory=list)
    groups: list[tuple[int, int, int, int]] = field(default_factory=list)  # row, n, body I, J
    names: list[str] = field(default_factory=list)  # of the rows
    owners: list[str] = field(default_factory=list)  # scene path of each group
    numbers: dict[str, int] = field(default_factory=dict)  # first group of a scene path
    reversed: set[int] = field(default_factory=set)  # groups whose I is the joint's J
    sliders: Sliders = field(default_factory=Sliders)

    def add(
        self,
        name: str,
        markers: Markers,
        I: int,  # noqa: E741
        J: int,
        rows: list[Entry],
        words: Sequence[str] = (),
    ) -> None:
        """Append a group of rows between I and J; `words` say what they are where it is known."""
        self.numbers.setdefault(name, len(self.groups))
        self.groups.append((len(self.rows), len(rows), markers.body(I), markers.body(J)))
        self.owners.append(name)
        self.rows += [PlacedEntry(row, I, J) for row in rows]
        self.names += [f"{name}: {what}" for what in words or map(_word, rows)]

    def in_group(self, k: int) -> list[PlacedEntry]:
        """The rows of a group."""
        row, n, _, _ = self.groups[k]
        return self.rows[row : row + n]


def couples(groups: Groups) -> list[tuple[int, int]]:
    """Pairs of bodies whose tangents a group couples: all but mere coincidence."""
    pairs = []
    for k, (_, _, i, j) in enumerate(groups.groups):
        curved = any(ROW_KINDS[row.entry.kind].tangent for row in groups.in_group(k))
        if curved and i >= 0 and j >= 0:
            pairs.append((i, j))
    return pairs


def check_ends(groups: Groups) -> list[str]:
    """Names of groups whose two markers are on the same body."""
    return [groups.names[row] for row, _, i, j in groups.groups if i == j]


def row_weights(groups: Groups, length: float) -> np.ndarray:
    """(nc,) size of one unit of every row: metres over the model size, radians."""
    angular = [ROW_KINDS[row.entry.kind].angular for row in groups.rows]
    return np.where(np.array(angular, bool), 1.0, 1.0 / length)


def row_table(groups: Groups, sizes: np.ndarray, n_functions: int) -> np.ndarray:
    """ROW rows with the places of their Jacobian rows; `sizes` is 6 + m of each body.

    What a row follows stands behind the functions of time, a slot for each such row.
    """
    entries = []
    size = sizes.tolist()
    at, slot = 0, n_functions
    for row, n, i, j in groups.groups:
        for r in range(n):
            (kind, a, b, offset, fun, follows), I, J = groups.rows[row + r]  # noqa: E741
            jac = []
            for body in (i, j):
                jac.append(at if body >= 0 else -1)
                at += size[body] if body >= 0 else 0
            if follows:
                fun, slot = slot, slot + 1
            entries.append((kind, I, J, a, b, fun, *jac, r, len(follows), offset))
    return np.array(entries, ROW)


def follow_table(groups: Groups) -> np.ndarray:
    """FOLLOW rows in the order of the rows; links are filled in later."""
    entries = [
        (k, coordinate, -1, n == 0, factor)
        for k, row in enumerate(groups.rows)
        for n, (coordinate, factor) in enumerate(row.entry.follows)
    ]
    return np.array(entries, FOLLOW)
