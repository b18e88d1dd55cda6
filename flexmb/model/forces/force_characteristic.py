"""Force characteristics of springs and dampers: a force over a deflection or a speed.

In: an expression in its own variable (``"k*x + k3*x**3"``, ``"c*v*abs(v)"``), a list of points
``[[x, force], ...]``, or a table ``{points = [...], interpolation = "akima"}`` or ``{file =
"spring.csv", ...}``; all in the scene's units. Out: a :class:`ForceCharacteristic`, which stores
the input (of a file its points) and programs in SI. Beyond its end points a tabulated
characteristic continues as a straight line.

Stops act on the distance of two markers, a displacement between them, or a coordinate of a joint.
Options and law are those of IMPACT and BISTOP of MSC Adams: at a penetration p of a bound the force
max(0, k p^e + c step(p / depth) dp/dt) pushes back, where step is the cubic from 0 to 1; the
elastic part is stored energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
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
from flexmb.model.lookup import Component, Scope
from flexmb.model.plane import keeps_plane
from flexmb.model.quantities import Axis, Pair, Quantity, Size, Text, expression_and_factor, plain
from flexmb.model.reading import (
    NUMBER,
    FieldType,
    Form,
    Names,
    ReadContext,
    Spec,
    context_of,
    fail,
    fail_if,
    list_form,
    quote,
    read_entry,
    reference,
)


class CharacteristicTable(Spec):
    """Points [x, force] with increasing x, or a file of two columns; straight lines beyond its
    ends.

    ``monotone`` (Fritsch and Carlson) has no extremes between points, ``akima`` hardly any,
    ``cubic`` has a continuous second derivative (natural ends).
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
    """A force characteristic: the user's input, and its program in SI over x or v instead of t.

    For a tabulated characteristic also the antiderivative from 0: the stored energy.
    """

    source: Any
    expression: Expression
    stored: Expression | None = None


@dataclass(frozen=True)
class CharacteristicOf(FieldType):
    """Annotation of a :class:`ForceCharacteristic`: its variable, SI unit of that, SI unit of the
    force."""

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
        """A characteristic from any of its notations.

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
        """The program of an expression in SI."""
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
        """Points in SI with increasing variable."""
        point = f"[{self.variable}, force]"
        points = read_points(rows, names, (self.unit, self.force), point)
        if len(points) < 2:
            raise SceneError(f"at least two points are expected, given {len(points)}")
        check_order([x for x, _ in points], names.units, self.unit, "points")
        return points


def _tabulated(source: Any, points: Points, interpolation: str) -> ForceCharacteristic:
    """The characteristic through points, straight beyond the first and last."""
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


class AnyStop(Component):
    """Options of all stops; ``lower`` and ``upper`` have the unit of the coordinate."""

    lower: float | None = None
    upper: float | None = None
    stiffness: float
    exponent: Annotated[float, Quantity("", "positive")] = 1.0
    damping: float = 0.0
    depth: float | None = None

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        problems = []
        if self.lower is None and self.upper is None:
            problems.append(Problem("", 'needs "lower", "upper" or both'))
        elif self.lower is not None and self.upper is not None and self.lower >= self.upper:
            what = "must lie above lower: between them the stop is clear"
            problems.append(Problem("upper", what))
        if self.exponent < 1.0:
            what = f"must be at least 1, is {self.exponent:g}: a stop stiffest at first touch jumps"
            problems.append(Problem("exponent", what))
        if self.damping > 0.0 and self.depth is None:
            what = "is missing: the penetration at which the whole damping acts"
            problems.append(Problem("depth", what))
        fail_if(problems)
        return self

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound; infinite if not given."""
        lower = -math.inf if self.lower is None else self.lower
        return lower, math.inf if self.upper is None else self.upper


_Place = Annotated[float, Quantity("m")]
_Angle = Annotated[float, Quantity("rad")]


class StopSpec(AnyStop):
    """Stops the distance of two markers, or with ``axis`` (global in the placed pose, fixed to I)
    the displacement of J from I along it, at ``lower`` and ``upper``. At a penetration p it pushes
    back with ``stiffness * p**exponent``, where stiffness is the force at a penetration of one
    unit, and with damping that rises to ``damping`` at the penetration ``depth``; it never pulls.
    """

    type: Literal["stop"]
    between: Pair
    axis: Axis | None = None
    lower: _Place | None = None
    upper: _Place | None = None
    stiffness: Annotated[float, Quantity("N/m", "positive")]
    exponent: Annotated[float, Quantity("", "positive")] = 1.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    depth: Size | None = None

    @model_validator(mode="after")
    def _check_distances(self) -> Self:
        if self.axis is None:
            for word in ("lower", "upper"):
                value = getattr(self, word)
                if value is not None and value <= 0.0:
                    what = "must be positive: a distance is (give axis for a displacement)"
                    raise fail(Problem(word, what))
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a stop")
        if self.axis is None:
            yield from scope.line_problems(where, self.between, "distance")

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        if self.axis is not None and not keeps_plane(self.axis, plane):
            yield Problem(f"{where}.axis", f"must lie in the plane {plane}")


class JointStopSpec(AnyStop):
    """A stop on a coordinate of a joint."""

    joint: Text

    @property
    def coordinate(self) -> str:
        """``"angle"``, ``"second_angle"`` or ``"stroke"``."""
        raise NotImplementedError

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.coordinate(where, self.joint, self.coordinate)


class RotationalStopSpec(JointStopSpec):
    """Stops the angle of a joint, counted over several revolutions, at ``lower`` and ``upper``; see
    stop.

    ``about = "second_axis"``: the second angle of a universal joint.
    """

    type: Literal["rotational-stop"]
    about: Literal["axis", "second_axis"] = "axis"
    lower: _Angle | None = None
    upper: _Angle | None = None
    stiffness: Annotated[float, Quantity("N m/rad", "positive")]
    damping: Annotated[float, Quantity("N m s/rad", "not negative")] = 0.0
    depth: Annotated[float, Quantity("rad", "positive")] | None = None

    @property
    def coordinate(self) -> str:
        return "angle" if self.about == "axis" else "second_angle"


class TranslationalStopSpec(JointStopSpec):
    """Stops the stroke of a joint at ``lower`` and ``upper``; see stop."""

    type: Literal["translational-stop"]
    lower: _Place | None = None
    upper: _Place | None = None
    stiffness: Annotated[float, Quantity("N/m", "positive")]
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    depth: Size | None = None

    @property
    def coordinate(self) -> str:
        return "stroke"
