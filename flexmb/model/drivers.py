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
    """Prescribes the ``angle``, ``second_angle`` or ``stroke`` of a joint; exactly one of them."""

    joint: Text
    angle: Annotated[Function, FunctionOf("rad")] | None = None
    second_angle: Annotated[Function, FunctionOf("rad")] | None = None
    stroke: Annotated[Function, FunctionOf("m")] | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        told = self._told()
        if len(told) != 1:
            shown = " and ".join(told) or "none"
            names = '"angle", "second_angle" and "stroke"'
            raise fail(Problem("", f"give exactly one of {names}, given {shown}"))
        return self

    def _told(self) -> list[str]:
        return [name for name in COORDINATES if getattr(self, name) is not None]

    @property
    def coordinate(self) -> str:
        """One of ``COORDINATES``."""
        return self._told()[0]

    @property
    def function(self) -> Function:
        """The prescribed coordinate over time."""
        function: Function = getattr(self, self.coordinate)
        return function
