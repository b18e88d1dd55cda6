"""Scene files that cannot be read, and values set from outside that do not exist."""

from __future__ import annotations

import warnings

import pytest

import flexmb
from flexmb.errors import FlexmbWarning, SceneError
from flexmb.model import Model, load_scene

GOOD = """
[parameters]
speed = 10
[bodies.b]
mass = 1
inertia = [1, 1, 1]
"""


def message(path, overrides=None):
    with pytest.raises(SceneError) as caught:
        load_scene(path, overrides)
    return str(caught.value)


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    return path


def test_missing_file(scene):
    text = message(scene.with_name("scen.toml"))
    assert text.endswith("scen.toml: no such file; nearest: scene.toml")
    assert "does not exist" in message(scene.parent / "nowhere" / "scene.toml")


def test_a_folder_instead_of_a_file(scene):
    assert "is a folder, not a scene file (it holds scene.toml" in message(scene.parent)


def test_a_binary_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\x89HDF\r\n\x1a\n\xff")
    assert "is no text in UTF-8 (byte 0); a scene is a TOML file" in message(path)


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [("a = 1\nb = = 2\n", 2, 5), ("[bodies.b]\nmass = \n", 2, 8), ("[a]\nb = 'x", 2, 7)],
)
def test_toml_syntax_errors_say_line_and_column(tmp_path, text, line, column):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    first, shown, caret = message(path).splitlines()
    assert "not TOML" in first and f"at line {line}, column {column}" in first
    assert shown.strip() == text.splitlines()[line - 1].strip()
    assert caret.index("^") == 4 + column - 1


def test_a_joint_given_twice(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("[joints.a]\n[joints.a]\n")
    assert "twice" in message(path) and "line 2" in message(path)


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("sped", "1", 'override sped: unknown parameter "sped"; nearest: speed; allowed: speed'),
        ("parameters.sped", "1", 'unknown parameter "sped"; nearest: speed'),
        ("dynamcs.step", "1", 'the scene has no table "dynamcs"'),
        ("bodies.c.mass", "1", 'the scene has no table "bodies.c"'),
        ("bodies.b", "1", "override bodies.b: is a table; name a value in it"),
        ("bodies.b.mas", "2", 'bodies.b.mas: unknown key "mas"; nearest: mass'),
        ("bodies.b.inertai.x", "2", 'bodies.b.inertai: unknown key "inertai"; nearest: inertia'),
        ("bodies.b.markers.tip.positon", "2", 'markers.tip.positon: unknown key "positon"'),
        ("bodies.b.shape", "{typ = 1}", "bodies.b.shape.type: is missing"),
        ("bodies.*.damping", "0.1", "override bodies.*.damping: the scene has no flexible body"),
        ("bodies.b.mass", "-2", "bodies.b.mass: must be positive, is -2 kg"),
        ("speed", "{a = 1}", "override speed: a single value is expected"),
        ("speed", "2*(", "parameters.speed: syntax error"),
        ("dynamics.duration", "0", "dynamics.duration: must be positive, is 0 s"),
    ],
)
def test_overrides_that_do_not_exist_or_cannot_be(scene, name, value, wanted):
    assert wanted in message(scene, {name: value})


@pytest.mark.parametrize("parameters", ["5", "[1]", '"speed"'])
@pytest.mark.parametrize("name", ["speed", "parameters.speed", "title"])
def test_overrides_of_a_scene_whose_parameters_are_no_table(tmp_path, parameters, name):
    path = tmp_path / "scene.toml"
    path.write_text(f"parameters = {parameters}\n" + GOOD.partition("speed = 10")[2])
    assert "parameter" in message(path, {name: "1"})


def test_all_wrong_overrides_at_once(scene):
    assert len(message(scene, {"sped": "1", "masss": "2"}).splitlines()) == 2


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("[bodies.b]\n", "[bodies.b] is there twice, or a value has its name at line 7"),
        ("[bodies.b c]\n", "a name with a blank must be in quotation marks at line 7"),
        ("mass = 2\n", 'the key "mass" is twice in this section at line 7'),
        ('[bodies.c]\norientation = {axis = "z", angle = "90"}', 'given "90", more than a turn'),
        ("[body.c]", 'unknown key "body"; nearest: bodies; allowed: '),
        ("[markers.tip]", 'unknown key "markers": it belongs under [bodies.NAME]'),
        ("[accuracy]", 'unknown key "accuracy": it belongs under [dynamics]'),
    ],
)
def test_what_is_twice_and_names_of_the_plural(scene, more, said):
    scene.write_text(GOOD + more)
    assert said in message(scene)


def test_gravity_is_a_vector(scene):
    text = message(scene, {"gravity": 9.81})
    assert text.startswith(
        "gravity: is a vector or has a direction, given 9.81; allowed: none, [gx"
    )


def test_analyses_take_scene_files_and_say_what_they_take(scene):
    assert flexmb.mobility(scene).coordinates == 6
    assert flexmb.simulate(scene, duration=0.1).time[-1] == pytest.approx(0.1)
    with pytest.raises(SceneError, match="a model or a scene file is expected, given 3"):
        flexmb.kinematics(3, duration=1)


def test_a_marker_that_is_added_says_where_it_is_wrong():
    model = Model("bar")
    model.add_body("bar", mass=1, inertia=[1, 1, 1])
    with pytest.raises(SceneError) as caught:
        model.add_marker("bar.tip", position=[1, 0])
    assert str(caught.value) == "bodies.bar.markers.tip.position[2]: is missing"
    with pytest.raises(SceneError, match='is used twice; a marker is named as "bar.tip"'):
        model.add_marker("bar", position=[1, 0, 0])


def test_changes_of_parameters_with_units(scene):
    scene.write_text(GOOD.replace("speed = 10", 'speed = "300 rpm"'))
    assert message(scene, {"speed": "3 mm"}).endswith('"300 rpm", and "3 mm" is another quantity')
    with pytest.warns(FlexmbWarning, match="200 has no unit and is 1909.86 rpm in the scene's"):
        load_scene(scene, {"speed": 200})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for clear in (30, "200 rad/s", "200 rpm", "2*pi"):
            load_scene(scene, {"speed": clear})


def test_changes_of_values_with_units_by_their_paths(scene):
    scene.write_text(GOOD + "[bodies.weight]\nmass = '500 g'\ninertia = [1, 1, 1]\n")
    assert message(scene, {"bodies.weight.mass": "3 mm"}).endswith("is another quantity")
    with pytest.warns(FlexmbWarning, match="mass: 400 has no unit and is 400000 g in the scene's"):
        load_scene(scene, {"bodies.weight.mass": 400})


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("30°", '"30°" is written "30 deg"'),
        ("30deg", '"30deg" is written "30 deg"'),
        ("3mm", '"3mm" is written "3 mm"'),
        ("5 m/s2", '"5 m/s2" is written "5 m/s^2"'),
        ("6 N/mm2", '"6 N/mm2" is written "6 N/mm^2"'),
        ("30 Nm", 'unknown unit "Nm"; nearest: N m;'),
        ("4 kNmm", 'unknown unit "kNmm"; nearest: kN mm;'),
        ("3,5 m", "a comma separates values, decimals are written with a point"),
    ],
)
def test_units_as_they_are_often_written(scene, value, told):
    assert told in message(scene, {"speed": value})


def test_an_entry_of_a_section_that_the_scene_does_not_have(scene):
    assert "[forces" not in GOOD
    wind = '{ type = "force", at = "b", value = ["3 N", 0, 0] }'
    assert load_scene(scene, {"forces.wind": wind}).forces["wind"].at == "b"
    assert "forces.wind.type: is missing" in message(scene, {"forces.wind": "{typ = 3}"})


def test_a_law_with_if_says_what_there_is(scene):
    scene.write_text(GOOD + "[sensors]\nlaw = {type = 'expression', value = 'if(t<0.5,0,1)'}")
    assert 'there is no "if"; step, sign' in message(scene)
