"""Laws of springs and dampers: a force as a function of a deflection or a speed.

In: an expression in its own variable (``"k*x + k3*x**3"``, ``"c*v*abs(v)"``), a list of points
``[[x, force], ...]``, or a table ``{points = [...], interpolation = "akima"}`` or
``{file = "spring.csv", ...}``; all in the scene's units. Out: a :class:`Law`, which keeps what was
given and holds the expression, or the points, in SI. Beyond its ends a tabulated law goes on
straight.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import GetCoreSchemaHandler, ValidationInfo
from pydantic_core import core_schema

from flexmb.errors import Problem, SceneError
from flexmb.model.expression import Expression, Ops, parse
from flexmb.model.quantities import plain, read_number
from flexmb.model.reading import Names, Spec, fail, given, names_of, read_entry, units_of
from flexmb.model.unit_texts import expression_and_factor

__all__ = ["INTERPOLATIONS", "Law", "LawOf", "LawTable"]

INTERPOLATIONS = ("monotone", "akima", "cubic", "linear")
Points = tuple[tuple[float, float], ...]


class LawTable(Spec):
    """Points [x, force] with x increasing, or a file of two columns; straight beyond its ends.

    ``monotone`` (Fritsch and Carlson) makes no new extremes, ``akima`` hardly any, ``cubic`` has a
    continuous second derivative (natural ends).
    """

    points: tuple[tuple[Any, Any], ...] | None = None
    file: str | None = None
    interpolation: Literal["monotone", "akima", "cubic", "linear"] = "monotone"


@dataclass(frozen=True)
class Law:
    """A law: what the user gave, and its expression or its points in SI.

    A law from a file has neither; ``points_in(folder)`` reads it. ``scales`` are one unit of the
    variable and of the force, in SI.
    """

    given: Any
    scales: tuple[float, float]
    expression: Expression | None = None
    points: Points | None = None
    file: str | None = None
    interpolation: str = "monotone"

    def points_in(self, folder: Path) -> Points:
        """The points in SI; of a file beside the scene if need be.

        Raises
        ------
        SceneError
            A file that cannot be read, or no increasing numbers in it.
        """
        if self.file is None:
            assert self.points is not None  # the caller asks of tables only
            return self.points
        rows = _read_csv(folder / self.file)
        _refuse_disorder([x for x, _ in rows], self.file)
        x, y = self.scales
        return tuple((a * x, b * y) for a, b in rows)


@dataclass(frozen=True)
class LawOf:
    """Annotation of a :class:`Law`: its variable with its SI unit, and that of the force."""

    variable: str
    unit: str
    force: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any, info: ValidationInfo) -> Law:
            try:
                return self.read(value, names_of(info))
            except SceneError as error:
                raise fail(*error.problems) from None

        written = core_schema.plain_serializer_function_ser_schema(lambda law: law.given)
        return core_schema.with_info_plain_validator_function(read, serialization=written)

    def read(self, value: Any, names: Names) -> Law:
        """The law from any of the ways to say it.

        Raises
        ------
        SceneError
            All that is wrong with it.
        """
        if isinstance(value, Law):
            return value
        value = plain(value)
        units = units_of(names)
        scales = units.scale(self.unit), units.scale(self.force)
        if isinstance(value, str):
            return Law(value, scales, expression=self._expression(value, names, scales))
        if isinstance(value, list):
            return Law(value, scales, points=self._points(value, names))
        if not isinstance(value, Mapping):
            raise SceneError(
                f"an expression in {self.variable}, a list of points [{self.variable}, force] or "
                f"a table with points or file is expected, given {given(value)}"
            )
        table, problems = read_entry(LawTable, value, names)
        if table is None:
            raise SceneError.from_problems(problems)
        if (table.points is None) == (table.file is None):
            raise SceneError('give one of "points" and "file"')
        points = None if table.points is None else self._points(plain(table.points), names)
        return Law(value, scales, None, points, table.file, table.interpolation)

    def _expression(self, text: str, names: Names, scales: tuple[float, float]) -> Expression:
        """The program in SI, its variable in place of time."""
        if self.variable in names:
            what = f'"{self.variable}" is the variable of this law and a parameter'
            raise SceneError(f"{what}: rename the parameter")
        front, factor = expression_and_factor(text, names, self.force)
        ops = parse(front, names, variable=self.variable).ops
        return Expression(text, _scaled(ops, scales[0], factor * scales[1]))

    def _points(self, rows: list[Any], names: Names) -> Points:
        """Points in SI, their variable increasing."""
        units = units_of(names)
        found, problems = [], []
        for i, row in enumerate(rows):
            if not isinstance(row, list) or len(row) != 2:
                what = f"a point [{self.variable}, force] is expected, given {given(row)}"
                problems.append(Problem(f"[{i}]", what))
                continue
            try:
                x, y = (
                    read_number(item, names, unit) * units.scale(unit)
                    for item, unit in zip(row, (self.unit, self.force), strict=True)
                )
                found.append((x, y))
            except SceneError as error:
                problems += [
                    Problem(f"[{i}]", p.what, p.allowed, p.nearest) for p in error.problems
                ]
        if problems:
            raise SceneError.from_problems(problems)
        _refuse_disorder([x / units.scale(self.unit) for x, _ in found])
        return tuple(found)


def _scaled(ops: Ops, x: float, y: float) -> Ops:
    """A program in the scene's units as one in SI: its variable over x, its value times y."""
    if x != 1.0:
        own = (("t", 0.0), ("const", x), ("/", 0.0))
        ops = tuple(step for op in ops for step in (own if op[0] == "t" else (op,)))
    return ops if y == 1.0 else (*ops, ("const", y), ("*", 0.0))


def _refuse_disorder(x: list[float], file: str | None = None) -> None:
    where = "" if file is None else f"{file}: "
    if len(x) < 2:
        raise SceneError(f"{where}at least two points are expected, given {len(x)}")
    for k in range(1, len(x)):
        if not x[k] > x[k - 1]:
            what = f"points must increase: point {k + 1} at {x[k]:g} follows {x[k - 1]:g}"
            raise SceneError(where + what)


def _read_csv(path: Path) -> list[tuple[float, float]]:
    """Rows of two numbers, separated by commas or semicolons; lines of words on top are skipped."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise SceneError(f"{path}: is no text in UTF-8") from None
    rows: list[tuple[float, float]] = []
    delimiter = ";" if ";" in text else ","
    for number, cells in enumerate(csv.reader(text.splitlines(), delimiter=delimiter), start=1):
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        try:
            pair = tuple(float(cell) for cell in cells if cell.strip())
        except ValueError:
            if not rows:
                continue  # headings
            raise SceneError(f"{path}: line {number} holds no numbers") from None
        if len(pair) != 2 or not all(math.isfinite(item) for item in pair):
            raise SceneError(f"{path}: line {number} must hold two finite numbers")
        rows.append((pair[0], pair[1]))
    return rows
