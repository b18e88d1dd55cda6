"""How a scene is run in time: span, step, outputs, method and its numbers."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import ValidationInfo, model_validator

from flexmb.errors import Problem
from flexmb.model.tasks.methods import MethodName
from flexmb.model.values.quantities import Integer, Quantity, Time
from flexmb.model.values.reading import Reader, Spec, fail

__all__ = ["ACCURACY", "INSTEAD", "ROUND_OFF", "DynamicsSpec"]

INSTEAD = {"accuracy": "step", "step": "accuracy"}
"""The choice that another one replaces where both are given, one after the other."""

ACCURACY = 1e-4
"""What is asked for where a scene gives neither accuracy nor step."""

ROUND_OFF = 1e-12
"""Accuracy below which the errors of a run are those of its arithmetic."""


def _radius(value: Any, info: ValidationInfo) -> float:
    number = Quantity().read(value, info)
    if not 0 <= number <= 1:
        raise fail(Problem("", f"must lie between 0 and 1, is {number:g}"))
    return number


def _tolerance(value: Any, info: ValidationInfo) -> float:
    number = Quantity("", "positive").read(value, info)
    if number >= 1:
        raise fail(Problem("", f"is relative and must be less than 1, is {number:g}"))
    return number


def _accuracy(value: Any, info: ValidationInfo) -> float:
    number = _tolerance(value, info)
    if number < ROUND_OFF:
        what = f"must be at least {ROUND_OFF:g}, is {number:g}; smaller errors are round-off"
        raise fail(Problem("", what))
    return number


class DynamicsSpec(Spec):
    """Run in time.

    ``duration`` [s]; ``outputs`` intervals of equal length are recorded. Either ``accuracy`` (1e-4
    by default): the largest error over the outputs of each position sensor, over its peak-to-peak;
    or ``step`` [s]: steps of fixed length. The error is measured by a second run with longer steps,
    a scout, unless ``verify`` is false. ``order`` is that of explicit-rk. ``spectral_radius`` is
    that of generalized-alpha at infinite frequency, from 0 to 1 (1 means no numerical damping);
    ``newton_tolerance`` is relative to the share of the accelerations in a step's motion, by
    default 1e-8 with fixed steps and a share of the error allowed with error control;
    ``start = "quasi-static"`` puts the flexible bodies into elastic equilibrium with the initial
    motion, ``"undeformed"`` leaves them straight.
    """

    duration: Time
    accuracy: Annotated[float, Reader(_accuracy)] | None = None
    verify: bool = True
    step: Time | None = None
    outputs: Annotated[int, Integer(1)] = 200
    method: MethodName = "auto"
    order: Literal[5, 8] = 8
    spectral_radius: Annotated[float, Reader(_radius)] = 0.8
    newton_tolerance: Annotated[float, Reader(_tolerance)] | None = None
    start: Literal["undeformed", "quasi-static"] = "undeformed"

    @model_validator(mode="after")
    def _step_fits(self) -> Self:
        if self.step is not None and self.accuracy is not None:
            what = "accuracy chooses the steps itself: give either accuracy or a fixed step"
            raise fail(Problem("step", what))
        if self.step is not None and self.step > self.duration:
            what = f"must not exceed the duration {self.duration:g} s, is {self.step:g} s"
            raise fail(Problem("step", what))
        return self
