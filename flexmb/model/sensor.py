"""Sensors: the channels that a run records, and that expressions of forces and states may use.

Motions of a marker, absolute, relative to another marker, or as an observer on another marker sees
them: channels ``name.x``, ``name.y``, ``name.z``. Three angles of an orientation: ``name.alpha``,
``name.beta``, ``name.gamma``. Coordinates of joints and between markers, energies, and expressions
of other channels: channel ``name``. Angles are continuous over several revolutions. `unit_of` gives
the unit of a sensor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem, nearest
from flexmb.model.forces.contact import ContactSpec, PointsSide
from flexmb.model.forces.load import BodyLoadSpec, LoadSpec
from flexmb.model.functions.function import Function, FunctionInDeclaredUnit, UnitName
from flexmb.model.lookup import Component, Scope
from flexmb.model.quantities import Axis, Pair, Text
from flexmb.model.reading import Reader, Spec, fail, only_one, quote

TURNS = ("alpha", "beta", "gamma")
"""Names of the three angles of an orientation."""


class SensorSpec(Component):
    """Base of all sensors."""

    type: str


class MarkerSensorSpec(SensorSpec):
    """Motion of the marker ``of``, minus that of ``relative_to``, in global or in a marker's axes.

    ``axes``: components along the present axes of this marker. ``seen_from``: as seen by an
    observer who moves and rotates with this marker, in its axes.
    """

    type: Literal[
        "position", "velocity", "acceleration", "angular_velocity", "angular_acceleration"
    ]
    of: Text
    relative_to: Text | None = None
    axes: Text = "global"
    seen_from: Text | None = None

    @model_validator(mode="after")
    def _check_observer(self) -> Self:
        if self.seen_from is not None and (self.relative_to is not None or self.axes != "global"):
            what = "is an observer with axes of its own; leave relative_to and axes out"
            raise fail(Problem("seen_from", what))
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.marker(f"{where}.axes", self.axes, "global")
        if self.seen_from is not None:
            yield from scope.marker(f"{where}.seen_from", self.seen_from)


def _sequence(value: Any, info: ValidationInfo) -> str:
    ok = isinstance(value, str) and len(value) == 3 and set(value) <= set("xyz")
    if not ok or value[0] == value[1] or value[1] == value[2]:
        what = f"three axes are expected of which no two neighbours are equal, given {quote(value)}"
        raise fail(Problem("", what, ("xyz", "zxz", "zyx", "...")))
    return str(value)


class OrientationSensorSpec(SensorSpec):
    """Three rotation angles from the axes of ``relative_to`` (or the global ones) to those of
    ``of``.

    They are about the axes of ``sequence``, each as the previous rotations have left it: ``"xyz"``
    gives Cardan (Bryan) angles, ``"zxz"`` Euler angles. With three different axes beta = 90 deg is
    singular, with two beta = 0 and 180 deg: there gamma stays and alpha takes the whole rotation.
    """

    type: Literal["orientation"]
    of: Text
    relative_to: Text | None = None
    sequence: Annotated[str, Reader(_sequence)] = "xyz"


class JointSensorSpec(SensorSpec):
    """A coordinate of a joint, or between two markers, or its first or second derivative."""

    joint: Text | None = None
    between: Pair | None = None
    axis: Axis | None = None
    derivative: Literal[0, 1, 2] = 0

    @model_validator(mode="after")
    def _check_markers(self) -> Self:
        if (self.joint is None) == (self.between is None):
            raise fail(Problem("", 'give either "joint" or "between" (with "axis")'))
        if self.joint is not None and self.axis is not None:
            raise fail(Problem("axis", "is the joint's own; leave it out"))
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        if self.joint is not None:
            yield from scope.coordinate(where, self.joint, self.type)


class AngleSensorSpec(JointSensorSpec):
    """Angle of a joint, or from marker I to J about ``axis``, measured from the placed pose.

    It is within +-pi at the start, or has the turns that a spring, stop, screw or gear of the joint
    counts, and is continuous from then on; with ``derivative`` its rate. A universal joint has a
    ``"second_angle"`` too.
    """

    type: Literal["angle", "second_angle"]

    @model_validator(mode="after")
    def _check_joint(self) -> Self:
        if self.type == "second_angle" and self.joint is None:
            raise fail(Problem("joint", "is missing: only joints have a second angle"))
        return self


class StrokeSensorSpec(JointSensorSpec):
    """Stroke of a joint, the distance from I to J along its axis, or from marker I to J along
    ``axis``; with ``derivative`` its rate.
    """

    type: Literal["stroke"]


class PlaceSensorSpec(SensorSpec):
    """Position of a joint along its curve, as arc length from the curve's beginning, or its rate.

    On a closed curve it continues to count over several laps. For two cams, ``on = "J"`` is the
    position on the curve of marker J.
    """

    type: Literal["place"]
    joint: Text
    on: Literal["I", "J"] = "I"
    derivative: Literal[0, 1] = 0

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.unknown(f"{where}.joint", "joint", self.joint, "joints")
        joint = scope.model.joints.get(self.joint)
        if joint is None:
            return
        if not joint.curves:
            names = tuple(name for name, other in scope.model.joints.items() if other.curves)
            what = f'the {joint.type} joint "{self.joint}" is on no curve'
            yield Problem(f"{where}.joint", what, names)
        elif self.on == "J" and len(joint.curves) < 2:
            what = f'the {joint.type} joint "{self.joint}" has a curve on I only'
            yield Problem(f"{where}.on", what)


class DistanceSensorSpec(SensorSpec):
    """Distance of two markers; with ``derivative`` its first or second rate."""

    type: Literal["distance"]
    between: Pair
    derivative: Literal[0, 1, 2] = 0


class ReactionSensorSpec(SensorSpec):
    """Force of a joint, driver, force or coupler on a marker, or its moment about the marker.

    For a coupler the joint on which it acts is named too: ``coupler = "gear.joint"``. ``on``
    selects one of the two markers; components are in the joint's axes there, in global axes, or in
    those of a marker. A force or torque at one marker acts on J.
    """

    type: Literal["reaction"]
    quantity: Literal["force", "moment"] = "force"
    joint: Text | None = None
    driver: Text | None = None
    force: Text | None = None
    coupler: Text | None = None
    on: Literal["I", "J"] = "J"
    axes: Text = "joint"

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        only_one(self, "joint", "driver", "force", "coupler")
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.marker(f"{where}.axes", self.axes, "joint", "global")
        for noun in ("joint", "driver", "force"):
            name = getattr(self, noun)
            if name is not None:
                yield from scope.unknown(f"{where}.{noun}", noun, name, f"{noun}s")
        if self.coupler is not None:
            yield from self._coupler_problems(scope, f"{where}.coupler", self.coupler)
        force = scope.model.forces.get(self.force or "")
        if isinstance(force, LoadSpec) and force.reaction is None and self.on == "I":
            what = f'"{self.force}" acts on one marker: its reaction is on ground; leave it out'
            yield Problem(f"{where}.on", what)
        if isinstance(force, BodyLoadSpec):
            what = "acts all over a body, at no marker: it is value times its load"
            yield Problem(f"{where}.force", what)
        if isinstance(force, ContactSpec) and self.quantity == "moment":
            side = force.shapes["IJ".index(self.on)]
            if isinstance(side, PointsSide):
                what = "points touch at many places: use the force, or the other side"
                yield Problem(f"{where}.quantity", what)

    def _coupler_problems(self, scope: Scope, where: str, reaction: str) -> Iterator[Problem]:
        """Problems unless the coupler has a reaction of that name."""
        if reaction.split(".")[0] not in scope.broken.get("couplers", {}):
            couplers = scope.model.couplers.items()
            names = tuple(one for name, spec in couplers for one in spec.reaction_names(name))
            if reaction not in names:
                what = f'unknown coupler and joint "{reaction}"'
                yield Problem(where, what, names, nearest(reaction, names))


class EnergySensorSpec(SensorSpec):
    """An energy of the model, or of one body; ``"total"`` is the sum of all four."""

    type: Literal["energy"]
    quantity: Literal["kinetic", "strain", "gravity", "spring", "total"] = "total"
    body: Text | None = None

    @model_validator(mode="after")
    def _check_body(self) -> Self:
        if self.body is not None and self.quantity in ("spring", "total"):
            allowed = ("kinetic", "strain", "gravity")
            raise fail(Problem("quantity", "is not that of one body", allowed))
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        if self.body is not None:
            yield from scope.unknown(f"{where}.body", "body", self.body, "bodies")


class ExpressionSensorSpec(SensorSpec):
    """A value computed of other channels, such as ``"hypot(tip.x, tip.y)"``, in ``unit``."""

    type: Literal["expression"]
    unit: UnitName = ""
    value: Annotated[Function, FunctionInDeclaredUnit()]


SENSOR_TYPES: dict[str, type[Spec]] = {
    "position": MarkerSensorSpec,
    "velocity": MarkerSensorSpec,
    "acceleration": MarkerSensorSpec,
    "angular_velocity": MarkerSensorSpec,
    "angular_acceleration": MarkerSensorSpec,
    "orientation": OrientationSensorSpec,
    "angle": AngleSensorSpec,
    "second_angle": AngleSensorSpec,
    "stroke": StrokeSensorSpec,
    "place": PlaceSensorSpec,
    "distance": DistanceSensorSpec,
    "reaction": ReactionSensorSpec,
    "energy": EnergySensorSpec,
    "expression": ExpressionSensorSpec,
}


CHANNEL_UNITS = {
    "position": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "angle": "rad",
    "angular velocity": "rad/s",
    "angular acceleration": "rad/s^2",
}
"""SI unit of each kind of motion."""

_LENGTHS = tuple(CHANNEL_UNITS.values())[:3]
_ANGLES = tuple(CHANNEL_UNITS.values())[3:]


def unit_of(table: Mapping[str, Any]) -> str | None:
    """SI unit of a sensor, state or controller from its fields; None if it is not known."""
    kind = str(table.get("type", ""))
    if kind in ("stroke", "place", "distance"):
        return _LENGTHS[int(table.get("derivative", 0))]
    if kind in ("angle", "second_angle"):
        return _ANGLES[int(table.get("derivative", 0))]
    if kind == "orientation":
        return "rad"
    if kind == "energy":
        return "J"
    if kind == "reaction":
        return "N m" if table.get("quantity") == "moment" else "N"
    unit = CHANNEL_UNITS.get(kind.replace("_", " "))
    if unit is not None:
        return unit
    declares = any(key in table for key in ("value", "rate", "input"))
    return str(table.get("unit", "")) if declares else None


def channel_unit(tables: Mapping[str, Mapping[str, Any]], channel: str) -> str | None:
    """SI unit of a channel, from the fields of all sensors by name; None for an unknown one."""
    name = channel if channel in tables else channel.rpartition(".")[0]
    return unit_of(tables[name]) if name in tables else None


def channels_of(name: str, sensor: Spec) -> tuple[str, ...]:
    """Names of the channels of a sensor."""
    if isinstance(sensor, MarkerSensorSpec | ReactionSensorSpec):
        return tuple(f"{name}.{axis}" for axis in "xyz")
    if isinstance(sensor, OrientationSensorSpec):
        return tuple(f"{name}.{angle}" for angle in TURNS)
    return (name,)
