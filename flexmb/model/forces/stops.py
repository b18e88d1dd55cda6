"""Stops: on the distance of two markers, a displacement between them, or a coordinate of a joint.

Words and law are those of IMPACT and BISTOP of MSC Adams: at a penetration p of a bound the force
max(0, k p^e + c step(p / depth) dp/dt) pushes back, step the cubic from 0 to 1; its elastic part is
stored energy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.lookup import Component, Scope
from flexmb.model.plane import keeps_plane
from flexmb.model.quantities import Axis, Pair, Quantity, Size, Text
from flexmb.model.reading import fail, fail_if


class AnyStop(Component):
    """What all stops have; ``lower`` and ``upper`` have the unit of their coordinate."""

    lower: float | None = None
    upper: float | None = None
    stiffness: float
    exponent: Annotated[float, Quantity("", "positive")] = 1.0
    damping: float = 0.0
    depth: float | None = None

    @model_validator(mode="after")
    def _bounds(self) -> Self:
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
        """Lower and upper bound, infinite where there is none."""
        lower = -math.inf if self.lower is None else self.lower
        return lower, math.inf if self.upper is None else self.upper


_Place = Annotated[float, Quantity("m")]
_Angle = Annotated[float, Quantity("rad")]


class StopSpec(AnyStop):
    """Stops the distance of two markers, or with ``axis`` (global in the placed pose, carried by I)
    the displacement of J from I along it, at ``lower`` and ``upper``.

    At a penetration p it pushes back with ``stiffness * p**exponent``, stiffness being the force at
    a penetration of one unit, and damps with up to ``damping``, from ``depth`` on; never pulls.
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
    def _distances(self) -> Self:
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
    """Stops the angle of a joint, which counts turns, at ``lower`` and ``upper``; see stop.

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
