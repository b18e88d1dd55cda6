"""The JSON schema of a scene, for editors that complete and check TOML as it is typed.

In: the specifications. Out: a schema (draft 4, the one all TOML editors understand) that accepts
every valid scene and refuses misspelt keys, wrong kinds and unknown choices. What needs the whole
scene (names that must exist, expressions, bodies told twice) is left to ``flexmb check``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from flexmb.flexbody.planar_body import PLANES
from flexmb.model.bodies.body import FlexbodySpec, RigidBodySpec, UnitsName
from flexmb.model.bodies.markers import GroundSpec
from flexmb.model.bodies.mesh_body import MeshBodySpec
from flexmb.model.forces.force import FORCE_TYPES
from flexmb.model.joints.couplers import COUPLER_TYPES
from flexmb.model.joints.curves import CurveSpec
from flexmb.model.joints.drivers import DriverSpec
from flexmb.model.joints.joint import JointSpec
from flexmb.model.scenes.building import TOP_KEYS
from flexmb.model.scenes.forms import NUMBER, VECTOR, Form, described, fields_of, form_of, reference
from flexmb.model.sensors.sensor import SENSOR_TYPES
from flexmb.model.sensors.states import CONTROLLER_TYPES, StateSpec
from flexmb.model.tasks.assembly import AssemblySpec
from flexmb.model.tasks.checks import CheckSpec, FrequencyCheckSpec
from flexmb.model.tasks.dynamics import DynamicsSpec
from flexmb.model.tasks.kinematics import KinematicsSpec
from flexmb.model.tasks.results import ResultsSpec
from flexmb.model.tasks.study import StudySpec
from flexmb.model.tasks.view import ViewSpec
from flexmb.model.values.reading import Spec

__all__ = ["scene_schema"]

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
