"""Into how many elements of which kind a simple shape is divided.

In: the extents of the shape [m] and what was asked for. Out: whole numbers, or what is wrong with
those asked for. Where nothing is asked: ten second-order elements, or twenty first-order ones,
along the longest extent, along the others as many as make their edges as long, and at least two
(four first-order ones in solids). Round shapes have 16 or 32 elements around.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, prod
from numbers import Integral
from typing import Any

from flexmb.errors import Problem, nearest
from flexmb.fe.meshes.lattice import KINDS
from flexmb.fe.tables import is_number

__all__ = [
    "across",
    "around",
    "beside",
    "chosen",
    "division_problems",
    "even",
    "kind_problems",
    "length_problems",
]

_LONGEST = {True: 10, False: 20}  # elements along the longest extent, by second order
_AROUND = {True: 16, False: 32}
_ACROSS = {True: 1, False: 2}  # through a wall
_MOST_BESIDE = 40  # elements along a tube
_MOST = 10_000_000  # nodes; a mesh of more is a slip of the keyboard


def _second_order(kind: str) -> bool:
    return kind not in ("line", "quad", "triangle", "hexahedron", "tetra")


def even(kind: str, extents: Sequence[float]) -> tuple[int, ...]:
    """The usual divisions of a box of these extents."""
    fine = _second_order(kind)
    edge = max(extents) / _LONGEST[fine]
    least = 4 if not fine and len(extents) == 3 else 2
    return tuple(max(least, round(extent / edge)) for extent in extents)


def around(kind: str) -> int:
    """The usual number of elements around a circle."""
    return _AROUND[_second_order(kind)]


def across(kind: str) -> int:
    """The usual number of elements through a wall."""
    return _ACROSS[_second_order(kind)]


def beside(extent: float, radius: float, turns: int) -> int:
    """The usual number along an extent beside ``turns`` elements on a circle: edges as long."""
    return min(_MOST_BESIDE, max(2, round(extent * turns / (2 * pi * radius))))


def chosen(given: Any, usual: Sequence[int]) -> tuple[int, ...]:
    """The divisions that were given, or the usual ones; one number counts for all directions."""
    if given is None:
        return tuple(usual)
    return (int(given),) * len(usual) if is_number(given) else tuple(int(n) for n in given)


def division_problems(given: Any, words: Sequence[str]) -> list[Problem]:
    """What is wrong with divisions along the directions ``words``; nothing with None."""
    if given is None:
        return []
    numbers = [given] * len(words) if is_number(given) else given
    listed = isinstance(numbers, list | tuple) and len(numbers) == len(words)
    if not listed or not all(
        isinstance(n, Integral) and not isinstance(n, bool) and n >= 1 for n in numbers
    ):
        what = f"must be whole numbers from 1 on, {', '.join(words)}; given {given!r}"
        return [Problem("mesh.divisions", what)]
    nodes = prod(2.0 * n + 1.0 for n in numbers)
    if nodes > _MOST:
        what = f"would make up to {nodes:.3g} nodes, more than {_MOST:.0e}; given {given!r}"
        return [Problem("mesh.divisions", what)]
    return []


def kind_problems(given: Any, *dims: int) -> list[Problem]:
    """What is wrong with a kind of elements, of solids (3) or surfaces (2); nothing with None."""
    names = tuple(name for dim in dims for name in KINDS[dim])
    if given is None or given in names:
        return []
    what = f"unknown kind {given!r}"
    return [Problem("mesh.elements", what, names, nearest(str(given), names))]


def length_problems(**values: Any) -> list[Problem]:
    """What is wrong with lengths that must be positive; nothing with None."""
    return [
        Problem(f"mesh.{name}", f"must be a positive length, given {value!r}")
        for name, value in values.items()
        if value is not None and not (is_number(value) and value > 0)
    ]
