"""Whether sensors and expressions over channels hold together.

In: the scope of a check. Out: problems: unknown channels, joints, axes and bodies of sensors, names
with two meanings, channels that no force can follow, expressions in a circle.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from typing import TYPE_CHECKING

from flexmb.errors import Problem, nearest
from flexmb.model.forces.contacts import ContactSpec, PointsSide
from flexmb.model.forces.force import LoadSpec
from flexmb.model.functions.expression import CONSTANTS
from flexmb.model.functions.syntax import unknown_channel
from flexmb.model.joints import curve_uses
from flexmb.model.joints.gearing import acting_names
from flexmb.model.scenes.scope import Scope
from flexmb.model.sensors import signals
from flexmb.model.sensors.sensor import (
    EnergySensorSpec,
    JointSensorSpec,
    MarkerSensorSpec,
    PlaceSensorSpec,
    ReactionSensorSpec,
)

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["sensor_problems", "signal_problems"]

_OWNERS = ("sensors", "states", "controllers")
_REPORTED = {EnergySensorSpec: "an energy", PlaceSensorSpec: "a place along a curve"}


def sensor_problems(scope: Scope) -> Iterator[Problem]:
    """What single sensors refer to."""
    yield from scope.markers("sensors")
    for name, spec in scope.model.sensors.items():
        where = f"sensors.{name}"
        if isinstance(spec, JointSensorSpec) and spec.joint is not None:
            yield from scope.coordinate(where, spec.joint, spec.type)
        elif isinstance(spec, PlaceSensorSpec):
            yield from curve_uses.of_sensor(scope, where, spec)
        elif isinstance(spec, MarkerSensorSpec):
            if spec.axes != "global":
                yield from scope.marker(f"{where}.axes", spec.axes)
            if spec.seen_from is not None:
                yield from scope.marker(f"{where}.seen_from", spec.seen_from)
        elif isinstance(spec, ReactionSensorSpec):
            yield from _reaction(scope, where, spec)
        elif isinstance(spec, EnergySensorSpec) and spec.body is not None:
            yield from _known(scope, where, "body", spec.body, "bodies")


def _known(scope: Scope, where: str, noun: str, name: str, section: str) -> Iterator[Problem]:
    if not scope.has(section, name):
        yield _unknown(f"{where}.{noun}", noun, name, scope.names(section))


def _unknown(where: str, noun: str, name: str, names: tuple[str, ...]) -> Problem:
    return Problem(where, f'unknown {noun} "{name}"', names, nearest(name, names))


def _reaction(scope: Scope, where: str, spec: ReactionSensorSpec) -> Iterator[Problem]:
    if spec.axes not in ("joint", "global"):
        yield from scope.marker(f"{where}.axes", spec.axes)
    for noun in ("joint", "driver", "force"):
        name = getattr(spec, noun)
        if name is not None:
            yield from _known(scope, where, noun, name, f"{noun}s")
    if spec.coupler is not None:
        yield from _coupler(scope, f"{where}.coupler", spec.coupler)
    force = scope.model.forces.get(spec.force or "")
    if isinstance(force, LoadSpec) and force.reaction is None and spec.on == "I":
        what = f'"{spec.force}" acts on one marker: its reaction is on ground; leave it out'
        yield Problem(f"{where}.on", what)
    if isinstance(force, ContactSpec) and spec.quantity == "moment":
        k = "IJ".index(spec.on)
        if isinstance(force.shapes[k], PointsSide):
            what = "points are touched at many places: ask for the force, or for the other side"
            yield Problem(f"{where}.quantity", what)


def _coupler(scope: Scope, where: str, acting: str) -> Iterator[Problem]:
    """What a coupler does to one of its joints."""
    couplers, name = scope.model.couplers, acting.split(".")[0]
    if name in scope.broken.get("couplers", {}):
        return
    if name not in couplers or acting not in acting_names(name, couplers[name]):
        names = tuple(one for name, spec in couplers.items() for one in acting_names(name, spec))
        yield _unknown(where, "coupler and joint", acting, names)


def signal_problems(scope: Scope) -> Iterator[Problem]:
    """Names in expressions, and how they depend on each other."""
    yield from _names(scope)
    known = dict.fromkeys(scope.model.channels())
    broken = {name for section in _OWNERS for name in scope.broken.get(section, {})}
    unknown = False
    for where, function in signals.live_functions(scope.model):
        text = function.expression.text
        yield from _two_meanings(scope, known, where, text)
        for name in function.expression.channels:
            if name not in known and name.partition(".")[0] not in broken:
                names = (*known, *scope.model.parameters)
                problem = unknown_channel(text, name, names)
                yield Problem(where, problem.what, problem.allowed, problem.nearest)
            unknown |= name not in known
    if not unknown:
        circles = list(_circles(scope.model))
        yield from circles
        if not circles:
            yield from _only_reported(scope.model)


def _names(scope: Scope) -> Iterator[Problem]:
    owner: dict[str, str] = {}
    for section in _OWNERS:
        for name in scope.names(section):
            if name in owner:
                what = f'the name "{name}" is taken by {owner[name]}: both would be channels'
                yield Problem(f"{section}.{name}", what)
            owner.setdefault(name, f"{section}.{name}")


def _two_meanings(
    scope: Scope, channels: Container[str], where: str, text: str
) -> Iterator[Problem]:
    known = {**dict.fromkeys(CONSTANTS, "a constant"), "t": "the time"}
    known |= dict.fromkeys(scope.model.parameters, "a parameter")
    for name, meaning in known.items():
        if name in channels and re.search(rf"(?<![\w.]){re.escape(name)}\b", text):
            yield Problem(where, f'"{name}" is {meaning} and a channel; rename the channel')


def _circles(model: Model) -> Iterator[Problem]:
    """Channels that depend on themselves at the same moment."""
    told: set[str] = set()
    for first in model.channels():
        trail = _way_back(model, first, (first,))
        if trail and not told & set(trail):
            told |= set(trail)
            section = next(s for s in _OWNERS if first in getattr(model, s))
            what = f"depends on itself at the same moment: {' -> '.join(trail)}"
            cure = "leave one of them out, or put a state or a filter between"
            yield Problem(f"{section}.{first}", f"{what}; {cure}")


def _way_back(model: Model, first: str, trail: tuple[str, ...]) -> tuple[str, ...]:
    """The way from the last channel of a trail to the first one, () if there is none."""
    for name in signals.depends_on(model, trail[-1]):
        if name == first:
            return (*trail, name)
        if name not in trail:
            found = _way_back(model, first, (*trail, name))
            if found:
                return found
    return ()


def _only_reported(model: Model) -> Iterator[Problem]:
    """Energies and places along curves are computed at outputs only."""
    for where, function in signals.live_functions(model):
        if where.startswith("sensors."):
            continue
        for name in signals.resolved(model, function.expression).channels:
            for kind, noun in _REPORTED.items():
                if isinstance(model.sensors.get(name), kind):
                    what = f'"{name}" is {noun}, known at outputs only: no force can follow it'
                    yield Problem(where, what)
