"""What a scene may hold: the fields of every kind, as JSON schema and in words.

All of it comes from the annotations that also validate scenes, through pydantic. The schema (draft
4, the one all TOML editors understand) accepts every valid scene and refuses misspelt keys, wrong
kinds and unknown choices. What needs the whole scene (names that must exist, expressions) is left
to ``flexmb check``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from flexmb.flexbody.planar_body import PLANES
from flexmb.model.bodies.body import FlexbodySpec, RigidBodySpec, UnitsName
from flexmb.model.bodies.markers import GroundSpec
from flexmb.model.bodies.mesh_body import MeshBodySpec
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.scenes.conversion import SINGLE_TABLES, TOP_KEYS
from flexmb.model.scenes.sections import (
    CONTROLLER_TYPES,
    COUPLER_TYPES,
    FORCE_TYPES,
    CheckSpec,
    FrequencyCheckSpec,
    ViewSpec,
)
from flexmb.model.sensors.control import StateSpec
from flexmb.model.sensors.sensor import SENSOR_TYPES
from flexmb.model.values.reading import NAME, NUMBER, Form, Spec, list_form, reference

_GRAVITY: Form = {
    "anyOf": [
        {"enum": ["none", "earth -x", "earth -y", "earth -z"]},
        {"type": "string", "pattern": "^earth +[+-]?[xyz]$"},
        list_form(NUMBER, 3),
    ],
    "description": "m/s^2, global axes",
}


class Field(NamedTuple):
    """One field of a specification: the JSON schema of what it may hold, and its default."""

    name: str
    form: Form
    required: bool
    default: Any

    @property
    def words(self) -> str:
        """What it may hold, such as ``number [kg], positive``."""
        return words(self.form)


class Description(NamedTuple):
    """What a kind of joint, force, body, ... is, and its fields."""

    text: str
    fields: tuple[Field, ...]


def describe(spec: type[Spec]) -> Description:
    """The documentation text of a specification and its fields, in the order of declaration."""
    forms = _definition(spec)["properties"]
    fields = (
        Field(name, forms[name], info.is_required(), info.get_default())
        for name, info in spec.model_fields.items()
    )
    return Description(_text_of(spec), tuple(fields))


def _text_of(spec: type[Spec]) -> str:
    """The docstring as one line, without marks of markup."""
    return " ".join((spec.__doc__ or "").replace("``", "`").split())


class _Generator(GenerateJsonSchema):
    """Pydantic's JSON schema in draft 4: without null, a reference for each other specification."""

    root: type[Spec] | None = None

    def generate_inner(self, schema: Any) -> Form:
        """As pydantic's, without its own definitions."""
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


def _form_of(annotation: Any) -> Form:
    return dict(_Generator().generate_inner(TypeAdapter(annotation).core_schema))


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
        "units": _form_of(UnitsName),
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
        "check": {"type": "array", "items": _one_of((CheckSpec, FrequencyCheckSpec))},
        **{key: reference(spec) for key, spec in SINGLE_TABLES.items()},
        "view": reference(ViewSpec),
    }


def _named(*specs: type[Spec]) -> Form:
    return {"type": "object", "additionalProperties": _one_of(specs)}


def _one_of(specs: Iterable[type[Spec]]) -> Form:
    """A table of one of these kinds, which differ by the keys they need or by ``type``."""
    forms = [reference(spec) for spec in dict.fromkeys(specs)]
    return {"anyOf": forms} if len(forms) > 1 else forms[0]


def _definitions(top: Form) -> dict[str, Form]:
    """Every definition that is referred to, directly or through others."""
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
    """Where a form refers to, at any depth."""
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
