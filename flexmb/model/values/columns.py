"""Two columns of a text file of numbers: comma, semicolon, tab or blanks between them.

In: a file and the columns to take. Out: pairs (t, y) in SI, t increasing; or a problem with the
line that is wrong. Empty lines and those that begin with # are skipped; a first line without
numbers names the columns.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.units import UnitSystem, parse_unit

Cells = tuple[int, list[str]]


class Columns(NamedTuple):
    """Which columns to take, by name or number from 1 on, and their units (None: the scene's)."""

    names: tuple[str | int, str | int]
    units: tuple[str, str] | None


_TIMES = ("s", "times")


def read_columns(
    path: Path, columns: Columns, units: UnitSystem, slot: str, first: tuple[str, str] = _TIMES
) -> tuple[tuple[float, float], ...]:
    """The points of a file.

    Parameters
    ----------
    path : Path
        The file.
    columns : Columns
        What to take.
    units : UnitSystem
        Units of the numbers, unless the columns say their own.
    slot : str
        SI unit of the second column.
    first : pair of str
        SI unit of the first column, and what it holds.

    Raises
    ------
    SceneError
        No such file or column, no number, or a first column that does not increase.
    """
    lines = list(_lines(path))
    if not lines:
        raise SceneError(f"{path.name} holds no numbers")
    named = not any(_number(cell) is not None for cell in lines[0][1])
    header = lines.pop(0)[1] if named else []
    places = [_place(path, name, header) for name in columns.names]
    scales = _scales(columns.units, units, (first[0], slot))
    found: list[tuple[float, float]] = []
    for number, cells in lines:
        t, y = (_cell(path, number, cells, place) for place in places)
        if found and not t * scales[0] > found[-1][0]:
            what = f"{first[1]} must increase, {t:g} does not lie after the one before"
            raise SceneError(f"{path.name}, line {number}: {what}")
        found.append((t * scales[0], y * scales[1]))
    return tuple(found)


def _lines(path: Path) -> Iterator[Cells]:
    """Number and cells of every line that says something."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError(f'there is no file "{path}"') from None
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text"
        raise SceneError(f'the file "{path}" cannot be read: {why}') from None
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            mark = next((c for c in ";\t," if c in line), None)
            cells = line.split(mark) if mark else re.split(r"\s+", line.strip())
            yield number, [cell.strip().strip('"') for cell in cells]


def _number(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _place(path: Path, name: str | int, header: list[str]) -> int:
    """Place of a column in a line, from 0 on."""
    if isinstance(name, int):
        return name - 1
    if name not in header:
        names = tuple(header)
        what = f'{path.name} has no column "{name}"'
        if not header:
            what += ": its first line names none, so give their numbers"
        raise SceneError.from_problems([Problem("", what, names, nearest(name, names))])
    return header.index(name)


def _cell(path: Path, line: int, cells: list[str], place: int) -> float:
    where = f"{path.name}, line {line}"
    if place >= len(cells):
        what = f"there are {len(cells)} columns, number {place + 1} is asked for"
        raise SceneError(f"{where}: {what}")
    value = _number(cells[place])
    if value is None:
        raise SceneError(f'{where}: "{cells[place]}" is no finite number')
    return value


def _scales(told: tuple[str, str] | None, units: UnitSystem, slots: tuple[str, str]) -> list[float]:
    """Factors of both columns to SI."""
    if told is None:
        return [units.scale(slot) for slot in slots]
    factors = []
    for text, unit in zip(told, slots, strict=True):
        try:
            found = parse_unit(text)
        except FlexmbError as error:
            raise SceneError.from_problems(list(error.problems)) from None
        if found.dimension != parse_unit(unit).dimension:
            raise SceneError(f'"{text}" is no unit of this column, "{unit}" is')
        factors.append(found.factor)
    return factors
