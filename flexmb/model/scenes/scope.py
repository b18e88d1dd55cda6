"""What a cross-reference check looks at, and the checks of a single reference.

In: a model, the flexible bodies as far as they are known, and the raw tables of entries that could
not be read: their names count as known, and what they refer to is still checked. Out: problems.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, nearest
from flexmb.model import lookup
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.values.names import GROUND, split_reference

if TYPE_CHECKING:
    from flexmb.model.model import Model

__all__ = ["Broken", "Scope"]

Broken = Mapping[str, Mapping[str, Any]]
_REFERENCES = ("between", "at", "of", "relative_to", "marker")


@dataclass(frozen=True)
class Scope:
    """The model under check."""

    model: Model
    flexbodies: lookup.Bodies
    broken: Broken

    def names(self, section: str) -> tuple[str, ...]:
        """Names in a section, those that could not be read included."""
        return (*getattr(self.model, section), *self.broken.get(section, {}))

    def has(self, section: str, name: str) -> bool:
        """Whether a section has an entry of that name, if only one that could not be read."""
        return name in getattr(self.model, section) or name in self.broken.get(section, {})

    def markers(self, section: str) -> Iterator[Problem]:
        """References to markers, of the entries that were read and of those that were not."""
        read = {name: vars(spec) for name, spec in getattr(self.model, section).items()}
        for name, table in {**read, **self.broken.get(section, {})}.items():
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

    def coordinate(self, where: str, joint: str, coordinate: str) -> Iterator[Problem]:
        """A joint that exists and has this coordinate."""
        if not self.has("joints", joint):
            names = self.names("joints")
            what = f'unknown joint "{joint}"'
            yield Problem(f"{where}.joint", what, names, nearest(joint, names))
        elif joint in self.model.joints:
            kind = JOINT_TYPES[self.model.joints[joint].type]
            if coordinate not in kind.coordinates:
                has = " and ".join(kind.coordinates) or "no coordinate"
                what = f'the {kind.name} joint "{joint}" has no {coordinate}; it has: {has}'
                yield Problem(f"{where}.{coordinate}", what)
