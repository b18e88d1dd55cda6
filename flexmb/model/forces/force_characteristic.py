"""Force characteristics of springs and dampers: a force over a deflection or a speed.

In: an expression in its own variable (``"k*x + k3*x**3"``, ``"c*v*abs(v)"``), a list of points
``[[x, force], ...]``, or a table ``{points = [...], interpolation = "akima"}`` or
``{file = "spring.csv", ...}``; all in the scene's units. Out: a :class:`ForceCharacteristic`, which
stores the input (of a file its points) and programs in SI. Beyond its ends a tabulated
characteristic is a straight line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import SceneError
from flexmb.model.functions.expression import Expression, parse, rescaled
from flexmb.model.functions.piecewise import (
    Piecewise,
    akima_curve,
    cubic_spline,
    linear_curve,
    monotone_curve,
    straight_beyond,
)
from flexmb.model.functions.tabulated import Columns, Points, check_order, read_columns, read_points
from flexmb.model.quantities import expression_and_factor, plain
from flexmb.model.reading import (
    NUMBER,
    FieldType,
    Form,
    Names,
    ReadContext,
    Spec,
    context_of,
    list_form,
    quote,
    read_entry,
    reference,
)


class CharacteristicTable(Spec):
    """Points [x, force] with x increasing, or a file of two columns; straight beyond its ends.

    ``monotone`` (Fritsch and Carlson) makes no new extremes, ``akima`` hardly any, ``cubic`` has a
    continuous second derivative (natural ends).
    """

    points: tuple[tuple[Any, Any], ...] | None = None
    file: str | None = None
    interpolation: Literal["monotone", "akima", "cubic", "linear"] = "monotone"


_CURVES: dict[str, Callable[[Any, Any, str], Piecewise]] = {
    "monotone": monotone_curve,
    "akima": akima_curve,
    "cubic": lambda x, y, beyond: cubic_spline(x, y, "natural", beyond),
    "linear": linear_curve,
}


@dataclass(frozen=True)
class ForceCharacteristic:
    """What the user wrote, and its program in SI, over its variable in place of time.

    Of a tabulated characteristic also its antiderivative, counted from 0: the stored energy.
    """

    source: Any
    expression: Expression
    stored: Expression | None = None


@dataclass(frozen=True)
class CharacteristicOf(FieldType):
    """Annotation of a :class:`ForceCharacteristic`: variable, its SI unit, that of the force."""

    variable: str
    unit: str
    force: str

    def read(self, value: Any, info: ValidationInfo) -> ForceCharacteristic:
        return self.read_characteristic(value, context_of(info))

    def write(self, value: Any, info: SerializationInfo) -> Any:
        return value.source

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        points = list_form(list_form(NUMBER, 2))
        forms = [{"type": "string"}, points, reference(CharacteristicTable)]
        return {"anyOf": forms, "description": "or an expression"}

    def read_characteristic(self, value: Any, context: Names) -> ForceCharacteristic:
        """The characteristic from any of its notations.

        Raises
        ------
        SceneError
            All that is wrong with it.
        """
        names = ReadContext.of(context)
        if isinstance(value, ForceCharacteristic):
            return value
        value = plain(value)
        if isinstance(value, str):
            return ForceCharacteristic(value, self._expression(value, names))
        if isinstance(value, list):
            return _tabulated(value, self._points(value, names), "monotone")
        if not isinstance(value, Mapping):
            raise SceneError(
                f"an expression in {self.variable}, a list of points [{self.variable}, force] or "
                f"a table with points or file is expected, given {quote(value)}"
            )
        table, problems = read_entry(CharacteristicTable, value, names)
        if table is None:
            raise SceneError.from_problems(problems)
        if (table.points is None) == (table.file is None):
            raise SceneError('give one of "points" and "file"')
        if table.file is None:
            return _tabulated(value, self._points(plain(table.points), names), table.interpolation)
        points = self._from_file(table.file, names)
        units = names.units
        written = [[units.written(x, self.unit), units.written(y, self.force)] for x, y in points]
        table_of_points = {"points": written, "interpolation": table.interpolation}
        return _tabulated(table_of_points, points, table.interpolation)

    def _expression(self, text: str, names: ReadContext) -> Expression:
        """The program in SI."""
        if self.variable in names:
            what = f'"{self.variable}" is the variable of this force characteristic and a parameter'
            raise SceneError(f"{what}: rename the parameter")
        units = names.units
        front, factor = expression_and_factor(text, names, self.force)
        ops = parse(front, names, variable=self.variable).ops
        return Expression(
            text, rescaled(ops, units.scale(self.unit), factor * units.scale(self.force))
        )

    def _from_file(self, file: str, names: ReadContext) -> Points:
        points = read_columns(
            names.folder / file, Columns((1, 2), None), names.units, self.force,
            (self.unit, "points"),
        )  # fmt: skip
        if len(points) < 2:
            raise SceneError(f"{file}: at least two points are expected, given {len(points)}")
        return points

    def _points(self, rows: Any, names: ReadContext) -> Points:
        """Points in SI, their variable increasing."""
        point = f"[{self.variable}, force]"
        points = read_points(rows, names, (self.unit, self.force), point)
        if len(points) < 2:
            raise SceneError(f"at least two points are expected, given {len(points)}")
        check_order([x for x, _ in points], names.units, self.unit, "points")
        return points


def _tabulated(source: Any, points: Points, interpolation: str) -> ForceCharacteristic:
    """The characteristic through points, straight beyond them."""
    x, y = zip(*points, strict=True)
    curve = straight_beyond(_CURVES[interpolation](x, y, "hold"))
    whole = curve.antiderivative()
    rows = whole.coefficients.copy()
    rows[:, 0] -= whole.jet(0.0)[0]
    stored = Piecewise(whole.knots, rows)
    force, energy = (
        Expression(f"a {interpolation} table", (("t", 0.0), ("piecewise", one)))
        for one in (curve, stored)
    )
    return ForceCharacteristic(source, force, energy)
