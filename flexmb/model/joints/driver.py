"""Drivers: a coordinate as a function of time, of a joint, of a marker, or between two markers.

Each driver prescribes the displacement itself, or its velocity or acceleration; these start from
``start`` (the placed pose by default) and ``start_velocity`` (zero by default). Equations: Hong &
Liu 2011, sections 1.4 and 2.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.functions.expression import Expression
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.joints.joint import COORDINATES
from flexmb.model.lookup import Component, ModelData, Scope
from flexmb.model.plane import across, keeps_plane
from flexmb.model.quantities import Axis, Pair, Text, plain, read_number, read_numbers
from flexmb.model.reading import (
    GROUND,
    NUMBER,
    Reader,
    context_of,
    fail,
    fail_if,
    list_form,
    quote,
    split_reference,
)

DRIVEN: dict[str, tuple[str, ...]] = {
    "joint": COORDINATES,
    "marker": ("x", "y", "z", "angle", "position"),
    "between": ("distance",),
}
"""Coordinates that drivers of each kind may prescribe."""

_ANGLES = ("angle", "second_angle")
_ORDER = ("displacement", "velocity", "acceleration")
_AXES = ("x", "y", "z")
_IN_PLANE = {"xy": ("x", "y"), "yz": ("y", "z"), "zx": ("z", "x")}
assert set(_IN_PLANE) == set(PLANES)


class Motion(NamedTuple):
    """A driven coordinate and its function of time."""

    coordinate: str
    function: Function


@dataclass(frozen=True)
class _Driven(FunctionOf):
    """Annotation of a prescribed function: the displacement, its velocity or its acceleration."""

    def unit_here(self, info: ValidationInfo) -> str:
        rates = {"displacement": "", "velocity": "/s", "acceleration": "/s^2"}
        return self.unit + rates[info.data.get("prescribes", "displacement")]


class Start(NamedTuple):
    """Start values [SI] and their unit."""

    values: tuple[float, ...]
    unit: str


def _start(value: Any, info: ValidationInfo) -> Start:
    """A number, or a list of them, in the unit of the prescribed displacement or velocity."""
    names, data = context_of(info), info.data
    unit = "rad" if any(data.get(name) is not None for name in _ANGLES) else "m"
    if info.field_name == "start_velocity":
        unit += "/s"
    value = plain(value)
    if isinstance(value, list):
        return Start(tuple(read_numbers(value, names, repeat(unit))), unit)
    return Start((read_number(value, names, unit) * names.units.scale(unit),), unit)


def _write_start(start: Start, info: SerializationInfo) -> Any:
    units = context_of(info).units
    written = [units.written(value, start.unit) for value in start.values]
    return written if len(written) > 1 else written[0]


_First = Annotated[
    Start | None, Reader(_start, _write_start, {"anyOf": [NUMBER, list_form(NUMBER)]})
]
_Angle = Annotated[Function, _Driven("rad")]
_Length = Annotated[Function, _Driven("m")]


class DriverSpec(Component):
    """Prescribes coordinates of a ``joint``, of a ``marker``, or the distance ``between`` two.

    Of a joint: its ``angle``, ``second_angle`` or ``stroke``. Of a marker: ``x``, ``y``, ``z`` or
    ``position``, in global axes or those of the marker ``relative_to``, and its ``angle`` about
    ``axis`` as for joints. The function is the displacement or, by ``prescribes``, its velocity or
    acceleration; then the displacement starts at ``start`` (by default that of the placed pose)
    with ``start_velocity`` (by default zero).
    """

    prescribes: Literal["displacement", "velocity", "acceleration"] = "displacement"
    joint: Text | None = None
    marker: Text | None = None
    between: Pair | None = None
    relative_to: Text | None = None
    axis: Axis | None = None
    angle: _Angle | None = None
    second_angle: _Angle | None = None
    stroke: _Length | None = None
    x: _Length | None = None
    y: _Length | None = None
    z: _Length | None = None
    position: tuple[_Length, ...] | None = None
    distance: _Length | None = None
    start: _First = None
    start_velocity: _First = None

    @model_validator(mode="before")
    @classmethod
    def _check_position(cls, fields: Any) -> Any:
        """A position of numbers is refused here, before it is read: only markers have one."""
        if isinstance(fields, dict) and "position" in fields and "marker" not in fields:
            target = next((name for name in DRIVEN if name in fields), None)
            if target is not None:
                what = f'a driver of "{target}" has no position'
                raise fail(Problem("position", what, DRIVEN[target]))
        return fields

    @model_validator(mode="after")
    def _check_target(self) -> Self:
        targets = [name for name in DRIVEN if getattr(self, name) is not None]
        if not targets:
            what = 'is missing: say what is driven by "joint", "marker" or "between"'
            raise fail(Problem("joint", what))
        if len(targets) > 1:
            what = 'exactly one of "joint", "marker" and "between" must be given, given'
            raise fail(Problem("", f"{what} {' and '.join(targets)}"))
        fail_if(self._coordinates() or [*self._words(), *self._starts()])
        return self

    def _coordinates(self) -> list[Problem]:
        """Problems of coordinates that the target does not have, and of their number."""
        allowed = DRIVEN[self.target]
        names = {name for names in DRIVEN.values() for name in names}
        present = sorted(name for name in names if getattr(self, name) is not None)
        problems = [
            Problem(name, f'a driver of "{self.target}" has no {name}', allowed)
            for name in present
            if name not in allowed
        ]
        if problems:
            return problems
        if self.joint is not None and len(present) != 1:
            one_of = '"angle", "second_angle" and "stroke"'
            shown = " and ".join(present) or "none"
            return [Problem("", f"give exactly one of {one_of}, given {shown}")]
        if not present:
            return [Problem("", "prescribes no coordinate; give one of these", allowed)]
        if self.position is not None:
            if len(self.position) not in (2, 3):
                what = "a point has 3 coordinates, 2 in a plane, given"
                return [Problem("position", f"{what} {len(self.position)}")]
            if any(name in present for name in _AXES):
                return [Problem("position", "and x, y, z are the same; give one of them")]
        return []

    def _words(self) -> list[Problem]:
        """Problems of options that have no meaning for this driver."""
        problems = []
        if self.relative_to is not None and self.marker is None:
            problems.append(Problem("relative_to", "only a driver of a marker has it"))
        alone = [motion.coordinate for motion in self.motions()] == ["angle"]
        if self.axis is not None and (self.marker is None or not alone):
            problems.append(Problem("axis", "only a driver of the angle of a marker has it"))
        return problems

    def _starts(self) -> list[Problem]:
        """Problems of start values: without meaning, or not one for each coordinate."""
        problems, count = [], len(self.motions())
        for name, start, least in (
            ("start", self.start, 1),
            ("start_velocity", self.start_velocity, 2),
        ):
            if start is None:
                continue
            if _ORDER.index(self.prescribes) < least:
                what = f"the function prescribes the {self.prescribes} and begins by itself"
                problems.append(Problem(name, what))
            elif len(start.values) != count:
                what = f"{count} {'values are' if count > 1 else 'value is'} expected, one for each"
                problems.append(Problem(name, f"{what} coordinate, given {quote(start.values)}"))
        return problems

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from _target(scope, where, self)
        for coordinate, function in self.motions(scope.model.plane):
            yield from function.problems(f"{where}.{coordinate}", max(0, 2 - self.order))
        if self.distance is not None and self.order == 0:
            what = closing_problem(scope.model, self.distance.expression)
            if what is not None:
                yield Problem(f"{where}.distance", what)

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """Problems of marker coordinates that are not in the plane or about its normal."""
        if self.marker is None:
            return
        if self.axis is not None and not across(self.axis, plane):
            yield Problem(f"{where}.axis", f"must be normal to the plane {plane}")
        if self.position is not None and len(self.position) != 2:
            what = f"a point has 2 coordinates in the plane {plane}, given {len(self.position)}"
            yield Problem(f"{where}.position", what)
            return
        marker = lookup.place_marker(scope.model, self.ends[0], scope.flexbodies)
        axes = lookup.global_axes(scope.model, marker)
        for coordinate, _ in self.motions(plane):
            if coordinate in "xyz" and not keeps_plane(axes[:, "xyz".index(coordinate)], plane):
                name = f"{coordinate} of {self.relative_to}" if self.relative_to else coordinate
                what = f"{name} has a component normal to the plane {plane}"
                yield Problem(f"{where}.{coordinate}", what)

    @property
    def target(self) -> str:
        """``"joint"``, ``"marker"`` or ``"between"``."""
        return next(name for name in DRIVEN if getattr(self, name) is not None)

    @property
    def ends(self) -> tuple[str, str]:
        """Markers I and J of a driver that is not on a joint."""
        if self.between is not None:
            return self.between
        assert self.marker is not None  # one of the three is given
        return self.relative_to or "ground.origin", self.marker

    @property
    def order(self) -> int:
        """Number of integrations of the function to the displacement: 0, 1 or 2."""
        return _ORDER.index(self.prescribes)

    def motions(self, plane: str | None = None) -> tuple[Motion, ...]:
        """All driven coordinates with their functions; in a plane a position has two."""
        motions = [
            Motion(name, getattr(self, name))
            for name in (*COORDINATES, *_AXES, "distance")
            if getattr(self, name) is not None
        ]
        if self.position is not None:
            names = _AXES if len(self.position) == 3 else _IN_PLANE[plane or "xy"]
            motions += [Motion(*pair) for pair in zip(names, self.position, strict=True)]
        return tuple(motions)

    @property
    def coordinate(self) -> str:
        """The coordinate, for a driver with a single one."""
        return self.motions()[0].coordinate

    @property
    def function(self) -> Function:
        """The prescribed function of time, for a driver with a single coordinate."""
        return self.motions()[0].function


_SAMPLES = 201  # samples of a distance over the run


def _target(scope: Scope, where: str, spec: DriverSpec) -> Iterator[Problem]:
    """Problems of a coordinate that the joint does not have, or of markers that cannot move."""
    if spec.joint is not None:
        yield from scope.coordinate(where, spec.joint, spec.coordinate)
        return
    if spec.position is not None and scope.model.plane is None and len(spec.position) != 3:
        yield Problem(f"{where}.position", "a point has 3 coordinates, given 2")
    if spec.between is not None:
        yield from scope.pair(where, spec.between, "a driver")
        return
    first, second = spec.ends
    yield from scope.material(f"{where}.marker", second)
    if spec.relative_to is not None:
        yield from scope.material(f"{where}.relative_to", first)
    bodies = split_reference(first)[0], split_reference(second)[0]
    if bodies[1] == GROUND:
        yield Problem(f"{where}.marker", "a marker of ground does not move")
    elif bodies[0] == bodies[1]:
        what = f'both markers are on "{bodies[0]}": they do not move against each other'
        yield Problem(f"{where}.relative_to", what)


def closing_problem(model: ModelData, distance: Expression) -> str | None:
    """A sentence if a prescribed distance is not positive at some sample of the run; else None."""
    end, units = model.dynamics.duration if model.dynamics is not None else 0.0, model.units
    for t in np.linspace(0.0, end, _SAMPLES if end > 0.0 else 1):
        value = distance.value(float(t))[0]
        if value <= 0.0:
            what = f"the distance is {units.say(value, 'm')} at {units.say(float(t), 's')}"
            return f"{what}; at zero the line between the markers has no direction: keep it above"
    return None
