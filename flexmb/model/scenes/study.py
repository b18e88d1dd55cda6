"""Changes of values of a scene: by overrides, and by studies of many values.

A name is a parameter, a field of ``[dynamics]``, or the path of a value: ``speed=2*pi*10``,
``dynamics.step=1e-5``; ``bodies.*`` are all flexible bodies. Below the entries of a section
(``bodies.rod``) a path may name a value that the scene does not contain yet. Texts are read as TOML
values if they are valid ones (also tables in braces), else they stay texts (expressions, names).
Values of a study are lists, or ranges: ``1e-2..1e-8`` by factors of ten, ``1e-3..1e-5:5`` five
values at equal ratios, rounded to three digits if they are far apart; between whole numbers the
values are whole.
"""

from __future__ import annotations

import copy
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import ValidationInfo

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.model.quantities import Integer, Quantity, Text, plain
from flexmb.model.reading import Reader, Spec, fail, fail_if, quote, under
from flexmb.model.scenes.dynamics import INSTEAD, DynamicsSpec, drop_idle_options
from flexmb.units import UNIT_SYSTEMS, parse_unit

_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s+(?P<unit>\S.*?)\s*$")

_MAKEABLE = (
    "assembly", "dynamics", "effects", "kinematics", "results", "statics", "validity", "view",
)  # tables whose fields all have defaults or will be missed  # fmt: skip


def override(
    scene: Mapping[str, Any], changes: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Problem]]:
    """The changed scene (a copy), and the problems of the changes."""
    changed: dict[str, Any] = copy.deepcopy(dict(scene))
    problems: list[Problem] = []
    for name, text in changes.items():
        problem = _set(changed, str(name).strip(), read_value(text))
        if problem is not None:
            problems.append(problem)
    if isinstance(changed.get("dynamics"), dict):
        names = {str(name).strip().removeprefix("dynamics.") for name in changes}
        drop_idle_options(changed["dynamics"], names)
    return changed, problems


def read_value(text: Any) -> Any:
    """A TOML value if the text is one, else the text: an expression or a name."""
    if not isinstance(text, str):
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError, RecursionError):
        return text.strip()


def _set(scene: dict[str, Any], name: str, value: Any) -> Problem | None:
    where = f"override {name}"
    parts = name.split(".")
    if len(parts) == 1:
        return _set_parameter(scene, name, value)
    if parts[:2] == ALL_BODIES and len(parts) > 2:
        bodies = flexible_bodies(scene)
        if ".".join(parts) in OF_MESHES.values():
            bodies = [body for body in bodies if "mesh" in scene["bodies"][body]]
        problems = [_set(scene, ".".join(("bodies", k, *parts[2:])), value) for k in bodies]
        return next(filter(None, problems), None) if bodies else Problem(where, NO_FLEXIBLE_BODY)
    table: Any = scene
    is_entry = len(parts) == 2 and isinstance(value, Mapping)
    for depth, part in enumerate(parts[:-1]):
        if depth == 0 and (part in _MAKEABLE or (part in _OF_ENTRIES and is_entry)):
            table.setdefault(part, {})
        if depth == 0 and part == "effects" and isinstance(table[part], str):
            table[part] = {"choice": table[part]}
        inside = table.get(part)
        if not isinstance(inside, dict):
            if isinstance(inside, list) or not _is_free(parts, depth):
                return _no_table(where, parts[: depth + 1], table)
            table[part] = {}
        table = table[part]
        if not isinstance(table, dict):
            return _no_table(where, parts[: depth + 1], {})
    return _put(where, table, parts, value)


def _set_parameter(scene: dict[str, Any], name: str, value: Any) -> Problem | None:
    """Set a parameter, or one of the single values of a scene."""
    where = f"override {name}"
    parameters = scene.get("parameters", {})
    if not isinstance(parameters, Mapping):
        parameters = {}
    if isinstance(value, Mapping) and (name in parameters or name != "effects"):
        return Problem(where, f"a single value is expected, given {quote(value)}")
    top = tuple(key for key in ("title", *_TOP) if key in scene)
    if name in parameters:
        parameters[name] = value
    elif name in ("title", *_TOP):
        scene[name] = value
    else:
        names = tuple(dict.fromkeys((*parameters, *top)))
        near = nearest(name, names)
        if name in DynamicsSpec.model_fields:
            near = (f"dynamics.{name}", *near)
        return Problem(where, f'unknown parameter "{name}"', names, near)
    return None


def units_of_changes(
    before: Mapping[str, Any], after: Mapping[str, Any], names: Iterable[str]
) -> tuple[list[Problem], list[str]]:
    """`units_of_values` for the changed values of which the scene states a unit."""
    problems, notes = [], []
    for name in map(str.strip, names):
        wrong, sentences = units_of_values(
            before, f"override {name}", name, [_value_at(after, name)]
        )
        problems += wrong
        notes += sentences
    return problems, notes


def units_of_values(
    scene: Mapping[str, Any], where: str, name: str, values: Iterable[Any]
) -> tuple[list[Problem], list[str]]:
    """Check values against the unit that a scene states for one: problems if they are of another
    quantity, and a sentence if the unit is missing though the numbers seem to be in it."""
    old, (stated, ratio) = _value_at(scene, name), stated_unit(scene, name)
    if not stated:
        return [], []
    unit = parse_unit(stated)
    problems, bare = [], []
    for new in values:
        other = _unit_text(new)
        if other and parse_unit(other).dimension != unit.dimension:
            what = f"the scene has {quote(old)}, and {quote(new)} is another quantity"
            problems.append(Problem(where, what))
        elif isinstance(new, int | float) and _is_meant(new, float(str(old).split()[0]), ratio):
            bare.append(new)
    if not bare:
        return problems, []
    first = bare[0]
    what = f"{first:.6g} has no unit and is {first * ratio:.6g} {stated} in the scene's units"
    cure = f'{first:.6g} {stated} is written "{first:.6g} {stated}"'
    others = f"; the same for {len(bare) - 1} more" if len(bare) > 1 else ""
    return problems, [f"{where}: {what}; {cure}{others}"]


def stated_unit(scene: Mapping[str, Any], name: str) -> tuple[str, float]:
    """The unit that a scene states for a value, and how many of it are one unit of the scene.

    An empty text and 1 if the scene states no unit.
    """
    system = UNIT_SYSTEMS.get(str(scene.get("units", "SI")))
    text = _unit_text(_value_at(scene, name))
    if system is None or not text:
        return "", 1.0
    unit = parse_unit(text)
    return text, system.factor(*unit.dimension[:3]) / unit.factor


def _value_at(scene: Mapping[str, Any], name: str) -> Any:
    """A parameter, or the value at a path."""
    parameters = scene.get("parameters")
    if isinstance(parameters, Mapping) and name in parameters:
        return parameters[name]
    if name in DynamicsSpec.model_fields:
        name = f"dynamics.{name}"
    table: Any = scene
    for part in name.split("."):
        table = table.get(part) if isinstance(table, Mapping) else None
    return table


def _is_meant(new: float, old: float, ratio: float) -> bool:
    """Whether a number is nearer to the old number before its unit than to that in scene units."""
    if ratio == 1.0 or new == 0.0 or old == 0.0:
        return False
    return abs(math.log(abs(new / old))) < abs(math.log(abs(new * ratio / old)))


def _unit_text(value: Any) -> str:
    """The unit after the number in a text; empty for anything else."""
    match = _NUMBER_WITH_UNIT.match(value) if isinstance(value, str) else None
    try:
        return match["unit"] if match and parse_unit(match["unit"]) else ""
    except FlexmbError:
        return ""  # an expression, or a mistake that the reader of the scene tells


_OF_ENTRIES = ("curves", "couplers", "drivers", "forces", "joints", "sensors", "states")
_OF_NAMES = ("markers", "interfaces", "sections")  # tables of named things


def _is_free(parts: Sequence[str], depth: int) -> bool:
    """Whether a path may name a table at this depth that the scene does not contain.

    The changed scene is checked when it is read.
    """
    return depth > 1 or (depth == 1 and parts[0] in _MAKEABLE)


def _no_table(where: str, path: list[str], table: Any) -> Problem:
    names = tuple(key for key, value in table.items() if isinstance(value, dict))
    what = f'the scene has no table "{".".join(path)}"'
    return Problem(where, what, names, nearest(path[-1], names))


def _put(where: str, table: dict[str, Any], parts: list[str], value: Any) -> Problem | None:
    key = parts[-1]
    whole = isinstance(table.get(key), dict) and not isinstance(value, Mapping)
    if whole and (key in _OF_NAMES or not _is_free(parts, len(parts) - 1)):
        names = tuple(f"{'.'.join(parts)}.{name}" for name in table[key])
        return Problem(where, "is a table; name a value in it", names)
    if parts[0] == "parameters" and key not in table:
        return Problem(where, f'unknown parameter "{key}"', tuple(table), nearest(key, table))
    table[key] = value
    if parts[0] == "dynamics" and key in INSTEAD:  # the new one replaces the scene's other choice
        table.pop(INSTEAD[key], None)
    return None


ALL_BODIES = ["bodies", "*"]
OF_MESHES = {"modes": "bodies.*.modes", "mesh": "bodies.*.refine"}
"""Short names of options of all bodies made from meshes: number of modes, refinements of the mesh.
"""
NO_FLEXIBLE_BODY = "the scene has no flexible body, with a mesh or a flexbody"


def flexible_bodies(scene: Mapping[str, Any]) -> list[str]:
    """Names of the bodies that the scene makes from meshes or flexbody files."""
    bodies = _table(scene, "bodies")
    return [name for name in bodies if {"mesh", "flexbody"} & set(_table(bodies, name))]


_SECTIONS = (
    "parameters", "ground", "bodies", "joints", "couplers", "drivers", "forces", "states",
    "controllers", "assembly", "dynamics", "effects", "validity",
)  # fmt: skip
_TOP = ("gravity", "effects", "budget")


def resolve_knob(scene: Mapping[str, Any], name: str) -> tuple[str, Problem | None]:
    """The full name of a knob, and the problem if the scene has none of that name.

    The last part of a path need not be in the scene, since a field may have a default; it is
    checked when the changed scene is read.
    """
    if name in _table(scene, "parameters") or name in _TOP:
        return name, None
    if name in DynamicsSpec.model_fields:
        return f"dynamics.{name}", None
    name = OF_MESHES.get(name, name)
    *path, last = name.split(".")
    if path[:2] == ALL_BODIES:
        return name, None if flexible_bodies(scene) else Problem("", NO_FLEXIBLE_BODY)
    table: Any = scene
    for depth, part in enumerate(path):
        inside = table.get(part, {} if depth == 0 and part in _MAKEABLE else None)
        table = {} if not isinstance(inside, Mapping) and _is_free(path, depth) else inside
        if not isinstance(table, Mapping):
            break
    if path and path[0] in _SECTIONS and isinstance(table, Mapping):
        inside = table.get(last)
        free = last not in _OF_NAMES and _is_free([*path, last], len(path))
        if free or not isinstance(inside, Mapping):
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
    """Short names, then the paths of all values in the scene."""
    yield from _table(scene, "parameters")
    yield from DynamicsSpec.model_fields
    yield from OF_MESHES if flexible_bodies(scene) else ()
    yield from _TOP
    for section in _SECTIONS[1:]:
        yield from (path for path, _ in leaves(section, _table(scene, section)))


def _table(scene: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    table = scene.get(key, {})
    return table if isinstance(table, Mapping) else {}


def leaves(path: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Values of nested tables: TOML reads ``bodies.rod.modes = [4]`` as tables in tables."""
    for key, value in table.items():
        name = f"{path}.{key}" if path else str(key)
        if isinstance(value, Mapping):
            yield from leaves(name, value)
        else:
            yield name, value


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"\s*(?P<a>{_NUMBER})\s*\.\.\s*(?P<b>{_NUMBER})\s*(?::(?P<n>.*))?\Z")
_HALF_RANGE = re.compile(rf"\s*(?:{_NUMBER}\s*\.\.|\.\.\s*{_NUMBER}\s*(?::|\Z))")
_COARSE = 0.1  # relative distance of neighbouring values above which three digits are enough
_MAX_VALUES = 1000  # largest number of values of one knob; more is a typing error


def sweep_values(source: Any) -> tuple[Any, ...]:
    """The values of a knob.

    Parameters
    ----------
    source : str, number, or sequence of them
        Texts are split at commas outside of brackets; each piece is a range, a TOML value or, as
        in a scene, an expression or a name.

    Raises
    ------
    SceneError
        No values, an empty piece, or a range that cannot be.
    """
    pieces = split_values(source) if isinstance(source, str) else plain(source)
    if not isinstance(pieces, list):
        pieces = [pieces]
    values: list[Any] = []
    for piece in pieces:
        for value in _expanded(piece):
            if value not in values:
                values.append(value)
    if not values:
        raise SceneError("no values are given")
    if len(values) > _MAX_VALUES:
        raise SceneError(f"{len(values)} values are given; a study takes up to {_MAX_VALUES}")
    return tuple(values)


def split_values(text: str) -> list[str]:
    """The parts of a text between commas outside of brackets."""
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
        raise SceneError("a value between the commas is empty")
    match = _RANGE.match(piece)
    if match is None:
        if _HALF_RANGE.match(piece):
            raise SceneError(f'the range "{piece.strip()}" must have two numbers: 1e-2..1e-6')
        yield read_value(piece.strip())
        return
    a, b = match["a"], match["b"]
    if not (0 < float(a) < math.inf and 0 < float(b) < math.inf):
        raise SceneError(f'the range "{piece.strip()}" must have two positive ends')
    values = _decades(float(a), float(b)) if match["n"] is None else _spaced(piece, match)
    whole = a.isdigit() and b.isdigit()
    yield from (round(value) if whole else value for value in values)


def _decades(a: float, b: float) -> Iterator[float]:
    sign = "" if b > a else "-"
    low, high = min(a, b) * (1 - 1e-9), max(a, b) * (1 + 1e-9)
    k = 0
    while low <= (value := a * float(f"1e{sign}{k}")) <= high:  # infinite above 1e308
        yield float(f"{value:.12g}")  # 0.001, not 0.0010000000000000002
        k += 1


def _spaced(piece: str, match: re.Match[str]) -> Iterator[float]:
    count = match["n"].strip()
    if not count.isdigit() or not 2 <= int(count) <= _MAX_VALUES:
        what = f'the range "{piece.strip()}" needs after ":" a number of values'
        raise SceneError(f"{what} from 2 to {_MAX_VALUES}")
    a, b, n = float(match["a"]), float(match["b"]), int(count)
    ratio = (b / a) ** (1 / (n - 1))
    digits = 3 if abs(ratio - 1.0) > _COARSE else 12
    inner = (a * ratio**i for i in range(1, n - 1))
    yield from (a, *(float(f"{value:.{digits}g}") for value in inner), b)


def _vary(value: Any, info: ValidationInfo) -> dict[str, tuple[Any, ...]]:
    if not isinstance(value, Mapping):
        raise fail(Problem("", f"a table {{knob = values, ...}} is expected, given {quote(value)}"))
    knobs: dict[str, tuple[Any, ...]] = {}
    problems: list[Problem] = []
    for knob, values in leaves("", value):
        try:
            knobs[knob] = sweep_values(values)
        except SceneError as error:
            problems += under(knob, error.problems)
    fail_if(problems)
    return knobs


def _target(value: Any, info: ValidationInfo) -> float:
    number = Quantity("", "positive").read(value, info)
    if number >= 1:
        raise fail(Problem("", f"is an error over the peak-to-peak, below 1; is {number:g}"))
    return number


class StudySpec(Spec):
    """Study of accuracy against cost.

    ``vary`` names knobs and their values: lists, or ranges such as ``"1e-2..1e-6"`` (by factors of
    ten) and ``"1e-3..1e-5:5"`` (five values at equal ratios); all combinations are run. ``repeats``
    is the number of runs of each, for the median of the processor time; ``target`` is the error,
    over the peak-to-peak, that the cheapest setting must meet; ``sensors`` (or channels) whose
    errors count, by default all.
    """

    vary: Annotated[dict[str, tuple[Any, ...]], Reader(_vary, form={"type": "object"})]
    repeats: Annotated[int, Integer(1)] = 3
    target: Annotated[float, Reader(_target)] = 0.01
    sensors: tuple[Text, ...] = ()
