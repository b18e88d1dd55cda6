"""Scene files: TOML in, a model out; and what they may hold, as JSON schema and in words.

The file is data and never executed. The schema is made by pydantic from the annotations that also
validate scenes. It (draft 4, which all TOML editors understand) accepts every valid scene and
refuses misspelt keys, wrong kinds and unknown choices. Checks that need the whole scene (names that
must exist, expressions) are left to ``flexmb check``.
"""

from __future__ import annotations

import os
import re
import tomllib
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from flexmb.errors import FlexmbWarning, Problem, SceneError
from flexmb.flexbody.planar_body import PLANES
from flexmb.folders import missing_file
from flexmb.model.body import RigidBodySpec, UnitsName
from flexmb.model.control import StateSpec
from flexmb.model.flexible_body import FlexbodySpec
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.markers import GroundSpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.model import Model, Source
from flexmb.model.reading import NAME, NUMBER, Form, Spec, list_form, reference
from flexmb.model.scenes.conversion import SINGLE_TABLES, TOP_KEYS, build
from flexmb.model.scenes.effects import EffectsSpec
from flexmb.model.scenes.sections import (
    CHECK_LISTS,
    CONTROLLER_TYPES,
    COUPLER_TYPES,
    FORCE_TYPES,
    ViewSpec,
)
from flexmb.model.scenes.study import override, units_of_changes
from flexmb.model.sensor import SENSOR_TYPES

_MAX_BYTES = 50_000_000
_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")


def load_scene(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Model:
    """Read a scene file.

    Parameters
    ----------
    path : path
        The TOML file; paths in it are relative to its folder.
    overrides : mapping, optional
        New values by name: a parameter (``"speed"``) or a path (``"dynamics.step"``); texts are
        read as in the file, so that expressions work.

    Returns
    -------
    Model
        The validated model.

    Raises
    ------
    SceneError
        The file cannot be read, or all mistakes of the scene at once.
    """
    path = Path(path)
    text = _text(path)
    scene = _parse(path, text)
    if overrides:
        before = scene
        scene, problems = override(scene, overrides)
        wrong, notes = units_of_changes(before, scene, overrides)
        if problems or wrong:
            raise SceneError.from_problems([*problems, *wrong])
        for note in notes:
            warnings.warn(note, FlexmbWarning, stacklevel=2)
    model = build(Model, scene, path.parent)
    model.source = Source(path.resolve(), text, dict(overrides or {}))
    return model


def as_model(source: Model | str | Path) -> Model:
    """The model itself, or that of a scene file."""
    if isinstance(source, str | Path):
        return load_scene(source)
    if not isinstance(source, Model):
        raise SceneError(f"a model or a scene file is expected, given {source!r}")
    return source


def raw_scene(path: str | Path) -> dict[str, Any]:
    """The tables of a scene file as they are written, not checked.

    Raises
    ------
    SceneError
        The file cannot be read or is no TOML.
    """
    path = Path(path)
    return _parse(path, _text(path))


def _text(path: Path) -> str:
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe may never end
            raise SceneError(f"{path}: is no file")
        if path.is_file() and path.stat().st_size > _MAX_BYTES:
            raise SceneError(f"{path}: has more than {_MAX_BYTES / 1e6:g} MB, a scene has some kB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError.from_problems([missing_file(path)]) from None
    except UnicodeDecodeError as error:
        what = f"is no text in UTF-8 (byte {error.start}); a scene is a TOML file"
        raise SceneError.from_problems([Problem(str(path), what)]) from None
    except (OSError, ValueError) as error:
        if os.path.isdir(path):  # of which Windows says that it may not be read
            inside = " (it holds scene.toml: name that)" if (path / "scene.toml").is_file() else ""
            raise SceneError(f"{path}: is a folder, not a scene file{inside}") from None
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read ({reason})") from None


_SECTION = re.compile(r"\s*\[+\s*(?P<name>[^\]]*)")


def _parse(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        match = _PLACE.search(message)
        reason = message[: match.start()] if match else message
        lines = text.splitlines() or [""]
        if match and match[1]:
            line, column = int(match[1]), int(match[2])
        else:
            line, column = len(lines), len(lines[-1]) + 1
        shown = lines[min(line, len(lines)) - 1].replace("\t", " ")
        reason = _twice(reason, shown)
        what = f"not TOML: {reason} at line {line}, column {column}"
        caret = f"\n    {shown}\n    {' ' * (column - 1)}^"
        raise SceneError.from_problems([Problem(str(path), what + caret)]) from None
    except RecursionError:
        raise SceneError(f"{path}: not TOML: nested too deeply") from None


def _twice(reason: str, line: str) -> str:
    """The sentence on a name that occurs twice in a file; other reasons unchanged."""
    if not reason.startswith(("Cannot overwrite a value", "Cannot declare")):
        return reason
    section = _SECTION.match(line)
    if section is None:
        return f'the key "{line.split("=")[0].strip()}" is twice in this section'
    if " " in section["name"].strip():
        return "a name with a blank must be in quotation marks"
    return f"[{section['name']}] is there twice, or a value has its name"


_GRAVITY: Form = {
    "anyOf": [
        {"enum": ["none", "earth -x", "earth -y", "earth -z"]},
        {"type": "string", "pattern": "^earth +[+-]?[xyz]$"},
        list_form(NUMBER, 3),
    ],
    "description": "m/s^2, global axes",
}


class Field(NamedTuple):
    """One field of a specification: JSON schema of its values, and its default."""

    name: str
    form: Form
    required: bool
    default: Any

    @property
    def words(self) -> str:
        """The allowed values in words, such as ``number [kg], positive``."""
        return words(self.form)


class Description(NamedTuple):
    """A kind of joint, force, body, ...: its text and its fields."""

    text: str
    fields: tuple[Field, ...]


def _as_source(default: Any) -> Any:
    """A default as a scene would write it: of a function its source."""
    return getattr(default, "source", default)


def describe(spec: type[Spec]) -> Description:
    """The documentation text of a specification and its fields, in the order of declaration."""
    forms = _definition(spec)["properties"]
    fields = (
        Field(name, forms[name], info.is_required(), _as_source(info.get_default()))
        for name, info in spec.model_fields.items()
    )
    return Description(_text_of(spec), tuple(fields))


def _text_of(spec: type[Spec]) -> str:
    """The docstring as one line, without markup."""
    return " ".join((spec.__doc__ or "").replace("``", "`").split())


class _Generator(GenerateJsonSchema):
    """Pydantic's JSON schema in draft 4, without null; other specifications are references."""

    root: type[Spec] | None = None

    def generate_inner(self, schema: Any) -> Form:
        """As in pydantic, but without its own definitions."""
        anonymous: Any = {key: value for key, value in schema.items() if key != "ref"}
        return super().generate_inner(anonymous)

    def get_schema_from_definitions(self, json_ref: Any) -> Form:
        return {}

    def model_schema(self, schema: core_schema.ModelSchema) -> Form:
        if schema["cls"] is not self.root:
            return reference(schema["cls"])
        form = super().model_schema(schema)
        required = {"required": form["required"]} if "required" in form else {}
        return {
            "type": "object",
            "description": _text_of(schema["cls"]),
            "properties": form.get("properties", {}),
            "additionalProperties": False,
            **required,
        }

    def float_schema(self, schema: core_schema.FloatSchema) -> Form:
        return dict(NUMBER)

    def int_schema(self, schema: core_schema.IntSchema) -> Form:
        return dict(NUMBER)

    def literal_schema(self, schema: core_schema.LiteralSchema) -> Form:
        return {"enum": list(schema["expected"])}

    def nullable_schema(self, schema: core_schema.NullableSchema) -> Form:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> Form:
        return self.generate_inner(schema["schema"])

    def tuple_schema(self, schema: core_schema.TupleSchema) -> Form:
        items = [self.generate_inner(item) for item in schema["items_schema"]]
        one = self.get_union_of_schemas(items)
        return list_form(one, 0 if "variadic_item_index" in schema else len(items))

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def _definition(spec: type[Spec]) -> Form:
    generator = _Generator()
    generator.root = spec
    return dict(generator.generate_inner(spec.__pydantic_core_schema__))


def scene_schema() -> dict[str, Any]:
    """The JSON schema of a scene as plain data."""
    forms = _top_forms()
    keys = {key: forms.get(key, {}) for key in TOP_KEYS}
    return {
        "$schema": "http://json-schema.org/draft-04/schema#",
        "title": "flexmb scene",
        "description": "A flexible multibody model; what it means is checked by `flexmb check`.",
        "type": "object",
        "properties": keys,
        "additionalProperties": False,
        "definitions": _definitions(keys),
    }


def _top_forms() -> dict[str, Form]:
    """The keys at the top level."""
    return {
        "title": {"type": "string"},
        "units": dict(_Generator().generate_inner(TypeAdapter(UnitsName).core_schema)),
        "plane": {"enum": list(PLANES)},
        "gravity": _GRAVITY,
        "parameters": {"type": "object", "additionalProperties": NUMBER},
        "ground": reference(GroundSpec),
        "bodies": _named(RigidBodySpec, MeshBodySpec, FlexbodySpec),
        "curves": _named(CurveSpec),
        "joints": _named(JointSpec),
        "couplers": _named(*COUPLER_TYPES.values()),
        "drivers": _named(DriverSpec),
        "forces": _named(*FORCE_TYPES.values()),
        "sensors": _named(*SENSOR_TYPES.values()),
        "states": _named(StateSpec),
        "controllers": _named(*CONTROLLER_TYPES.values()),
        "check": {"type": "array", "items": _one_of(tuple(CHECK_LISTS))},
        **{key: reference(spec) for key, spec in SINGLE_TABLES.items()},
        "effects": {"anyOf": [{"enum": ["auto"]}, reference(EffectsSpec)]},
        "budget": NUMBER,
        "view": reference(ViewSpec),
    }


def _named(*specs: type[Spec]) -> Form:
    return {"type": "object", "additionalProperties": _one_of(specs)}


def _one_of(specs: Iterable[type[Spec]]) -> Form:
    """A table of one of these kinds, which differ by their required keys or by ``type``."""
    forms = [reference(spec) for spec in dict.fromkeys(specs)]
    return {"anyOf": forms} if len(forms) > 1 else forms[0]


def _definitions(top: Form) -> dict[str, Form]:
    """All definitions that are referenced, directly or through others."""
    specs = {reference(spec)["$ref"]: spec for spec in _subclasses(Spec)}
    todo, done = _references(top), dict[str, Form]()
    while todo:
        where = todo.pop()
        if where not in done:
            done[where] = _definition(specs[where])
            todo |= _references(done[where])
    return {where.rpartition("/")[2]: done[where] for where in sorted(done)}


def _subclasses(cls: type[Spec]) -> list[type[Spec]]:
    direct = cls.__subclasses__()
    return direct + [below for spec in direct for below in _subclasses(spec)]


def _references(form: Any) -> set[str]:
    """The references in a form, at any depth."""
    parts = form.values() if isinstance(form, dict) else form if isinstance(form, list) else ()
    targets = {form["$ref"]} if isinstance(form, dict) and "$ref" in form else set[str]()
    return targets.union(*(_references(part) for part in parts))


def words(form: Form) -> str:
    """A form in a few words, such as ``number [kg], positive``."""
    kind = form.get("type")
    if "enum" in form:
        return " | ".join(str(value) for value in form["enum"])
    if "$ref" in form or kind == "object":
        return "table"
    if kind == ["integer", "string"]:
        return f"whole number from {form['minimum']} on"
    if "anyOf" in form:
        parts = list(dict.fromkeys(words(part) for part in form["anyOf"]))
        plain = [part for part in parts if part != "name" or len(parts) == 1]
        text = " or ".join(parts if plain == ["table"] else plain)
    elif kind == "array":
        count = f"{form['minItems']} x " if form.get("minItems") else "list of "
        text = f"{count}{words(form['items'])}"
    elif kind in (NAME["type"], "string"):
        text = "name"
    else:
        text = "true | false" if kind == "boolean" else "number"
    limits = ", >= 0" if "minimum" in form else ""
    if "exclusiveMinimum" in form:
        limits = ", positive"
    elif "maximum" in form:
        limits = f", from {form['minimum']:.4g} to {form['maximum']:.4g}"
    unit = f" {form['description']}" if "description" in form else ""
    return f"{text}{unit}{limits}"
