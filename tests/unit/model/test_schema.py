"""The JSON schema of scenes: it takes all that is valid and refuses what an editor can see."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from goodscene import GOOD

from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.reading import Spec
from flexmb.model.scenes.conversion import TOP_KEYS
from flexmb.model.scenes.scene import describe, scene_schema

SCHEMA = scene_schema()
SCENE = tomllib.loads(GOOD) | {
    "title": "A good scene",
    "gravity": [0, 0, "-9.81"],
    "view": {"time": 0.1},
    "forces": {
        "spring": {
            "type": "spring-damper",
            "between": ["ground", "crank.tip"],
            "stiffness": "100*r",
        }
    },
}


def _refusals(scene: dict[str, Any]) -> list[str]:
    jsonschema = pytest.importorskip("jsonschema")
    return [error.message for error in jsonschema.Draft4Validator(SCHEMA).iter_errors(scene)]


def test_it_is_a_schema() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft4Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("folder", ["cases", "flexmb/templates"])
def test_it_accepts_all_scenes_of_the_project(project: Path, folder: str) -> None:
    paths = sorted((project / folder).glob("*/scene.toml"))
    assert paths
    for path in paths:
        assert _refusals(tomllib.loads(path.read_text(encoding="utf-8"))) == [], path


def test_it_accepts_every_way_to_say_things() -> None:
    assert _refusals(SCENE) == []
    scene = copy.deepcopy(SCENE)
    body = {"mass": 1, "inertia": {"xx": 1, "yy": "2*r", "zz": 1, "xy": 0}, "color": "#aa00ff"}
    scene["bodies"] |= {
        "a": body | {"orientation": {"axis": "z", "angle": "30 deg"}, "markers": {"m": {}}},
        "b": {"shape": {"type": "sphere", "radius": 0.1}, "material": {"E": 1e9, "nu": 0.3,
              "density": 1e3}},
        "c": {"flexbody": "c.flexbody.h5", "position": ["r", 0, 0]},
    }  # fmt: skip
    scene["forces"] |= {
        "f": {"type": "force", "at": "a", "value": [0, "sin(t)", {"type": "step", "t1": 1,
              "y1": "2*r"}]},
    }  # fmt: skip
    assert _refusals(scene) == []


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("bodys",), {}),
        (("bodies", "crank", "mas"), 1.0),
        (("bodies", "crank", "mass"), 0.0),
        (("bodies", "rod", "shape"), {"size": [1, 1, 1]}),
        (("bodies", "rod", "shape"), {"type": "box", "sise": [1, 1, 1]}),
        (("bodies", "crank", "position"), [0, 0]),
        (("joints", "bearing", "type"), "revolut"),
        (("joints", "bearing", "axes"), "z"),
        (("drivers", "motor", "angel"), "t"),
        (("forces", "spring", "stifness"), 1.0),
        (("forces", "spring", "type"), "sprung"),
        (("sensors", "tip", "relative"), "x"),
        (("dynamics", "outputs"), 0.5),
        (("dynamics", "method"), "rk4"),
        (("view", "size"), [640]),
        (("title",), 3),
    ],
)
def test_it_refuses_what_is_misspelt(path: tuple[str, ...], value: Any) -> None:
    scene = copy.deepcopy(SCENE)
    table = scene
    for key in path[:-1]:
        assert key in table, f"the good scene has no {key}"
        table = table[key]
    table[path[-1]] = value
    assert _refusals(scene) != []


def test_it_names_every_key_joint_and_field() -> None:
    assert set(SCHEMA["properties"]) == set(TOP_KEYS)
    untold = [key for key, form in SCHEMA["properties"].items() if not form]
    assert untold == [], "flexmb/model/schema.py must say what these hold"
    definitions = SCHEMA["definitions"]
    assert set(definitions["Joint"]["properties"]["type"]["enum"]) == set(JOINT_TYPES)
    for spec in _subclasses(Spec):
        name = spec.__name__.removesuffix("Spec")
        if name in definitions:
            assert set(definitions[name]["properties"]) == set(spec.model_fields)
            assert definitions[name]["additionalProperties"] is False
            assert definitions[name]["description"]


def test_fields_in_words() -> None:
    from flexmb.model.body import RigidBodySpec

    told = {field.name: field.words for field in describe(RigidBodySpec).fields}
    assert told["mass"] == "number [kg], positive"
    assert told["position"].startswith("3 x number")


def _subclasses(cls: type) -> list[type]:
    return [cls, *(below for sub in cls.__subclasses__() for below in _subclasses(sub))]
