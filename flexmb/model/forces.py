"""Forces: applied force and torque at a marker, springs and dampers along a line or on a joint.

The components of a force are in global axes, or in the marker's own axes,
which turn with the body. A spring-damper acts along the line between its markers and pulls with
k (d - d0) + c d', d the distance. Values of forces and torques, and those that act on joints, may
be expressions over channels: of sensors, states and controllers.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ValidationInfo

from flexmb.errors import Problem
from flexmb.model.contacts import ContactSpec
from flexmb.model.friction import JointFrictionSpec
from flexmb.model.functions import Function, FunctionOf
from flexmb.model.quantities import Pair, Quantity, Text
from flexmb.model.reading import Reader, Spec, fail, given, names_of, units_of

__all__ = [
    "FORCE_TYPES",
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
    """A force or a torque on a marker, three functions of time; its reaction is on ground."""

    type: Literal["force", "torque"]
    at: Text
    value: tuple[Function, Function, Function]
    axes: Literal["global", "body"] = "global"


class ForceSpec(LoadSpec):
    """A force on the marker ``at``; with ``axes = "body"`` it turns with the marker."""

    type: Literal["force"]
    value: tuple[_Force, _Force, _Force]


class TorqueSpec(LoadSpec):
    """A torque on the body of the marker ``at``; with ``axes = "body"`` it turns with it."""

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


class JointSpringSpec(Spec):
    """A linear spring, damper and actuator on a coordinate s of a joint.

    It turns or pushes the joint with value - k (s - free) - c s'.
    """

    joint: Text
    stiffness: float = 0.0
    damping: float = 0.0
    free: float = 0.0
    value: Function | None = None

    @property
    def coordinate(self) -> str:
        """``"angle"``, ``"second_angle"`` or ``"stroke"``."""
        raise NotImplementedError


class RotationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the angle of a joint, which counts turns.

    ``about = "second_axis"``: on the second angle of a universal joint.
    """

    type: Literal["rotational-spring-damper"]
    about: Literal["axis", "second_axis"] = "axis"
    stiffness: Annotated[float, Quantity("N m/rad", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N m s/rad", "not negative")] = 0.0
    free: Annotated[float, Quantity("rad")] = 0.0
    value: _Torque | None = None

    @property
    def coordinate(self) -> str:
        return "angle" if self.about == "axis" else "second_angle"


class TranslationalSpringSpec(JointSpringSpec):
    """A spring, damper and actuator on the stroke of a joint."""

    type: Literal["translational-spring-damper"]
    stiffness: Annotated[float, Quantity("N/m", "not negative")] = 0.0
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    free: Annotated[float, Quantity("m")] = 0.0
    value: _Force | None = None

    @property
    def coordinate(self) -> str:
        return "stroke"


class SpringDamperSpec(Spec):
    """A linear spring and damper; ``free_length = "placed"``: no force in the placed pose."""

    type: Literal["spring-damper"]
    between: Pair
    stiffness: Annotated[float, Quantity("N/m", "not negative")]
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    free_length: Annotated[float | str, Reader(_free_length, _FREE_LENGTH.write)] = "placed"


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
}
