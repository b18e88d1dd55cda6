"""What a study of accuracy against cost varies, and by what it judges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import SerializationInfo, ValidationInfo

from flexmb.errors import Problem, SceneError
from flexmb.model.tasks.sweep import sweep_values
from flexmb.model.values.quantities import Integer, Quantity, Text
from flexmb.model.values.reading import Reader, Spec, fail, given, under

__all__ = ["StudySpec"]


def _vary(value: Any, info: ValidationInfo) -> dict[str, tuple[Any, ...]]:
    if not isinstance(value, Mapping):
        raise fail(Problem("", f"a table {{knob = values, ...}} is expected, given {given(value)}"))
    found: dict[str, tuple[Any, ...]] = {}
    problems: list[Problem] = []
    for knob, values in _flat("", value):
        try:
            found[knob] = sweep_values(values)
        except SceneError as error:
            problems += under(knob, error.problems)
    if problems:
        raise fail(*problems)
    return found


def _flat(path: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Knobs of nested tables too: TOML reads ``bodies.rod.modes = [4]`` as tables in tables."""
    for key, value in table.items():
        name = f"{path}.{key}" if path else str(key)
        if isinstance(value, Mapping):
            yield from _flat(name, value)
        else:
            yield name, value


def _as_lists(
    value: Mapping[str, tuple[Any, ...]], info: SerializationInfo
) -> dict[str, list[Any]]:
    return {knob: list(values) for knob, values in value.items()}


def _share(value: Any, info: ValidationInfo) -> float:
    number = Quantity("", "positive").read(value, info)
    if number >= 1:
        raise fail(Problem("", f"is an error over the peak-to-peak, below 1; is {number:g}"))
    return number


class StudySpec(Spec):
    """Study of accuracy against cost.

    ``vary`` names knobs and their values: lists, or ranges such as ``"1e-2..1e-6"`` (by factors of
    ten) and ``"1e-3..1e-5:5"`` (five values at equal ratios); all combinations are run.
    ``repeats`` of each run, for the median of its wall time; ``target`` is the error over the
    peak-to-peak that the cheapest setting must meet; ``sensors`` (or channels) that are judged,
    all by default.
    """

    vary: Annotated[dict[str, tuple[Any, ...]], Reader(_vary, _as_lists)]
    repeats: Annotated[int, Integer(1)] = 3
    target: Annotated[float, Reader(_share)] = 0.01
    sensors: tuple[Text, ...] = ()
