"""Points (x, y) of a curve: lists in the scene, or columns of a text file of numbers.

In a file comma, semicolon, tab or blanks stand between the columns; empty lines and what
follows # are skipped; a first line without numbers names the columns. Out: pairs in SI, x
increasing; or a problem with the point or the line that is wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.values.quantities import plain, read_numbers
from flexmb.model.values.reading import ReadContext, quote, under
from flexmb.units import UnitSystem, parse_unit

Points = tuple[tuple[float, float], ...]
_TIMES = ("s", "times")


def read_points(value: Any, names: ReadContext, units: tuple[str, str], point: str) -> Points:
    """Points of a list; ``point`` is how one is written, such as ``"[t, y]"``."""
    rows = plain(value)
    if not isinstance(rows, list):
        raise SceneError(f"a list of points {point} is expected, given {quote(value)}")
    points, problems = [], []
    for i, row in enumerate(rows):
        try:
            if not isinstance(row, list) or len(row) != 2:
                raise SceneError(f"a point {point} is expected, given {quote(row)}")
            x, y = read_numbers(row, names, units)
            points.append((x, y))
        except SceneError as error:
            problems += under(f"[{i}]", error.problems)
    if problems:
        raise SceneError.from_problems(problems)
    return tuple(points)


def check_order(x: Sequence[float], units: UnitSystem, unit: str, noun: str) -> None:
    """Refuse values that do not increase."""
    for i in range(1, len(x)):
        if not x[i] > x[i - 1]:
            before, now = (units.say(x[j], unit) for j in (i - 1, i))
            what = f"{noun} must increase: {now} does not lie after {before}"
            raise SceneError.from_problems([Problem(f"[{i}]", what)])


class Columns(NamedTuple):
    """Which columns to take, by name or number from 1 on, and their units (None: the scene's)."""

    names: tuple[str | int, str | int]
    units: tuple[str, str] | None


def read_columns(
    path: Path, columns: Columns, units: UnitSystem, unit: str, first: tuple[str, str] = _TIMES
) -> Points:
    """The points of a file.

    Parameters
    ----------
    path : Path
        The file.
    columns : Columns
        What to take.
    units : UnitSystem
        Units of the numbers, unless the columns have their own.
    unit : str
        SI unit of the second column.
    first : pair of str
        SI unit of the first column, and what it holds.

    Raises
    ------
    SceneError
        No such file or column, no number, or a first column that does not increase.
    """
    lines = list(read_lines(path))
    if not lines:
        raise SceneError(f"{path.name} holds no numbers")
    has_header = not any(number_in(cell) is not None for cell in lines[0][1])
    header = lines.pop(0)[1] if has_header else []
    places = [_place(path, name, header) for name in columns.names]
    scales = _scales(columns.units, units, (first[0], unit))
    points: list[tuple[float, float]] = []
    for number, cells in lines:
        x, y = (_cell(path, number, cells, place) for place in places)
        if points and not x * scales[0] > points[-1][0]:
            what = f"{first[1]} must increase, {x:g} does not lie after the one before"
            raise SceneError(f"{path.name}, line {number}: {what}")
        points.append((x * scales[0], y * scales[1]))
    return tuple(points)


def read_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line of a text file that is not empty."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError(f'there is no file "{path}"') from None
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text"
        raise SceneError(f'the file "{path}" cannot be read: {why}') from None
    lines = (line.partition("#")[0] for line in text.splitlines())
    for number, line in enumerate(lines, start=1):
        if line.strip():
            mark = next((c for c in ";\t," if c in line), None)
            cells = line.split(mark) if mark else re.split(r"\s+", line.strip())
            yield number, [cell.strip().strip('"') for cell in cells]


def number_in(cell: str) -> float | None:
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
        raise SceneError(f"{where}: there are {len(cells)} columns, no number {place + 1}")
    value = number_in(cells[place])
    if value is None:
        raise SceneError(f'{where}: "{cells[place]}" is no finite number')
    return value


def _scales(texts: tuple[str, str] | None, units: UnitSystem, si: tuple[str, str]) -> list[float]:
    """Factors of both columns to SI."""
    if texts is None:
        return [units.scale(unit) for unit in si]
    factors = []
    for text, unit in zip(texts, si, strict=True):
        own = parse_unit(text)
        if own.dimension != parse_unit(unit).dimension:
            raise SceneError(f'"{text}" is no unit of this column, "{unit}" is')
        factors.append(own.factor)
    return factors
