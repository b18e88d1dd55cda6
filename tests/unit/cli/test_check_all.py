"""`flexmb check-all`: the known answers of all scenes of a folder, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flexmb.cli import app

FALL = """
title = "A stone that falls"
gravity = [0, 0, -10]
[bodies.stone]
mass = 1
inertia = [1, 1, 1]
[sensors.stone]
type = "position"
of = "stone"
[dynamics]
duration = 1
outputs = 10
[[check]]
sensor = "stone.z"
time = 1
value = {value}
tolerance = 1e-6
source = "g t^2/2"
"""
STUCK = FALL.replace(
    "[dynamics]",
    """[joints.pin]
type = "revolute"
between = ["ground", "stone"]
[drivers.motor]
joint = "pin"
angle = "t"
[sensors.turn]
type = "angle"
joint = "pin"
[forces.brake]
type = "torque"
at = "stone"
value = [0, 0, "log(0.5 - turn)"]
[dynamics]""",
)


def check_all(folder: Path, *words: str) -> Result:
    out = str(folder.parent / "out")
    return CliRunner().invoke(app, ["check-all", str(folder), "-o", out, "--workers", "1", *words])


@pytest.mark.slow
def test_two_workers_find_the_same(scenes: Path) -> None:
    assert check_all(scenes).stdout == check_all(scenes, "--workers", "2").stdout


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    for name, value in (("right", -5), ("wrong", -4)):
        (folder / name).mkdir(parents=True)
        (folder / name / "scene.toml").write_text(FALL.format(value=value), encoding="utf-8")
    return folder


def test_right_wrong_and_missing_answers_stand_in_one_table(scenes: Path) -> None:
    (scenes / "right" / "silent.toml").write_text(FALL.split("[[check]]")[0], encoding="utf-8")
    done = check_all(scenes)
    assert done.exit_code == 3
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert any(line.startswith("right ok stone.z at t = 1 s -5 -5") for line in lines), done.stdout
    assert any(line.startswith("wrong FAILED stone.z at t = 1 s -5 -4 1 1e-06") for line in lines)
    assert "right/silent no [[check]]" in lines
    assert lines[-1] == "3 scenes: 1 of 2 checks passed"
    assert any("wrong" in line and "g t^2/2" in line for line in lines if "failed" in line)
    assert check_all(scenes / "right").exit_code == 0  # silence is not a failure


def test_a_run_that_fails_does_not_end_the_others(scenes: Path) -> None:
    (scenes / "wrong" / "scene.toml").write_text(STUCK.format(value=0), encoding="utf-8")
    done = check_all(scenes)
    assert done.exit_code == 3
    assert "the run failed" in done.stdout
    assert done.stdout.splitlines()[-1] == "2 scenes: 1 of 1 check passed, 1 run failed"


def test_mistakes_of_all_scenes_come_before_the_first_run(scenes: Path) -> None:
    for name in ("right", "wrong"):
        (scenes / name / "scene.toml").write_text(
            FALL.format(value=1).replace("mass", f"{name}_mass"), encoding="utf-8"
        )
    done = check_all(scenes)
    assert done.exit_code == 2
    for name in ("right", "wrong"):
        assert f"{name}_mass" in done.stderr
        assert str(scenes / name / "scene.toml") in done.stderr
    assert not (scenes.parent / "out").exists()


def test_a_folder_without_scenes_is_a_mistake(tmp_path: Path) -> None:
    for folder, what in ((tmp_path, "holds no scene"), (tmp_path / "none", "no such folder")):
        done = check_all(folder)
        assert done.exit_code == 2
        assert what in done.stderr
    (tmp_path / "scene.toml").write_text(FALL.format(value=-5), encoding="utf-8")
    done = check_all(tmp_path, "--workers", "0")
    assert done.exit_code == 2
    assert "workers" in done.stderr
