"""Options of a body as dataclasses, which scenes and the finite-element half read alike.

The annotation of a field says which values are allowed: ``Annotated[float, Unit("m",
"positive")]``, a ``Literal``, a tuple, another dataclass of options, :class:`OneOf` several kinds
that differ by ``type``, or a :class:`Kind` that each half reads in its own way (a material, a group
of the mesh). The scene model makes pydantic classes, JSON schema and lists of them, in the scene's
units; :func:`read_options` reads plain data in SI and reports all mistakes at once. A method
``check`` of the class returns what is wrong with the fields taken together.
"""

from __future__ import annotations

import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from numbers import Integral, Real
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from flexmb.errors import FlexmbError, Problem, nearest


class Options(Protocol):
    """A dataclass of options."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


T = TypeVar("T", bound=Options)
Sign = Literal["any", "positive", "not negative"]
Say = Callable[[float, str], str]
_COUNTS = {2: "two", 3: "three", 6: "six"}


@dataclass(frozen=True)
class Unit:
    """Annotation of a float: its SI unit and the sign it must have."""

    unit: str = ""
    sign: Sign = "any"


@dataclass(frozen=True)
class Whole:
    """Annotation of an int: the smallest value it may have."""

    minimum: int = 0


@dataclass(frozen=True)
class Kind:
    """Annotation of a value that scenes and finite elements each read by a function of their
    own."""

    name: str


@dataclass(frozen=True)
class OneOf:
    """Annotation of a table whose ``type`` selects its options."""

    noun: str
    kinds: Mapping[str, type]


Number = Annotated[float, Unit()]
Length = Annotated[float, Unit("m")]
Size = Annotated[float, Unit("m", "positive")]
Position = tuple[Length, Length, Length]


@cache
def option_types(options: type) -> dict[str, tuple[Any, Any]]:
    """Annotation and default (``MISSING`` if there is none) of each field by name."""
    hints = get_type_hints(options, include_extras=True)
    types_by_name = {}
    for field in fields(options):
        default = field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        types_by_name[field.name] = (hints[field.name], default)
    return types_by_name


def is_number(value: Any) -> bool:
    """Whether it is a finite number, and not a bool."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def require_tables(error: type[FlexmbError], tables: Mapping[str, Any]) -> None:
    """Refuse anything but tables by name; each may be None."""
    problems = [
        Problem(name, f"a table by name is expected, given {value!r}")
        for name, value in tables.items()
        if value is not None and not isinstance(value, Mapping)
    ]
    if problems:
        raise error.from_problems(problems)


def kind_of(
    noun: str, names: Sequence[str], words: Any, where: str, error: type[FlexmbError]
) -> str:
    """The type named in a table.

    Raises
    ------
    FlexmbError
        Of the class ``error``: not a table, no type, or a type that is not among ``names``.
    """
    names = tuple(names)
    if not isinstance(words, Mapping):
        what = f"a table such as {{type = ...}} is expected, given {words!r}"
        raise error.from_problems([Problem(where, what)])
    if "type" not in words:
        raise error.from_problems([Problem(f"{where}.type", "is missing", names)])
    kind = words["type"]
    if kind not in names:
        near = nearest(str(kind), names)
        problem = Problem(f"{where}.type", f'unknown {noun} "{kind}"', names, near)
        raise error.from_problems([problem])
    return str(kind)


def key_problems(options: type, words: Mapping[str, Any], where: str) -> list[Problem]:
    """Keys of a table that are unknown, and those that are missing."""
    options_by_name = option_types(options)
    names = tuple(options_by_name)
    unknown = [
        Problem(f"{where}.{key}", "unknown key", names, nearest(str(key), names))
        for key in words
        if key not in options_by_name
    ]
    misspelt = {problem.nearest[0] for problem in unknown if problem.nearest}
    return unknown + [
        Problem(f"{where}.{name}", "is missing")
        for name, (_, default) in options_by_name.items()
        if default is MISSING and name not in words and name not in misspelt
    ]


def read_options(
    options: type[T], words: Mapping[str, Any] | T, where: str, error: type[FlexmbError]
) -> T:
    """Read options from plain data in SI.

    Parameters
    ----------
    options : dataclass
        The class.
    words : mapping or instance
        Values by field.
    where : str
        Path of the table, put before the paths of its problems.
    error : type
        Class of the error.

    Raises
    ------
    FlexmbError
        Of the class ``error``, with everything that is wrong.
    """
    if isinstance(words, options):
        return words
    if not isinstance(words, Mapping):
        raise error.from_problems([Problem(where, f"a table is expected, given {words!r}")])
    problems = key_problems(options, words, where)
    values: dict[str, Any] = {}
    for name, (annotation, default) in option_types(options).items():
        value = words.get(name, default)
        if value is default or (value is None and default is None):
            values[name] = value
            continue
        values[name], wrong = _read(annotation, value, name)
        problems += [replace(p, where=f"{where}.{p.where}") for p in wrong]
    if not problems:
        read = options(**values)
        check = getattr(read, "check", None)
        problems = check(_say) if check is not None else []
        problems = [replace(p, where=f"{where}.{p.where}".rstrip(".")) for p in problems]
        if not problems:
            return read
    raise error.from_problems(problems)


def option_values(options: Options) -> dict[str, Any]:
    """The fields that are not at their default, by name, without the type."""
    options_by_name = option_types(type(options))
    return {
        name: getattr(options, name)
        for name in options_by_name
        if name != "type" and getattr(options, name) is not options_by_name[name][1]
    }


def rooted(where: str, problems: Sequence[Problem]) -> list[Problem]:
    """The problems of an object, with paths such as ``section.A``, moved under its path in a
    table."""
    fields_ = (problem.where.partition(".")[2] for problem in problems)
    return [
        replace(problem, where=f"{where}.{name}" if name else where)
        for name, problem in zip(fields_, problems, strict=True)
    ]


def _say(value: float, unit: str) -> str:
    return f"{value:g} {unit}".rstrip()


def _read(annotation: Any, value: Any, where: str) -> tuple[Any, list[Problem]]:
    """The value converted to its annotation, and what is wrong with it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation is str or (origin is Annotated and parts[0] is str):
        wrong = not isinstance(value, str)
        return value, [Problem(where, f"must be a name, given {value!r}")] * wrong
    if origin is Annotated:
        return _read_marked(parts[1], value, where)
    if origin in (Union, types.UnionType):
        return _read(next(part for part in parts if part is not type(None)), value, where)
    if origin is tuple:
        return _read_list(parts, value, where)
    if origin is Literal and value not in parts:
        names = tuple(str(part) for part in parts)
        return value, [Problem(where, f'unknown "{value}"', names, nearest(str(value), names))]
    if annotation is bool and not isinstance(value, bool):
        return value, [Problem(where, f"must be true or false, given {value!r}")]
    if is_dataclass(annotation) and not is_dataclass(value):
        options: Any = annotation
        return _read_table(lambda: read_options(options, value, "x", FlexmbError), value, where)
    return value, []


def _read_marked(mark: Any, value: Any, where: str) -> tuple[Any, list[Problem]]:
    if isinstance(mark, Unit):
        return value, _number_problems(mark, value, where)
    if isinstance(mark, Whole):
        whole = isinstance(value, Integral) and not isinstance(value, bool)
        if not whole or value < mark.minimum:
            what = f"must be a whole number >= {mark.minimum}, given {value!r}"
            return value, [Problem(where, what)]
    if isinstance(mark, OneOf) and isinstance(value, Mapping):
        kinds = mark.kinds

        def read() -> Any:
            kind = kind_of(mark.noun, tuple(kinds), value, "x", FlexmbError)
            return read_options(kinds[kind], value, "x", FlexmbError)

        return _read_table(read, value, where)
    return value, []


def _number_problems(mark: Unit, value: Any, where: str) -> list[Problem]:
    if not isinstance(value, Real) or isinstance(value, bool) or math.isnan(value):
        return [Problem(where, f"must be a number, given {value!r}")]
    number, unit = float(value), f" {mark.unit}".rstrip()
    if mark.sign == "positive" and not number > 0:
        return [Problem(where, f"must be positive, given {number:g}{unit}")]
    if mark.sign == "not negative" and number < 0:
        return [Problem(where, f"must not be negative, given {number:g}{unit}")]
    return []


def _read_list(parts: tuple[Any, ...], value: Any, where: str) -> tuple[Any, list[Problem]]:
    items = value.tolist() if hasattr(value, "tolist") else value
    if parts[-1] is Ellipsis:
        if isinstance(items, str | Mapping) or not hasattr(items, "__iter__"):
            return value, [Problem(where, f"a list is expected, given {value!r}")]
        choices = get_origin(parts[0]) is Literal
        places = (where if choices else f"{where}[{k}]" for k in range(len(items)))
        results = [_read(parts[0], *pair) for pair in zip(items, places, strict=True)]
        return tuple(item for item, _ in results), [p for _, wrong in results for p in wrong]
    listed = isinstance(items, list | tuple) and len(items) == len(parts)
    if not listed or not all(is_number(item) for item in items):
        mark = get_args(parts[0])[1] if get_args(parts[0]) else Unit()
        if not isinstance(mark, Unit):
            return tuple(items) if listed else value, []
        unit = f" [{mark.unit}]" if mark.unit else ""
        count = _COUNTS.get(len(parts), str(len(parts)))
        return value, [Problem(where, f"must be {count} finite numbers{unit}, given {value!r}")]
    results = [_read(part, item, where) for part, item in zip(parts, items, strict=True)]
    return tuple(items), [p for _, wrong in results for p in wrong][:1]


def _read_table(read: Callable[[], Any], value: Any, where: str) -> tuple[Any, list[Problem]]:
    try:
        return read(), []
    except FlexmbError as error:
        return value, rooted(where, error.problems)
