"""Whether the parts of a model fit together: names, coordinates, functions, times, files.

In: a model, with what is known of its flexible bodies and of entries that could not be read. Out:
all problems, with scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flexmb.errors import Problem, nearest
from flexmb.model import lookup
from flexmb.model.bodies.body import FlexbodySpec
from flexmb.model.bodies.carriers import body_problems
from flexmb.model.bodies.mesh_body import MeshBodySpec
from flexmb.model.forces.problems import force_problems
from flexmb.model.joints import curve_uses
from flexmb.model.joints.coupling import coupler_problems
from flexmb.model.joints.driver_problems import driver_problems
from flexmb.model.plane import planar_problems
from flexmb.model.scenes.scope import Broken, Scope
from flexmb.model.scenes.times import time_problems
from flexmb.model.sensors.signal_checks import sensor_problems, signal_problems
from flexmb.model.tasks.assembly import assembly_problems

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["problems"]


def problems(
    model: Model, flexbodies: lookup.Bodies, broken: Broken | None = None
) -> list[Problem]:
    """All problems of a model; see :meth:`Model.problems`."""
    scope = Scope(model, flexbodies, broken or {})
    named = (body_problems, _joints, coupler_problems, driver_problems, force_problems)
    further = (sensor_problems, signal_problems, assembly_problems, curve_uses.shapes)
    parts = (*named, *further, _channels, _judged, _frequencies, time_problems)
    found = [problem for part in parts for problem in part(scope)]
    if not found:  # what is in the plane is known of entries that hold together
        found += planar_problems(model, flexbodies)
    return found


def _joints(scope: Scope) -> Iterator[Problem]:
    yield from scope.markers("joints")
    for name, spec in scope.model.joints.items():
        yield from scope.pair(f"joints.{name}", spec.between, "a joint")
        yield from curve_uses.of_joint(scope, name, spec)


def _channels(scope: Scope) -> Iterator[Problem]:
    channels, broken = scope.model.channels(), _broken_channels(scope)
    asked = [(f"view.history[{i}]", name) for i, name in enumerate(scope.model.view.history)]
    asked += [(f"check[{i}].sensor", c.sensor) for i, c in enumerate(scope.model.checks)]
    for where, name in asked:
        if name not in channels and name.partition(".")[0] not in broken:
            yield Problem(where, f'unknown channel "{name}"', channels, nearest(name, channels))


def _broken_channels(scope: Scope) -> set[str]:
    """Names of what would give channels but could not be read."""
    sections = ("sensors", "states", "controllers")
    return {name for section in sections for name in scope.broken.get(section, {})}


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
    study, broken = scope.model.study, _broken_channels(scope)
    names = tuple(dict.fromkeys((*scope.model.sensors, *scope.model.channels())))
    for i, name in enumerate(study.sensors if study is not None else ()):
        if name not in names and name.partition(".")[0] not in broken:
            what = f'unknown sensor or channel "{name}"'
            yield Problem(f"study.sensors[{i}]", what, names, nearest(name, names))
