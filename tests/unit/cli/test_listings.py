"""What the command line offers to begin with: lists, new scenes, the schema of scenes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.fe.elements.element_blocks import ELEMENTS
from flexmb.flexbody.mesh_options import REDUCTIONS
from flexmb.flexbody.part_options import SUPPORTS
from flexmb.materials import LIBRARY
from flexmb.model.body import SHAPES
from flexmb.model.control import StateSpec
from flexmb.model.functions.expression import CONSTANTS, FUNCTIONS
from flexmb.model.functions.function import FUNCTION_FORMS
from flexmb.model.joints.curve import CurveSpec
from flexmb.model.joints.driver import DriverSpec
from flexmb.model.joints.joint import COORDINATES, JOINT_TYPES
from flexmb.model.mesh_body import LOAD_TYPES, MESH_TYPES, SECTION_TYPES, MeshBodySpec
from flexmb.model.scenes.dynamics import METHODS, DynamicsSpec
from flexmb.model.scenes.sections import CONTROLLER_TYPES, COUPLER_TYPES, FORCE_TYPES, ViewSpec
from flexmb.model.scenes.supports import PartSpec
from flexmb.model.sensor import SENSOR_TYPES
from flexmb.units import UNIT_SYSTEMS
from flexmb.workflow import listings, simulate

METHOD_NAMES = get_args(DynamicsSpec.model_fields["method"].annotation)
ALL = {
    "joints": JOINT_TYPES,
    "curves": CurveSpec.model_fields,
    "couplers": (*COUPLER_TYPES, "terms", "constant", "second_angle", "stroke"),
    "forces": FORCE_TYPES,
    "drivers": (*COORDINATES, *DriverSpec.model_fields),
    "functions": (*FUNCTION_FORMS, *FUNCTIONS, *CONSTANTS),
    "elements": ELEMENTS,
    "meshes": MESH_TYPES,
    "sections": SECTION_TYPES,
    "reductions": (*REDUCTIONS, *MeshBodySpec.model_fields, *LOAD_TYPES),
    "parts": (*SUPPORTS, *PartSpec.model_fields, "interface", "spin"),
    "methods": (*METHOD_NAMES, *DynamicsSpec.model_fields),
    "sensors": SENSOR_TYPES,
    "controllers": (*CONTROLLER_TYPES, *StateSpec.model_fields),
    "materials": LIBRARY,
    "units": UNIT_SYSTEMS,
    "shapes": SHAPES,
    "view": ViewSpec.model_fields,
    "templates": listings.templates(),
    "cases": ("pendulum", "slider_crank"),
}


def call(*words: str) -> Any:
    return CliRunner().invoke(app, list(words))


@pytest.mark.parametrize("topic", listings.TOPICS)
def test_a_list_holds_everything_there_is(topic: str) -> None:
    done = call("list", topic)
    assert done.exit_code == 0, done.output
    missing = [name for name in ALL[topic] if name not in done.stdout]
    assert missing == []


def test_a_list_of_one_entry() -> None:
    """By a word of the names of entries, else of their fields or rows."""
    headings = [about.partition(":")[0] for about, _ in listings.listing("forces", "Stop").tables]
    assert headings == ["stop", "rotational-stop", "translational-stop"]
    (contact,) = (t for _, t in listings.listing("forces", "restitution").tables)
    assert [row[0] for row in contact.rows] == ["restitution"]
    (steels,) = (table for _, table in listings.listing("materials", "steel").tables)
    assert [row[0] for row in steels.rows] == ["steel", "stainless steel"]
    wrong = call("list", "forces", "contakt")
    assert wrong.exit_code == 2
    assert 'unknown entry of forces "contakt"; nearest: contact;' in wrong.stderr


def test_without_a_topic_it_says_what_can_be_listed() -> None:
    done = call("list")
    assert done.exit_code == 0
    assert all(topic in done.stdout for topic in listings.TOPICS)
    wrong = call("list", "joint")
    assert wrong.exit_code == 2
    assert "nearest: joints" in wrong.stderr


def test_fields_come_with_their_defaults() -> None:
    spring = dict(listings.listing("forces").tables)
    table = next(table for about, table in spring.items() if about.startswith("spring-damper"))
    assert {name: default for name, _, default in table.rows} == {
        "between": "required",
        "stiffness": "0",
        "damping": "0",
        "spring_force": "",
        "damper_force": "",
        "value": "",
        "free_length": "placed",
    }


def test_what_a_joint_leaves_free_is_as_many_motions_as_its_equations_leave() -> None:
    (_, table), *_ = listings.listing("joints").tables
    free = {row[0]: row[3] for row in table.rows}
    assert (free["fixed"], free["revolute"], free["spherical"]) == (
        "nothing", "turn z", "turn x, y, z",
    )  # fmt: skip
    for name, row in JOINT_TYPES.items():
        motions = [] if free[name] == "nothing" else free[name].replace(";", ",").split(",")
        assert len(motions) == row.freedoms or free[name] == str(row.freedoms)


def test_every_method_is_described() -> None:
    assert set(METHODS) == set(METHOD_NAMES) and all(METHODS.values())
    shown = call("list", "methods").stdout
    for about in METHODS.values():
        assert about.split(":")[0].split(",")[0] in shown


def test_a_new_scene_is_valid_and_nothing_is_overwritten(tmp_path: Path) -> None:
    for template in listings.templates():
        done = call("new", str(tmp_path / template), "--template", template)
        assert done.exit_code == 0, done.output
        scene = tmp_path / template / "scene.toml"
        checked = call("check", str(scene))
        assert "the scene is valid" in checked.stdout, checked.output
        again = call("new", str(tmp_path / template), "-t", template)
        assert again.exit_code == 2
        assert "never overwritten" in again.stderr
    named = listings.new_scene(tmp_path / "named" / "flexible-beam")
    assert named.read_bytes() == (tmp_path / "flexible-beam" / "scene.toml").read_bytes()
    spaced = call("new", str(tmp_path / "x y")).stdout
    assert f"run it with: flexmb run '{tmp_path / 'x y' / 'scene.toml'}'" in spaced
    wrong = call("new", str(tmp_path / "y"), "-t", "pendulums")
    assert (wrong.exit_code, "nearest: pendulum" in wrong.stderr) == (2, True)
    assert not (tmp_path / "y").exists()


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    done = call("new", str(tmp_path / "file" / "scene"))
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr


@pytest.mark.parametrize("template", listings.templates())
def test_a_new_scene_runs_and_keeps_its_known_answers(template: str, tmp_path: Path) -> None:
    scene = listings.new_scene(tmp_path / "new", template)
    report = simulate.run_scene(scene, output=tmp_path / "out", pictures=False)
    assert report.checks
    assert all(outcome.passed for outcome in report.checks), report.checks


def test_the_schema_is_written_to_screen_and_file(tmp_path: Path) -> None:
    shown = json.loads(call("schema").stdout)
    done = call("schema", "--output", str(tmp_path / "s.json"))
    assert done.exit_code == 0
    assert "#:schema s.json" in done.stdout
    assert json.loads((tmp_path / "s.json").read_text(encoding="utf-8")) == shown
    assert call("schema", "--output", str(tmp_path / "no" / "s.json")).exit_code == 2


def test_warmup_is_for_all_methods_at_once() -> None:
    done = call("warmup", "--method", "generalized-alpha")
    assert done.exit_code == 2
    assert "No such option" in done.stderr


def test_templates_are_plain_toml_with_titles() -> None:
    for template, title in listings.templates().items():
        folder = Path(listings.__file__).parents[1] / "templates" / template
        text = (folder / "scene.toml").read_text(encoding="utf-8")
        assert tomllib.loads(text)["title"] == title
        assert "flexmb run scene.toml" in text


@pytest.mark.seconds
def test_letters_that_a_pipe_cannot_take_do_no_harm() -> None:
    """What Windows gives a pipe is an encoding of 256 letters, and a C locale one of 128."""
    for encoding in ("cp1252", "ascii"):
        done = subprocess.run(
            [sys.executable, "-m", "flexmb", "list", "sensors"],
            env={**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"},
            capture_output=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert b"position" in done.stdout
