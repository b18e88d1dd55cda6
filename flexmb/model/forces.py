"""Forces: applied force and torque at a marker, springs and dampers along a line or on a joint.

SI: N, N m, N/m, N s/m. The components of a force are in global axes, or in the marker's own axes,
which turn with the body. A spring-damper acts along the line between its markers and pulls with
k (d - d0) + c d', d the distance.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ValidationInfo

from flexmb.errors import Problem
from flexmb.model.functions import Function
from flexmb.model.quantities import Pair, Quantity, Text
from flexmb.model.reading import Reader, Spec, fail, given

__all__ = ["FORCE_TYPES", "JointSpringSpec", "LoadSpec", "SpringDamperSpec"]

Triple = tuple[Function, Function, Function]


class LoadSpec(Spec):
    """A force or a torque on a marker, three functions of time; its reaction is on ground."""

    type: Literal["force", "torque"]
    at: Text
    value: Triple
    axes: Literal["global", "body"] = "global"


def _free_length(value: Any, info: ValidationInfo) -> float | str:
    if value == "placed":
        return "placed"
    if isinstance(value, str) and value.isalpha() and value not in (info.context or {}):
        what = f"a length [m] is expected, given {given(value)}"
        raise fail(Problem("", what, ("placed", "a number or an expression")))
    return Quantity("m", "not negative").read(value, info)


class JointSpringSpec(Spec):
    """A linear spring, damper and actuator on the angle or the stroke s of a joint.

    It pulls the joint with k (s - free) + c s' - value; an angle counts turns. Units for an angle:
    N m/rad, N m s/rad, rad, N m; for a stroke: N/m, N s/m, m, N.
    """

    type: Literal["joint-spring"]
    joint: Text
    coordinate: Literal["angle", "stroke"] | None = None
    stiffness: Annotated[float, Quantity("", "not negative")] = 0.0
    damping: Annotated[float, Quantity("", "not negative")] = 0.0
    free: Annotated[float, Quantity()] = 0.0
    value: Function | None = None


class SpringDamperSpec(Spec):
    """A linear spring and damper; ``free_length = "placed"``: no force in the placed pose."""

    type: Literal["spring-damper"]
    between: Pair
    stiffness: Annotated[float, Quantity("N/m", "not negative")]
    damping: Annotated[float, Quantity("N s/m", "not negative")] = 0.0
    free_length: Annotated[float | str, Reader(_free_length)] = "placed"


FORCE_TYPES: dict[str, type[Spec]] = {
    "force": LoadSpec,
    "torque": LoadSpec,
    "spring-damper": SpringDamperSpec,
    "joint-spring": JointSpringSpec,
}
