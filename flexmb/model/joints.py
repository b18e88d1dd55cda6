"""Joints: what they leave free between two markers, as data.

``axis`` is a global direction in the placed pose, where the joint angle is 0; left out, it is the z
axis of both markers and the angle is measured between their x axes. The stroke is the distance from
marker I to marker J along the axis. Equations: Shabana, Dynamics of Multibody Systems, ch. 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem, nearest
from flexmb.model.quantities import Axis, Pair
from flexmb.model.reading import Reader, Spec, fail, given

__all__ = ["COORDINATES", "JOINT_TYPES", "JointSpec", "JointType"]

COORDINATES = ("angle", "stroke")
"""Joint coordinates: angle [rad] about the axis, stroke [m] along it."""


@dataclass(frozen=True)
class JointType:
    """One row of the joint table."""

    name: str
    equations: int
    planar_equations: int
    coordinates: tuple[str, ...]
    has_axis: bool
    summary: str

    @property
    def freedoms(self) -> int:
        """Relative motions it leaves free, between two bodies in space."""
        return 6 - self.equations


JOINT_TYPES: dict[str, JointType] = {
    row.name: row
    for row in (
        JointType("fixed", 6, 3, (), False, "holds both markers together, place and axes"),
        JointType("revolute", 5, 2, ("angle",), True, "turns about its axis"),
        JointType("prismatic", 5, 2, ("stroke",), True, "slides along its axis"),
        JointType("cylindrical", 4, 2, ("angle", "stroke"), True, "turns about and slides along"),
        JointType("spherical", 3, 2, (), False, "holds the markers' points together"),
    )
}


def _type(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str) or value not in JOINT_TYPES:
        names = tuple(sorted(JOINT_TYPES))
        near = nearest(str(value), names)
        raise fail(Problem("", f"unknown joint type {given(value)}", names, near))
    return value


class JointSpec(Spec):
    """A joint between the markers ``between = [I, J]``."""

    type: Annotated[str, Reader(_type)]
    between: Pair
    axis: Axis | None = None

    @model_validator(mode="after")
    def _axis_means_something(self) -> Self:
        if self.axis is not None and not JOINT_TYPES[self.type].has_axis:
            raise fail(Problem("axis", f"a {self.type} joint has no axis; leave it out"))
        return self
