"""Every command on every case and template: it ends, or says in a sentence why not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app

ROOT = Path(__file__).parents[2]
SCENES = sorted([*ROOT.glob("cases/*/*.toml"), *ROOT.glob("flexmb/templates/*/*.toml")])
STATES = ("quasi-static", "undeformed", "initial", "static")


def named(scene: Path) -> str:
    return f"{scene.parent.name}/{scene.stem}"


def has_mesh(scene: Path) -> bool:
    return re.search(r"^mesh =", scene.read_text(encoding="utf-8"), re.MULTILINE) is not None


def commands(scene: str) -> list[list[str]]:
    still = ["--no-picture", "--output", "rest"]
    return [
        ["check", scene, "--tables"],
        *(["modes", scene, "--about", state] for state in STATES),
        ["statics", scene, "--starts", "3"],
        ["statics", scene, "--vary", "time=0,1e-3"],
        ["inverse", scene, "--no-picture", "--output", "inverse"],
        ["run", scene, "--analysis", "statics", *still],
    ]


def said(*arguments: str) -> tuple[int, str]:
    """The exit code of a command, which is no fault of flexmb, and all that it showed."""
    outcome = CliRunner().invoke(app, list(arguments))
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        raise outcome.exception
    assert outcome.exit_code in (0, 2), f"{arguments}: {outcome.output}"
    if outcome.exit_code:
        assert "error: " in outcome.output, f"{arguments}: {outcome.output}"
    assert "Traceback" not in outcome.output
    return outcome.exit_code, outcome.output


@pytest.mark.seconds
@pytest.mark.parametrize(
    "scene",
    [pytest.param(s, marks=pytest.mark.slow) if has_mesh(s) else s for s in SCENES],
    ids=named,
)
def test_it_ends_or_says_why_not(scene: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments in commands(str(scene)):
        said(*arguments)
    _, names = said("response", str(scene))
    channels = dict(re.findall(r"^(inputs|sensors): ([^,\n]+)", names, re.MULTILINE))
    if "none" not in channels.values():
        words = ["--input", channels["inputs"], "--sensor", channels["sensors"]]
        assert "largest: " in said("response", str(scene), *words, "--frequencies", "1,10")[1]


def test_known_answers_of_a_motion_are_not_those_of_its_equilibrium(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = str(ROOT / "cases/andrews/scene.toml")
    code, shown = said("run", scene, "--analysis", "statics", "--no-picture")
    assert code == 0
    assert "14 known answers of sensors in the scene not compared" in shown
    assert "FAILED" not in shown


def test_known_answers_of_deforming_bodies_are_not_those_of_rigid_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, shown = said("inverse", str(ROOT / "cases/flexible_four_bar/scene.toml"), "--no-picture")
    assert code == 0
    assert "not compared: of its motion, not of undeformed bodies" in shown


@pytest.mark.seconds
def test_a_part_by_itself_is_drawn_in_its_vibrations_and_at_rest(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = str(ROOT / "cases/elliptic_plate/membrane.toml")
    assert said("modes", scene, "--pictures", "modes", "--count", "7")[0] == 0
    assert (tmp_path / "modes/mode_6.png").exists()
    code, _ = said("run", scene, "--analysis", "statics", "--output", "rest")
    assert code == 0
    assert (tmp_path / "rest/picture.png").exists()
    assert flexmb.load_result("rest").scene_model.part is None
