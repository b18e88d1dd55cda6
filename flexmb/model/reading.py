"""Reading one table of a scene into its specification, with messages a user can act on.

In: a class derived from :class:`Spec`, the raw table, and the values of the parameters. Out: the
frozen specification, or all :class:`Problem` of the table: pydantic's errors translated to the
place, the given value, what is allowed, and the nearest names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializationInfo,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
)
from pydantic_core import PydanticCustomError, core_schema

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.units import SI, UnitSystem

S = TypeVar("S", bound="Spec")
Names = Mapping[str, float]
_HERE = Path()
_MAX_LENGTH = 60  # characters of a value shown in a message


class Spec(BaseModel):
    """Base of all specifications: frozen, and unknown keys are mistakes."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True
    )


GROUND = "ground"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*\Z")


def bad_name(name: Any) -> str:
    """What is wrong with a name; empty if nothing."""
    if isinstance(name, str) and _NAME.match(name):
        return ""
    return f'"{name}" is no name: letters, digits, _ and - only, and a letter first'


def split_reference(reference: str) -> tuple[str, str]:
    """Body and marker of ``"body.marker"``; a bare ``"body"`` means its origin."""
    body, _, marker = reference.partition(".")
    return body, marker or "origin"


class ReadContext(dict[str, float]):
    """How to read the numbers of a scene: parameters by name, the unit system, the expected unit.

    Parameters
    ----------
    values : mapping
        Values of the parameters, in the scene's units.
    units : UnitSystem
        The unit system in which numbers are given.
    expected_unit : str, optional
        SI unit of values whose quantity depends on their use, such as those of a function of
        time; None if it is not known yet.
    folder : Path, optional
        Folder that paths of files are relative to.
    """

    def __init__(
        self,
        values: Names | None = None,
        units: UnitSystem = SI,
        expected_unit: str | None = None,
        folder: Path = _HERE,
    ) -> None:
        super().__init__(values or {})
        self.units, self.expected_unit, self.folder = units, expected_unit, folder

    @classmethod
    def of(cls, names: Names | None) -> ReadContext:
        """The context itself, or one for plain values of the parameters in SI."""
        return names if isinstance(names, cls) else cls(names)


def fail(*problems: Problem) -> PydanticCustomError:
    """The exception a validator raises to report problems; their ``where`` is relative."""
    return PydanticCustomError("flexmb", "see problems", {"problems": problems})


def fail_if(problems: Iterable[Problem]) -> None:
    """Raise the problems from a validator, if there are any."""
    problems = tuple(problems)
    if problems:
        raise fail(*problems)


def only_one(spec: Spec, *words: str) -> str:
    """The one of several fields that is given; none or several are a mistake."""
    present = [word for word in words if getattr(spec, word) is not None]
    if len(present) != 1:
        *first, last = (f'"{word}"' for word in words)
        what = f"give exactly one of {', '.join(first)} and {last}"
        raise fail(Problem("", f"{what}, given {' and '.join(present) or 'none'}"))
    return present[0]


def context_of(info: ValidationInfo | SerializationInfo) -> ReadContext:
    """The context of the numbers that pydantic validates or writes."""
    return ReadContext.of(info.context)


def quote(value: Any) -> str:
    """A value as messages show it: as in TOML, and short."""
    text = _toml(value)
    if isinstance(value, bool):
        return text
    return text if len(text) <= _MAX_LENGTH else text[: _MAX_LENGTH - 3] + "..."


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_toml(one)}' for key, one in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def under(where: str, problems: Iterable[Problem]) -> list[Problem]:
    """The problems with ``where`` put before their own paths."""
    return [replace(problem, where=_join(where, problem.where)) for problem in problems]


def _join(where: str, place: str) -> str:
    if not where or not place:
        return where or place
    return where + place if place.startswith("[") else f"{where}.{place}"


def read_entry(cls: type[S], data: Any, names: ReadContext) -> tuple[S | None, list[Problem]]:
    """Read a table: the specification, or the problems with paths relative to the table."""
    if isinstance(data, cls):
        return data, []
    if not isinstance(data, Mapping):
        return None, [Problem("", f"a table is expected, given {quote(data)}")]
    try:
        return cls.model_validate(dict(data), context=names), []
    except ValidationError as error:
        return None, _translate(cls, error)
    except SceneError as error:
        return None, list(error.problems)


def _translate(cls: type[Spec], error: ValidationError) -> list[Problem]:
    problems: list[Problem] = []
    misspelt: set[str] = set()
    details = error.errors(include_url=False)
    for detail in details:
        if detail["type"] == "extra_forbidden":
            key = str(detail["loc"][-1])
            problem = unknown_key(key, tuple(cls.model_fields))
            misspelt.update(problem.nearest[:1])
            problems.append(problem)
    for detail in details:
        where = ""
        for part in detail["loc"]:
            where = _join(where, f"[{part}]" if isinstance(part, int) else str(part))
        if detail["type"] == "flexmb":
            problems += under(where, detail["ctx"]["problems"])
        elif detail["type"] == "missing" and where not in misspelt:
            problems.append(Problem(where, "is missing"))
        elif detail["type"] not in ("extra_forbidden", "missing"):
            problems.append(_plain(where, detail))
    return problems


def unknown_key(key: Any, allowed: tuple[str, ...]) -> Problem:
    """The problem of a key that does not exist."""
    return Problem(str(key), f'unknown key "{key}"', allowed, nearest(str(key), allowed))


_EXPECTED = {
    "string_type": "text is expected",
    "tuple_type": "a list is expected",
    "list_type": "a list is expected",
    "dict_type": "a table is expected",
    "bool_type": "true or false is expected",
}


def _plain(where: str, detail: Any) -> Problem:
    """An error of pydantic itself in the words of scenes."""
    kind, value, limits = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "literal_error":
        allowed = tuple(re.findall(r"'([^']*)'", str(limits["expected"])))
        return Problem(
            where, f"unknown choice {quote(value)}", allowed, nearest(str(value), allowed)
        )
    if kind in ("too_long", "too_short"):
        count = limits.get("max_length", limits.get("min_length"))
        return Problem(where, f"{count} values are expected, given {quote(value)}")
    if kind in _EXPECTED:
        return Problem(where, f"{_EXPECTED[kind]}, given {quote(value)}")
    return Problem(where, f"{detail['msg']}, given {quote(value)}")


Form = dict[str, Any]
"""A part of a JSON schema."""

NUMBER: Form = {"type": ["number", "string"]}  # a string is an expression
NAME: Form = {"type": ["string", "integer"]}


def choice(names: Iterable[str]) -> Form:
    """The form of one of these names; an editor offers them, other spellings are accepted too."""
    return {"anyOf": [{"enum": list(names)}, {"type": "string"}]}


def list_form(items: Form, count: int = 0) -> Form:
    """The form of a list of `count` items; by default of any number."""
    return {"type": "array", "items": items} | (
        {"minItems": count, "maxItems": count} if count else {}
    )


def reference(spec: type[Spec]) -> Form:
    """A reference to the definition of a specification in the schema of the scene."""
    return {"$ref": f"#/definitions/{spec.__name__.removesuffix('Spec')}"}


class FieldType:
    """Base of annotations for fields that are read, written and described by our own functions."""

    def read(self, value: Any, info: ValidationInfo) -> Any:
        """The value of the field, from what a scene says."""
        raise NotImplementedError

    def write(self, value: Any, info: SerializationInfo) -> Any:
        """What a scene says, from the value of the field."""
        return value

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        """The JSON schema of the field in a scene; ``form_of`` gives that of another annotation."""
        return form_of(source)

    def reader(self, source: Any) -> Callable[[Any, ValidationInfo], Any]:
        """The function that reads a field whose annotated type is ``source``."""
        return self.read

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        reader = self.reader(source)

        def read(value: Any, info: ValidationInfo) -> Any:
            try:
                return reader(value, info)
            except FlexmbError as error:
                raise fail(*error.problems) from None

        return core_schema.with_info_plain_validator_function(
            read,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self.write, info_arg=True
            ),
            metadata={"source": source},
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> Form:
        def form_of(annotation: Any) -> Form:
            return dict(handler(TypeAdapter(annotation).core_schema))

        return self.form(schema["metadata"]["source"], form_of)


class Reader(FieldType):
    """A field that is read, and written, by given functions; by default with the form of its
    type."""

    def __init__(
        self,
        read: Callable[[Any, ValidationInfo], Any],
        write: Callable[[Any, SerializationInfo], Any] | None = None,
        form: Form | Callable[[], Form] | None = None,
    ) -> None:
        self._read, self._write, self._form = read, write, form

    def read(self, value: Any, info: ValidationInfo) -> Any:
        return self._read(value, info)

    def write(self, value: Any, info: SerializationInfo) -> Any:
        return self._write(value, info) if self._write else value

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        if self._form is None:
            return form_of(source)
        return self._form() if callable(self._form) else self._form


class _Table(FieldType):
    """A field that is a table, so that its problems have its path."""

    def write(self, value: Any, info: SerializationInfo) -> Any:
        return value.model_dump(mode="json", exclude_none=True, context=info.context)


class Entry(_Table):
    """Annotation of a field that is a table of the annotated specification."""

    def reader(self, source: Any) -> Callable[[Any, ValidationInfo], Any]:
        def read(value: Any, info: ValidationInfo) -> Spec:
            spec, problems = read_entry(source, value, context_of(info))
            if spec is None:
                raise fail(*problems)
            return spec  # type: ignore[no-any-return]

        return read


@dataclass(frozen=True)
class Variant(_Table):
    """Annotation of a field whose table has a ``type`` that selects one of several
    specifications."""

    noun: str
    kinds: Callable[[], Mapping[str, type[Spec]]]

    def read(self, value: Any, info: ValidationInfo) -> Spec:
        if isinstance(value, Spec):
            return value
        spec, problems = read_variant(self.noun, self.kinds(), value, context_of(info))
        if spec is None:
            raise fail(*problems)
        return spec

    def form(self, source: Any, form_of: Callable[[Any], Form]) -> Form:
        kinds = dict.fromkeys(self.kinds().values())
        return {"anyOf": [reference(kind) for kind in kinds], "required": ["type"]}


_STRESS = ": stress needs no sensor, results have it (body.von_mises, body.stress.NODE.xx; `flexmb "
_STRESS += "stress` shows the largest, a known answer names body.von_mises)"
_REACTION = ': that is type = "reaction", with its quantity and the joint, driver or force'
_MEANT = {("sensor type", name): _STRESS for name in ("stress", "von_mises", "strain")}
_MEANT |= {("sensor type", name): _REACTION for name in ("force", "moment", "torque")}


def read_variant(
    noun: str, kinds: Mapping[str, type[S]], data: Any, names: ReadContext
) -> tuple[S | None, list[Problem]]:
    """Read a table whose key ``type`` selects the specification."""
    if isinstance(data, Mapping) and "type" not in data:
        return None, [Problem("type", "is missing", tuple(kinds))]
    if isinstance(data, Mapping) and data["type"] not in tuple(kinds):
        what = f"unknown {noun} {quote(data['type'])}" + _MEANT.get((noun, str(data["type"])), "")
        near = nearest(str(data["type"]), kinds)
        return None, [Problem("type", what, tuple(kinds), near)]
    kind = kinds[data["type"]] if isinstance(data, Mapping) else next(iter(kinds.values()))
    return read_entry(kind, data, names)
