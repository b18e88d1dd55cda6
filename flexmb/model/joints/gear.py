"""Gears and racks: wheels that roll on each other on their pitch circles.

Two wheels are mounted by two joints on one common body, the carrier: ground, or an arm that rotates
itself. θ is the angle of a wheel relative to the carrier about the axis u of its joint, measured
from the placed pose; it is the joint's angle if the carrier is on side I and its negative
otherwise. Wheels in external contact rotate in opposite senses if their axes u are parallel and of
the same direction, or if the axes intersect and both u point from the intersection to the wheels,
or both away from them. Wheels in internal contact rotate in the same sense. If the marker of a
wheel is at the intersection itself, u counts as pointing to the wheel. A rack moves with the point
of the pinion next to it, s' = R θ' (u × n)·d, where d is the direction of the rack and n is normal
to it, from the pinion's axis to the rack. Source: rolling of pitch cones; Hong & Liu 2011, section
1.7; Willis, Principles of Mechanism, 1841.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import StrictBool, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model import lookup
from flexmb.model.joints.coupler import Coupler, Equation, Key, Term
from flexmb.model.lookup import Bodies, ModelData, Scope
from flexmb.model.quantities import Integer, Number, Pair, Size
from flexmb.model.reading import fail_if, only_one, split_reference

_WHEEL_JOINTS = ("revolute", "cylindrical", "screw", "planar", "parallel")
_RACK_JOINTS = ("prismatic", "cylindrical", "screw")
_ZERO_DISTANCE = 1e-6  # relative to the distances between the axes
# relative difference allowed between the sum of the radii and the distance of the axes
_RADII_TOLERANCE = 1e-2
# relative difference of modules of one wheel that profile shift may explain
_MODULE_TOLERANCE = 0.05
_Teeth = Annotated[int, Integer(1)]


@dataclass(frozen=True)
class _Wheel:
    """A wheel or rack on its carrier: position and axis in the placed pose, global."""

    sense: float  # +1 if the carrier has marker I of the joint, else -1
    x: Array
    u: Array


class RollingCoupler(Coupler):
    """Base of gears and racks: two joints on one carrier."""

    joints: Pair
    joint_types: ClassVar[tuple[tuple[str, ...], tuple[str, ...]]]
    nouns: ClassVar[tuple[str, str]]

    def carriers(self, model: ModelData) -> list[str]:
        """Bodies that both joints connect to."""
        first, second = (self._bodies(model, joint) for joint in self.joints)
        return [body for body in first if body in second]

    def _bodies(self, model: ModelData, joint: str) -> list[str]:
        return [split_reference(end)[0] for end in model.joints[joint].between]

    def equation(self, model: ModelData, flexbodies: Bodies) -> Equation:
        carrier = self.carriers(model)[0]
        first, second = (_wheel(model, joint, carrier, flexbodies) for joint in self.joints)
        a, b = self._factors(model, first, second)
        factors = a * first.sense, b * second.sense
        keys = zip(self.coordinates, factors, strict=True)
        return Equation(tuple(Term(*key, factor) for key, factor in keys), 0.0, relative=True)

    def _factors(self, model: ModelData, first: _Wheel, second: _Wheel) -> tuple[float, float]:
        """Factors of the motions of both joints relative to the carrier in the coupler's
        equation."""
        raise NotImplementedError

    def reference_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        joints = scope.model.joints
        for i, (joint, coordinate) in enumerate(self.coordinates):
            place = f"{where}.joints[{i}]"
            problems = list(scope.coordinate(place, joint, coordinate))
            yield from (Problem(place, p.what, p.allowed, p.nearest) for p in problems)
            types, noun = self.joint_types[i], self.nouns[i]
            if joint in joints and not problems and joints[joint].type not in types:
                what = f'no {noun} can hang by the {joints[joint].type} joint "{joint}"'
                yield Problem(place, what, types)
        if self.joints[0] == self.joints[1]:
            what = f'names the joint "{self.joints[0]}" twice: a {self.type} joins two of them'
            yield Problem(f"{where}.joints", what)

    def geometry_problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        """Problems without exactly one common body, or with axes on which the wheels cannot
        roll."""
        shared = self.carriers(scope.model)
        if len(shared) == 1:
            yield from super().geometry_problems(scope, where)
            return
        first, second = self.joints
        joins = [
            '"{}" joins {} and {}'.format(joint, *self._bodies(scope.model, joint))
            for joint in self.joints
        ]
        if shared:
            what = f'{joins[0]}, and so does "{second}": the second wheel must be another body'
        else:
            what = f"no common carrier: {joins[0]}, {joins[1]}; both wheels must hang on one body, "
            what += "which may be ground or an arm that turns"
        yield Problem(f"{where}.joints", what)


class GearSpec(RollingCoupler):
    """Two meshing wheels: spur gears, bevel gears, or wheels of a planetary gear train.

    ``joints`` mount them on their common carrier. Exactly one of ``teeth``, ``radii`` and ``ratio``
    is given; ``ratio`` is the revolutions of the second wheel for one of the first, relative to the
    carrier and about the joints' own axes, negative for opposite senses. With teeth or radii the
    sense follows from the axes: wheels rotate in opposite senses about parallel axes, bevel wheels
    as seen from the intersection of their axes, and in the same sense if one lies inside the other
    (``internal``).
    """

    type: Literal["gear"]
    teeth: tuple[_Teeth, _Teeth] | None = None
    radii: tuple[Size, Size] | None = None
    ratio: Number | None = None
    internal: StrictBool = False
    joint_types = (_WHEEL_JOINTS, _WHEEL_JOINTS)
    nouns = ("wheel", "wheel")

    @model_validator(mode="after")
    def _check_measure(self) -> Self:
        only_one(self, "teeth", "radii", "ratio")
        problems = []
        if self.ratio == 0:
            what = "is zero: the second wheel would never turn; leave the gear out, or give turns"
            problems.append(Problem("ratio", what))
        elif self.ratio is not None and self.internal:
            what = "is ignored when 'ratio' is given (its sign sets the direction); remove it"
            problems.append(Problem("internal", what))
        fail_if(problems)
        return self

    @property
    def coordinates(self) -> tuple[Key, ...]:
        return (self.joints[0], "angle"), (self.joints[1], "angle")

    def _factors(self, model: ModelData, first: _Wheel, second: _Wheel) -> tuple[float, float]:
        if self.ratio is not None:
            return self.ratio, -1.0
        sizes = self.teeth or self.radii
        assert sizes is not None  # either teeth or radii, since there is no ratio
        h = second.x - first.x
        if np.linalg.norm(np.cross(first.u, second.u)) < lookup.PARALLEL:
            ends = 1.0, float(np.sign(first.u @ second.u))
            if self.radii is not None:
                distance = float(np.linalg.norm(h - (h @ first.u) * first.u))
                self._check_distance(model, *self.radii, distance)
        else:
            ends = _outward(first, second)
        side = -1.0 if self.internal else 1.0
        return sizes[0] * ends[0], side * sizes[1] * ends[1]

    def _check_distance(self, model: ModelData, R: float, r: float, distance: float) -> None:
        needed = abs(R - r) if self.internal else R + r
        if abs(distance - needed) > _RADII_TOLERANCE * max(R, r):
            say = model.units.say
            kind = "one inside the other" if self.internal else "outside"
            raise SceneError(
                f"wheels of the radii {say(R, 'm')} and {say(r, 'm')} roll {kind} with their axes "
                f"{say(needed, 'm')} apart, these are {say(distance, 'm')} apart; correct radii or "
                'places, or give "ratio"'
            )


def unequal_teeth(model: ModelData, flexbodies: Bodies) -> Iterator[str]:
    """Sentences about wheels in mesh with two others at distances that require different numbers of
    teeth. Pitch circles touch if twice the distance is the module times the sum of the numbers of
    teeth."""
    modules: dict[tuple[str, int], tuple[str, float]] = {}
    for name, gear in model.couplers.items():
        if not isinstance(gear, GearSpec) or gear.teeth is None:
            continue
        carrier = gear.carriers(model)[0]
        first, second = (_wheel(model, joint, carrier, flexbodies) for joint in gear.joints)
        h, (a, b) = second.x - first.x, gear.teeth
        count = abs(a - b) if gear.internal else a + b
        distance = float(np.linalg.norm(h - (h @ first.u) * first.u))
        if count == 0 or np.linalg.norm(np.cross(first.u, second.u)) >= lookup.PARALLEL:
            continue
        module = 2.0 * distance / count
        for joint, teeth in zip(gear.joints, gear.teeth, strict=True):
            other, size = modules.setdefault((joint, teeth), (name, module))
            if abs(module - size) > _MODULE_TOLERANCE * max(module, size):
                say = model.units.say
                yield (
                    f"couplers.{name}: by the distances of the axes the {teeth} teeth of {joint} "
                    f"have the module {say(module, 'm', 4)} here and {say(size, 'm', 4)} in "
                    f"couplers.{other}: numbers of teeth or places do not fit"
                )
                break


class RackSpec(RollingCoupler):
    """A pinion that rolls on a rack; ``joints`` mount first the pinion, then the rack, on the
    carrier.

    The rack moves like the point of the pinion that is nearest to the rack's joint.
    """

    type: Literal["rack-and-pinion"]
    radius: Size
    joint_types = (_WHEEL_JOINTS, _RACK_JOINTS)
    nouns = ("wheel", "rack")

    @property
    def coordinates(self) -> tuple[Key, ...]:
        return (self.joints[0], "angle"), (self.joints[1], "stroke")

    def _factors(self, model: ModelData, first: _Wheel, second: _Wheel) -> tuple[float, float]:
        if abs(first.u @ second.u) > lookup.PARALLEL:
            raise SceneError("the rack must slide at right angles to the axis of its pinion")
        h = second.x - first.x
        n = h - (h @ first.u) * first.u - (h @ second.u) * second.u
        distance = float(np.linalg.norm(n))
        if distance <= _ZERO_DISTANCE * self.radius:
            raise SceneError(
                "the joint of the rack lies on the axis of the pinion, so that it is not known on "
                "which side the rack runs: put its markers on the pitch line, one radius away"
            )
        return self.radius * float(np.cross(first.u, n / distance) @ second.u), -1.0


def _wheel(model: ModelData, joint: str, carrier: str, flexbodies: Bodies) -> _Wheel:
    I, J = lookup.joint_frames(model, joint, flexbodies)  # noqa: E741
    x = lookup.global_position(model, J if I.body == carrier else I)
    return _Wheel(1.0 if I.body == carrier else -1.0, x, lookup.global_axes(model, I)[:, 2])


def _outward(first: _Wheel, second: _Wheel) -> tuple[float, float]:
    """For intersecting axes: +1 if u points from the intersection to the wheel, else -1, for
    each."""
    h = second.x - first.x
    across = np.cross(first.u, second.u)
    n = across / np.linalg.norm(across)
    size = float(np.linalg.norm(h))
    if abs(h @ n) > _ZERO_DISTANCE * size:
        raise SceneError(
            "the axes of the wheels are neither parallel nor do they meet, so that the sense of "
            'turning does not follow from them: give "ratio" with its sign'
        )
    # first.x + s first.u = second.x + t second.u
    s, t = np.linalg.lstsq(np.column_stack([first.u, -second.u]), h, rcond=None)[0]
    ends = (1.0 if abs(a) <= _ZERO_DISTANCE * size else -float(np.sign(a)) for a in (s, t))
    return next(ends), next(ends)
