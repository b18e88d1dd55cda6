"""States and controllers: what has a memory of its own beside the bodies.

A state is a number with a rate, an expression of channels, states and the time. A controller makes
an output of an input, both numbers in the scene's units, and keeps the states that this needs; its
name is a channel like that of a state, for forces, rates and other controllers.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from flexmb.errors import Problem
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.values.quantities import Number, Quantity, Time
from flexmb.model.values.reading import Spec, fail
from flexmb.model.values.told_units import ToldUnit, UnitName

__all__ = ["CONTROLLER_TYPES", "ControllerSpec", "PidSpec", "StateSpec", "TransferFunctionSpec"]

_Input = Annotated[Function, FunctionOf("", channels=True)]
_Scale = Annotated[float, Quantity("", "positive")]


def _as_list(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


Coefficients = Annotated[tuple[Number, ...], BeforeValidator(_as_list)]


class StateSpec(Spec):
    """A number with a rate [unit/s], from ``start`` [unit] on.

    ``scale`` is a value from which on it is large: error control keeps errors small against it; by
    default the larger of the start and one.
    """

    unit: UnitName = ""
    rate: Annotated[Function, ToldUnit(rate=True)]
    start: Annotated[Function, ToldUnit(channels=False)] | None = None
    scale: _Scale | None = None

    @model_validator(mode="after")
    def _a_number(self) -> Self:
        if self.start is not None and self.start.constant is None:
            raise fail(Problem("start", "is a number, no function of time"))
        return self

    @property
    def first(self) -> float:
        """Value at the start, in SI."""
        return float(self.start.constant or 0.0) if self.start is not None else 0.0


class ControllerSpec(Spec):
    """Base of the controllers: ``input`` is an expression; ``unit`` that of the output.

    ``scale`` is the size of the input from which on it is large, for the error control.
    """

    unit: UnitName = ""
    input: _Input
    scale: _Scale = 1.0


class PidSpec(ControllerSpec):
    """Output kp e + ki int(e) + kd e', e the input, its rate filtered: kd s/(1 + filter s).

    With ``limits = [low, high]`` the output stays between them, and the integral follows it there
    within the time ``tracking`` (anti-windup by back-calculation); by default sqrt(kd/ki), without
    kd kp/ki. Gains are in the scene's units. The filter starts at rest: no kick.
    """

    type: Literal["pid"]
    kp: Number = 0.0
    ki: Number = 0.0
    kd: Number = 0.0
    filter: Time | None = None
    limits: tuple[Number, Number] | None = None
    tracking: Time | None = None

    @model_validator(mode="after")
    def _words_fit(self) -> Self:
        problems = []
        if self.kp == 0 and self.ki == 0 and self.kd == 0:
            problems.append(Problem("", "does nothing: give kp, ki or kd"))
        if self.kd != 0 and self.filter is None:
            what = "is missing: the time constant of the rate's filter, a tenth of kd/kp or less"
            problems.append(Problem("filter", what))
        if self.kd == 0 and self.filter is not None:
            problems.append(Problem("filter", "is that of the rate, but kd is zero; leave it out"))
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            what = f"the lower limit comes first, given [{self.limits[0]:g}, {self.limits[1]:g}]"
            problems.append(Problem("limits", what))
        winds = self.limits is not None and self.ki != 0
        if self.tracking is not None and not winds:
            problems.append(Problem("tracking", "has a meaning with ki and limits; leave it out"))
        if winds and self.tracking is None and self.kp == 0 and self.kd == 0:
            what = "is missing: the time in which the integral follows an output at its limit"
            problems.append(Problem("tracking", what))
        if problems:
            raise fail(*problems)
        return self


class TransferFunctionSpec(ControllerSpec):
    """Output G(s) input, coefficients of falling powers of s; from rest.

    G = (b0 s^m + ... + bm)/(a0 s^n + ... + an), m <= n; realised in controllable canonical form.
    """

    type: Literal["transfer-function"]
    numerator: Coefficients
    denominator: Coefficients

    @model_validator(mode="after")
    def _proper(self) -> Self:
        b, a = self.polynomials
        if len(a) == 0:
            raise fail(Problem("denominator", "is zero"))
        if len(b) > len(a):
            what = (
                f"has degree {len(b) - 1}, the denominator {len(a) - 1}: such a transfer function "
                "is improper, it would need rates of its input; raise the denominator's degree "
                "with a fast pole"
            )
            raise fail(Problem("numerator", what))
        return self

    @property
    def polynomials(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Numerator and denominator without leading zeros."""
        trimmed = (np.trim_zeros(np.array(p), "f") for p in (self.numerator, self.denominator))
        b, a = (tuple(float(c) for c in p) for p in trimmed)
        return b, a

    @property
    def direct(self) -> bool:
        """Whether the output follows the input at once."""
        b, a = self.polynomials
        return len(b) == len(a)


CONTROLLER_TYPES: dict[str, type[Spec]] = {
    "pid": PidSpec,
    "transfer-function": TransferFunctionSpec,
}
