"""Drivers as rows: which primitives measure what they prescribe, and the function of each.

Coordinates of a marker are offsets along the axes of the marker that they are relative to (of
ground: the global ones) and an angle about its z axis, or the normal in a plane. A velocity or
acceleration is integrated here, so that every row is holonomic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flexmb.engine.joints import ANGLE, DISTANCE, DOT2
from flexmb.engine.joints.joint import X, row_constant
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.model import lookup
from flexmb.model.functions.antiderivatives import antiderivative
from flexmb.model.functions.expression import Expression
from flexmb.model.joints.driver import DriverSpec, Start, closing_problem
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model
from flexmb.model.plane import in_plane_triad

Kind = tuple[int, int, int]
Ends = tuple[PlacedMarker, PlacedMarker]


def marker_rows(
    model: Model, driver: DriverSpec, flexbodies: Mapping[str, FlexBody]
) -> tuple[PlacedMarker, PlacedMarker, list[Kind]]:
    """Both markers of a driver that is not of a joint, and the row of each of its motions."""
    I, J = lookup.frames(model, driver.ends, driver.axis, flexbodies)  # noqa: E741
    turn = np.eye(3)
    if model.plane is not None and driver.axis is None:
        turn = in_plane_triad(model.plane)
        I, J = lookup.with_axes(I, I.R @ turn), lookup.with_axes(J, J.R @ turn)  # noqa: E741
    rows = []
    for coordinate, _ in driver.motions(model.plane):
        if coordinate == "distance":
            rows.append((DISTANCE, X, X))
        elif coordinate == "angle":
            rows.append((ANGLE, X, X))
        else:
            axis = int(np.argmax(turn["xyz".index(coordinate)]))
            rows.append((DOT2, axis, axis))
    return I, J, rows


def driver_functions(model: Model, name: str, ends: Ends, rows: Sequence[Kind]) -> list[Expression]:
    """What each row follows over time.

    Raises
    ------
    SceneError
        A function that cannot be integrated, or a distance that comes to zero.
    """
    driver = model.drivers[name]
    expressions = []
    for k, motion in enumerate(driver.motions(model.plane)):
        expression = motion.function.expression
        if driver.order > 0:
            where = f"drivers.{name}.{motion.coordinate}"
            first = _first(driver.start, k)
            try:
                if first is None:
                    first = row_constant(model, (*rows[k], True), *ends)
                line = (first, _first(driver.start_velocity, k) or 0.0)
                expression = _integrated(model, driver.order, expression, line)
            except ZeroDivisionError:
                what = "the distance begins with zero: its direction is not known"
                raise SceneError.from_problems([Problem(where, what)]) from None
            except SceneError as error:
                problems = [Problem(where, problem.what) for problem in error.problems]
                raise SceneError.from_problems(problems) from None
            what = closing_problem(model, expression) if motion.coordinate == "distance" else None
            if what is not None:
                raise SceneError.from_problems([Problem(where, what)])
        expressions.append(expression)
    return expressions


def _integrated(
    model: Model, order: int, rate: Expression, line: tuple[float, float]
) -> Expression:
    """The displacement of a rate; `line` holds its first value and velocity."""
    spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
    end = max(spans, default=None)
    first, speed = line
    start = (("t", 0.0), ("const", speed), ("*", 0.0), ("const", first), ("+", 0.0))
    return Expression(rate.text, (*antiderivative(rate.ops, order, end), *start, ("+", 0.0)))


def _first(start: Start | None, k: int) -> float | None:
    return None if start is None else start.values[k]
