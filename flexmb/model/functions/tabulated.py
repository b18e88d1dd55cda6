"""Functions through points: splines and tables, the points in the scene or in a CSV file.

In: ``points = [[t, y], ...]`` or ``file = "motion.csv"`` with the columns to take. Out: operations
over t in SI. ``beyond`` selects the continuation before the first and after the last point.

Columns of a file are separated by comma, semicolon, tab or blanks; empty lines and comments after #
are skipped; a first line without numbers names the columns. Curves read their points (x, y) by the
same functions. Out: pairs in SI, or a problem that names the wrong point or line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.functions.expression import Ops
from flexmb.model.functions.forms import FunctionForm
from flexmb.model.functions.piecewise import Piecewise, akima_curve, cubic_spline, linear_curve
from flexmb.model.quantities import Text, plain, read_numbers
from flexmb.model.reading import (
    NAME,
    ReadContext,
    Reader,
    context_of,
    fail,
    list_form,
    quote,
    under,
)
from flexmb.units import UnitSystem, parse_unit

Points = tuple[tuple[float, float], ...]
_TIMES = ("s", "times")
_DECIMALS = "; decimals are written with a point, columns apart by commas, semicolons or tabs"
# characters of a cell quoted in a message; a longer one is neither number nor name
_MAX_QUOTED = 24
_MAX_BYTES = 2e8  # largest size of a file [bytes]


def read_points(value: Any, names: ReadContext, units: tuple[str, str], point: str) -> Points:
    """Points of a list in SI; ``point`` is its notation in messages, such as ``"[t, y]"``."""
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
    """The columns to take, by name or by number from 1 on, and their units (None: the scene's)."""

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
        Names or numbers of the columns, and their units.
    units : UnitSystem
        Units of the numbers, unless the columns state their own.
    unit : str
        SI unit of the second column.
    first : pair of str
        SI unit of the first column, and what it contains.

    Raises
    ------
    SceneError
        No such file or column, no number, or a first column that does not increase.
    """
    lines = list(read_lines(path))
    if not lines:
        raise SceneError(f"{path.name} holds no numbers")
    has_header = not any(number_in(cell) is not None for cell in lines[0][1])
    _check_widths(path, lines)
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
        if path.exists() and not path.is_file():
            raise SceneError(f'"{path}" is no file')
        if path.exists() and path.stat().st_size > _MAX_BYTES:
            raise SceneError(f'the file "{path}" has more than {_MAX_BYTES / 1e6:g} MB')
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


def _check_widths(path: Path, lines: Sequence[tuple[int, list[str]]]) -> None:
    """Refuse lines with more or fewer cells than the first; decimal commas split numbers this
    way."""
    first, *widths = ((number, _width(cells)) for number, cells in lines)
    for number, width in widths:
        if width != first[1]:
            what = f"there are {width} columns, line {first[0]} has {first[1]}"
            raise SceneError(f"{path.name}, line {number}: {what}{_DECIMALS}")


def _width(cells: Sequence[str]) -> int:
    """Number of cells, not counting empty ones at the end."""
    return max((k for k, cell in enumerate(cells, 1) if cell), default=0)


def number_in(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _place(path: Path, name: str | int, header: list[str]) -> int:
    """Index of a column in a line, from 0 on."""
    if isinstance(name, int):
        return name - 1
    if name not in header:
        short = len(header) > 1 and all(len(cell) <= _MAX_QUOTED for cell in header)
        # otherwise it is not a header; its text is not repeated
        names = tuple(header) if short else ()
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
        shown = f'"{cells[place]}"' if len(cells[place]) <= _MAX_QUOTED else "its text"
        decimals = _DECIMALS if number_in(cells[place].replace(",", ".", 1)) is not None else ""
        raise SceneError(f"{where}: {shown} is no finite number{decimals}")
    return value


def _scales(texts: tuple[str, str] | None, units: UnitSystem, si: tuple[str, str]) -> list[float]:
    """Factors that convert both columns to SI."""
    if texts is None:
        return [units.scale(unit) for unit in si]
    factors = []
    for text, unit in zip(texts, si, strict=True):
        own = parse_unit(text)
        if own.dimension != parse_unit(unit).dimension:
            raise SceneError(f'"{text}" is no unit of this column, "{unit}" is')
        factors.append(own.factor)
    return factors


def _points(value: Any, info: ValidationInfo) -> Points:
    """Pairs of a time and a value, in SI."""
    names = context_of(info)
    points = read_points(value, names, ("s", names.expected_unit or ""), "[t, y]")
    check_order([t for t, _ in points], names.units, "s", "times")
    return points


def _write_points(points: Points, info: SerializationInfo) -> Any:
    return written_points(points, context_of(info))


def written_points(points: Points, names: ReadContext) -> list[list[Any]]:
    """Points in the scene's units that read back as the same numbers."""
    units, slot = names.units, names.expected_unit or ""
    return [[units.written(t, "s"), units.written(y, slot)] for t, y in points]


def _column_names(value: Any, info: ValidationInfo) -> tuple[str | int, str | int]:
    value = plain(value)
    if not isinstance(value, list) or len(value) != 2:
        raise fail(Problem("", f"two columns, of t and of y, are expected, given {quote(value)}"))
    for i, name in enumerate(value):
        whole = isinstance(name, int) and not isinstance(name, bool) and name > 0
        if not (isinstance(name, str) or whole):
            what = "a column is a name of the first line or a number from 1 on"
            raise fail(Problem(f"[{i}]", f"{what}, given {quote(name)}"))
    return value[0], value[1]


def _file(value: Any, info: ValidationInfo) -> tuple[str, Points]:
    """The name of a file, and its points in SI."""
    names = context_of(info)
    if not isinstance(value, str) or not value.strip():
        raise fail(Problem("", f"the name of a file is expected, given {quote(value)}"))
    columns = Columns(info.data.get("columns") or (1, 2), info.data.get("units"))
    unit = names.expected_unit or ""
    return value, read_columns(names.folder / value, columns, names.units, unit)


def _write_file(value: tuple[str, Points], info: SerializationInfo) -> str:
    return value[0]


class Tabulated(FunctionForm):
    """Base of the forms through points."""

    points: Annotated[Points | None, Reader(_points, _write_points)] = None
    columns: Annotated[
        tuple[str | int, str | int] | None, Reader(_column_names, form=list_form(NAME, 2))
    ] = None
    units: tuple[Text, Text] | None = None
    file: Annotated[tuple[str, Points] | None, Reader(_file, _write_file, {"type": "string"})] = (
        None
    )
    beyond: Literal["error", "hold", "extrapolate", "repeat"] = "error"

    @model_validator(mode="after")
    def _check_source(self, info: ValidationInfo) -> Self:
        if (self.points is None) == (self.file is None):
            raise fail(Problem("", 'give either "points" or "file"'))
        for name in ("columns", "units"):
            if getattr(self, name) is not None and self.file is None:
                raise fail(Problem(name, "belongs to a file; the scene says its own units"))
        if len(self.pairs) < 2:
            where = "points" if self.file is None else "file"
            raise fail(Problem(where, f"two points or more are needed, given {len(self.pairs)}"))
        return self

    @property
    def pairs(self) -> Points:
        """The points, in SI."""
        if self.file is not None:
            return self.file[1]
        assert self.points is not None  # either points or file is given
        return self.points

    def curve(self, t: Any, y: Any) -> Piecewise:
        raise NotImplementedError

    def ops(self) -> Ops:
        t, y = np.array(self.pairs).T
        return (("t", 0.0), ("piecewise", self.curve(t, y)))

    def written(self, table: Any, names: ReadContext) -> Any:
        """The table with the points of the file."""
        if self.file is None:
            return table
        left = {k: v for k, v in table.items() if k not in ("file", "columns", "units")}
        return {**left, "points": written_points(self.pairs, names)}


class CubicSpline(Tabulated):
    """cubic spline through points, with two continuous derivatives.

    Ends: natural (no curvature), clamped (level) or periodic. Beyond the points: an error, their
    first and last value (hold), the same cubics (extrapolate), or all over again (repeat). The
    two columns of a file are named as in its first line, or numbered from 1 on.
    """

    type: Literal["spline"]
    ends: Literal["natural", "clamped", "periodic"] = "natural"

    @model_validator(mode="after")
    def _check_ends(self, info: ValidationInfo) -> Self:
        if self.ends == "periodic":
            first, last = self.pairs[0][1], self.pairs[-1][1]
            if len(self.pairs) < 3:
                raise fail(Problem("ends", "a periodic spline needs three points or more"))
            if abs(last - first) > 1e-9 * max(abs(y) for _, y in self.pairs):
                what = "a periodic spline ends with the value that it begins with: "
                units, slot = context_of(info).units, context_of(info).expected_unit or ""
                what += f"{units.say(first, slot)} and {units.say(last, slot)} differ"
                raise fail(Problem("ends", what))
        return self

    def curve(self, t: Any, y: Any) -> Piecewise:
        return cubic_spline(t, y, self.ends, self.beyond)


class AkimaSpline(Tabulated):
    """cubics through points that do not overshoot at corners, one continuous derivative.

    Points, file and what is beyond them as for a spline.
    """

    type: Literal["akima"]

    def curve(self, t: Any, y: Any) -> Piecewise:
        return akima_curve(t, y, self.beyond)


class Table(Tabulated):
    """straight lines from point to point.

    Points, file and what is beyond them as for a spline. Its slope jumps at the points.
    """

    type: Literal["table"]

    def curve(self, t: Any, y: Any) -> Piecewise:
        return linear_curve(t, y, self.beyond)
