"""Functions through points: splines and tables, the points in the scene or in a CSV file.

In: ``points = [[t, y], ...]`` or ``file = "motion.csv"`` with the columns to take. Out: operations
over t in SI. What holds beyond the first and the last point is said by ``beyond``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.functions.expression import Ops
from flexmb.model.functions.forms import FunctionForm
from flexmb.model.functions.piecewise import (
    Piecewise,
    akima_curve,
    cubic_spline,
    linear_curve,
)
from flexmb.model.values.points import Columns, Points, check_order, read_columns, read_points
from flexmb.model.values.quantities import Text, plain
from flexmb.model.values.reading import (
    NAME,
    ReadContext,
    Reader,
    context_of,
    fail,
    list_form,
    quote,
)


def _points(value: Any, info: ValidationInfo) -> Points:
    """Pairs of a time and a value, in SI."""
    names = context_of(info)
    points = read_points(value, names, ("s", names.expected_unit or ""), "[t, y]")
    check_order([t for t, _ in points], names.units, "s", "times")
    return points


def _write_points(points: Points, info: SerializationInfo) -> Any:
    return written_points(points, context_of(info))


def written_points(points: Points, names: ReadContext) -> list[list[Any]]:
    """Points in the scene's units, such that reading gives the same."""
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
    def _points_or_file(self, info: ValidationInfo) -> Self:
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
        assert self.points is not None  # one of them is given
        return self.points

    def curve(self, t: Any, y: Any) -> Piecewise:
        raise NotImplementedError

    def ops(self) -> Ops:
        t, y = np.array(self.pairs).T
        return (("t", 0.0), ("piecewise", self.curve(t, y)))

    def written(self, table: Any, names: ReadContext) -> Any:
        """With the points in place of the file."""
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
    def _closed(self, info: ValidationInfo) -> Self:
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
