"""Changing single values of a scene from outside: ``speed=2*pi*10``, ``dynamics.step=1e-5``.

In: the raw scene and name to text. Out: the scene with those values replaced. A bare name is a
parameter, or a value at the top of the scene; a dotted one is the path of any value that is no
table. Texts read as TOML values where they are ones, else stay texts (expressions, names).
"""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from typing import Any

from flexmb.errors import Problem, nearest
from flexmb.model.tasks.dynamics import INSTEAD, drop_idle_options
from flexmb.model.values.reading import given

__all__ = ["override"]

_MAKEABLE = (
    "assembly",
    "dynamics",
    "kinematics",
    "results",
    "view",
)  # tables whose fields all have defaults or will be missed


def override(
    scene: Mapping[str, Any], changes: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Problem]]:
    """The changed scene (a copy), and the problems of the changes."""
    changed: dict[str, Any] = copy.deepcopy(dict(scene))
    problems: list[Problem] = []
    for name, text in changes.items():
        problem = _set(changed, str(name).strip(), _value(text))
        if problem is not None:
            problems.append(problem)
    if isinstance(changed.get("dynamics"), dict):
        names = {str(name).strip().removeprefix("dynamics.") for name in changes}
        drop_idle_options(changed["dynamics"], names)
    return changed, problems


def _value(text: Any) -> Any:
    if not isinstance(text, str):
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text.strip()


def _set(scene: dict[str, Any], name: str, value: Any) -> Problem | None:
    where = f"override {name}"
    if isinstance(value, Mapping):
        return Problem(where, f"a single value is expected, given {given(value)}")
    parts = name.split(".")
    if len(parts) == 1:
        parameters = scene.get("parameters", {})
        if not isinstance(parameters, Mapping):
            parameters = {}
        top = tuple(key for key in ("title", "gravity") if key in scene)
        if name in parameters:
            parameters[name] = value
        elif name in ("title", "gravity"):
            scene[name] = value
        else:
            names = tuple(dict.fromkeys((*parameters, *top)))
            return Problem(where, f'unknown parameter "{name}"', names, nearest(name, names))
        return None
    table: Any = scene
    for depth, part in enumerate(parts[:-1]):
        if depth == 0 and part in _MAKEABLE:
            table.setdefault(part, {})
        if not isinstance(table, dict) or not isinstance(table.get(part), dict):
            return _no_table(where, parts[: depth + 1], table)
        table = table[part]
    return _put(where, table, parts, value)


def _no_table(where: str, path: list[str], table: Any) -> Problem:
    names = tuple(key for key, value in table.items() if isinstance(value, dict))
    what = f'the scene has no table "{".".join(path)}"'
    return Problem(where, what, names, nearest(path[-1], names))


def _put(where: str, table: dict[str, Any], parts: list[str], value: Any) -> Problem | None:
    key = parts[-1]
    if isinstance(table.get(key), dict) and key not in ("orientation", "material", "shape"):
        names = tuple(f"{'.'.join(parts)}.{name}" for name in table[key])
        return Problem(where, "is a table; name a value in it", names)
    if parts[0] == "parameters" and key not in table:
        return Problem(where, f'unknown parameter "{key}"', tuple(table), nearest(key, table))
    table[key] = value
    if parts[0] == "dynamics" and key in INSTEAD:  # the new one replaces the scene's other choice
        table.pop(INSTEAD[key], None)
    return None
