"""Texts that end in a unit, such as ``"30 mm"``, ``"360*t deg"`` or ``"1500 rpm"``.

In: the text, the names it may use, and the SI unit of what is asked. Out: the expression before the
unit, and the factor that takes its value into the scene's unit system. An expression never has two
values side by side, so whether a text has a unit is never in doubt, but for a parameter that is
called like one: that is refused.
"""

from __future__ import annotations

import re

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.model.values.reading import Names, given, units_of
from flexmb.units import UNITS, Unit, parse_unit

__all__ = ["expression_and_factor"]

_ENDS_A_VALUE = re.compile(r"[\w.)]$")
_NUMBER_AND_WORD = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s+(?P<unit>[A-Za-zµ].*)$")
_SYMBOLS = re.compile(r"[A-Za-zµ]+")
_NOUNS = {
    "": "a plain number",
    "m": "a length",
    "kg": "a mass",
    "s": "a time",
    "rad": "an angle",
    "Hz": "a frequency",
    "m/s": "a velocity",
    "rad/s": "an angular velocity",
    "m/s^2": "an acceleration",
    "N": "a force",
    "N m": "a torque",
    "kg m^2": "a moment of inertia",
    "kg/m^3": "a density",
    "Pa": "a pressure or modulus",
    "N/m": "a stiffness",
    "N s/m": "a damping coefficient",
}


def expression_and_factor(
    text: str, names: Names, unit: str | None, time: bool = False
) -> tuple[str, float]:
    """The expression of a text, and the factor from its unit to the scene's own.

    Parameters
    ----------
    text : str
        An expression, perhaps followed by a unit.
    names : mapping
        Values of the parameters.
    unit : str or None
        SI unit of the quantity that is asked for, ``""`` for a plain number; None takes any.
    time : bool
        Whether ``t`` is the time, and not the tonne.

    Raises
    ------
    SceneError
        A unit of something else, a symbol that is a parameter too, or an unknown unit.
    """
    front, told = _split(text, time)
    if not told:
        _refuse_unknown(text, names, time)
        return text, 1.0
    for symbol in _SYMBOLS.findall(told):
        if symbol in names:
            what = f'"{symbol}" in {given(text)} is a unit and a parameter: rename the parameter, '
            raise SceneError(what + f'or write "*{symbol}" if it was meant')
    found, units = parse_unit(told), units_of(names)
    if unit is not None and found.dimension != parse_unit(unit).dimension:
        label = f" [{units.label(unit)}]" if unit else ""
        raise SceneError(f"{_noun(unit)}{label} is expected, given {given(text)}")
    return front, _ratio(found, units.factor(*found.dimension[:3]))


def _split(text: str, time: bool) -> tuple[str, str]:
    """Expression and unit; the unit is empty where the text has none."""
    for gap in re.finditer(r"(?<=\S)\s+(?=\S)", text):
        front, rest = text[: gap.start()], text[gap.end() :].strip()
        if not _ENDS_A_VALUE.search(front) or (time and "t" in _SYMBOLS.findall(rest)):
            continue
        try:
            parse_unit(rest)
        except FlexmbError:
            continue
        return front, rest
    return text, ""


def _refuse_unknown(text: str, names: Names, time: bool) -> None:
    """Say so where a number is followed by a word that is no unit."""
    found = _NUMBER_AND_WORD.match(text)
    if found is None or any(s in names for s in _SYMBOLS.findall(found["unit"])):
        return
    if time and "t" in _SYMBOLS.findall(found["unit"]):
        return
    try:
        parse_unit(found["unit"])
    except FlexmbError as error:
        problem = error.problems[0]
        if problem.allowed:
            raise SceneError.from_problems(
                [Problem("", problem.what, tuple(UNITS), problem.nearest)]
            ) from None


def _noun(unit: str) -> str:
    return _NOUNS.get(unit, "another quantity")


def _ratio(unit: Unit, scale: float) -> float:
    return float(f"{unit.factor / scale:.15g}")
