"""Curves that joints slide along: their shape alone, in the axes of the marker that carries them.

A curve is a spline through points, a polar or parametric expression in the parameter t, or a
circle, in the plane x, y of its marker or, with three coordinates, in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.model.functions import jets
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.values.quantities import Angle, Length, Number, Size, Text, plain, read_number
from flexmb.model.values.reading import Names, Reader, Spec, fail, given, names_of, units_of
from flexmb.model.values.unit_texts import expression_and_factor
from flexmb.units import UnitSystem

__all__ = ["CurveSpec", "Points", "Profile", "read_points"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """A length as an expression in the parameter t of a curve; its program gives it in SI."""

    given: float | str
    ops: Ops

    def values(self, t: Array) -> Array:
        """(n, 3) value [m], first and second derivative in t at parameters (n,)."""
        return np.array([jets.evaluate(self.ops, float(u)) for u in t]).reshape(-1, 3)


def _profile(value: Any, info: ValidationInfo) -> Profile:
    if isinstance(value, Profile):
        return value
    names: Names = names_of(info)
    scale = units_of(names).scale("m")
    try:
        if not isinstance(value, str):
            return Profile(value, (("const", read_number(value, names) * scale),))
        text, factor = expression_and_factor(value, names, "m", time=True)
        ops = parse(text, names).ops
    except SceneError as error:
        raise fail(*error.problems) from None
    return Profile(value, (*ops, ("const", factor * scale), ("*", 0.0)))


def _written(value: Profile, info: SerializationInfo) -> float | str:
    return value.given


Coordinate = Annotated[Profile, Reader(_profile, _written)]
Points = Annotated[tuple[tuple[Length, ...], ...], BeforeValidator(plain)]
_SHAPES = ("points", "file", "polar", "polar_points", "x", "circle")


class CurveSpec(Spec):
    """The shape of a curve: exactly one of ``points``, ``file`` (a CSV table of points), ``polar``
    (radius over the angle t), ``polar_points`` (angles and radii), ``x`` with ``y`` over t,
    ``circle`` (a radius). ``range`` of t, one turn by default; ``closed``: its end goes on at its
    beginning.
    """

    points: Points | None = None
    file: Text | None = None
    polar: Coordinate | None = None
    polar_points: Annotated[tuple[tuple[Angle, Length], ...], BeforeValidator(plain)] | None = None
    x: Coordinate | None = None
    y: Coordinate | None = None
    z: Coordinate | None = None
    range: tuple[Number, Number] = (0.0, 2 * np.pi)
    circle: Size | None = None
    center: tuple[Length, Length] = (0.0, 0.0)
    closed: bool = False

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        told = [key for key in _SHAPES if getattr(self, key) is not None]
        if len(told) != 1:
            shown = " and ".join(told) or "none of them"
            raise fail(Problem("", f"give exactly one of {', '.join(_SHAPES)}, given {shown}"))
        problems = []
        if told != ["x"] and (self.y is not None or self.z is not None):
            problems.append(Problem("y", "only a curve given by x, y (and z) has them"))
        if told == ["x"] and self.y is None:
            problems.append(Problem("y", "is missing beside x"))
        if "range" in self.model_fields_set and told[0] not in ("polar", "x"):
            problems.append(Problem("range", "only curves given by expressions in t have a range"))
        if not self.range[0] < self.range[1]:
            problems.append(Problem("range", "its second value must be larger than the first"))
        if "center" in self.model_fields_set and told != ["circle"]:
            problems.append(Problem("center", "only a circle has a center"))
        if told == ["circle"] and "closed" in self.model_fields_set and not self.closed:
            problems.append(Problem("closed", "a circle is closed; leave it out"))
        if problems:
            raise fail(*problems)
        return self

    @property
    def in_plane(self) -> bool:
        """Whether it is told by two coordinates, in the plane x, y of its marker.

        A file is known once it is read.
        """
        flat = self.points is None or all(len(point) == 2 for point in self.points)
        return flat and self.z is None


def read_points(path: Path, units: UnitSystem) -> Points:
    """Points of a CSV file, two or three columns in the scene's unit of length, in SI.

    Values stand apart by commas, semicolons or blanks; the first row may name the columns, and what
    follows # is left out.

    Raises
    ------
    SceneError
        The file cannot be read, or a row holds no numbers.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        what = f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        raise SceneError.from_problems([Problem("file", what)]) from None
    rows: list[tuple[float, ...]] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(";", " ").replace(",", " ").split()
        try:
            row = tuple(float(word) * units.scale("m") for word in words)
        except ValueError:
            if not rows:
                continue  # the names of the columns
            row = (np.nan,)
        if words and (len(row) not in (2, 3) or not np.isfinite(row).all()):
            what = f"{path}: line {number} is no point of two or three numbers: {given(line)}"
            raise SceneError.from_problems([Problem("file", what)])
        if words:
            rows.append(row)
    return tuple(rows)
