"""Values of a knob that a study goes through: ``1e-2..1e-8``, ``1e-3..1e-5:5``, ``4,8,16``.

In: a text or a list. Out: the values in the order given, each once. ``a..b`` goes by factors of
ten, ``a..b:n`` takes n values at equal ratios, rounded to three digits where they are far apart;
between whole numbers the values are whole.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from flexmb.errors import Problem, SceneError
from flexmb.model.values.quantities import plain

__all__ = ["sweep_values"]

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"\s*(?P<a>{_NUMBER})\s*\.\.\s*(?P<b>{_NUMBER})\s*(?::(?P<n>.*))?\Z")
_HALF_RANGE = re.compile(rf"\s*(?:{_NUMBER}\s*\.\.|\.\.\s*{_NUMBER}\s*(?::|\Z))")
_COARSE = 0.1  # relative distance of neighbours from which three digits are enough
_MOST = 1000  # values of one knob; more is a slip of the keyboard


def sweep_values(given: Any) -> tuple[Any, ...]:
    """The values of a knob.

    Parameters
    ----------
    given : str, number, or sequence of them
        Texts are split at commas outside of brackets; each piece is a range, a TOML value or, as
        in a scene, an expression or a name.

    Raises
    ------
    SceneError
        No values, an empty piece, or a range that cannot be.
    """
    pieces = _split(given) if isinstance(given, str) else plain(given)
    if not isinstance(pieces, list):
        pieces = [pieces]
    found: list[Any] = []
    for piece in pieces:
        for value in _expanded(piece):
            if value not in found:
                found.append(value)
    if not found:
        raise _bad("no values are given")
    if len(found) > _MOST:
        raise _bad(f"{len(found)} values are given; a study takes up to {_MOST}")
    return tuple(found)


def _bad(what: str) -> SceneError:
    return SceneError.from_problems([Problem("", what)])


def _split(text: str) -> list[str]:
    pieces, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            pieces.append("")
        else:
            pieces[-1] += letter
    if not text.strip():
        return []
    return pieces


def _expanded(piece: Any) -> Iterator[Any]:
    if not isinstance(piece, str):
        yield piece
        return
    if not piece.strip():
        raise _bad("a value between the commas is empty")
    found = _RANGE.match(piece)
    if found is None:
        if _HALF_RANGE.match(piece):
            raise _bad(f'the range "{piece.strip()}" must have two numbers: 1e-2..1e-6')
        yield _value(piece.strip())
        return
    a, b = found["a"], found["b"]
    if float(a) <= 0 or float(b) <= 0:
        raise _bad(f'the range "{piece.strip()}" must have two positive ends')
    values = _decades(float(a), float(b)) if found["n"] is None else _spaced(piece, found)
    whole = a.isdigit() and b.isdigit()
    yield from (round(value) if whole else value for value in values)


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text


def _decades(a: float, b: float) -> Iterator[float]:
    factor = 10.0 if b > a else 0.1
    low, high = min(a, b) * (1 - 1e-9), max(a, b) * (1 + 1e-9)
    k = 0
    while low <= a * factor**k <= high:
        yield float(f"{a * factor**k:.12g}")  # 0.001, not 0.0010000000000000002
        k += 1


def _spaced(piece: str, found: re.Match[str]) -> Iterator[float]:
    count = found["n"].strip()
    if not count.isdigit() or not 2 <= int(count) <= _MOST:
        what = f'the range "{piece.strip()}" needs after ":" a number of values'
        raise _bad(f"{what} from 2 to {_MOST}")
    a, b, n = float(found["a"]), float(found["b"]), int(count)
    ratio = (b / a) ** (1 / (n - 1))
    digits = 3 if abs(ratio - 1.0) > _COARSE else 12
    inner = (a * ratio**i for i in range(1, n - 1))
    yield from (a, *(float(f"{value:.{digits}g}") for value in inner), b)
