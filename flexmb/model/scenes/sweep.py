"""Options of a sweep: distributions and values of knobs, scalars of channels, questions.

In: texts such as ``normal(0.15, 1e-4)``, ``0.1..0.2:5``, ``slider.x:peak-to-peak``,
``crank_pin.rod.force:max <= 5 kN``. Out: records by which settings are sampled and runs are
assessed. Numbers may be expressions over the scene's parameters and may have units, as everywhere
in a scene.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.quantities import Integer, Quantity, plain, read_number
from flexmb.model.reading import (
    NUMBER,
    ReadContext,
    Reader,
    Spec,
    context_of,
    fail,
    fail_if,
    quote,
    under,
)
from flexmb.model.scenes.study import leaves, read_value, split_values

DISTRIBUTIONS = {
    "uniform": ("low", "high"),
    "log-uniform": ("low", "high"),
    "normal": ("mean", "deviation"),
    "triangular": ("low", "mode", "high"),
    "choice": ("value", "value", "..."),
}
"""Distributions and their parameters; `normal` may have two more, limits that no value exceeds."""

SCALARS = ("min", "max", "peak", "peak-to-peak", "rms", "mean", "final")
"""Scalars of a channel over the outputs of a run; `peak` is the largest magnitude."""

_CALL = re.compile(r"\s*([A-Za-z][\w-]*)\s*\((.*)\)\s*(?::(.*))?\Z", re.DOTALL)
_RANGE = re.compile(r"\s*(.*?)\s*\.\.(?![/\\])\s*([^:]*?)\s*(?::(.*))?\Z", re.DOTALL)
_QUESTION = re.compile(
    r"\s*(?:(minimise|maximise)\s+(\S+)|([^\s<>=]+)\s*(<=|>=|<|>|==?)\s*(.+?))\s*\Z"
)
_MAX_LEVELS = 10_000
_NORMAL_LIMITS = 4  # parameters of a normal distribution with limits


@dataclass(frozen=True)
class Distribution:
    """The distribution of the values of a knob.

    Attributes
    ----------
    kind : str
        One of `DISTRIBUTIONS`.
    numbers : tuple of float
        Its numbers, in the scene's units.
    choices : tuple
        Values of a ``choice``.
    levels : int
        Number of values on a grid; 0 if not stated.
    """

    kind: str
    numbers: tuple[float, ...] = ()
    choices: tuple[Any, ...] = ()
    levels: int = 0

    @property
    def text(self) -> str:
        """The distribution in its notation."""
        if self.kind == "choice":
            return ", ".join(map(str, self.choices))
        inside = ", ".join(repr(number).removesuffix(".0") for number in self.numbers)
        return f"{self.kind}({inside})" + (f":{self.levels}" if self.levels else "")

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest value; for a normal distribution two standard deviations to each
        side."""
        if self.kind != "normal":
            return self.numbers[0], self.numbers[-1]
        mean, deviation, *limits = self.numbers
        low, high = limits or (mean - 2.0 * deviation, mean + 2.0 * deviation)
        return max(low, mean - 2.0 * deviation), min(high, mean + 2.0 * deviation)


def read_distribution(source: Any, names: ReadContext) -> Distribution:
    """The distribution described by a text, a number or a list of values.

    Parameters
    ----------
    source : str, number or list
        ``normal(0.15, 1e-4)``; a range ``0.1..0.2`` (uniform), ``0.1..0.2:5`` (five values at equal
        distances); values with commas or a list.
    names : ReadContext
        Parameters and units of the scene.

    Raises
    ------
    SceneError
        All that is wrong with it.
    """
    if not isinstance(source, str):
        values = plain(source)
        return _choice(values if isinstance(values, list) else [values])
    call, ends = _CALL.match(source), _RANGE.match(source)
    if call is not None and (call[1] in DISTRIBUTIONS or nearest(call[1], DISTRIBUTIONS)):
        kind, inside, levels = call.groups()
        if kind not in DISTRIBUTIONS:
            raise SceneError.unknown_name("distribution", kind, DISTRIBUTIONS)
    elif ends is not None:
        if not (ends[1] and ends[2]):
            raise SceneError(f"{quote(source)}: a range has two ends: low..high")
        kind, inside, levels = "uniform", f"{ends[1]}, {ends[2]}", ends[3]
    else:
        return _choice([read_value(piece.strip()) for piece in split_values(source)])
    if kind == "choice":
        return _choice([read_value(piece.strip()) for piece in split_values(inside)])
    numbers = tuple(read_number(piece.strip(), names, None) for piece in split_values(inside))
    _check_numbers(kind, numbers, source)
    return Distribution(kind, numbers, levels=0 if levels is None else _levels(levels, source))


def numbers_written(source: Any) -> list[Any]:
    """The values in the notation of a distribution, as they are written: numbers, or texts."""
    if not isinstance(source, str):
        values = plain(source)
        return values if isinstance(values, list) else [values]
    call, ends = _CALL.match(source), _RANGE.match(source)
    if call is not None and call[1] in DISTRIBUTIONS:
        source = call[2]
    elif ends is not None:
        source = f"{ends[1]}, {ends[2]}"
    return [read_value(piece.strip()) for piece in split_values(source)]


def _choice(values: list[Any]) -> Distribution:
    if not values or any(isinstance(value, str) and not value.strip() for value in values):
        raise SceneError("no values are given" if not values else "a value is empty")
    distinct = [value for i, value in enumerate(values) if value not in values[:i]]
    return Distribution("choice", choices=tuple(distinct))


def _levels(text: str, source: str) -> int:
    number = text.strip()
    if not number.isdigit() or not 2 <= int(number) <= _MAX_LEVELS:
        what = f'{quote(source)} needs after ":" a number of values from 2 to {_MAX_LEVELS}'
        raise SceneError(what)
    return int(number)


def _check_numbers(kind: str, numbers: tuple[float, ...], source: str) -> None:
    form = f"{kind}({', '.join(DISTRIBUTIONS[kind])})"
    limited = kind == "normal" and len(numbers) == _NORMAL_LIMITS
    if len(numbers) != len(DISTRIBUTIONS[kind]) and not limited:
        count = f"{len(numbers)} number{'s' * (len(numbers) != 1)}"
        raise SceneError(f"{form} is expected, {quote(source)} has {count}")
    where = f"{quote(source)}: "
    if kind == "normal":
        mean, deviation, *limits = numbers
        if deviation <= 0.0:
            raise SceneError(f"{where}the deviation must be positive, is {deviation:g}")
        if limits and not limits[0] < mean < limits[1]:
            raise SceneError(f"{where}the limits must be below and above the mean")
        return
    low, high = numbers[0], numbers[-1]
    if not low < high:
        raise SceneError(f"{where}the range is empty: {low:g} is not below {high:g}")
    if kind == "log-uniform" and low <= 0.0:
        raise SceneError(f"{where}the ends must be positive, the lower one is {low:g}")
    if kind == "triangular" and not low <= numbers[1] <= high:
        raise SceneError(f"{where}the mode {numbers[1]:g} must lie between {low:g} and {high:g}")


def read_scalar(text: str) -> tuple[str, str]:
    """Channel and scalar of ``slider.x:max``; the scalar is empty if the text has none.

    Raises
    ------
    SceneError
        An unknown scalar.
    """
    channel, colon, word = str(text).strip().rpartition(":")
    if not colon:
        return word, ""
    if word not in SCALARS:
        raise SceneError.unknown_name("scalar", word, SCALARS)
    return channel, word


@dataclass(frozen=True)
class Question:
    """A question of a designer: a bound or a value of a scalar, or its minimum or maximum.

    Attributes
    ----------
    scalar : tuple of str
        Channel and scalar.
    relation : str
        ``"<="``, ``">="``, ``"="``, ``"minimise"`` or ``"maximise"``.
    bound : str
        A number, with or without a unit; its quantity is that of the channel.
    """

    scalar: tuple[str, str]
    relation: str
    bound: str = ""

    @property
    def text(self) -> str:
        """The question in its notation."""
        name = ":".join(self.scalar)
        return f"{name} {self.relation} {self.bound}" if self.bound else f"{self.relation} {name}"


def read_question(text: str) -> Question:
    """Read a question such as ``slider.x:max <= 0.6`` or ``minimise lift.y:rms``.

    Raises
    ------
    SceneError
        It cannot be read.
    """
    match = _QUESTION.match(str(text))
    if match is None:
        raise SceneError(
            f"{quote(text)} is no question: write channel:scalar <= value (or >=, =), "
            "minimise channel:scalar or maximise channel:scalar"
        )
    extreme, objective, name, relation, bound = match.groups()
    channel, scalar = read_scalar(objective or name)
    if not scalar:
        what = f"{quote(text)} needs a scalar, such as {channel}:max"
        raise SceneError.from_problems([Problem("", what, SCALARS)])
    relation = extreme or {"<": "<=", ">": ">=", "==": "="}.get(relation, relation)
    return Question((channel, scalar), relation, bound or "")


def read_knobs(
    vary: Mapping[str, Any], names: ReadContext
) -> tuple[dict[str, Distribution], list[Problem]]:
    """Distributions by knob, and problems of them."""
    knobs: dict[str, Distribution] = {}
    problems: list[Problem] = []
    for knob, source in leaves("", vary):
        try:
            is_read = isinstance(source, Distribution)
            knobs[knob] = source if is_read else read_distribution(source, names)
        except SceneError as error:
            problems += under(knob, error.problems)
    return knobs, problems


def _vary(value: Any, info: ValidationInfo) -> dict[str, Distribution]:
    if not isinstance(value, Mapping):
        raise fail(Problem("", f"a table {{knob = values, ...}} is expected, given {quote(value)}"))
    knobs, problems = read_knobs(value, context_of(info))
    fail_if(problems)
    return knobs


def _write_vary(value: Mapping[str, Distribution], info: SerializationInfo) -> dict[str, Any]:
    return {
        knob: list(one.choices) if one.kind == "choice" else one.text for knob, one in value.items()
    }


def _readable(read: Callable[[str], object]) -> Reader:
    """Annotation of a text that a function must be able to read."""

    def check(value: Any, info: ValidationInfo) -> str:
        if not isinstance(value, str):
            raise fail(Problem("", f"a text is expected, given {quote(value)}"))
        try:
            read(value)
        except SceneError as error:
            raise fail(*error.problems) from None
        return value

    return Reader(check, form={"type": "string"})


def _share(value: Any, info: ValidationInfo) -> float:
    number = Quantity("", "positive").read(value, info)
    if number >= 1.0:
        raise fail(Problem("", f"is a share of the runs, below 1; is {number:g}"))
    return number


class SweepSpec(Spec):
    """Sweep over knobs of a scene: samples, statistics, sensitivities, questions.

    ``vary`` names knobs and their distributions: ``"normal(0.15, 1e-4)"``, ``"0.1..0.2"``
    (uniform), ``"0.1..0.2:5"`` (five values of a grid), or a list of values. ``method`` selects the
    settings, by default a grid if all knobs have values, else Sobol samples; ``samples`` is their
    number (for a Saltelli scheme that of its base samples), ``seed`` sets the random numbers.
    ``sensors`` are the scalars to be assessed, such as ``"slider.x:max"``; ``quantiles`` are
    computed of them. ``find`` has questions such as ``"slider.x:max <= 0.6"`` or ``"minimise
    lift.y:rms"``.
    """

    vary: Annotated[dict[str, Distribution], Reader(_vary, _write_vary, form={"type": "object"})]
    method: Literal[
        "auto", "grid", "random", "latin-hypercube", "sobol", "saltelli", "derivatives"
    ] = "auto"
    samples: Annotated[int, Integer(1, 1_000_000)] = 256
    seed: Annotated[int, Integer()] = 0
    sensors: tuple[Annotated[str, _readable(read_scalar)], ...] = ()
    quantiles: tuple[Annotated[float, Reader(_share, form=NUMBER)], ...] = (0.05, 0.5, 0.95)
    find: tuple[Annotated[str, _readable(read_question)], ...] = ()
