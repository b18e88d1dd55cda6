"""How a scene is run in time: span, step, outputs, method and its numbers."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import SerializationInfo, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.model.tasks.methods import MethodName
from flexmb.model.values.quantities import Integer, Quantity, Time, plain, read_number
from flexmb.model.values.reading import Reader, Spec, fail, names_of, under, units_of

__all__ = ["ACCURACY", "INSTEAD", "MOST_OUTPUTS", "ROUND_OFF", "DynamicsSpec"]

INSTEAD = {"accuracy": "step", "step": "accuracy"}
"""The choice that another one replaces where both are given, one after the other."""

ACCURACY = 1e-4
"""What is asked for where a scene gives neither accuracy nor step."""

ROUND_OFF = 1e-12
"""Accuracy below which the errors of a run are those of its arithmetic."""


_SAME = 1e-12  # share of the run by which times that are the same may differ


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


MOST_OUTPUTS = 10_000_000
"""Rows that a run records at most."""


def _outputs(value: Any, info: ValidationInfo) -> int | tuple[float, ...]:
    """The number of intervals, or times in SI that increase."""
    value = plain(value)
    if not isinstance(value, list | tuple):
        number = Integer(1).read(value, info)
        if number > MOST_OUTPUTS:
            raise fail(Problem("", f"at most {MOST_OUTPUTS} are recorded, is {number}"))
        return number
    if not value:
        raise fail(Problem("", "the list of output times is empty"))
    if len(value) > MOST_OUTPUTS:
        raise fail(Problem("", f"at most {MOST_OUTPUTS} are recorded, given {len(value)}"))
    names = names_of(info)
    units = units_of(names)
    times: list[float] = []
    problems: list[Problem] = []
    for i, item in enumerate(value):
        try:
            times.append(read_number(item, names, "s") * units.scale("s"))
        except SceneError as error:
            problems += under(f"[{i}]", error.problems)
            continue
        if i == len(times) - 1 and i and times[i] <= times[i - 1]:
            before, now = (units.say(times[j], "s") for j in (i - 1, i))
            what = f"times must increase: {now} does not lie after {before}"
            problems.append(Problem(f"[{i}]", what))
    if problems:
        raise fail(*problems[:_MOST_PROBLEMS])
    return tuple(times)


_MOST_PROBLEMS = 5  # of one list that are told


def _write_outputs(value: int | tuple[float, ...], info: SerializationInfo) -> Any:
    if isinstance(value, int):
        return value
    units = units_of(names_of(info))
    return [units.written(time, "s") for time in value]


class DynamicsSpec(Spec):
    """Run in time.

    ``duration`` [s]; ``outputs`` intervals of equal length are recorded, both ends included, or the
    times of a list [s], those and no other: increasing, from 0 to the duration, to which the run
    goes in any case. Either ``accuracy`` (1e-4
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
    outputs: Annotated[int | tuple[float, ...], Reader(_outputs, _write_outputs)] = 200
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

    @model_validator(mode="after")
    def _outputs_lie_inside(self, info: ValidationInfo) -> Self:
        if isinstance(self.outputs, tuple):
            units = units_of(names_of(info))
            end = units.say(self.duration, "s")
            for i in (0, len(self.outputs) - 1):
                time = self.outputs[i]
                if not -_SAME * self.duration <= time <= self.duration * (1.0 + _SAME):
                    what = (
                        f"{units.say(time, 's')} lies outside the run, which goes from 0 to {end}"
                    )
                    raise fail(Problem(f"outputs[{i}]", what))
        return self

    @property
    def n_rows(self) -> int:
        """Number of rows that are recorded."""
        return len(self.outputs) if isinstance(self.outputs, tuple) else self.outputs + 1
