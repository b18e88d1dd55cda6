"""Mistakes of a sweep on the command line: all at once, exit code 2, nothing run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from goodscene import GOOD
from typer.testing import CliRunner

from flexmb.cli import app


def call(*words: str | Path) -> Any:
    return CliRunner().invoke(app, ["sweep", *(str(word) for word in words)])


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "scene.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


VARY = ("--vary", "step=1e-4..1e-3")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "no knob to vary"),
        (("--vary", "stpe=1e-4..1e-3"), 'the scene has no knob "stpe"; nearest: step'),
        (("--vary", "step=1e-3..1e-4"), "the range is empty: 0.001 is not below 0.0001"),
        (("--vary", "step=normal(1e-3)"), "normal(mean, deviation) is expected"),
        (("--vary", "step=unifrm(1, 2)"), 'unknown distribution "unifrm"; nearest: uniform'),
        (("--vary", "step=.."), "a range has two ends: low..high"),
        (("--vary", "method=radau,foo"), "vary dynamics.method = foo: unknown choice"),
        ((*VARY, "--sensor", "tip.x:mox"), 'unknown scalar "mox"'),
        ((*VARY, "--sensor", "nothing:max"), 'there is no channel "nothing"'),
        ((*VARY, "--method", "monte-carlo"), 'method: unknown choice "monte-carlo"; allowed: auto'),
        ((*VARY, "--method", "grid"), "a grid needs a number of values"),
        ((*VARY, "--samples", "0"), "samples: a whole number from 1 on is expected"),
        ((*VARY, "--find", "how long"), '"how long" is no question'),
        ((*VARY, "--find", "nothing:max <= 3"), 'find[0]: there is no channel "nothing"'),
        ((*VARY, "--vary", "step"), '"step" is not of the form name=value'),
        ((*VARY, "--scheduler", "nowhere"), "no Dask scheduler answers at nowhere"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_and_nothing_is_run(
    scene: Path, words: tuple[str, ...], message: str
) -> None:
    result = call(scene, *words)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not list(scene.parent.glob("out/**/*.parquet"))


def test_all_mistakes_of_a_table_at_once(scene: Path) -> None:
    table = """
[sweep]
vary = { stpe = "1e-4..1e-3", step = "normal(1)" }
methd = "sobol"
samples = 0
sensors = ["tip.x:mox"]
quantiles = [0.5, 95]
find = ["minimise"]
"""
    scene.write_text(GOOD + table, encoding="utf-8")
    result = call(scene)
    assert result.exit_code == 2
    for what in (
        "sweep.methd: unknown key",
        "sweep.vary.step: normal(mean, deviation) is expected",
        "sweep.samples: a whole number from 1 on",
        "sweep.sensors[0]: unknown scalar",
        "sweep.quantiles[1]: is a share of the runs, below 1; is 95",
        'sweep.find[0]: "minimise" is no question',
    ):
        assert what in result.output


@pytest.mark.skipif(os.name == "nt", reason="a device of Unix that is full")
def test_a_full_disk(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmb.studies import record_table

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(record_table.RecordTable, "_add_line", fail)
    result = call(scene, *VARY, "--samples", "2", "--workers", "1")
    assert result.exit_code == 2
    assert "cannot be written (No space left on device): make room" in result.output


def test_a_wrong_range_and_an_unknown_knob_are_told_together(scene) -> None:
    done = call(scene, "--vary", "accuracy=5..1", "--vary", "accurasy=1..2")
    assert done.exit_code == 2
    assert "the range is empty" in done.stderr
    assert 'no knob "accurasy"' in done.stderr
