"""Reading a table of words, such as ``{type = "tube", radius = 0.02, inner = 0.015}``, in SI.

In: the table, and the functions that make something of its values, by ``type``. Out: what they
make, or all :class:`Problem` at once: an unknown type or key with the nearest names, a missing
key, a value that is no number. The words are the parameters of those functions.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Real
from typing import Any, TypeVar

from flexmb.errors import FlexmbError, Problem, nearest

__all__ = ["call", "is_number", "make", "number_problem", "rooted"]

T = TypeVar("T")


def make(
    noun: str, kinds: Mapping[str, Callable[..., T]], given: Any, where: str, error: type
) -> T:
    """What the function under ``given["type"]`` makes of the other words of a table.

    Raises
    ------
    FlexmbError
        Of the class ``error``, with everything that is wrong with the table.
    """
    if not isinstance(given, Mapping):
        what = f"a table such as {{type = ...}} is expected, given {given!r}"
        raise error.from_problems([Problem(where, what)])
    words = dict(given)
    names = tuple(kinds)
    if "type" not in words:
        raise error.from_problems([Problem(f"{where}.type", "is missing", names)])
    kind = words.pop("type")
    if kind not in names:
        what = f"unknown {noun} {kind!r}"
        raise error.from_problems(
            [Problem(f"{where}.type", what, names, nearest(str(kind), names))]
        )
    return call(kinds[kind], words, where, error)


def call(function: Callable[..., T], words: Mapping[str, Any], where: str, error: type) -> T:
    """The function's value with these words as its parameters, all mistakes told at once.

    Raises
    ------
    FlexmbError
        Of the class ``error``; places begin with ``where``.
    """
    parameters = inspect.signature(function).parameters
    allowed = tuple(parameters)
    problems = [
        Problem(f"{where}.{key}", f'unknown key "{key}"', allowed, nearest(str(key), allowed))
        for key in words
        if key not in allowed
    ]
    misspelt = {problem.nearest[0] for problem in problems if problem.nearest}
    for name, parameter in parameters.items():
        if name in words:
            problems += number_problem(f"{where}.{name}", words[name], str(parameter.annotation))
        elif parameter.default is parameter.empty and name not in misspelt:
            problems.append(Problem(f"{where}.{name}", "is missing"))
    if problems:
        raise error.from_problems(problems)
    try:
        return function(**words)
    except FlexmbError as found:
        raise type(found).from_problems(rooted(where, found.problems)) from None
    except (TypeError, ValueError) as found:
        raise error.from_problems([Problem(where, f"cannot be understood: {found}")]) from None


def number_problem(where: str, value: Any, annotation: str) -> list[Problem]:
    """The problem of a value that should be a number by its annotation, and is none."""
    if annotation in ("float", "float | None", "int", "int | None"):
        if is_number(value) or (value is None and annotation.endswith("None")):
            return []
        return [Problem(where, f"must be a finite number, given {value!r}")]
    if annotation == "bool" and not isinstance(value, bool):
        return [Problem(where, f"must be true or false, given {value!r}")]
    return []


def is_number(value: Any) -> bool:
    """Whether it is a number that is neither true, false, infinite nor undefined."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def rooted(where: str, problems: tuple[Problem, ...]) -> list[Problem]:
    """The problems of a made thing, ``section.A`` or ``mesh.size``, under its place in a table."""
    told = []
    for problem in problems:
        _, _, field = problem.where.partition(".")
        told.append(replace(problem, where=f"{where}.{field}" if field else where))
    return told
