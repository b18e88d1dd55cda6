"""Whether the parts of a model fit together: names, coordinates, functions, times, files.

In: a model, with what is known of its flexible bodies and of entries that could not be read. Out:
all problems, with scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flexmb.errors import Problem, nearest
from flexmb.model import curve_uses, lookup
from flexmb.model.bodies import FlexbodySpec
from flexmb.model.carriers import body_problems
from flexmb.model.coupling import coupler_problems
from flexmb.model.force_problems import finite, force_problems
from flexmb.model.meshbody import MeshBodySpec
from flexmb.model.plane import planar_problems
from flexmb.model.scope import Broken, Scope
from flexmb.model.sensors import AngleSensorSpec

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["problems"]


def problems(
    model: Model, flexbodies: lookup.Bodies, broken: Broken | None = None
) -> list[Problem]:
    """All problems of a model; see :meth:`Model.problems`."""
    scope = Scope(model, flexbodies, broken or {})
    named = (body_problems, _joints, coupler_problems, _drivers, force_problems, _sensors)
    parts = (*named, curve_uses.shapes, _channels, _judged, _frequencies, _times)
    found = [problem for part in parts for problem in part(scope)]
    if not found:  # what is in the plane is known of entries that hold together
        found += planar_problems(model, flexbodies)
    return found


def _joints(scope: Scope) -> Iterator[Problem]:
    yield from scope.markers("joints")
    for name, spec in scope.model.joints.items():
        yield from scope.pair(f"joints.{name}", spec.between, "a joint")
        yield from curve_uses.of_joint(scope, name, spec)


def _drivers(scope: Scope) -> Iterator[Problem]:
    driven: dict[tuple[str, str], str] = {}
    for name, spec in scope.model.drivers.items():
        where = f"drivers.{name}"
        yield from scope.coordinate(where, spec.joint, spec.coordinate)
        yield from finite(f"{where}.{spec.coordinate}", spec.function, derivatives=True)
        key = (spec.joint, spec.coordinate)
        if key in driven:
            what = f'the {key[1]} of joint "{key[0]}" is driven by "{driven[key]}" already'
            yield Problem(where, what)
        driven.setdefault(key, name)


def _sensors(scope: Scope) -> Iterator[Problem]:
    yield from scope.markers("sensors")
    for name, spec in scope.model.sensors.items():
        if isinstance(spec, AngleSensorSpec) and spec.joint is not None:
            yield from scope.coordinate(f"sensors.{name}", spec.joint, "angle")


def _channels(scope: Scope) -> Iterator[Problem]:
    channels = scope.model.channels()
    asked = [(f"view.history[{i}]", name) for i, name in enumerate(scope.model.view.history)]
    asked += [(f"check[{i}].sensor", c.sensor) for i, c in enumerate(scope.model.checks)]
    for where, name in asked:
        if name not in channels and name.partition(".")[0] not in scope.broken.get("sensors", {}):
            yield Problem(where, f'unknown channel "{name}"', channels, nearest(name, channels))


def _frequencies(scope: Scope) -> Iterator[Problem]:
    """Bodies and interfaces of natural frequencies that are known."""
    for i, check in enumerate(scope.model.frequency_checks):
        bodies = tuple(
            name
            for name, spec in scope.model.bodies.items()
            if isinstance(spec, MeshBodySpec | FlexbodySpec)
        )
        if check.body not in bodies:
            if check.body not in scope.broken.get("bodies", {}):
                what = f'there is no flexible body "{check.body}"'
                yield Problem(f"check[{i}].body", what, bodies, nearest(check.body, bodies))
            continue
        spec = scope.model.bodies[check.body]
        known = tuple(spec.interfaces) if isinstance(spec, MeshBodySpec) else None
        for name in check.held:
            if known is not None and name not in known:
                what = f'{check.body} has no interface "{name}"'
                yield Problem(f"check[{i}].held", what, known, nearest(name, known))


def _judged(scope: Scope) -> Iterator[Problem]:
    """Sensors or channels that a study judges by."""
    study, broken = scope.model.study, scope.broken.get("sensors", {})
    names = tuple(dict.fromkeys((*scope.model.sensors, *scope.model.channels())))
    for i, name in enumerate(study.sensors if study is not None else ()):
        if name not in names and name.partition(".")[0] not in broken:
            what = f'unknown sensor or channel "{name}"'
            yield Problem(f"study.sensors[{i}]", what, names, nearest(name, names))


def _times(scope: Scope) -> Iterator[Problem]:
    model = scope.model
    if model.dynamics is None:
        return
    duration, units = model.dynamics.duration, model.units
    times = [] if model.view.time is None else [("view.time", model.view.time)]
    times += [(f"check[{i}].time", c.time) for i, c in enumerate(model.checks)]
    for where, time in times:
        if time > duration * (1 + 1e-12):
            after, end = units.say(time, "s"), units.say(duration, "s")
            yield Problem(where, f"{after} lies after the end of the run, {end}")
