"""Whether the parts of a model fit together: names, coordinates, times, files.

In: a model, and the raw tables of entries that could not be read, so that their names count as
known and their own references are still checked. Out: all problems, with scene paths.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model import lookup
from flexmb.model.bodies import FlexbodySpec, MeshBodySpec
from flexmb.model.forces import LoadSpec, SpringDamperSpec
from flexmb.model.functions import Function
from flexmb.model.joints import JOINT_TYPES
from flexmb.model.markers import MarkerSpec
from flexmb.model.names import GROUND, split_reference
from flexmb.model.sensors import AngleSensorSpec

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["problems", "unknown_body"]

Broken = Mapping[str, Mapping[str, Any]]
_REFERENCES = ("between", "at", "of", "relative_to")


def problems(
    model: Model, flexbodies: lookup.Bodies, broken: Broken | None = None
) -> list[Problem]:
    """All problems of a model; see :meth:`Model.problems`."""
    check = _References(model, flexbodies, broken or {})
    return [
        *check.bodies(),
        *check.joints(),
        *check.drivers(),
        *check.forces(),
        *check.sensors(),
    ] + [*check.outputs()]


def unknown_body(model: Model, where: str, reference: str) -> Problem:
    """The problem of a reference whose body does not exist."""
    body, names = split_reference(reference)[0], (*model.bodies, GROUND)
    return Problem(where, f'unknown body "{body}"', names, nearest(body, names))


class _References:
    """One method per section; each yields its problems."""

    def __init__(self, model: Model, flexbodies: lookup.Bodies, broken: Broken) -> None:
        self.model, self.flexbodies, self.broken = model, flexbodies, broken

    def entries(self, section: str) -> Iterator[tuple[str, Any]]:
        """Path and specification of an entry."""
        for name, spec in getattr(self.model, section).items():
            yield f"{section}.{name}", spec

    def markers(self, section: str) -> Iterator[Problem]:
        """References to markers, of the entries that were read and of those that were not."""
        raw = self.broken.get(section, {})
        tables = {name: vars(spec) for name, spec in getattr(self.model, section).items()}
        for name, table in {**tables, **raw}.items():
            for key in _REFERENCES if isinstance(table, Mapping) else ():
                value = table.get(key)
                pair = isinstance(value, list | tuple)
                for i, reference in enumerate(value if pair else (value,)):
                    where = f"{section}.{name}.{key}" + (f"[{i}]" if pair else "")
                    if isinstance(reference, str):
                        yield from self.marker(where, reference)

    def marker(self, where: str, reference: str) -> Iterator[Problem]:
        body = split_reference(reference)[0]
        if body in self.broken.get("bodies", {}):
            return
        problem = lookup.missing(self.model, reference, self.flexbodies)
        if problem is not None:
            wrong = set(self.broken.get("bodies", {}))
            names = (
                (*problem.allowed, *sorted(wrong)) if body not in self.names() else problem.allowed
            )
            target = body if body not in self.names() else split_reference(reference)[1]
            yield Problem(where, problem.what, names, nearest(target, names))

    def names(self) -> tuple[str, ...]:
        return (*self.model.bodies, GROUND)

    def exists(self, reference: str) -> bool:
        body = split_reference(reference)[0]
        return (
            body not in self.broken.get("bodies", {})
            and lookup.missing(self.model, reference, self.flexbodies) is None
        )

    def bodies(self) -> Iterator[Problem]:
        if not self.model.bodies and not self.broken.get("bodies"):
            yield Problem("bodies", "the model has no body: give at least one [bodies.NAME]")
        yield from self.body_markers("ground", GROUND, self.model.ground.markers)
        for where, spec in self.entries("bodies"):
            name = where.removeprefix("bodies.")
            if isinstance(spec, MeshBodySpec):
                yield from self.file(f"{where}.mesh", spec.mesh)
            if isinstance(spec, FlexbodySpec) and isinstance(spec.flexbody, str):
                yield from self.file(f"{where}.flexbody", spec.flexbody)
            yield from self.body_markers(where, name, spec.markers)

    def file(self, where: str, given: str) -> Iterator[Problem]:
        if self.flexbodies:
            return
        path = self.model.path(given)
        if path.is_dir():
            yield Problem(where, f'"{given}" is a folder, not a file ({path})')
        elif not path.exists():
            yield Problem(where, f'no file "{given}" ({path})', (), _neighbours(path))

    def body_markers(
        self, where: str, body: str, markers: Mapping[str, MarkerSpec]
    ) -> Iterator[Problem]:
        taken = lookup.automatic_markers(self.model, body, self.flexbodies)
        spec = self.model.bodies.get(body)
        flexible = spec is not None and spec.flexible
        for name, marker in markers.items():
            place = f"{where}.markers.{name}"
            if name in taken:
                yield Problem(place, f'the name "{name}" is taken by a marker every such body has')
            if not flexible:
                for key in ("node", "interface"):
                    if getattr(marker, key) is not None:
                        yield Problem(f"{place}.{key}", "only a flexible body has one")
            elif lookup.markers_known(self.model, body, self.flexbodies):
                yield from self.carrier(place, body, marker, tuple(taken))

    def carrier(
        self, place: str, body: str, marker: MarkerSpec, taken: tuple[str, ...]
    ) -> Iterator[Problem]:
        names = tuple(name for name in taken if name != "origin")
        if marker.interface is not None and marker.interface not in names:
            what = f'the body has no interface "{marker.interface}"'
            yield Problem(f"{place}.interface", what, names, nearest(marker.interface, names))
            return
        flexbody = lookup.flexbody_of(self.model, body, self.flexbodies)
        if flexbody is not None:
            try:
                lookup.place(body, marker, flexbody)
            except FlexmbError as error:
                yield from (Problem(place, p.what, p.allowed, p.nearest) for p in error.problems)

    def joints(self) -> Iterator[Problem]:
        yield from self.markers("joints")
        for where, spec in self.entries("joints"):
            yield from self.pair(where, spec.between, "a joint")

    def pair(self, where: str, between: tuple[str, str], noun: str) -> Iterator[Problem]:
        """Two bodies, and material points of them."""
        first, second = (split_reference(reference)[0] for reference in between)
        if first == second:
            what = f'{noun} connects two bodies, both markers are on "{first}"'
            yield Problem(f"{where}.between", what)
        for i, reference in enumerate(between):
            yield from self.material(f"{where}.between[{i}]", reference)

    def material(self, where: str, reference: str) -> Iterator[Problem]:
        body = split_reference(reference)[0]
        spec = self.model.bodies.get(body)
        if spec is None or not spec.flexible or not self.exists(reference):
            return
        flexbody = lookup.flexbody_of(self.model, body, self.flexbodies)
        rigid = flexbody is not None and flexbody.m == 0
        if lookup.find(self.model, reference, self.flexbodies).spec.is_frame and not rigid:
            names = lookup.marker_names(self.model, body, self.flexbodies)
            names = tuple(f"{body}.{name}" for name in names if name != "origin")
            what = (
                f'"{reference}" is the floating frame of a flexible body, no point of its material'
            )
            yield Problem(where, what, names)

    def coordinate(self, where: str, joint: str, coordinate: str) -> Iterator[Problem]:
        """A joint that has this coordinate."""
        names = (*self.model.joints, *self.broken.get("joints", {}))
        if joint not in names:
            what = f'unknown joint "{joint}"'
            yield Problem(f"{where}.joint", what, names, nearest(joint, names))
        elif joint in self.model.joints:
            kind = JOINT_TYPES[self.model.joints[joint].type]
            if coordinate not in kind.coordinates:
                has = " and ".join(kind.coordinates) or "none"
                what = (
                    f'the {kind.name} joint "{joint}" has no {coordinate}; its coordinates: {has}'
                )
                yield Problem(f"{where}.{coordinate}", what, kind.coordinates)

    def drivers(self) -> Iterator[Problem]:
        driven: dict[tuple[str, str], str] = {}
        for where, spec in self.entries("drivers"):
            yield from self.coordinate(where, spec.joint, spec.coordinate)
            yield from _finite(f"{where}.{spec.coordinate}", spec.function, derivatives=True)
            key = (spec.joint, spec.coordinate)
            if key in driven:
                what = f'the {key[1]} of joint "{key[0]}" is driven by {driven[key]} already'
                yield Problem(where, what)
            driven.setdefault(key, where)

    def forces(self) -> Iterator[Problem]:
        yield from self.markers("forces")
        for where, spec in self.entries("forces"):
            if isinstance(spec, SpringDamperSpec):
                yield from self.pair(where, spec.between, "a spring-damper")
                yield from self.length(where, spec)
            elif isinstance(spec, LoadSpec):
                for i, function in enumerate(spec.value):
                    yield from _finite(f"{where}.value[{i}]", function)
                if split_reference(spec.at)[0] == GROUND:
                    yield Problem(f"{where}.at", f"a {spec.type} on ground moves nothing")
                yield from self.material(f"{where}.at", spec.at)

    def length(self, where: str, spec: SpringDamperSpec) -> Iterator[Problem]:
        """A spring needs two points apart, as far as they are known."""
        try:
            ends = [lookup.placed(self.model, name, self.flexbodies) for name in spec.between]
        except FlexmbError:
            return
        known = [
            marker.body == GROUND
            or not self.model.bodies[marker.body].flexible
            or lookup.flexbody_of(self.model, marker.body, self.flexbodies) is not None
            for marker in ends
        ]
        points = [lookup.global_position(self.model, marker) for marker in ends]
        if all(known) and np.linalg.norm(points[1] - points[0]) == 0:
            what = (
                "its markers coincide in the placed pose: a spring of length zero has no direction"
            )
            yield Problem(f"{where}.between", what)

    def sensors(self) -> Iterator[Problem]:
        yield from self.markers("sensors")
        for where, spec in self.entries("sensors"):
            if isinstance(spec, AngleSensorSpec) and spec.joint is not None:
                yield from self.coordinate(where, spec.joint, "angle")

    def outputs(self) -> Iterator[Problem]:
        channels = list(self.model.channels())
        broken = tuple(self.broken.get("sensors", {}))
        asked = [(f"view.history[{i}]", name) for i, name in enumerate(self.model.view.history)]
        asked += [(f"check[{i}].sensor", c.sensor) for i, c in enumerate(self.model.checks)]
        for where, name in asked:
            if name not in channels and name.partition(".")[0] not in broken:
                near = nearest(name, channels)
                yield Problem(where, f'unknown channel "{name}"', tuple(channels), near)
        dynamics = self.model.dynamics
        times = [("view.time", self.model.view.time)]
        times += [(f"check[{i}].time", c.time) for i, c in enumerate(self.model.checks)]
        for where, time in times:
            if dynamics and time is not None and time > dynamics.duration * (1 + 1e-12):
                what = f"{time:g} s lies after the end of the run, {dynamics.duration:g} s"
                yield Problem(where, what)


def _finite(where: str, function: Function, derivatives: bool = False) -> Iterator[Problem]:
    jet = function.value(0.0)
    parts = ("value", "first derivative", "second derivative")
    for part, value in zip(parts, jet if derivatives else jet[:1], strict=False):
        if not math.isfinite(value):
            text = function.expression.text
            yield Problem(where, f'the {part} of "{text}" is {value:g} at t = 0, not finite')
            return


def _neighbours(path: Path) -> tuple[str, ...]:
    try:
        return nearest(path.name, [entry.name for entry in path.parent.iterdir()])
    except OSError:
        return ()
