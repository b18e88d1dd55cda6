"""Springs and dampers with actuators: along the line between two markers, or on a joint.

A spring-damper acts along the line between its markers and pulls with k (d - d0) + c d', where d is
the distance. A force characteristic of the elongation or of its rate can replace k or c. The value
of an actuator may be an expression over channels of sensors, states and controllers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.forces.force_characteristic import CharacteristicOf, ForceCharacteristic
from flexmb.model.forces.load import ForceFunction, TorqueFunction
from flexmb.model.functions.function import Function
from flexmb.model.lookup import Component, Scope
from flexmb.model.quantities import Pair, Quantity, Text, WordOr
from flexmb.model.reading import fail_if

_LinearSpring = Annotated[ForceCharacteristic, CharacteristicOf("x", "m", "N")]
_LinearDamper = Annotated[ForceCharacteristic, CharacteristicOf("v", "m/s", "N")]


class NonlinearSpring(Component):
    """A spring, damper and actuator on a coordinate; force characteristics may replace the
    constants."""

    stiffness: float = 0.0
    damping: float = 0.0
    spring_force: ForceCharacteristic | None = None
    damper_force: ForceCharacteristic | None = None
    value: Function | None = None

    @model_validator(mode="after")
    def _check_replacements(self) -> Self:
        fail_if(
            Problem(word, f'replaces "{number}"; give one of them')
            for word, number in (("spring_force", "stiffness"), ("damper_force", "damping"))
            if getattr(self, word) is not None and getattr(self, number) != 0.0
        )
        return self

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        if self.value is not None:
            yield from self.value.problems(f"{where}.value")
        curves = {"spring_force": self.spring_force, "damper_force": self.damper_force}
        numbers, functions = (self.stiffness, self.damping), (*curves.values(), self.value)
        if not any(numbers) and all(function is None for function in functions):
            what = "needs stiffness, damping or value, or spring_force or damper_force"
            yield Problem(where, what)
        for word, curve in curves.items():
            if curve is None:
                continue
            for part, number in zip(("value", "slope"), curve.expression.value(0.0), strict=False):
                if not math.isfinite(number):
                    what = f'the {part} of "{curve.expression.text}" is {number:g} at 0, not finite'
                    yield Problem(f"{where}.{word}", what)
                    break


class JointSpringSpec(NonlinearSpring):
    """A spring, damper and actuator on a coordinate s of a joint.

    The torque or force on the joint is value - k (s - free) - c s'.
    """

    joint: Text
    free: float = 0.0

    @property
    def coordinate(self) -> str:
        """``"angle"``, ``"second_angle"`` or ``"stroke"``."""
        raise NotImplementedError

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.coordinate(where, self.joint, self.coordinate)
        yield from super().problems(scope, where)


class RotationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the angle of a joint, counted over several revolutions.

    ``spring_force`` is a function of x = angle - free and replaces the stiffness, ``damper_force``
    one of the speed v; ``about = "second_axis"``: on the second angle of a universal joint.
    """

    type: Literal["rotational-spring-damper"]
    about: Literal["axis", "second_axis"] = "axis"
    stiffness: Annotated[float, Quantity("N m/rad", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N m s/rad", "not negative")] = 0.0
    spring_force: Annotated[ForceCharacteristic, CharacteristicOf("x", "rad", "N m")] | None = None
    damper_force: Annotated[ForceCharacteristic, CharacteristicOf("v", "rad/s", "N m")] | None = (
        None
    )
    free: Annotated[float, Quantity("rad")] = 0.0
    value: TorqueFunction | None = None

    @property
    def coordinate(self) -> str:
        return "angle" if self.about == "axis" else "second_angle"


class TranslationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the stroke of a joint, the distance from I to J along its
    axis; ``spring_force`` is a function of x = stroke - free and replaces the stiffness,
    ``damper_force`` one of the speed v.
    """

    type: Literal["translational-spring-damper"]
    stiffness: Annotated[float, Quantity("N/m", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    spring_force: _LinearSpring | None = None
    damper_force: _LinearDamper | None = None
    free: Annotated[float, Quantity("m")] = 0.0
    value: ForceFunction | None = None

    @property
    def coordinate(self) -> str:
        return "stroke"


class SpringDamperSpec(NonlinearSpring):
    """A spring, damper and actuator along a line; ``free_length = "placed"``: no force in the
    placed pose. ``spring_force`` is a function of the elongation x and replaces the stiffness,
    ``damper_force`` one of its rate v; both pull if positive. ``value`` pushes the markers apart.
    """

    type: Literal["spring-damper"]
    between: Pair
    stiffness: Annotated[float, Quantity("N/m", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    spring_force: _LinearSpring | None = None
    damper_force: _LinearDamper | None = None
    value: ForceFunction | None = None
    free_length: Annotated[float | str, WordOr("placed", "a length", "m", "not negative")] = (
        "placed"
    )

    @property
    def linear(self) -> bool:
        """Whether it consists of a linear spring and damper only."""
        return (self.spring_force, self.damper_force, self.value) == (None, None, None)

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a spring-damper")
        yield from scope.line_problems(where, self.between, "spring")
        yield from super().problems(scope, where)
