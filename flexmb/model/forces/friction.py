"""Dry friction: its coefficients, and friction in joints.

Coulomb's law with Stribeck's curve, mu(v) = dynamic + (static - dynamic) exp(-(v/v_s)^2) +
viscous v. The model "bristle" sticks truly: an elastic spring between the surfaces that begins to
slide when its force exceeds mu(v) N. "smooth" replaces sticking by a steep slope over speed; it is
cheap, but creeps under any load. Sources: see :mod:`flexmb.engine.forces.friction`.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.values.quantities import Quantity, Size, Text
from flexmb.model.values.reading import Entry, Spec, fail

__all__ = ["BaseFriction", "Friction", "FrictionSpec", "JointFrictionSpec"]

_Coefficient = Annotated[float, Quantity("", "not negative")]
_Speed = Annotated[float, Quantity("m/s", "positive")]


class BaseFriction(Spec):
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
        if problems:
            raise fail(*problems)
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
