"""The parameters of a scene: names for numbers, in terms of each other, in any order.

In: name to number or expression, perhaps with a unit. Out: name to value in the scene's units, and
the problems. A cycle is named.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS, names_in
from flexmb.model.values.quantities import expression_and_factor, read_number
from flexmb.model.values.reading import ReadContext, quote
from flexmb.units import SI, UnitSystem

_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*\Z")
_RESERVED = {"t": "the time", **dict.fromkeys(CONSTANTS, "a constant")}
_RESERVED |= dict.fromkeys(FUNCTIONS, "a function")


def resolve(
    raw: Mapping[str, Any], units: UnitSystem = SI
) -> tuple[dict[str, float], list[Problem]]:
    """Values of the parameters in the scene's units.

    A parameter that depends on a wrong one gets no value and no problem of its own.
    """
    return _Resolver(raw, units).run()


class _Resolver:
    """Depth-first evaluation; ``trail`` is the chain of names being evaluated."""

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
            what = f'the name "{name}" is taken: it is {_RESERVED[name]} of expressions'
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
        """All names, so that a misspelt one finds its neighbours; used ones have their values."""
        values = {other: self.values.get(other, 0.0) for other in self.raw if other != name}
        return ReadContext(values, self.units)
