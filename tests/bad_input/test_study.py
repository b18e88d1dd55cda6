"""Mistakes of a study on the command line: one clear message, exit code 2, nothing run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from goodscene import GOOD
from typer.testing import CliRunner

from flexmb.cli import app

PENDULUM = Path(__file__).parents[2] / "cases" / "pendulum" / "scene.toml"


def call(*words: str | Path) -> Any:
    return CliRunner().invoke(app, ["study", *(str(word) for word in words)])


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "scene.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no knob to vary"),
        (("--vary", "stpe=1e-3"), 'vary stpe: the scene has no knob "stpe"; nearest: step'),
        (("--vary", "bodies.crnk.mass=1"), "nearest: bodies.crank.mass"),
        (("--vary", "bodies.crank.mas=1"), 'bodies.crank.mas: unknown key "mas"; nearest: mass'),
        (("--vary", "bodies.crank=1"), "bodies.crank: is a table; name a value in it"),
        (("--vary", "step=1e-3,,1e-4"), "vary step: a value between the commas is empty"),
        (("--vary", "step=-1,0"), "the model refuses every setting of the study"),
        (("--vary", "method=foo"), 'dynamics.method: unknown choice "foo"; allowed: auto, general'),
        (("--vary", "method=radau,foo"), 'dynamics.method: unknown choice "foo"; allowed: auto'),
        (("--vary", "bodies.crank.mass=1,-1"), "bodies.crank.mass: must be positive"),
        (("--vary", "speed=10,3 mm", "--set", "speed=300 rpm"), "is another quantity"),
        (("--vary", "step=1e-3", "--vary", "dynamics.step=1e-4"), "which is given twice"),
        (("--vary", "step=1e-3", "--sensor", "tpi"), 'unknown sensor or channel "tpi"; nearest:'),
        (("--vary", "step=1e-3", "--target", "2"), "study.target: is an error over the peak"),
        (
            ("--vary", "step=1.0..2.0:1000", "--vary", "r=1.0..2.0:11"),
            "11000 combinations; 10000 are",
        ),
        (("--vary", "step=1e-3", "-o", "scene.toml/x"), "cannot write to the output folder"),
        (("--vary", "step=1e-3", "--set", "rr=1"), 'override rr: unknown parameter "rr"'),
    ],
)
def test_a_mistake_is_told_before_anything_runs(
    scene: Path, words: tuple[str, ...], said: str
) -> None:
    done = call(scene, *words)
    assert done.exit_code == 2, done.output
    assert said in done.stderr
    assert not list(scene.parent.rglob("runs.p*"))


def test_a_scene_without_sensors_says_how_to_add_one(scene: Path) -> None:
    before, _, after = GOOD.partition("[sensors.tip]")
    scene.write_text(before + after[after.index("[dynamics]") :], encoding="utf-8")
    done = call(scene, "--vary", "step=1e-3")
    assert done.exit_code == 2
    assert 'type = "position"' in done.stderr


@pytest.mark.seconds
def test_a_study_of_the_scene_is_run_shown_and_written(scene: Path) -> None:
    text = PENDULUM.read_text(encoding="utf-8")
    scene.write_text(f"{text}[study]\nvary = {{ step = [1e-2, 5e-3] }}\n", encoding="utf-8")
    done = call(scene, "--workers", "1", "--repeats", "1")
    assert done.exit_code == 0, done.output
    assert "cheapest setting that meets 1 % in positions" in done.stdout
    assert "time: processor time of the integration" in done.stdout
    assert (scene.parent / "out" / scene.parent.name / "study" / "study.md").is_file()


def test_a_study_of_which_no_run_ends_says_why_and_is_a_mistake(scene: Path) -> None:
    """The good scene is no mechanism that could move: its joints lock."""
    done = call(scene, "--vary", "step=1e-1", "--workers", "1")
    assert done.exit_code == 2
    assert "✗ step=0.1: " in done.stdout
    assert "no run ended" in done.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), "no Dask scheduler answers at tcp://127.0.0.1:1"),
        (("--dashboard",), 'needs the package bokeh: pip install "flexmb[dashboard]"'),
    ],
)
def test_a_cluster_that_is_not_there_is_told(
    scene: Path, words: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexmb.workflow.worker_processes.REACH", 0.2)
    monkeypatch.setattr("flexmb.workflow.cluster.find_spec", lambda name: None)
    done = call(scene, "--vary", "step=1e-3", *words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not list(scene.parent.rglob("runs.p*"))
