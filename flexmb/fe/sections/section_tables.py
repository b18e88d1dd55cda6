"""Sections from tables: ``{type = "rectangle", y = 0.02, z = 0.03}``.

In: a section, or its type and words in SI. Out: a section of beams, shells or solids. The words are
the parameters of the functions in ``SECTIONS``; ``material`` is a name, a table or a material.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flexmb.errors import FlexmbError, MaterialError, Problem, ReductionError
from flexmb.fe.material import resolve
from flexmb.fe.sections.beam_chain import TaperedSection, tapered
from flexmb.fe.sections.beam_section import BeamSection, general, section_of
from flexmb.fe.sections.beam_shapes import circle, rectangle, tube
from flexmb.fe.sections.shell_section import (
    Layer,
    ShellSection,
    layered,
    shell,
)
from flexmb.fe.sections.solid_section import SolidSection
from flexmb.fe.sections.thin_walls import angle_section, box_section, i_section
from flexmb.fe.tables import call, kind_of, rooted
from flexmb.materials import AnyMaterial

Section = BeamSection | TaperedSection | ShellSection | SolidSection


SECTIONS: dict[str, Callable[..., Section]] = {
    "rectangle": rectangle,
    "circle": circle,
    "tube": tube,
    "I": i_section,
    "box": box_section,
    "L": angle_section,
    "general": general,
    "tapered": tapered,
    "shell": shell,
    "layered": layered,
    "solid": SolidSection,
}
"""What makes a section of each type."""

_VECTORS = ("orientation", "offset", "shear_center", "axis1", "axis2")


def sections_from(given: Mapping[str, Any] | None) -> dict[str, Section]:
    """Sections by mesh group.

    Raises
    ------
    ReductionError, MaterialError
        What is wrong with all of them.
    """
    found: dict[str, Section] = {}
    errors: list[FlexmbError] = []
    for group, words in (given or {}).items():
        try:
            found[group] = section_from(words, f"sections.{group}")
        except (ReductionError, MaterialError) as error:
            errors.append(error)
    if errors:
        told = [problem for error in errors for problem in error.problems]
        raise type(errors[0]).from_problems(told)
    return found


def section_from(given: Any, where: str = "section") -> Section:
    """The section that was meant: itself, or ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError, MaterialError
        Unknown type, missing or unknown key, or impossible values; all at once.
    """
    if isinstance(given, Section):
        return given
    kind, words = kind_of("section", tuple(SECTIONS), given, where, ReductionError)
    problems = _read_parts(kind, words, where)
    if problems:
        raise ReductionError.from_problems(problems)
    for key in _VECTORS:
        if isinstance(words.get(key), list):
            words[key] = tuple(words[key])
    return call(SECTIONS[kind], words, where, ReductionError, section_of)


def _read_parts(kind: str, words: dict[str, Any], where: str) -> list[Problem]:
    """Put materials, layers and the ends of a taper in the place of their tables."""
    problems: list[Problem] = []
    if words.get("material") is not None:
        words["material"], found = _material(words["material"], f"{where}.material")
        problems += found
    if kind == "tapered":
        for end in ("start", "end"):
            if isinstance(words.get(end), Mapping):
                try:
                    words[end] = section_from(words[end], f"{where}.{end}")
                except (ReductionError, MaterialError) as error:
                    problems += error.problems
    if kind == "layered" and "layers" in words:
        words["layers"], found = _layers(words["layers"], f"{where}.layers")
        problems += found
    return problems


def _material(given: Any, where: str) -> tuple[AnyMaterial | None, list[Problem]]:
    try:
        return resolve(given), []
    except MaterialError as error:
        return None, rooted(where, error.problems)


def _layers(given: Any, where: str) -> tuple[list[Layer], list[Problem]]:
    if isinstance(given, Mapping | str) or not hasattr(given, "__iter__"):
        return [], [Problem(where, f"a list of layers is expected, given {given!r}")]
    found: list[Layer] = []
    problems: list[Problem] = []
    for k, words in enumerate(given):
        place = f"{where}[{k}]"
        if isinstance(words, Layer):
            found.append(words)
            continue
        if not isinstance(words, Mapping):
            problems.append(Problem(place, f"a table is expected, given {words!r}"))
            continue
        table = dict(words)
        wrong: list[Problem] = []
        if table.get("material") is not None:
            table["material"], wrong = _material(table["material"], f"{place}.material")
        try:
            found.append(call(Layer, table, place, ReductionError))
        except ReductionError as error:
            problems += error.problems
        problems += wrong
    return found, problems
