"""Forces: applied force and torque at a marker, springs and dampers along a line or on a joint.

The components of a force are in global axes, in the marker's own axes, which turn with the body, or
in those of any marker. A spring-damper acts along the line between its markers and pulls with
k (d - d0) + c d', d the distance; a law of the elongation or of its rate can stand in place of k or
c. Values of forces, torques and actuators may be expressions over channels: of sensors, states and
controllers. Bushings, beams and stops are in modules of their own.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.forces.contacts import ContactSpec
from flexmb.model.forces.elements import BeamForceSpec, BushingSpec
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.forces.laws import Law, LawOf
from flexmb.model.forces.stops import (
    JointStopSpec,
    RotationalStopSpec,
    StopSpec,
    TranslationalStopSpec,
)
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.values.quantities import Pair, Quantity, Text
from flexmb.model.values.reading import Reader, Spec, fail, given, names_of, units_of

__all__ = [
    "FORCE_TYPES",
    "AnyForce",
    "ForceSpec",
    "JointSpringSpec",
    "LineForceSpec",
    "LoadSpec",
    "RotationalSpringSpec",
    "SpringDamperSpec",
    "TorqueSpec",
    "TranslationalSpringSpec",
]

_Force = Annotated[Function, FunctionOf("N", channels=True)]
_Torque = Annotated[Function, FunctionOf("N m", channels=True)]


class LoadSpec(Spec):
    """A force or a torque on a marker, three functions of time.

    Its opposite is on ground, or on the body of the marker ``reaction``.
    """

    type: Literal["force", "torque"]
    at: Text
    value: tuple[Function, Function, Function]
    axes: Text = "global"
    reaction: Text | None = None

    @property
    def axes_marker(self) -> str | None:
        """The marker whose axes it has, if these are not the global ones or its own."""
        return None if self.axes in ("global", "body") else self.axes


class ForceSpec(LoadSpec):
    """A force on the marker ``at``, in ``global`` axes, in the marker's own with ``axes = "body"``,
    or in those of any marker named; with ``reaction`` its opposite acts on the body of that marker,
    at the same point.
    """

    type: Literal["force"]
    value: tuple[_Force, _Force, _Force]


class TorqueSpec(LoadSpec):
    """A torque on the body of the marker ``at``; axes and reaction as of a force."""

    type: Literal["torque"]
    value: tuple[_Torque, _Torque, _Torque]


_FREE_LENGTH = Quantity("m", "not negative")


def _free_length(value: Any, info: ValidationInfo) -> float | str:
    if value == "placed":
        return "placed"
    if isinstance(value, str) and value.isalpha() and value not in (info.context or {}):
        label = units_of(names_of(info)).label("m")
        what = f"a length [{label}] is expected, given {given(value)}"
        raise fail(Problem("", what, ("placed", "a number or an expression")))
    return _FREE_LENGTH.read(value, info)


class _Lawful(Spec):
    """A spring, damper and actuator on a coordinate; laws in place of the numbers if told."""

    stiffness: float = 0.0
    damping: float = 0.0
    spring_force: Law | None = None
    damper_force: Law | None = None
    value: Function | None = None

    @model_validator(mode="after")
    def _one_law_each(self) -> Self:
        problems = [
            Problem(law, f'stands in place of "{number}"; give one of them')
            for law, number in (("spring_force", "stiffness"), ("damper_force", "damping"))
            if getattr(self, law) is not None and getattr(self, number) != 0.0
        ]
        if problems:
            raise fail(*problems)
        return self

    @property
    def does_nothing(self) -> bool:
        """Whether neither number nor law nor function is told."""
        laws = (self.spring_force, self.damper_force, self.value)
        return self.stiffness == 0 and self.damping == 0 and laws == (None, None, None)


class JointSpringSpec(_Lawful):
    """A spring, damper and actuator on a coordinate s of a joint.

    It turns or pushes the joint with value - k (s - free) - c s'.
    """

    joint: Text
    free: float = 0.0

    @property
    def coordinate(self) -> str:
        """``"angle"``, ``"second_angle"`` or ``"stroke"``."""
        raise NotImplementedError


class RotationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the angle of a joint, which counts turns.

    ``spring_force`` is a law of x = angle - free in place of the stiffness, ``damper_force`` one of
    the speed v; ``about = "second_axis"``: on the second angle of a universal joint.
    """

    type: Literal["rotational-spring-damper"]
    about: Literal["axis", "second_axis"] = "axis"
    stiffness: Annotated[float, Quantity("N m/rad", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N m s/rad", "not negative")] = 0.0
    spring_force: Annotated[Law, LawOf("x", "rad", "N m")] | None = None
    damper_force: Annotated[Law, LawOf("v", "rad/s", "N m")] | None = None
    free: Annotated[float, Quantity("rad")] = 0.0
    value: _Torque | None = None

    @property
    def coordinate(self) -> str:
        return "angle" if self.about == "axis" else "second_angle"


_LinearSpring = Annotated[Law, LawOf("x", "m", "N")]
_LinearDamper = Annotated[Law, LawOf("v", "m/s", "N")]


class TranslationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the stroke of a joint; ``spring_force`` is a law of
    x = stroke - free in place of the stiffness, ``damper_force`` one of the speed v.
    """

    type: Literal["translational-spring-damper"]
    stiffness: Annotated[float, Quantity("N/m", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    spring_force: _LinearSpring | None = None
    damper_force: _LinearDamper | None = None
    free: Annotated[float, Quantity("m")] = 0.0
    value: _Force | None = None

    @property
    def coordinate(self) -> str:
        return "stroke"


class SpringDamperSpec(_Lawful):
    """A spring, damper and actuator along a line; ``free_length = "placed"``: no force in the
    placed pose. ``spring_force`` is a law of the elongation x in place of the stiffness,
    ``damper_force`` one of its rate v; both pull if positive. ``value`` pushes the markers apart.
    """

    type: Literal["spring-damper"]
    between: Pair
    stiffness: Annotated[float, Quantity("N/m", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    spring_force: _LinearSpring | None = None
    damper_force: _LinearDamper | None = None
    value: _Force | None = None
    free_length: Annotated[float | str, Reader(_free_length, _FREE_LENGTH.write)] = "placed"

    @property
    def linear(self) -> bool:
        """Whether it is a linear spring and damper and nothing else."""
        return (self.spring_force, self.damper_force, self.value) == (None, None, None)


class LineForceSpec(Spec):
    """A force along the line between two markers, pushing them apart where it is positive."""

    type: Literal["line-force"]
    between: Pair
    value: _Force


FORCE_TYPES: dict[str, type[Spec]] = {
    "force": ForceSpec,
    "torque": TorqueSpec,
    "spring-damper": SpringDamperSpec,
    "line-force": LineForceSpec,
    "rotational-spring-damper": RotationalSpringSpec,
    "translational-spring-damper": TranslationalSpringSpec,
    "contact": ContactSpec,
    "joint-friction": JointFrictionSpec,
    "bushing": BushingSpec,
    "beam": BeamForceSpec,
    "stop": StopSpec,
    "rotational-stop": RotationalStopSpec,
    "translational-stop": TranslationalStopSpec,
}
AnyForce = (
    LoadSpec | SpringDamperSpec | LineForceSpec | JointSpringSpec | BushingSpec | BeamForceSpec
    | StopSpec | JointStopSpec | ContactSpec | JointFrictionSpec
)  # fmt: skip
"""Every force of a model."""
