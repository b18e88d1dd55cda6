"""Coordinate systems of Nastran: rectangular, cylindrical and spherical, by points or nodes.

A system is given by its origin, a point on its z axis and one in its xz plane, in another system or
by three nodes. Angles are in degrees. Source: MSC Nastran Quick Reference Guide, CORD1R to CORD2S.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexmb.errors import MeshError
from flexmb.flexbody.arrays import FloatArray

SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
_ZERO_SINE = 1e-9  # between the axis and the third point of a system


@dataclass
class Systems:
    """Places in the basic system.

    Parameters
    ----------
    entries : iterable of list of str
        The entries of a deck that define systems: name and fields.
    nodes : mapping of int to (str, list of str)
        System and coordinates of each node, as in the deck.
    real : callable
        Reads a number.
    error : callable
        Makes the error of the deck from a sentence.
    """

    entries: Iterable[Sequence[str]]
    nodes: Mapping[int, tuple[str, Sequence[str]]]
    real: Callable[[str], float]
    error: Callable[[str], MeshError]
    _rows: dict[int, tuple[str, Sequence[str]]] = field(init=False, default_factory=dict)
    _frames: dict[int, tuple[FloatArray, FloatArray]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for word, *fields in self.entries:
            rows = [fields[:11]] if word[4] == "2" else [fields[:4], fields[4:8]]
            for row in rows:
                if row[0] and self._rows.setdefault(int(row[0]), (word, row)) != (word, row):
                    raise self.error(f"the coordinate system {row[0]} is given twice")

    def place(self, system: str, fields: Iterable[str], inside: tuple[int, ...] = ()) -> FloatArray:
        """(3,) the point with these coordinates, in the basic system.

        Raises
        ------
        MeshError
            A system that is not defined, depends on itself, or has no axes.
        """
        a, b, c = (self.real(x) for x in fields)
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
            raise self.error(f"GRID or a CORD entry names the coordinate system {number}, which "
                             "the deck does not have")  # fmt: skip
        if number in inside:
            raise self.error(f"the coordinate system {number} is defined by itself")
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
            raise self.error(f"the three points of the coordinate system {number} lie on a line")
        axes = np.column_stack([np.cross(y, z), y, z])
        self._frames[number] = origin, axes / np.linalg.norm(axes, axis=0)
        return self._frames[number]

    def _node(self, node: int, number: int, inside: tuple[int, ...]) -> FloatArray:
        if node not in self.nodes:
            what = f"the coordinate system {number} names node {node}, which the deck does not have"
            raise self.error(what)
        return self.place(*self.nodes[node], inside)


def _cos(degrees: float) -> float:
    return float(np.cos(np.radians(degrees)))


def _sin(degrees: float) -> float:
    return float(np.sin(np.radians(degrees)))
