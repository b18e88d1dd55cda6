"""Knobs: the values of a scene that may be turned from outside, by path or by short name.

In: the raw scene and the name of a knob. Out: the name under which `overrides` sets it. A short
name is a parameter, or a field of ``[dynamics]`` (`accuracy` for `dynamics.accuracy`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from flexmb.errors import Problem, nearest
from flexmb.model.tasks.dynamics import DynamicsSpec

__all__ = ["knob_names", "resolve_knob"]

_SECTIONS = (
    "parameters", "ground", "bodies", "joints", "couplers", "drivers", "forces", "states",
    "controllers", "assembly", "dynamics",
)  # fmt: skip
_TOP = ("gravity",)


def resolve_knob(scene: Mapping[str, Any], name: str) -> tuple[str, Problem | None]:
    """The full name of a knob, and the problem if the scene has none of that name.

    A last part that the scene does not write down is left to whoever reads the changed scene: a
    field may have a default.
    """
    if name in _table(scene, "parameters") or name in _TOP:
        return name, None
    if name in DynamicsSpec.model_fields:
        return f"dynamics.{name}", None
    *path, last = name.split(".")
    table: Any = scene
    for part in path:
        table = table.get(part) if isinstance(table, Mapping) else None
    there = name.startswith("dynamics.") or isinstance(table, Mapping)
    if path and path[0] in _SECTIONS and there:
        inside = table.get(last) if isinstance(table, Mapping) else None
        if not isinstance(inside, Mapping):
            return name, _unknown_parameter(path, last, table)
        names = tuple(f"{name}.{key}" for key in inside)
        return name, Problem("", "is a table; name a value in it", names)
    names = tuple(knob_names(scene))
    return name, Problem("", f'the scene has no knob "{name}"', names, nearest(name, names))


def _unknown_parameter(path: list[str], last: str, table: Mapping[str, Any]) -> Problem | None:
    if path != ["parameters"] or last in table:
        return None
    return Problem("", f'unknown parameter "{last}"', tuple(table), nearest(last, table))


def knob_names(scene: Mapping[str, Any]) -> Iterator[str]:
    """Short names, then the paths of all values that the scene writes down."""
    yield from _table(scene, "parameters")
    yield from DynamicsSpec.model_fields
    yield from _TOP
    for section in _SECTIONS[1:]:
        yield from _leaves(section, _table(scene, section))


def _table(scene: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table = scene.get(key, {})
    return table if isinstance(table, Mapping) else {}


def _leaves(path: str, value: Any) -> Iterator[str]:
    if not isinstance(value, Mapping):
        yield path
        return
    for key, inside in value.items():
        yield from _leaves(f"{path}.{key}", inside)
