"""Functions through points: splines and tables, the points in the scene or in a CSV file.

In: ``points = [[t, y], ...]`` or ``file = "motion.csv"`` with the columns to take. Out: operations
over t in SI. What holds beyond the first and the last point is said by ``beyond``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.expression import Ops
from flexmb.model.functions.forms import FunctionForm
from flexmb.model.functions.piecewise import (
    Piecewise,
    akima_curve,
    cubic_spline,
    linear_curve,
)
from flexmb.model.values.columns import Columns, read_columns
from flexmb.model.values.quantities import Text, plain, read_number
from flexmb.model.values.reading import (
    NAME,
    Names,
    Reader,
    fail,
    folder_of,
    given,
    list_form,
    names_of,
    slot_of,
    under,
    units_of,
)

Points = tuple[tuple[float, float], ...]


def _points(value: Any, info: ValidationInfo) -> Points:
    """Pairs of a time and a value, in SI."""
    names = names_of(info)
    units = units_of(names)
    value = plain(value)
    if not isinstance(value, list) or not all(isinstance(p, list) and len(p) == 2 for p in value):
        raise fail(Problem("", f"a list of points [t, y] is expected, given {given(value)}"))
    found, problems = [], []
    for i, point in enumerate(value):
        row = []
        for k, unit in enumerate(("s", slot_of(names) or "")):
            try:
                row.append(read_number(point[k], names, unit) * units.scale(unit))
            except SceneError as error:
                problems += under(f"[{i}][{k}]", error.problems)
        found.append((row[0], row[-1]) if len(row) == 2 else (float(i), 0.0))
        if i and not problems and found[i][0] <= found[i - 1][0]:
            before, now = (units.say(found[j][0], "s") for j in (i - 1, i))
            what = f"times must increase: {now} does not lie after {before}"
            problems.append(Problem(f"[{i}]", what))
    if problems:
        raise fail(*problems)
    return tuple(found)


def _write_points(points: Points, info: SerializationInfo) -> Any:
    return written_points(points, names_of(info))


def written_points(points: Points, names: Names) -> list[list[Any]]:
    """Points in the scene's units, such that reading gives the same."""
    units, slot = units_of(names), slot_of(names) or ""
    return [[units.written(t, "s"), units.written(y, slot)] for t, y in points]


def _column_names(value: Any, info: ValidationInfo) -> tuple[str | int, str | int]:
    value = plain(value)
    if not isinstance(value, list) or len(value) != 2:
        raise fail(Problem("", f"two columns, of t and of y, are expected, given {given(value)}"))
    for i, name in enumerate(value):
        whole = isinstance(name, int) and not isinstance(name, bool) and name > 0
        if not (isinstance(name, str) or whole):
            what = "a column is a name of the first line or a number from 1 on"
            raise fail(Problem(f"[{i}]", f"{what}, given {given(name)}"))
    return value[0], value[1]


def _file(value: Any, info: ValidationInfo) -> tuple[str, Points]:
    """The name of a file, and its points in SI."""
    names = names_of(info)
    if not isinstance(value, str) or not value.strip():
        raise fail(Problem("", f"the name of a file is expected, given {given(value)}"))
    told = Columns(info.data.get("columns") or (1, 2), info.data.get("units"))
    try:
        points = read_columns(folder_of(names) / value, told, units_of(names), slot_of(names) or "")
    except SceneError as error:
        raise fail(*error.problems) from None
    return value, points


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
    def _points_or_file(self, info: ValidationInfo) -> Self:
        if (self.points is None) == (self.file is None):
            raise fail(Problem("", 'give either "points" or "file"'))
        for name in ("columns", "units"):
            if getattr(self, name) is not None and self.file is None:
                raise fail(Problem(name, "belongs to a file; the scene says its own units"))
        if len(self.known) < 2:
            where = "points" if self.file is None else "file"
            raise fail(Problem(where, f"two points or more are needed, given {len(self.known)}"))
        return self

    @property
    def known(self) -> Points:
        """The points, in SI."""
        if self.file is not None:
            return self.file[1]
        assert self.points is not None  # one of them is given
        return self.points

    def curve(self, t: Any, y: Any) -> Piecewise:
        raise NotImplementedError

    def ops(self) -> Ops:
        t, y = np.array(self.known).T
        return (("t", 0.0), ("piecewise", self.curve(t, y)))

    def written(self, table: Any, names: Names) -> Any:
        """With the points in place of the file."""
        if self.file is None:
            return table
        left = {k: v for k, v in table.items() if k not in ("file", "columns", "units")}
        return {**left, "points": written_points(self.known, names)}


class CubicSpline(Tabulated):
    """cubic spline through points, with two continuous derivatives.

    Ends: natural (no curvature), clamped (level) or periodic. Beyond the points: an error, their
    first and last value (hold), the same cubics (extrapolate), or all over again (repeat). A file
    has its two columns told by their names in the first line or by numbers from 1 on.
    """

    type: Literal["spline"]
    ends: Literal["natural", "clamped", "periodic"] = "natural"

    @model_validator(mode="after")
    def _closed(self, info: ValidationInfo) -> Self:
        if self.ends == "periodic":
            first, last = self.known[0][1], self.known[-1][1]
            if len(self.known) < 3:
                raise fail(Problem("ends", "a periodic spline needs three points or more"))
            if abs(last - first) > 1e-9 * max(abs(y) for _, y in self.known):
                what = "a periodic spline ends with the value that it begins with: "
                units, slot = units_of(names_of(info)), slot_of(names_of(info)) or ""
                what += f"{units.say(first, slot)} and {units.say(last, slot)} differ"
                raise fail(Problem("ends", what))
        return self

    def curve(self, t: Any, y: Any) -> Piecewise:
        return cubic_spline(t, y, self.ends, self.beyond)


class AkimaSpline(Tabulated):
    """cubics through points that do not overshoot beside corners, one continuous derivative.

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
