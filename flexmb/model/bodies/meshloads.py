"""Load patterns on the mesh of a body: they become modal loads, and the modes answer them exactly.

In: groups and values in the scene's units, body axes. Out: specifications in SI with the words of
``flexmb.fe.assembly.loads``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, model_validator

from flexmb.errors import Problem
from flexmb.model.bodies.interfaces import GroupName, NodeChoice
from flexmb.model.values.quantities import Acceleration, Quantity, plain
from flexmb.model.values.reading import Spec, Variant, fail

__all__ = ["LOAD_TYPES", "MeshLoads"]

_Pressure = Annotated[float, Quantity("Pa")]
_PerLength = Annotated[float, Quantity("N/m")]
_Force = Annotated[float, Quantity("N")]
_Moment = Annotated[float, Quantity("N m")]


class PressureLoad(Spec):
    """Pressure on a group of surfaces: it pushes on solids, and along the normal of shells."""

    type: Literal["pressure"]
    group: GroupName
    pressure: _Pressure
    residual: bool = True


class TractionLoad(Spec):
    """Force per area, body axes, on a group of surfaces."""

    type: Literal["traction"]
    group: GroupName
    traction: Annotated[tuple[_Pressure, _Pressure, _Pressure], BeforeValidator(plain)]
    residual: bool = True


class LineLoad(Spec):
    """Force per length, body axes, on a group of lines."""

    type: Literal["line"]
    group: GroupName
    force: Annotated[tuple[_PerLength, _PerLength, _PerLength], BeforeValidator(plain)]
    residual: bool = True


class PointLoad(NodeChoice):
    """Force and moment, body axes, on nodes chosen as for an interface."""

    type: Literal["force"]
    force: Annotated[tuple[_Force, _Force, _Force], BeforeValidator(plain)] | None = None
    moment: Annotated[tuple[_Moment, _Moment, _Moment], BeforeValidator(plain)] | None = None
    residual: bool = True

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if self.force is None and self.moment is None:
            raise fail(Problem("", 'give "force", "moment" or both'))
        return self


class GravityLoad(Spec):
    """The weight in a field of gravity, body axes; it deforms no free body."""

    type: Literal["gravity"]
    acceleration: Acceleration
    residual: bool = False


LOAD_TYPES: dict[str, type[Spec]] = {
    "pressure": PressureLoad,
    "traction": TractionLoad,
    "line": LineLoad,
    "force": PointLoad,
    "gravity": GravityLoad,
}

MeshLoads = dict[str, Annotated[Any, Variant("load type", lambda: LOAD_TYPES)]]
"""Loads on a mesh by name."""
