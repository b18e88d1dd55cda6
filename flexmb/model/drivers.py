"""Drivers: a joint coordinate as a function of time."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import model_validator

from flexmb.errors import Problem
from flexmb.model.functions import Function, FunctionOf
from flexmb.model.joints import COORDINATES
from flexmb.model.quantities import Text
from flexmb.model.reading import Spec, fail

__all__ = ["DriverSpec"]


class DriverSpec(Spec):
    """Prescribes the ``angle`` or the ``stroke`` of a joint; exactly one of them."""

    joint: Text
    angle: Annotated[Function, FunctionOf("rad")] | None = None
    stroke: Annotated[Function, FunctionOf("m")] | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        told = [name for name in COORDINATES if getattr(self, name) is not None]
        if len(told) != 1:
            shown = "both" if told else "neither"
            raise fail(Problem("", f'give exactly one of "angle" and "stroke", given {shown}'))
        return self

    @property
    def coordinate(self) -> str:
        """``"angle"`` or ``"stroke"``."""
        return "angle" if self.angle is not None else "stroke"

    @property
    def function(self) -> Function:
        """The prescribed coordinate over time."""
        function = self.angle if self.angle is not None else self.stroke
        assert function is not None  # exactly one is given
        return function
