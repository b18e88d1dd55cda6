"""Curves that joints slide along: their shape alone, in the axes of the marker that carries them.

A curve is a spline through points, a polar or parametric expression in the parameter t, or a
circle; it lies in the plane x, y of its marker or, with three coordinates, in space. Splines are
cubic, natural or periodic, over the accumulated lengths of the chords between their points. A
:class:`CurveShape` gives value and derivatives. It is twice continuously differentiable between its
breaks, and also across them except at corners of expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, SerializationInfo, StrictBool, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import evaluate
from flexmb.model.functions.discontinuities import derivative_jumps
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.functions.tabulated import number_in, read_lines
from flexmb.model.lookup import Component, ModelData, Scope
from flexmb.model.quantities import (
    Angle,
    Length,
    Number,
    Size,
    Text,
    expression_and_factor,
    plain,
    read_number,
)
from flexmb.model.reading import NUMBER, Reader, context_of, fail_if, only_one, under
from flexmb.units import UnitSystem


@dataclass(frozen=True)
class Profile:
    """A length as an expression in the parameter t of a curve; ``ops`` is its program in SI."""

    source: float | str
    ops: Ops

    def values(self, t: Array) -> Array:
        """(n, 3) value [m], first and second derivative in t at parameters (n,)."""
        return np.array([evaluate(self.ops, float(u)) for u in t]).reshape(-1, 3)


def _profile(value: Any, info: ValidationInfo) -> Profile:
    if isinstance(value, Profile):
        return value
    names = context_of(info)
    scale = names.units.scale("m")
    if not isinstance(value, str):
        return Profile(value, (("const", read_number(value, names) * scale),))
    text, factor = expression_and_factor(value, names, "m", time=True)
    return Profile(value, (*parse(text, names).ops, ("const", factor * scale), ("*", 0.0)))


def _written(value: Profile, info: SerializationInfo) -> float | str:
    return value.source


Coordinate = Annotated[
    Profile, Reader(_profile, _written, {**NUMBER, "description": "[m], over t"})
]
Points = Annotated[tuple[tuple[Length, ...], ...], BeforeValidator(plain)]
_SHAPES = ("points", "file", "polar", "polar_points", "x", "circle")


class CurveSpec(Component):
    """The shape of a curve: exactly one of ``points``, ``file`` (a CSV table of points), ``polar``
    (radius over the angle t), ``polar_points`` (angles and radii), ``x`` with ``y`` over t,
    ``circle`` (a radius). ``range`` of t, 0 to 2 pi by default; ``closed``: its end joins its
    start.
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
    closed: StrictBool = False

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        shape = only_one(self, *_SHAPES)
        problems = []
        if shape != "x" and (self.y is not None or self.z is not None):
            problems.append(Problem("y", "only a curve given by x, y (and z) has them"))
        if shape == "x" and self.y is None:
            problems.append(Problem("y", "is missing: x and y are given together"))
        if "range" in self.model_fields_set and shape not in ("polar", "x"):
            problems.append(Problem("range", "only curves given by expressions in t have a range"))
        if not self.range[0] < self.range[1]:
            problems.append(Problem("range", "its second value must be larger than the first"))
        if "center" in self.model_fields_set and shape != "circle":
            problems.append(Problem("center", "only a circle has a center"))
        if shape == "circle" and "closed" in self.model_fields_set and not self.closed:
            problems.append(Problem("closed", "a circle is closed; leave it out"))
        fail_if(problems)
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        try:
            curve_shape(scope.model, where.partition(".")[2])
        except SceneError as error:
            yield from error.problems

    @property
    def in_plane(self) -> bool:
        """Whether it has two coordinates, in the plane x, y of its marker.

        For a file this is known once it is read.
        """
        flat = self.points is None or all(len(point) == 2 for point in self.points)
        return flat and self.z is None


def read_curve_file(path: Path, units: UnitSystem) -> Points:
    """Points of a CSV file, two or three columns in the scene's unit of length, in SI.

    Rows before the first row of numbers may name the columns.

    Raises
    ------
    SceneError
        The file cannot be read, or a row holds no numbers.
    """
    points: list[tuple[float, ...]] = []
    try:
        for number, cells in read_lines(path):
            row = [number_in(cell) for cell in cells]
            x = tuple(value * units.scale("m") for value in row if value is not None)
            if len(x) == len(row) in (2, 3):
                points.append(x)
            elif points or len(x) == len(row):
                raise SceneError(f"{path}: line {number} is no point of two or three numbers")
    except SceneError as error:
        raise SceneError.from_problems(under("file", error.problems)) from None
    return tuple(points)


_SAME_POINT = 1e-9  # points closer than this fraction of the curve's size are equal
_SAMPLES = 720
# speed of the point over t, relative to the largest, below which it is a cusp; where it vanishes
# round-off leaves 1e-8
_CUSP = 1e-4


@dataclass(frozen=True, eq=False)
class CurveShape:
    """A curve over a parameter u: at(u) gives (n, 3, 3), value and two derivatives, each x, y,
    z."""

    breaks: Array  # (k + 1,) parameters between which the curve is smooth
    at: Callable[[Array], Array]
    closed: bool
    in_plane: bool

    @property
    def length(self) -> float:
        """Length of the polygon through the points [m]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def samples(self) -> Array:
        """Equally spaced parameters from start to end, both included."""
        return np.linspace(self.breaks[0], self.breaks[-1], _SAMPLES + 1)

    @cached_property
    def points(self) -> Array:
        """(n, 3) points along the curve [m], both ends included."""
        points: Array = self.at(self.samples)[:, 0]
        return points


def curve_shape(model: ModelData, name: str) -> CurveShape:
    """The shape of a curve of a model.

    Raises
    ------
    SceneError
        What is wrong with the curve or its file.
    """
    spec = model.curves[name]
    try:
        points = spec.points
        if spec.file is not None:
            points = read_curve_file(model.path(spec.file), model.units)
        return shape_of(spec, points)
    except SceneError as error:
        raise SceneError.from_problems(under(f"curves.{name}", error.problems)) from None


@lru_cache(maxsize=64)  # checks, joints and pictures all need the curve
def shape_of(spec: CurveSpec, points: Points | None = None) -> CurveShape:
    """The shape of a curve; `points` (n, 2 or 3) [m] are those of its file or its own.

    Raises
    ------
    SceneError
        Too few or repeated points, ends that do not meet, a cusp, values that are not finite.
    """
    if points is not None:
        shape = _through(points, spec.closed)
    elif spec.polar_points is not None:
        shape = _polar_table(spec.polar_points, spec.closed)
    elif spec.circle is not None:
        shape = _circle(spec.circle, spec.center)
    else:
        shape = _expressions(spec)
    _check(shape)
    return shape


def _fail(where: str, what: str) -> SceneError:
    return SceneError.from_problems([Problem(where, what)])


def _through(points: Points, closed: bool) -> CurveShape:
    sizes = {len(point) for point in points}
    if not sizes <= {2, 3} or len(sizes) > 1:
        raise _fail("points", "all points have two coordinates, or all have three")
    least = 3 if closed else 2
    if len(points) < least:
        kind = "a closed curve" if closed else "a curve"
        raise _fail("points", f"{kind} needs {least} points at least, given {len(points)}")
    x = np.zeros((len(points), 3))
    x[:, : sizes.pop()] = points
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    if closed and np.linalg.norm(x[-1] - x[0]) <= _SAME_POINT * size:
        raise _fail("points", "the last point repeats the first; a closed curve closes by itself")
    ends = np.vstack([x, x[:1]]) if closed else x
    chords = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    if np.any(chords <= _SAME_POINT * size):
        k = int(np.argmin(chords))
        raise _fail("points", f"point {k + 2} repeats point {k + 1}; leave one of them out")
    return _spline(np.append(0.0, np.cumsum(chords)), ends, closed, len(points[0]) == 2)


def _spline(u: Array, x: Array, closed: bool, in_plane: bool) -> CurveShape:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(u, x, bc_type="periodic" if closed else "natural")
    return CurveShape(
        u, lambda t: np.stack([spline(t, n) for n in range(3)], axis=1), closed, in_plane
    )


def _polar(t: Array, r: Array) -> Array:
    """(n, 3, 3) position and two derivatives from radii (n, 3) and their derivatives over the angle
    t."""
    e = np.column_stack([np.cos(t), np.sin(t), 0.0 * t])
    n = np.column_stack([-np.sin(t), np.cos(t), 0.0 * t])
    r0, r1, r2 = (r[:, [k]] for k in range(3))
    return np.stack([r0 * e, r1 * e + r0 * n, (r2 - r0) * e + 2.0 * r1 * n], axis=1)


def _polar_table(pairs: tuple[tuple[float, float], ...], closed: bool) -> CurveShape:
    from scipy.interpolate import CubicSpline

    if len(pairs) < 3:
        raise _fail("polar_points", f"a curve needs 3 points at least, given {len(pairs)}")
    angle, radius = np.array(pairs).T
    if np.any(np.diff(angle) <= 0):
        k = int(np.argmax(np.diff(angle) <= 0))
        what = f"angles must increase; that of point {k + 2} does not exceed that of point {k + 1}"
        raise _fail("polar_points", what)
    if closed and abs(radius[-1] - radius[0]) > _SAME_POINT * np.abs(radius).max():
        what = "of a closed curve the last radius, one turn on, must be the first again"
        raise _fail("polar_points", what)
    radius = np.append(radius[:-1], radius[0]) if closed else radius
    spline = CubicSpline(angle, radius, bc_type="periodic" if closed else "natural")

    def at(t: Array) -> Array:
        return _polar(t, np.column_stack([spline(t, n) for n in range(3)]))

    return CurveShape(angle, at, closed, True)


def _circle(radius: float, center: tuple[float, float]) -> CurveShape:
    def at(t: Array) -> Array:
        x = _polar(t, np.column_stack([radius + 0.0 * t, 0.0 * t, 0.0 * t]))
        x[:, 0, :2] += center
        return x

    return CurveShape(np.array([0.0, 2 * np.pi]), at, True, True)


def _expressions(spec: CurveSpec) -> CurveShape:
    if spec.polar is not None:
        polar = spec.polar

        def at(t: Array) -> Array:
            return _polar(t, polar.values(t))
    else:
        nothing = Profile(0.0, (("const", 0.0),))
        parts = [profile or nothing for profile in (spec.x, spec.y, spec.z)]

        def at(t: Array) -> Array:
            return np.stack([part.values(t) for part in parts], axis=2)

    own = [one for one in (spec.polar, spec.x, spec.y, spec.z) if one is not None]
    return CurveShape(_breaks(own, *spec.range), at, spec.closed, spec.in_plane)


def _breaks(profiles: list[Profile], begin: float, end: float) -> Array:
    """Ends of the range of t, and where one of the first three derivatives jumps in between."""
    from_begin: Ops = (("t", 0.0), ("const", begin), ("+", 0.0))
    length, least, inner = end - begin, _SAME_POINT * (end - begin), set[float]()
    for one in profiles:
        ops = tuple(new for op in one.ops for new in (from_begin if op[0] == "t" else (op,)))
        inner.update(derivative_jumps(ops, length, derivatives=3))
    u = np.array([0.0, *sorted(t for t in inner if least < t < length - least), length])
    return begin + u[np.diff(u, prepend=-np.inf) > least]


def _check(shape: CurveShape) -> None:
    """Refuse a shape along which no marker can slide."""
    u = shape.samples
    with np.errstate(all="ignore"):  # values that are not finite are reported below
        x = shape.at(u)
    bad = ~np.isfinite(x).all(axis=(1, 2))
    if bad.any():
        raise _fail("", f"its value or a derivative is not finite at t = {u[np.argmax(bad)]:.6g}")
    size = float(np.linalg.norm(np.ptp(x[:, 0], axis=0)))
    speed = np.linalg.norm(x[:, 1], axis=1)
    if size == 0.0:
        raise _fail("", "it has no length: all its points coincide")
    at, least = _slowest(shape, u, speed)
    if least <= _CUSP * speed.max():
        what = f"its tangent vanishes at t = {at:.6g}: a cusp, or a place where it turns back. "
        raise _fail("", what + "No marker slides through that; round it, or end the range before")
    if shape.closed:
        _check_ends(x, size, speed)


def _slowest(shape: CurveShape, u: Array, speed: Array) -> tuple[float, float]:
    """Parameter at which the point moves slowest, and its speed; refined around the slowest
    sample."""
    k = int(np.argmin(speed))
    best, least = float(u[k]), float(speed[k])
    low, high = u[max(k - 1, 0)], u[min(k + 1, len(u) - 1)]
    for _ in range(6):
        inner = np.linspace(low, high, 17)
        speeds = np.linalg.norm(shape.at(inner)[:, 1], axis=1)
        k = int(np.argmin(speeds))
        if speeds[k] < least:
            best, least = float(inner[k]), float(speeds[k])
        low, high = inner[max(k - 1, 0)], inner[min(k + 1, 16)]
    return best, least


def _check_ends(x: Array, size: float, speed: Array) -> None:
    gap = float(np.linalg.norm(x[-1, 0] - x[0, 0]))
    if gap > _SAME_POINT * size:
        what = (
            f"closed, its ends must meet, but lie {gap / size:.3g} of its size apart: let the last "
        )
        what += "last point repeat the first, and the range of a parameter be a whole turn"
        raise _fail("closed", what)
    turned = np.linalg.norm(x[-1, 1] / speed[-1] - x[0, 1] / speed[0])
    if turned > 1e-6:
        raise _fail("closed", "closed, it has a corner where its ends meet; round it there")
