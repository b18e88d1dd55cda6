"""Dry friction: its coefficients, and friction in joints.

Coulomb friction with the Stribeck curve, mu(v) = dynamic + (static - dynamic) exp(-(v/v_s)^2) +
viscous v. The model "bristle" has true sticking: an elastic spring between the surfaces, which
slides when its force exceeds mu(v) N. "smooth" replaces sticking by a steep slope over speed; it is
cheaper, but creeps under any load. Sources: see :mod:`flexmb.engine.forces.friction`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.functions.expression import parse
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.lookup import Component, ModelData, Scope
from flexmb.model.quantities import Quantity, Size, Text
from flexmb.model.reading import Entry, fail_if

_JOINTS = ("revolute", "prismatic", "cylindrical")
_Coefficient = Annotated[float, Quantity("", "not negative")]
_Speed = Annotated[float, Quantity("m/s", "positive")]
_SAMPLES = 501  # times at which the sign of a preload is examined


class BaseFriction(Component):
    """Coulomb friction with the Stribeck curve.

    ``static`` and ``dynamic`` coefficients (equal by default), ``stribeck_speed`` v_s of the
    transition between them, ``viscous`` increase of the coefficient per speed. ``model``:
    ``"bristle"`` with the ``stiffness`` (and ``damping``) of the surfaces while they stick, or
    ``"smooth"``, which has 71 % of its force at ``creep_speed``.
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
    def _check_coefficients(self) -> Self:
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
        """The coefficient of static friction."""
        return self.dynamic if self.static is None else self.static


class FrictionSpec(BaseFriction):
    """Friction of a contact: Coulomb friction with the Stribeck curve."""


Friction = Annotated[FrictionSpec, Entry()]


Preload = Annotated[Function, FunctionOf("N")]


class JointFrictionSpec(BaseFriction):
    """Friction in a joint, computed from the joint's own reaction.

    It acts on the ``coordinate`` of a revolute, prismatic or cylindrical joint. ``radius`` is that
    of the pin, on whose surface friction acts (for an angle). The bearing, with marker J in its
    middle, carries bending moments over its ``length``, and in a prismatic joint torques about its
    axis over its ``width``; without these, such moments cause no friction. ``preload`` is an
    additional normal force, a number or a function of time, such as that of a brake.
    """

    type: Literal["joint-friction"]
    joint: Text
    coordinate: Literal["angle", "stroke"] | None = None
    radius: Size | None = None
    length: Size | None = None
    width: Size | None = None
    preload: Preload = Function(0.0, parse("0"))

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from self._preload_problems(scope.model, f"{where}.preload")
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

    def _preload_problems(self, model: ModelData, where: str) -> Iterator[Problem]:
        """A preload that is negative at some time of the analyses would pull."""
        spans = [spec.duration for spec in (model.dynamics, model.kinematics) if spec is not None]
        end = max(spans, default=0.0)
        times = np.unique([*np.linspace(0.0, end, _SAMPLES), *self.preload.derivative_jumps(end)])
        values = [self.preload.value(t)[0] for t in times]
        if (least := min(values)) < 0.0:
            say, time = model.units.say, times[values.index(least)]
            what = f"must not be negative, is {say(least, 'N')}"
            if self.preload.constant is None:
                what += f" at t = {say(time, 's')}: it would pull; max(0, ...) presses only"
            yield Problem(where, what)


def friction_coordinate(model: ModelData, spec: JointFrictionSpec) -> str:
    """The coordinate on which friction acts: the stated one, or the only one of the joint."""
    return spec.coordinate or str(model.joints[spec.joint].kind.coordinates[0])
