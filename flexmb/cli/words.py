"""What options mean: ``name=value`` pairs, directions, sizes, and tables as in a scene.

In: the text of an option. Out: data, or a :class:`typer.BadParameter` that says what was expected.
"""

from __future__ import annotations

import tomllib
from typing import Any

import typer

__all__ = [
    "direction",
    "exaggeration",
    "names",
    "numbers",
    "pairs",
    "size",
    "tables",
    "word_or_table",
]


def pairs(given: list[str], option: str) -> dict[str, str]:
    """``["a=1", "b=x=y"]`` as a dictionary."""
    found: dict[str, str] = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise typer.BadParameter(f'"{text}" is not of the form name=value', param_hint=option)
        if name.strip() in found:
            raise typer.BadParameter(f'"{name.strip()}" is given twice', param_hint=option)
        found[name.strip()] = value.strip()
    return found


def word_or_table(text: str, option: str) -> Any:
    """A word, or a table such as ``{E = 70e9, nu = 0.33, density = 2700}`` as in a scene."""
    if not text.lstrip().startswith("{"):
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError as error:
        raise typer.BadParameter(f"{text} is no table ({error})", param_hint=option) from None


def tables(given: list[str], option: str) -> dict[str, Any]:
    """``["all={...}"]`` as a dictionary of tables."""
    return {name: word_or_table(text, option) for name, text in pairs(given, option).items()}


def direction(text: str | None) -> tuple[float, float, float] | None:
    """``x``, ``-y``, ``z`` or three numbers ``1,-1,0.5``."""
    if text is None:
        return None
    sign, letter = (-1.0, text[1:]) if text.startswith("-") else (1.0, text)
    if letter in ("x", "y", "z"):
        x, y, z = (sign * float(letter == axis) for axis in "xyz")
        return x, y, z
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        expected = "x, y, z, -x, -y, -z or three numbers such as 1,-1,0.5"
        raise typer.BadParameter(f'"{text}" is not {expected}', param_hint="--direction") from None
    return x, y, z


def exaggeration(text: str | None) -> float | str | None:
    """A number, or ``auto``."""
    if text is None or text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is neither a number nor auto', param_hint="--exaggeration"
        ) from None


def numbers(text: str | None, option: str) -> list[int] | None:
    """``7``, ``1..6`` or ``1,3,5`` as a list."""
    if text is None:
        return None
    found: list[int] = []
    try:
        for part in text.split(","):
            first, dots, last = part.partition("..")
            found += range(int(first), int(last) + 1) if dots else [int(first)]
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is not of the form 7, 1..6 or 1,3,5', param_hint=option
        ) from None
    return found


def names(text: str | None) -> list[str]:
    """``a, b`` as a list; empty for nothing."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def size(text: str | None) -> tuple[int, int] | None:
    """``1280x720`` as width and height."""
    if text is None:
        return None
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise typer.BadParameter(
            f'"{text}" is not width x height such as 1280x720', param_hint="--size"
        ) from None
    return width, height
