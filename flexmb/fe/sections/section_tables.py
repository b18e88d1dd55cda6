"""Sections from tables: ``{type = "rectangle", y = 0.02, z = 0.03}``.

In: a section, or its type and words in SI. Out: a section of beams, shells or solids. The words are
the parameters of the functions in ``SECTIONS``; ``material`` is a name, a table or a material.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flexmb.errors import FlexmbError, MaterialError, Problem, ReductionError
from flexmb.fe.sections import beam_shapes, thin_walls
from flexmb.fe.sections.beam_chain import TaperedSection, tapered
from flexmb.fe.sections.beam_section import BeamSection, Releases, general
from flexmb.fe.sections.material import SolidSection, resolve
from flexmb.fe.sections.shell_section import (
    Layer,
    ShellSection,
    layered,
    shell,
)
from flexmb.flexbody.options import kind_of, option_values, read_options, rooted
from flexmb.flexbody.section_options import SECTIONS as OPTIONS
from flexmb.materials import AnyMaterial

Section = BeamSection | TaperedSection | ShellSection | SolidSection


SECTIONS: dict[str, Callable[..., Section]] = {
    **beam_shapes.SECTIONS,
    **thin_walls.SECTIONS,
    "general": general,
    "tapered": tapered,
    "shell": shell,
    "layered": layered,
    "solid": SolidSection,
}
"""What makes a section of each type."""

_VECTORS = ("orientation", "axis1", "axis2")


def sections_from(sections: Mapping[str, Any] | None) -> dict[str, Section]:
    """Sections by mesh group.

    Raises
    ------
    ReductionError, MaterialError
        What is wrong with all of them.
    """
    made: dict[str, Section] = {}
    errors: list[FlexmbError] = []
    for group, words in (sections or {}).items():
        try:
            made[group] = section_from(words, f"sections.{group}")
        except (ReductionError, MaterialError) as error:
            errors.append(error)
    if errors:
        problems = [problem for error in errors for problem in error.problems]
        raise type(errors[0]).from_problems(problems)
    return made


def section_from(words: Any, where: str = "section") -> Section:
    """The section itself, or that of ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError, MaterialError
        Unknown type, missing or unknown key, or impossible values; all at once.
    """
    if isinstance(words, Section):
        return words
    kind = kind_of("section", tuple(SECTIONS), words, where, ReductionError)
    values = option_values(read_options(OPTIONS[kind], words, where, ReductionError))
    problems: list[Problem] = []
    for name, value in values.items():
        place = f"{where}.{name}"
        try:
            values[name] = _value(name, value, place)
        except FlexmbError as error:
            problems += error.problems
    if problems:
        raise ReductionError.from_problems(problems)
    try:
        return SECTIONS[kind](**values)
    except FlexmbError as error:
        raise type(error).from_problems(rooted(where, error.problems)) from None
    except (TypeError, ValueError) as error:
        problem = Problem(where, f"cannot be understood: {error}")
        raise ReductionError.from_problems([problem]) from None


def _value(name: str, value: Any, where: str) -> Any:
    """An option as the function of a section takes it."""
    if name == "material":
        return _material(value, where)
    if name == "releases":
        return value if isinstance(value, Releases) else Releases(value.start, value.end)
    if name in ("start", "end"):
        return section_from(value if isinstance(value, Section) else _as_words(value), where)
    if name == "layers":
        return [_layer(layer, f"{where}[{k}]") for k, layer in enumerate(value)]
    return tuple(value) if name in _VECTORS and isinstance(value, list) else value


def _as_words(options: Any) -> dict[str, Any]:
    return {"type": options.type, **option_values(options)}


def _layer(options: Any, where: str) -> Layer:
    if isinstance(options, Layer):
        return options
    values = option_values(options)
    if "material" in values:
        values["material"] = _material(values["material"], f"{where}.material")
    return Layer(**values)


def _material(value: Any, where: str) -> AnyMaterial:
    try:
        return resolve(value)
    except MaterialError as error:
        raise MaterialError.from_problems(rooted(where, error.problems)) from None
