"""Reading a table of words, such as ``{type = "tube", radius = 0.02, inner = 0.015}``, in SI.

In: the table, and the functions that make something of its values, by ``type``. Out: what they
make, or all :class:`Problem` at once: an unknown type or key with the nearest names, a missing
key, a value that is no number. The words are the parameters of those functions.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, TypeVar

from flexmb.errors import FlexmbError, Problem, nearest

__all__ = ["call", "is_number", "kind_of", "make", "rooted", "word_problems"]

T = TypeVar("T")
Words = Sequence[inspect.Parameter]


def make(
    noun: str, kinds: Mapping[str, Callable[..., T]], given: Any, where: str, error: type
) -> T:
    """What the function under ``given["type"]`` makes of the other words of a table.

    Raises
    ------
    FlexmbError
        Of the class ``error``, with everything that is wrong with the table.
    """
    kind, words = kind_of(noun, tuple(kinds), given, where, error)
    return call(kinds[kind], words, where, error)


def kind_of(
    noun: str, names: tuple[str, ...], given: Any, where: str, error: type
) -> tuple[str, dict[str, Any]]:
    """The type of a table, and its other words.

    Raises
    ------
    FlexmbError
        Of the class ``error``: no table, no type, or none of ``names``.
    """
    if not isinstance(given, Mapping):
        what = f"a table such as {{type = ...}} is expected, given {given!r}"
        raise error.from_problems([Problem(where, what)])
    words = dict(given)
    if "type" not in words:
        raise error.from_problems([Problem(f"{where}.type", "is missing", names)])
    kind = words.pop("type")
    if kind not in names:
        what = f'unknown {noun} "{kind}"'
        raise error.from_problems(
            [Problem(f"{where}.type", what, names, nearest(str(kind), names))]
        )
    return str(kind), words


def word_problems(
    words: Mapping[str, Any], where: str, allowed: Sequence[str], needed: Sequence[str] = ()
) -> list[Problem]:
    """Keys of a table that are unknown, and those that are missing."""
    names = tuple(allowed)
    unknown = [
        Problem(f"{where}.{key}", "unknown key", names, nearest(str(key), names))
        for key in words
        if key not in names
    ]
    return unknown + [Problem(f"{where}.{key}", "is missing") for key in needed if key not in words]


def call(
    function: Callable[..., T],
    words: Mapping[str, Any],
    where: str,
    error: type,
    common: Callable[..., Any] | None = None,
) -> T:
    """The function's value with these words as its parameters, all mistakes told at once.

    Parameters
    ----------
    function : callable
        Its parameters are the words that there are.
    words : mapping
        What is given.
    where : str
        Place of the table, in front of the places of the problems.
    error : type
        Class of the error.
    common : callable, optional
        Whose keyword-only parameters ``function`` takes as well.

    Raises
    ------
    FlexmbError
        Of the class ``error``.
    """
    parameters = _parameters(function, common)
    allowed = tuple(parameter.name for parameter in parameters)
    problems = word_problems(words, where, allowed)
    misspelt = {problem.nearest[0] for problem in problems if problem.nearest}
    for parameter in parameters:
        name = parameter.name
        if name in words:
            problems += _value_problem(f"{where}.{name}", words[name], str(parameter.annotation))
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


def _parameters(function: Callable[..., Any], common: Callable[..., Any] | None) -> Words:
    own = list(inspect.signature(function).parameters.values())
    if common is None or not any(word.kind is word.VAR_KEYWORD for word in own):
        return own
    shared = inspect.signature(common).parameters.values()
    return [word for word in own if word.kind is not word.VAR_KEYWORD] + [
        word for word in shared if word.kind is word.KEYWORD_ONLY
    ]


def _value_problem(where: str, value: Any, annotation: str) -> list[Problem]:
    """The problem of a value that should be a number, true or false by its annotation."""
    if annotation in ("float", "float | None"):
        optional = value is None and annotation.endswith("None")
        if optional or (_is_real(value) and not math.isnan(value)):
            return []
        return [Problem(where, f"must be a number, given {value!r}")]
    if annotation == "bool" and not isinstance(value, bool):
        return [Problem(where, f"must be true or false, given {value!r}")]
    return []


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Whether it is a number that is neither true, false, infinite nor undefined."""
    return _is_real(value) and math.isfinite(value)


def rooted(where: str, problems: Sequence[Problem]) -> list[Problem]:
    """The problems of a made thing, ``section.A`` or ``mesh.size``, under its place in a table."""
    told = []
    for problem in problems:
        _, _, field = problem.where.partition(".")
        told.append(replace(problem, where=f"{where}.{field}" if field else where))
    return told
