"""What a scene may hold: fields of every kind, as JSON schema and in words.

In: a class derived from :class:`Spec`. Out: its fields by name, each with the JSON schema (draft 4,
the one all TOML editors understand) of what a scene may write there, whether it must be given, and
its default. All of it is read off the annotations that also validate scenes, so that it cannot say
anything else than they do. The schema accepts every valid scene and refuses misspelt keys, wrong
kinds and unknown choices. What needs the whole scene (names that must exist, expressions) is left
to ``flexmb check``.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from flexmb.flexbody.planar_body import PLANES
from flexmb.materials import LIBRARY
from flexmb.model.bodies.body import (
    COLORS,
    BodySpec,
    FlexbodySpec,
    FlexibleSource,
    RigidBodySpec,
    UnitsName,
)
from flexmb.model.bodies.markers import GroundSpec
from flexmb.model.bodies.mass_properties import Inertia
from flexmb.model.bodies.mesh_body import (
    MESH_TYPES,
    Interfaces,
    InterfaceSpec,
    MeshBodySpec,
    MeshSource,
    Modes,
    ModesSpec,
)
from flexmb.model.bodies.option_specs import (
    MATERIAL_KINDS,
    Divisions,
    GroupName,
    MaterialField,
    NodeOrGroup,
    Stiffness,
    Weights,
)
from flexmb.model.forces.force_characteristic import CharacteristicTable, ForceCharacteristic
from flexmb.model.functions.function import FUNCTION_FORMS, Function, FunctionOf
from flexmb.model.functions.tabulated import Tabulated
from flexmb.model.joints.coupler import AngleTerm, LinearCouplerSpec, StrokeTerm
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import JOINT_TYPES, JointSpec
from flexmb.model.scenes.conversion import TOP_KEYS
from flexmb.model.scenes.sections import CONTROLLER_TYPES, COUPLER_TYPES, FORCE_TYPES
from flexmb.model.sensors.control import StateSpec
from flexmb.model.sensors.sensor import SENSOR_TYPES
from flexmb.model.tasks.dynamics import DynamicsSpec
from flexmb.model.tasks.kinematics import AssemblySpec, KinematicsSpec
from flexmb.model.tasks.results import CheckSpec, FrequencyCheckSpec, ResultsSpec, ViewSpec
from flexmb.model.tasks.study import StudySpec
from flexmb.model.values.orientation import Orientation
from flexmb.model.values.quantities import NUMBER, Axis, Integer, Quantity, WordOr
from flexmb.model.values.reading import Entry, Reader, Spec, Variant
from flexmb.units import UNIT_SYSTEMS

Form = dict[str, Any]

VECTOR: Form = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3}
_MATRIX: Form = {"type": "array", "items": VECTOR, "minItems": 3, "maxItems": 3}
_ROW: Form = {"type": "array", "items": NUMBER, "minItems": 6, "maxItems": 6}
_SIX: Form = {"type": "array", "items": _ROW, "minItems": 6, "maxItems": 6}
_NAMED: Form = {"type": ["string", "integer"]}
_COUNT: Form = {"type": ["integer", "string"], "minimum": 1}
_SIGNS: dict[str, Form] = {
    "positive": {"minimum": 0, "exclusiveMinimum": True},
    "not negative": {"minimum": 0},
}


class Field(NamedTuple):
    """One field of a specification."""

    name: str
    form: Form
    required: bool
    default: Any


def fields_of(spec: type[Spec]) -> tuple[Field, ...]:
    """The fields of a specification, in the order in which they are declared."""
    return tuple(_field(name, info) for name, info in spec.model_fields.items())


def _field(name: str, info: FieldInfo) -> Field:
    annotation: Any = info.annotation
    if info.metadata:
        annotation = Annotated[annotation, *info.metadata]
    required = info.is_required()
    return Field(name, form_of(annotation), required, None if required else info.get_default())


def form_of(annotation: Any) -> Form:
    """The JSON schema of what may be written where this annotation stands."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _marked(parts[0], parts[1:])
    if origin in (Union, types.UnionType):
        return _either([form_of(part) for part in parts if part is not type(None)])
    if origin is Literal:
        return {"enum": list(parts)}
    if origin is tuple:
        return _list(parts)
    if origin is dict:
        return {"type": "object", "additionalProperties": form_of(parts[1])}
    if isinstance(annotation, type):
        return _of_class(annotation)
    return {}


def _of_class(cls: type) -> Form:
    if issubclass(cls, Spec):
        return reference(cls)
    if issubclass(cls, Function):
        return {
            "anyOf": [NUMBER, *(reference(form) for form in FUNCTION_FORMS.values())],
            "description": "as a function of t",
        }
    if issubclass(cls, ForceCharacteristic):
        points = {"type": "array", "items": _list((float, float))}
        return {
            "anyOf": [{"type": "string"}, points, reference(CharacteristicTable)],
            "description": "or an expression",
        }
    plain: dict[type, Form] = {str: {"type": "string"}, bool: {"type": "boolean"}}
    return dict(plain.get(cls, NUMBER if cls in (int, float) else {}))


def _marked(annotation: Any, marks: Iterable[Any]) -> Form:
    """The form of an annotation that carries marks; the innermost mark that reads decides."""
    for mark in marks:
        if isinstance(mark, Quantity):
            unit = {"description": f"[{mark.unit}]"} if mark.unit else {}
            limits = dict(zip(("minimum", "maximum"), mark.limits or (), strict=False))
            return {**NUMBER, **_SIGNS.get(mark.sign, {}), **limits, **unit}
        if isinstance(mark, Integer):
            return {"type": ["integer", "string"], "minimum": mark.minimum}
        if isinstance(mark, FunctionOf) and mark.channels:
            return {**_of_class(Function), "description": "as a function of t and channels"}
        if isinstance(mark, Entry):
            return reference(annotation)
        if isinstance(mark, Variant):
            return {**_either([reference(s) for s in mark.kinds().values()]), "required": ["type"]}
        if isinstance(mark, WordOr):
            return _either([{"enum": [mark.word]}, {**NUMBER, **_SIGNS.get(mark.sign, {})}])
        if isinstance(mark, Reader) and mark.form is not None:
            return mark.form
        if isinstance(mark, Reader):
            known = _readers().get(mark)
            return known() if known else form_of(annotation)
    return form_of(annotation)


def _either(forms: list[Form]) -> Form:
    different = list({json.dumps(form, sort_keys=True): form for form in forms}.values())
    return different[0] if len(different) == 1 else {"anyOf": different}


def _list(parts: tuple[Any, ...]) -> Form:
    if parts[-1] is Ellipsis:
        return {"type": "array", "items": form_of(parts[0])}
    items = _either([form_of(part) for part in parts])
    return {"type": "array", "items": items, "minItems": len(parts), "maxItems": len(parts)}


def reference(spec: type[Spec]) -> Form:
    """A reference to the definition of a specification in the schema of the scene."""
    return {"$ref": f"#/definitions/{spec.__name__.removesuffix('Spec')}"}


def _marks(annotation: Any) -> list[Any]:
    """All marks of an annotation, at any depth."""
    if get_origin(annotation) is Annotated:
        inner, *marks = get_args(annotation)
        return [*marks, *_marks(inner)]
    return [mark for part in get_args(annotation) for mark in _marks(part)]


def _reader(annotation: Any) -> Reader:
    return next(mark for mark in _marks(annotation) if isinstance(mark, Reader))


def _field_reader(spec: type[Spec], name: str) -> Reader:
    info = spec.model_fields[name]
    return _reader(Annotated[info.annotation, *info.metadata, None])


def _readers() -> Mapping[Reader, Callable[[], Form]]:
    """What the readers take whose annotation does not tell it."""
    return {
        _field_reader(JointSpec, "type"): lambda: {"enum": list(JOINT_TYPES)},
        _field_reader(LinearCouplerSpec, "terms"): lambda: {
            "anyOf": [reference(AngleTerm), reference(StrokeTerm)]
        },
        _field_reader(CurveSpec, "polar"): lambda: {**NUMBER, "description": "[m], over t"},
        _field_reader(BodySpec, "color"): lambda: _choice(COLORS),
        _field_reader(StudySpec, "vary"): lambda: {"type": "object"},
        _field_reader(Tabulated, "file"): lambda: {"type": "string"},
        _field_reader(Tabulated, "columns"): lambda: _list((GroupName, GroupName)),
        _field_reader(DynamicsSpec, "outputs"): lambda: {
            "anyOf": [_COUNT, {"type": "array", "items": NUMBER, "minItems": 1}],
            "description": "or times [s]",
        },
        _field_reader(DriverSpec, "start"): lambda: {
            "anyOf": [NUMBER, {"type": "array", "items": NUMBER}]
        },
        _reader(UnitsName): lambda: _choice(UNIT_SYSTEMS),
        _reader(MaterialField): lambda: {
            "anyOf": [*_choice(LIBRARY)["anyOf"], *map(reference, MATERIAL_KINDS.values())]
        },
        _reader(Interfaces): lambda: {
            "type": "object",
            "additionalProperties": {"anyOf": [_NAMED, reference(InterfaceSpec)]},
            "minProperties": 1,
        },
        _reader(GroupName): lambda: _NAMED,
        _reader(NodeOrGroup): lambda: _NAMED,
        _reader(Weights): lambda: {
            "anyOf": [{"enum": ["uniform", "area"]}, {"type": "array", "items": NUMBER}]
        },
        _reader(Stiffness): lambda: {
            "anyOf": [NUMBER, {"type": "array", "items": NUMBER, "minItems": 6, "maxItems": 6}],
            "description": "[N/m, N m/rad]",
        },
        _reader(MeshSource): lambda: {
            "anyOf": [{"type": "string"}, *map(reference, MESH_TYPES.values())]
        },
        _reader(Divisions): lambda: {"anyOf": [_COUNT, {"type": "array", "items": _COUNT}]},
        _reader(Modes): lambda: {"anyOf": [{**_COUNT, "minimum": 0}, reference(ModesSpec)]},
        _reader(FlexibleSource): lambda: {"type": "string"},
        _reader(Axis): lambda: {"anyOf": [_choice(_signed("xyz")), VECTOR]},
        _reader(Inertia): lambda: {
            "anyOf": [VECTOR, _MATRIX, _table(("xx", "yy", "zz"), ("xy", "xz", "yz"))],
            "description": "[kg m^2]",
        },
        _reader(Orientation): lambda: {
            "anyOf": [
                {"type": "array", "items": NUMBER, "minItems": 4, "maxItems": 4},
                _MATRIX,
                {"type": "object"},
            ]
        },
    }


def _signed(letters: str) -> list[str]:
    return [*letters, *(f"-{letter}" for letter in letters)]


def _choice(names: Iterable[str]) -> Form:
    """One of these names, which an editor offers; other spellings of them pass as well."""
    return {"anyOf": [{"enum": list(names)}, {"type": "string"}]}


def _table(required: tuple[str, ...], optional: tuple[str, ...]) -> Form:
    """A table of numbers."""
    return {
        "type": "object",
        "properties": {key: NUMBER for key in (*required, *optional)},
        "required": list(required),
        "additionalProperties": False,
    }


def described(spec: type[Spec]) -> str:
    """The docstring of a specification as one line, without marks of markup."""
    return " ".join((spec.__doc__ or "").replace("``", "`").split())


def words(form: Form) -> str:
    """A form in a few words, such as ``number [kg], positive``."""
    if "enum" in form:
        return " | ".join(str(value) for value in form["enum"])
    if "$ref" in form or form.get("type") == "object":
        return "table"
    if "anyOf" in form:
        parts = list(dict.fromkeys(words(part) for part in form["anyOf"]))
        plain = [part for part in parts if part != "name" or len(parts) == 1]
        told = " or ".join(parts if plain == ["table"] else plain)
    elif form.get("type") == "array":
        count = f"{form['minItems']} x " if form.get("minItems") else "list of "
        told = f"{count}{words(form['items'])}"
    elif form.get("type") == ["integer", "string"]:
        return f"whole number from {form['minimum']} on"
    else:
        kind = "name" if form.get("type") == _NAMED["type"] else str(form.get("type"))
        told = {"name": "name", "string": "name", "boolean": "true | false"}.get(kind, "number")
    sign = ", positive" if "exclusiveMinimum" in form else ", >= 0" if "minimum" in form else ""
    unit = f" {form['description']}" if "description" in form else ""
    return f"{told}{unit}{sign}"


_GRAVITY: Form = {
    "anyOf": [
        {"enum": ["none", "earth -x", "earth -y", "earth -z"]},
        {"type": "string", "pattern": "^earth +[+-]?[xyz]$"},
    ]
}
_BODIES: tuple[type[Spec], ...] = (RigidBodySpec, MeshBodySpec, FlexbodySpec)


def scene_schema() -> dict[str, Any]:
    """The JSON schema of a scene as plain data."""
    known = _top()
    keys = {key: known.get(key, {}) for key in TOP_KEYS}
    return {
        "$schema": "http://json-schema.org/draft-04/schema#",
        "title": "flexmb scene",
        "description": "A flexible multibody model; what it means is checked by `flexmb check`.",
        "type": "object",
        "properties": keys,
        "additionalProperties": False,
        "definitions": _definitions(keys),
    }


def _top() -> dict[str, Form]:
    """The keys at the top level."""
    return {
        "title": {"type": "string"},
        "units": form_of(UnitsName),
        "plane": {"enum": list(PLANES)},
        "gravity": {"anyOf": [_GRAVITY, VECTOR], "description": "m/s^2, global axes"},
        "parameters": {"type": "object", "additionalProperties": NUMBER},
        "ground": reference(GroundSpec),
        "bodies": _named(_one_of(_BODIES)),
        "curves": _named(reference(CurveSpec)),
        "joints": _named(reference(JointSpec)),
        "couplers": _named(_one_of(COUPLER_TYPES.values())),
        "drivers": _named(reference(DriverSpec)),
        "forces": _named(_one_of(FORCE_TYPES.values())),
        "sensors": _named(_one_of(SENSOR_TYPES.values())),
        "states": _named(reference(StateSpec)),
        "controllers": _named(_one_of(CONTROLLER_TYPES.values())),
        "check": {"type": "array", "items": _one_of((CheckSpec, FrequencyCheckSpec))},
        "assembly": reference(AssemblySpec),
        "dynamics": reference(DynamicsSpec),
        "kinematics": reference(KinematicsSpec),
        "results": reference(ResultsSpec),
        "study": reference(StudySpec),
        "view": reference(ViewSpec),
    }


def _named(entry: Form) -> Form:
    return {"type": "object", "additionalProperties": entry}


def _one_of(specs: Iterable[type[Spec]]) -> Form:
    """A table of one of these kinds, which differ by the keys they need or by ``type``."""
    return {"anyOf": [reference(spec) for spec in dict.fromkeys(specs)]}


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
    found = {form["$ref"]} if isinstance(form, dict) and "$ref" in form else set[str]()
    return found.union(*(_references(part) for part in parts))


def _definition(spec: type[Spec]) -> Form:
    fields = fields_of(spec)
    required = [field.name for field in fields if field.required]
    return {
        "type": "object",
        "description": described(spec),
        "properties": {field.name: field.form for field in fields},
        "additionalProperties": False,
        **({"required": required} if required else {}),
    }
