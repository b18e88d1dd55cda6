"""The model: Python and file say the same, and a model survives writing and reading."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.flexbody import rigid_body, save
from flexmb.model import Model, load_scene
from flexmb.model.joints.joint import count

CASES = sorted((Path(__file__).parents[3] / "cases").glob("*/scene.toml"))
SCENE = """
title = "pendulum"
gravity = [0, 0, "-g"]
[parameters]
T = "2*period"
period = "2*pi*sqrt(l/g)"
l = 0.5
g = 9.81
[ground.markers.pivot]
position = [0, 0, "l"]
[bodies.bob]
mass = 2
inertia = [1e-3, 1e-3, 1e-3]
position = [0, 0, 0]
markers.eye = { position = [0, 0, "l"] }
[joints.pin]
type = "revolute"
between = ["ground.pivot", "bob.eye"]
axis = "y"
[forces.push]
type = "force"
at = "bob"
value = ["sin(t/l)", 0, 0]
[forces.spring]
type = "spring-damper"
between = ["ground.pivot", "bob"]
stiffness = 100
[sensors.bob]
type = "position"
of = "bob"
[sensors.swing]
type = "angle"
joint = "pin"
[dynamics]
duration = "T"
step = 1e-3
[[check]]
sensor = "bob.x"
time = "T"
value = 0
tolerance = 1
source = "none, an example"
"""


def _python():
    parameters = {"T": "2*period", "period": "2*pi*sqrt(l/g)", "l": 0.5, "g": 9.81}
    model = Model("pendulum", parameters=parameters)
    model.set_gravity([0, 0, "-g"])
    model.add_marker("ground.pivot", position=np.array([0, 0, 0.5]))
    model.add_body("bob", mass=2, inertia=[1e-3] * 3, position=(0, 0, 0))
    model.add_marker("bob.eye", position=[0, 0, "l"])
    model.add_joint("pin", "revolute", between=["ground.pivot", "bob.eye"], axis="y")
    model.add_force("push", "force", at="bob", value=["sin(t/l)", 0, 0])
    model.add_force("spring", "spring-damper", between=["ground.pivot", "bob"], stiffness=100)
    model.add_sensor("bob", "position", of="bob")
    model.add_sensor("swing", "angle", joint="pin")
    model.set_dynamics(duration="T", step=1e-3)
    model.add_check(sensor="bob.x", time="T", value=0, tolerance=1, source="none, an example")
    model.validate()
    return model


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_python_and_file_say_the_same(scene):
    assert _python().to_scene_dict() == load_scene(scene).to_scene_dict()


def test_parameters_refer_to_each_other_in_any_order(scene):
    model = load_scene(scene)
    assert model.parameters["T"] == pytest.approx(4 * np.pi * np.sqrt(0.5 / 9.81))
    assert list(model.parameters) == ["T", "period", "l", "g"]
    assert model.dynamics.duration == model.parameters["T"]


def test_the_source_is_kept(scene):
    model = load_scene(scene)
    assert model.source.path == scene and model.source.text == SCENE


def test_channels(scene):
    assert load_scene(scene).channels() == ("bob.x", "bob.y", "bob.z", "swing")


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.parent.name)
def test_cases_survive_writing_and_reading(path, tmp_path):
    model = load_scene(path)
    written = json.loads(json.dumps(model.to_scene_dict(tmp_path)))
    again = Model.from_scene_dict(written, tmp_path)
    assert again.to_scene_dict(tmp_path) == written
    assert again.bodies.keys() == model.bodies.keys()


def test_a_flexible_body_object_is_written_as_its_file(tmp_path):
    body = rigid_body(1.0, [0, 0, 0], np.eye(3), name="b")
    save(body, tmp_path / "b.flexbody.h5")
    model = Model("m")
    model.add_body("b", body)
    with pytest.raises(SceneError, match="object in memory"):
        model.to_scene_dict()
    written = model.to_scene_dict(tmp_path, {"b": "b.flexbody.h5"})
    assert written["bodies"]["b"]["flexbody"] == "b.flexbody.h5"
    assert not Model.from_scene_dict(written, tmp_path).problems()


def test_overrides(scene):
    model = load_scene(
        scene, {"l": "2*0.3", "dynamics.step": "1e-4", "dynamics.method": "explicit-rk"}
    )
    assert model.parameters["l"] == 0.6
    assert model.dynamics.step == 1e-4 and model.dynamics.method == "explicit-rk"
    assert load_scene(scene, {"dynamics.outputs": "7"}).dynamics.outputs == 7
    assert load_scene(scene, {"view.time": "T/2"}).view.time == pytest.approx(
        load_scene(scene).parameters["T"] / 2
    )
    assert load_scene(scene, {"gravity": "none"}).gravity is None


def test_counts_of_the_slider_crank():
    path = next(path for path in CASES if path.parent.name == "rigid_slider_crank")
    counts = count(load_scene(path))
    assert (counts.rigid_coordinates, counts.equations, counts.drivers) == (18, 17, 1)
    assert counts.mobility == 0 and counts.modes == 0


def test_numbers_of_numpy_are_written_as_plain_ones():
    parameters = {"n": np.int64(3), "l": np.float32(0.5), "h": np.array(2.0), "q": Fraction(1, 4)}
    model = Model("m", parameters=parameters)
    model.add_body("bob", mass="n", inertia=[1, 1, 1])
    for name, coefficients in (("a", np.array([1, 2])), ("b", (np.float64(1), np.int64(2)))):
        table = {"type": "polynomial", "coefficients": coefficients}
        model.add_force(name, "force", at="bob", value=[table, np.float64(1), "q*t"])
    written = json.loads(json.dumps(model.to_scene_dict()))
    assert written["parameters"] == {"n": 3, "l": 0.5, "h": 2.0, "q": 0.25}
    assert written["forces"]["a"]["value"][0]["coefficients"] == [1, 2]
    again = Model.from_scene_dict(written | {"parameters": parameters})
    assert json.loads(json.dumps(again.to_scene_dict())) == written


def test_names_are_used_once():
    model = _python()
    with pytest.raises(SceneError, match='joints.pin: the name "pin" is used twice'):
        model.add_joint("pin", "fixed", between=["ground", "bob"])
    with pytest.raises(SceneError, match='"eye" is used twice'):
        model.add_marker("bob.eye")
