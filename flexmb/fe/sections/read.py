"""Sections from tables: ``{type = "rectangle", y = 0.02, z = 0.03}``.

In: a section, or its type and words. Out: a section.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.material import resolve
from flexmb.fe.sections.angle import angle_section
from flexmb.fe.sections.beam import general
from flexmb.fe.sections.beam_shapes import circle, rectangle, section_of, tube
from flexmb.fe.sections.taper import tapered
from flexmb.fe.sections.thin_walls import box_section, i_section

__all__ = ["SECTIONS", "section_from"]

SECTIONS: dict[str, Callable[..., Any]] = {
    "rectangle": rectangle,
    "circle": circle,
    "tube": tube,
    "I": i_section,
    "box": box_section,
    "L": angle_section,
    "general": general,
    "tapered": tapered,
}
"""What makes a section of each type."""


def section_from(given: Any, where: str = "section") -> Any:
    """The section that was meant: itself, or ``{type = "rectangle", y = 0.02, z = 0.03}``.

    Raises
    ------
    ReductionError
        Unknown type, missing or unknown key, or impossible values.
    """
    if not isinstance(given, Mapping):
        if hasattr(given, "with_material"):
            return given
        what = f"a section or a table with its type is expected, given {given!r}"
        raise ReductionError.from_problems([Problem(where, what)])
    words = dict(given)
    kind = words.pop("type", None)
    if kind not in SECTIONS:
        names = tuple(SECTIONS)
        problem = Problem(f"{where}.type", f'unknown "{kind}"', names, nearest(str(kind), names))
        raise ReductionError.from_problems([problem])
    allowed, needed = _words(SECTIONS[kind])
    unknown = [
        Problem(f"{where}.{key}", "unknown key", allowed, nearest(key, allowed))
        for key in words
        if key not in allowed
    ]
    if unknown:
        raise ReductionError.from_problems(unknown)
    if kind == "tapered":
        for end in ("start", "end"):
            if end in words:
                words[end] = section_from(words[end], f"{where}.{end}")
    if words.get("material") is not None:
        words["material"] = resolve(words["material"])
    for key in ("orientation", "offset", "shear_center"):
        if isinstance(words.get(key), list):
            words[key] = tuple(words[key])
    missing = [name for name in needed if name not in words]
    if missing:
        what = f"a {kind} needs {', '.join(needed)}; {', '.join(missing)} is missing"
        raise ReductionError.from_problems([Problem(where, what)])
    try:
        return SECTIONS[kind](**words)
    except ReductionError as error:
        found = [
            replace(problem, where=where + problem.where.removeprefix("section"))
            for problem in error.problems
        ]
        raise ReductionError.from_problems(found) from error
    except (TypeError, ValueError) as error:
        what = f"a {kind} needs numbers for {', '.join(needed)}: {error}"
        raise ReductionError.from_problems([Problem(where, what)]) from error


def _words(make: Callable[..., Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """All words of a type, and those that must be given."""
    own = list(inspect.signature(make).parameters.values())
    if any(entry.kind is entry.VAR_KEYWORD for entry in own):
        common = list(inspect.signature(section_of).parameters.values())[1:]
        own = [entry for entry in own if entry.kind is not entry.VAR_KEYWORD] + common
    needed = tuple(entry.name for entry in own if entry.default is entry.empty)
    return tuple(entry.name for entry in own), needed
