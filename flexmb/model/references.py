"""What the parts of a model refer to: markers, joints and their coordinates, that must exist.

In: a model, the flexible bodies as far as they are reduced, and the raw tables of entries that
could not be read: their names count as names, and what they refer to is checked as well. Out:
problems with scene paths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model import lookup
from flexmb.model.lookup import Array, Bodies, ModelData
from flexmb.model.values.reading import GROUND, Spec, split_reference

Broken = Mapping[str, Mapping[str, Any]]
_REFERENCES = ("between", "at", "of", "relative_to", "marker")


class Component(Spec):
    """Base of what acts on bodies or measures them: joints, couplers, drivers, forces, sensors."""

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """What does not fit the model that it is in; ``where`` is its scene path."""
        yield from ()

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """What has no meaning in a planar scene; asked where it fits the model otherwise."""
        yield from ()


@dataclass(frozen=True)
class Scope:
    """A model under check."""

    model: ModelData
    flexbodies: Bodies
    broken: Broken

    def names(self, section: str) -> tuple[str, ...]:
        """Names in a section, those that could not be read included."""
        return (*getattr(self.model, section), *self.broken.get(section, {}))

    def has(self, section: str, name: str) -> bool:
        """Whether a section has an entry of that name, if only one that could not be read."""
        return name in getattr(self.model, section) or name in self.broken.get(section, {})

    def unknown(self, where: str, noun: str, name: str, section: str) -> Iterator[Problem]:
        """An entry that is in no section of the scene."""
        if not self.has(section, name):
            names = self.names(section)
            yield Problem(where, f'unknown {noun} "{name}"', names, nearest(name, names))

    def markers(self, section: str) -> Iterator[Problem]:
        """References to markers, of the entries that were read and of those that were not."""
        tables = {name: vars(spec) for name, spec in getattr(self.model, section).items()}
        for name, table in {**tables, **self.broken.get(section, {})}.items():
            for key in _REFERENCES if isinstance(table, Mapping) else ():
                value = table.get(key)
                pair = isinstance(value, list | tuple)
                for i, reference in enumerate(value if pair else (value,)):
                    where = f"{section}.{name}.{key}" + (f"[{i}]" if pair else "")
                    if isinstance(reference, str):
                        yield from self.marker(where, reference)

    def marker(self, where: str, reference: str) -> Iterator[Problem]:
        """A marker that exists."""
        body = split_reference(reference)[0]
        if body != GROUND and not self.has("bodies", body):
            bodies = (*self.names("bodies"), GROUND)
            yield Problem(where, f'unknown body "{body}"', bodies, nearest(body, bodies))
        elif body not in self.broken.get("bodies", {}):
            problem = lookup.missing(self.model, reference, self.flexbodies)
            if problem is not None:
                yield Problem(where, problem.what, problem.allowed, problem.nearest)

    def pair(self, where: str, between: tuple[str, str], noun: str) -> Iterator[Problem]:
        """Two bodies, and material points of them."""
        first, second = (split_reference(reference)[0] for reference in between)
        if first == second:
            what = f'{noun} connects two bodies, both markers are on "{first}"'
            yield Problem(f"{where}.between", what)
        for i, reference in enumerate(between):
            yield from self.material(f"{where}.between[{i}]", reference)

    def material(self, where: str, reference: str) -> Iterator[Problem]:
        """A marker that is a point of its body, not the floating frame of a flexible one."""
        body = split_reference(reference)[0]
        spec = self.model.bodies.get(body)
        if spec is None or not spec.flexible or any(self.marker(where, reference)):
            return
        flexbody = lookup.flexbody_of(self.model, body, self.flexbodies)
        rigid = flexbody is not None and flexbody.m == 0
        if lookup.find(self.model, reference, self.flexbodies).spec.is_frame and not rigid:
            names = lookup.marker_names(self.model, body, self.flexbodies)
            names = tuple(f"{body}.{name}" for name in names if name != "origin")
            what = f'"{reference}" is the floating frame of a flexible body, no material point'
            yield Problem(where, what, names)

    def line(self, between: tuple[str, str]) -> Array | None:
        """From marker I to J (3,) [m] in the placed pose; None as long as it is not known."""
        model = self.model
        try:
            ends = [lookup.place_marker(model, marker, self.flexbodies) for marker in between]
        except FlexmbError:
            return None
        for body in {end.body for end in ends} - {GROUND}:
            flexbody = lookup.flexbody_of(model, body, self.flexbodies)
            if model.bodies[body].flexible and flexbody is None:
                return None
        I, J = (lookup.global_position(model, end) for end in ends)  # noqa: E741
        return J - I

    def line_problems(self, where: str, between: tuple[str, str], noun: str) -> Iterator[Problem]:
        """Markers between which there is a direction."""
        line = self.line(between)
        if line is not None and np.linalg.norm(line) == 0:
            what = f"its markers coincide in the placed pose: the direction of the {noun} is "
            yield Problem(f"{where}.between", what + "undefined (zero length)")

    def coordinate(self, where: str, joint: str, coordinate: str) -> Iterator[Problem]:
        """A joint that exists and has this coordinate."""
        yield from self.unknown(f"{where}.joint", "joint", joint, "joints")
        if joint in self.model.joints:
            kind = self.model.joints[joint].kind
            if coordinate not in kind.coordinates:
                has = " and ".join(kind.coordinates) or "no coordinate"
                what = f'the {kind.name} joint "{joint}" has no {coordinate}; it has: {has}'
                yield Problem(f"{where}.{coordinate}", what)
