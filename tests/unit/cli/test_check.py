"""`flexmb check` on whole scenes: what it shows of mobility, the tables, and the JSON report."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mechanisms import crank_slider, excavator, quick_return
from scenefiles import write_scene
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.model import Model


def checked(folder: Path, model: Model, *words: str) -> str:
    path = write_scene(model, folder / "scene.toml")
    done = CliRunner().invoke(app, ["check", str(path), *words])
    assert done.exit_code == 0, done.output
    return str(done.stdout)


def test_a_scene_without_faults_is_told_in_few_lines(tmp_path: Path) -> None:
    shown = checked(tmp_path, crank_slider("RSUT", driven=True))
    for words in (
        ("coordinates", "18", "of 3 bodies"),
        ("constraint equations", "18", "1 of them drivers'"),
        ("their rank", "18", "0 redundant"),
        ("degrees of freedom", "0", "1 without drivers"),
    ):
        assert any(all(word in line for word in words) for line in shown.splitlines()), words
    assert "not unique" not in shown and "redundant equation" not in shown
    assert shown.splitlines()[-1] == "the scene is valid"


def test_redundant_equations_cures_reactions_and_motions(tmp_path: Path) -> None:
    lines = [" ".join(line.split()) for line in checked(tmp_path, excavator("RTR")).splitlines()]
    for line in (
        "coordinates 72 of 12 bodies",
        "constraint equations 80 no drivers",
        "their rank 68 12 redundant",
        "degrees of freedom 4 kinematics needs 4 drivers",
        "3 redundant equations among boom_pin, boom_cylinder_foot, boom_cylinder_slide, "
        "boom_cylinder_head",
        "cured by boom_pin: revolute -> in-line",
        "or boom_pin: revolute -> spherical; boom_cylinder_foot: revolute -> cylindrical",
    ):
        assert line in lines, "\n".join(lines)
    text = " ".join(lines)
    assert "reactions not unique at" in text and "force z, moment x, moment y" in text
    assert "free 4 motions move house, boom, arm" in text


def test_idle_motions_are_marked(tmp_path: Path) -> None:
    shown = checked(tmp_path, crank_slider("RSST"))
    (line,) = (line for line in shown.splitlines() if "idle" in line)
    assert "rod can turn about the line through its joints pin and wrist" in line


def test_tables_define_the_model_in_its_units(tmp_path: Path) -> None:
    model = quick_return("C", driven=True)
    model.add_force("load", "force", at="ram", value=["-5 - t", 0, 0])
    model.bodies["ram"] = model.bodies["ram"].model_copy(update={"velocity": (1.5, 0.0, 0.0)})
    shown = checked(tmp_path, model, "--tables")
    lines = [" ".join(line.split()) for line in shown.splitlines()]
    for line in (
        "bodies: frames in the placed pose, global axes",
        "crank 0, 0.35, 0 1, 0, 0, 0",
        "bodies: inertia, body axes",
        "crank 1 0, 0, 0 0.1, 0.12, 0.14 0, 0, 0",
        "link distance lever.p2 ram.p1 1",
        "ram_guide I ground",
        "markers of the joints, body axes",
        "motor crank_bearing angle = 2*pi*t",
        "ram.origin 1.5, 0, 0 global",
        "load force at = ram, value = [-5 - t, 0, 0]",
    ):
        assert any(found.startswith(line) for found in lines), line
    assert "slot" not in checked(tmp_path, model)


def test_json_holds_the_whole_report(tmp_path: Path) -> None:
    told: dict[str, Any] = json.loads(checked(tmp_path, crank_slider("RRRT"), "--json"))
    mobility = told["mobility"]
    assert (mobility["coordinates"], mobility["count"], mobility["rank"]) == (18, 20, 17)
    assert (mobility["delta"], mobility["redundant"], mobility["singular"]) == (1, 3, False)
    (group,) = mobility["redundancies"]
    assert group["cured_by"][0] == "pin: revolute -> in-line"
    assert mobility["equations"][0] == {"path": "joints.bearing", "type": "revolute", "count": 5}
    assert told["definition"] == {}
    told = json.loads(checked(tmp_path, crank_slider("RRRT"), "--json", "--tables"))
    assert told["definition"]["bodies: inertia, body axes"][0]["body"] == "crank"


def test_a_large_scene_is_counted_only(tmp_path: Path) -> None:
    model = Model("stones")
    for k in range(101):
        model.add_body(f"stone{k}", mass=1.0, inertia=[1, 1, 1])
    shown = checked(tmp_path, model)
    assert "more than 600 coordinates" in shown and "redundant" not in shown


def hanging_chain() -> Model:
    """100 bars on spherical joints."""
    model = Model("chain", gravity=[0, 0, -9.81])
    for k in range(100):
        model.add_body(f"b{k}", mass=1.0, inertia=[0.01, 0.1, 0.1], position=[k, 0, 0])
        model.add_marker(f"b{k}.end", position=[1, 0, 0])
        before = f"b{k - 1}.end" if k else "ground"
        model.add_joint(f"j{k}", "spherical", between=[before, f"b{k}"])
    return model


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: excavator("RTR"), hanging_chain], ids=["12", "100"])
def test_scenes_of_twelve_and_100_bodies_take_hardly_more_than_their_imports(
    tmp_path: Path, make: Callable[[], Model]
) -> None:
    """Of the processor, from the shell to the end: the command must not wait for Numba.

    They take 3.4 to 5.7 times those of the libraries below; compiling would take 40 s, and linear
    algebra by several threads may take more than all else.
    """
    path = write_scene(make(), tmp_path / "scene.toml")
    env = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    env["FLEXMB_CACHE_DIR"] = str(tmp_path / "nothing compiled")
    imports = processor_time("-c", "import scipy.linalg, scipy.sparse, pydantic", env=env)
    assert processor_time("-m", "flexmb", "check", str(path), env=env) < 12 * imports


def processor_time(*words: str, env: dict[str, str]) -> float:
    """Seconds of the processor that Python takes."""
    before = os.times()
    subprocess.run([sys.executable, *words], env=env, check=True, capture_output=True)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


DIAPHRAGM = """
title = "diaphragm"
gravity = "none"

[bodies.plate]
mesh = { type = "plate", length = 1, width = 1, divisions = [4, 4] }
material = "steel"
sections = { surface = { type = "shell", thickness = 0.01 } }
interfaces = { rim = "edges" }
loads = { wind = { type = "pressure", group = "surface", pressure = 1000 } }

[joints.rim]
type = "fixed"
between = ["ground.rim", "plate.rim"]

[ground.markers.rim]
position = [0.5, 0, 0]

[forces.gust]
type = "body-load"
body = "plate"
load = "wind"
value = 1
"""


def test_a_load_of_a_mesh_that_is_not_reduced_yet_is_no_mistake(tmp_path: Path) -> None:
    """It was: bodies.plate has no load "wind"."""
    scene = tmp_path / "scene.toml"
    scene.write_text(DIAPHRAGM)
    result = CliRunner().invoke(app, ["check", str(scene)])
    assert result.exit_code == 0 and "the scene is valid" in result.output
    scene.write_text(DIAPHRAGM.replace('load = "wind"', 'load = "wint"'))
    result = CliRunner().invoke(app, ["check", str(scene)])
    assert result.exit_code != 0 and "nearest: wind" in result.output


def test_membrane_forces_of_a_mesh_in_a_plane_are_told_before_it_is_reduced(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    wanted = DIAPHRAGM.replace("[bodies.plate]", '[bodies.plate]\nmembrane_forces = "full"')
    scene.write_text('plane = "xy"\n' + wanted)
    result = CliRunner().invoke(app, ["check", str(scene)])
    assert "bodies.plate.membrane_forces" in " ".join(result.output.split())
