"""Dry friction: its coefficients, and friction in joints.

Coulomb's law with Stribeck's curve, mu(v) = dynamic + (static - dynamic) exp(-(v/v_s)^2) +
viscous v. The model "bristle" sticks truly: an elastic spring between the surfaces that begins to
slide when its force exceeds mu(v) N. "smooth" replaces sticking by a steep slope over speed; it is
cheap, but creeps under any load. Sources: see :mod:`flexmb.engine.forces.friction`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.lookup import Component, ModelData, Scope
from flexmb.model.quantities import Quantity, Size, Text
from flexmb.model.reading import Entry, fail_if

_JOINTS = ("revolute", "prismatic", "cylindrical")
_Coefficient = Annotated[float, Quantity("", "not negative")]
_Speed = Annotated[float, Quantity("m/s", "positive")]


class BaseFriction(Component):
    """Friction by Coulomb and Stribeck.

    ``static`` and ``dynamic`` coefficients (equal by default), ``stribeck_speed`` v_s at which the
    one turns into the other, ``viscous`` increase of the coefficient per speed. ``model``:
    ``"bristle"`` with the ``stiffness`` of the surfaces (and ``damping``) while they stick, or
    ``"smooth"``, which reaches 71 % of its force at ``creep_speed``.
    """

    static: _Coefficient | None = None
    dynamic: _Coefficient
    stribeck_speed: _Speed = 0.01
    viscous: Annotated[float, Quantity("s/m", "not negative")] = 0.0
    model: Literal["bristle", "smooth"] = "bristle"
    stiffness: Annotated[float, Quantity("N/m", "positive")] | None = None
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    creep_speed: _Speed | None = None

    @model_validator(mode="after")
    def _words_fit(self) -> Self:
        problems = []
        if self.static is not None and self.static < self.dynamic:
            what = f"must be at least dynamic = {self.dynamic:g}, is {self.static:g}"
            problems.append(Problem("static", what))
        if self.model == "bristle":
            if self.stiffness is None:
                what = 'is missing: what sticks is held by a spring (or choose model = "smooth")'
                problems.append(Problem("stiffness", what))
            if self.creep_speed is not None:
                what = "a bristle does not creep; leave it out"
                problems.append(Problem("creep_speed", what))
        else:
            if self.creep_speed is None:
                what = "is missing: the speed at which smooth friction reaches 71 % of its force"
                problems.append(Problem("creep_speed", what))
            if self.stiffness is not None:
                what = "smooth friction has no spring; leave it out"
                problems.append(Problem("stiffness", what))
        fail_if(problems)
        return self

    @property
    def static_coefficient(self) -> float:
        """The coefficient at rest."""
        return self.dynamic if self.static is None else self.static


class FrictionSpec(BaseFriction):
    """Friction of a contact, by Coulomb and Stribeck."""


Friction = Annotated[FrictionSpec, Entry()]


class JointFrictionSpec(BaseFriction):
    """Friction in a joint, from its own reaction.

    On the ``coordinate`` of a revolute, prismatic or cylindrical joint. ``radius`` of the pin, on
    whose surface friction acts (of an angle). The bearing, in the middle of which marker J is,
    carries bending moments by its ``length``, a prismatic one torques about its axis by its
    ``width``; without them these cause no friction. ``preload`` is a normal force of its own.
    """

    type: Literal["joint-friction"]
    joint: Text
    coordinate: Literal["angle", "stroke"] | None = None
    radius: Size | None = None
    length: Size | None = None
    width: Size | None = None
    preload: Annotated[float, Quantity("N", "not negative")] = 0.0

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        joint = scope.model.joints.get(self.joint)
        if joint is None or self.coordinate is not None:
            problems = list(scope.coordinate(where, self.joint, self.coordinate or "angle"))
            yield from problems
            if joint is None or problems:
                return
        if joint.type not in _JOINTS:
            what = f'there is no friction in {joint.type} joints such as "{self.joint}"'
            yield Problem(f"{where}.joint", what, _JOINTS)
            return
        if self.coordinate is None and joint.type == "cylindrical":
            what = "is missing: a cylindrical joint both turns and slides"
            yield Problem(f"{where}.coordinate", what, ("angle", "stroke"))
            return
        turning = friction_coordinate(scope.model, self) == "angle"
        if turning and self.radius is None:
            yield Problem(f"{where}.radius", "is missing: friction acts on the surface of a pin")
        if not turning and self.radius is not None:
            yield Problem(f"{where}.radius", "friction along a stroke needs none; leave it out")
        if self.width is not None and joint.type != "prismatic":
            what = "only a prismatic joint carries a torque about its axis; leave it out"
            yield Problem(f"{where}.width", what)


def friction_coordinate(model: ModelData, spec: JointFrictionSpec) -> str:
    """The coordinate that friction acts on: its own, or the only one of the joint."""
    return spec.coordinate or str(model.joints[spec.joint].kind.coordinates[0])
