"""Parameters of a scene, and quantities and times that are written with them.

Parameters are numbers with names, defined by each other in any order; a cycle is an error. Options
of commands and arguments of functions, such as a time of a picture, are read as in the scene: with
its parameters and units.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS, names_in
from flexmb.model.quantities import expression_and_factor, read_number
from flexmb.model.reading import ReadContext, quote, under
from flexmb.model.scenes.study import split_values
from flexmb.units import SI, UnitSystem, unit_system

_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*\Z")
_RESERVED = {"t": "the time", **dict.fromkeys(CONSTANTS, "a constant")}
_RESERVED |= dict.fromkeys(FUNCTIONS, "a function")


def resolve_parameters(
    raw: Mapping[str, Any], units: UnitSystem = SI
) -> tuple[dict[str, float], list[Problem]]:
    """Values of the parameters in the scene's units.

    A parameter that depends on a wrong one gets neither a value nor a problem.
    """
    return _Resolver(raw, units).run()


Time = float | str
"""A number in the scene's units, or a text as in a scene: ``"30 ms"``, ``"turn/2"``."""


def read_quantity(scene: Mapping[str, Any], value: Time, where: str, unit: str) -> float:
    """A number in the units of a scene, read with its parameters.

    Parameters
    ----------
    scene : mapping
        The scene as data.
    value : float or str
        A number in its units, or a text as in a scene.
    where : str
        Name of the option, for messages.
    unit : str
        SI unit of the quantity, such as ``"s"``.
    """
    units = unit_system(str(scene.get("units", "SI")))
    values, _ = resolve_parameters(scene.get("parameters", {}), units)
    try:
        return read_number(value, ReadContext(values, units), unit)
    except SceneError as error:
        raise SceneError.from_problems(under(where, error.problems)) from None


def read_times(
    scene: Mapping[str, Any], value: Time | Iterable[Time], where: str = "time"
) -> list[float]:
    """Times in the units of a scene: one, several, or a text with commas between them."""
    parts: Iterable[Time] = [value] if isinstance(value, int | float) else value
    if isinstance(value, str):
        parts = [part.strip() for part in split_values(value)] or [value]
    times: list[float] = []
    problems: list[Problem] = []
    for part in parts:
        try:
            times.append(read_quantity(scene, part, where, "s"))
        except SceneError as error:
            problems += error.problems
    if problems:
        raise SceneError.from_problems(problems)
    return times


def read_span(scene: Mapping[str, Any], value: str | Sequence[Time]) -> tuple[float, float]:
    """First and last time in the units of a scene, of two values or ``"20 ms..40 ms"``."""
    ends = [end.strip() for end in value.split("..")] if isinstance(value, str) else [*value]
    what = ""
    if len(ends) == 2 and "" not in ends:  # noqa: PLR2004
        first, last = read_times(scene, ends, "times")
        if first < last:
            return first, last
        unit = unit_system(str(scene.get("units", "SI"))).label("s")
        what = f"must begin before they end, {first:g} {unit} to {last:g} {unit} do not"
        if isinstance(value, str) and " " in value:
            what += "; each end has a unit of its own, as in 20 ms..40 ms"
    what = what or f'must be two times, first..last such as "20 ms..40 ms", not {quote(value)}'
    raise SceneError.from_problems([Problem("times", what)])


class _Resolver:
    """Depth-first evaluation of parameters; ``trail`` is the chain of names being evaluated."""

    def __init__(self, raw: Mapping[str, Any], units: UnitSystem) -> None:
        self.units = units
        self.raw = {str(name): value for name, value in raw.items()}
        self.values: dict[str, float] = {}
        self.wrong: dict[str, list[Problem]] = {}

    def run(self) -> tuple[dict[str, float], list[Problem]]:
        for name in self.raw:
            self.visit(name, ())
        values = {name: self.values[name] for name in self.raw if name in self.values}
        return values, [problem for problems in self.wrong.values() for problem in problems]

    def visit(self, name: str, trail: tuple[str, ...]) -> None:
        if name in self.values or name in self.wrong:
            return
        where = f"parameters.{name}"
        if name in trail:
            cycle = " -> ".join((*trail[trail.index(name) :], name))
            for member in trail[trail.index(name) :]:
                self.wrong[member] = []
            self.wrong[name] = [Problem(where, f"depends on itself: {cycle}")]
        elif not _NAME.match(name):
            self.wrong[name] = [Problem(where, "a name has letters, digits and _ only")]
        elif name in _RESERVED:
            what = f'the name "{name}" is taken: it is {_RESERVED[name]} of expressions; rename it'
            self.wrong[name] = [Problem(where, what)]
        else:
            self.evaluate(name, where, trail)

    def evaluate(self, name: str, where: str, trail: tuple[str, ...]) -> None:
        value = self.raw[name]
        if isinstance(value, Mapping):
            self.wrong[name] = [Problem(where, f"a number is expected, given {quote(value)}")]
            return
        try:
            used: tuple[str, ...] = ()
            if isinstance(value, str):
                used = names_in(expression_and_factor(value, self.context(name), None)[0])
            for other in used:
                if other in self.raw:
                    self.visit(other, (*trail, name))
            if name in self.wrong:
                return
            if any(other in self.wrong for other in used):
                self.wrong[name] = []
                return
            self.values[name] = read_number(value, self.context(name), None)
        except SceneError as error:
            self.wrong[name] = [replace(problem, where=where) for problem in error.problems]

    def context(self, name: str) -> ReadContext:
        """All names, so that a misspelt one finds the nearest; the used ones have their values."""
        values = {other: self.values.get(other, 0.0) for other in self.raw if other != name}
        return ReadContext(values, self.units)
