"""The commands resume, export and run --from, and the words about a run's cost."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import slidercrank
from typer.testing import CliRunner

from flexmb.analysis.dynamics import integration as module
from flexmb.cli import app
from flexmb.results import Result
from flexmb.results.run_summary import summary_sentence, time_rows, work_rows

SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"


def call(*words: str | Path) -> Any:
    return CliRunner().invoke(app, [str(word) for word in words])


def refused(*words: str | Path) -> str:
    done = call(*words)
    assert done.exit_code == 2, done.output
    assert "Traceback" not in done.output
    return str(done.stderr)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run"))


def test_export_writes_beside_the_result(result: Path) -> None:
    done = call("export", result.parent)
    assert done.exit_code == 0, done.output
    assert f"written: {result.with_suffix('.csv')} (201 rows of 7 channels)" in done.stdout
    header, first, *_ = result.with_suffix(".csv").read_text().splitlines()
    assert header.startswith("time [s],slider.x [m],slider.y [m],")
    assert float(first.split(",")[1]) == Result(result)["slider.x"][0]


def test_export_takes_names_of_any_kind(result: Path, tmp_path: Path) -> None:
    names = "slider.x, energy.kinetic,rod.eta.0"
    done = call("export", result, "--channels", names, "-o", tmp_path / "x.csv")
    assert done.exit_code == 0, done.output
    header = (tmp_path / "x.csv").read_text().splitlines()[0]
    assert header == "time [s],slider.x [m],energy.kinetic [J],rod.eta.0"
    assert call("export", result, "--what", "drift", "-o", tmp_path / "d.csv").exit_code == 0
    assert "drift.velocity" in (tmp_path / "d.csv").read_text()


def test_export_takes_wildcards_and_vectors(result: Path, tmp_path: Path) -> None:
    names = "slider.[xy],energy.k*,slider.x,speed"
    done = call("export", result, "--channels", names, "-o", tmp_path / "x.csv")
    assert done.exit_code == 0, done.output
    assert "of 6 channels" in done.stdout
    header = (tmp_path / "x.csv").read_text().splitlines()[0].split(",")
    speed = [f"speed.{axis} [m/s]" for axis in "xyz"]
    assert header == ["time [s]", "slider.x [m]", "slider.y [m]", "energy.kinetic [J]", *speed]
    missing = refused("export", result, "--channels", "slidr.*,enrgy.kinetic")
    assert 'no channel "slidr.*"; nearest: slider.' in missing
    assert 'no channel "enrgy.kinetic"; nearest: energy.kinetic' in missing


def test_export_names_what_there_is_not(result: Path, tmp_path: Path) -> None:
    assert 'no channel "slidr.x"; nearest: slider.x' in refused(
        "export", result, "--channels", "slidr.x"
    )
    assert "allowed: sensors, reactions, energy" in refused("export", result, "--what", "forces")
    both = refused("export", result, "--what", "energy", "--channels", "slider.x")
    assert "either --channels or --what" in both
    assert "there is no such file" in refused("export", tmp_path / "no.h5")
    assert "is a folder without a result.h5" in refused("export", tmp_path)
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refused("export", result, "-o", tmp_path / "file" / "x.csv")


@pytest.mark.seconds
@pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")
def test_ctrl_c_says_how_to_go_on_and_resume_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = Path(shutil.copy(SCENE, tmp_path / "scene.toml")), tmp_path / "out"
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * 170)
    march, calls = module.Integration.integrate, []

    def pressed(self: module.Integration, steps: int) -> int:
        calls.append(steps)
        status = march(self, steps)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return status

    monkeypatch.setattr(module.Integration, "integrate", pressed)
    done = call("run", scene, "-o", out, "--no-picture")
    assert done.exit_code == 130, done.output
    assert f"resume with: flexmb resume {out}" in done.stdout
    assert "note: stopped by the user at t = " in done.stdout
    assert "FAILED" not in done.stdout  # answers that were not reached are not wrong
    assert len(Result(out).time) > 1
    done = call("resume", out, "--no-picture")
    assert done.exit_code == 0, done.output
    assert "finished, 201 rows" in done.stdout and "resumed at" in done.stdout
    assert "is finished at t = 0.04 s" in refused("resume", out)
    assert "whole number of output intervals" in refused("resume", out, "--duration", "0.0401")
    done = call("resume", out, "--duration", "50 ms", "--no-picture")
    assert "251 rows" in done.stdout
    done = call("run", scene, "-o", tmp_path / "next", "--from", out, "--no-picture")
    assert done.exit_code == 0, done.output
    assert "ended at t = 0.05 s: crank, rod, slider" in done.stdout.replace("\n", " ")
    assert "no such file" in refused("run", scene, "-o", out, "--from", tmp_path / "x.h5")
    scene.write_text(scene.read_text().replace("l = 0.45", "l = 0.46"))
    text = refused("resume", out, "--duration", "0.06")
    assert "parameters.l was 0.45, is 0.46" in text and "--as-begun" in text


EVERYTHING = {
    "steps": 1234,
    "rejected_steps": 5,
    "failed_steps": 1,
    "residual_evaluations": 2468,
    "factorisations": 617,
    "replaced_pivots": 0,
    "smallest_step_s": 1e-6,
    "largest_step_s": 2e-3,
    "estimated_error": 3.21e-5,
    "energy_balance_error": 4e-7,
    "largest_position_drift": 1e-12,
    "largest_velocity_drift": 1e-7,
    "ten_times_more_accuracy_costs": 3.1623,
    "seconds_integrate": 0.01234,
    "seconds_compile": 2.0,
}


def test_the_summary_says_what_a_run_cost_and_what_more_would() -> None:
    rows = {name: (value, about) for name, value, about in work_rows(EVERYTHING)}
    assert rows["steps"][0] == "1 234"
    assert rows["steps"][1] == "of 1e-06 to 0.002 s; 5 rejected; 1 failed and tried shorter"
    assert rows["residual evaluations"] == ("2 468", "2 per step")
    assert rows["factorisations"][1] == "0.5 per step"
    assert rows["estimated error"][0] == "3.2e-05"
    assert "leave out verify = false to measure it" in rows["estimated error"][1]
    assert "ill-conditioned pivots" not in rows
    assert ("integrate", "0.0123", "10 µs per step") in time_rows(EVERYTHING)
    assert summary_sentence(EVERYTHING) == (
        "1 234 steps in 0.0123 s: error not measured, sum of local errors 3e-05, energy balance "
        "4e-07, drift 1e-12; "
        "ten times more accuracy would cost about 3.2 times the time"
    )


def test_what_is_not_known_is_left_out() -> None:
    assert summary_sentence({}) == ""
    assert work_rows({}) == time_rows({}) == []
    assert summary_sentence({"steps": 7}) == "7 steps"
    assert work_rows({"steps": 7, "replaced_pivots": 2, "method": "x"}) == [
        ("steps", "7", "by x"),
        (
            "ill-conditioned pivots",
            "2",
            "regularised: inertia is missing somewhere, or the pose is singular",
        ),
    ]
    for key in EVERYTHING:
        known = {name: value for name, value in EVERYTHING.items() if name != key}
        work_rows(known), time_rows(known), summary_sentence(known)


def test_a_killed_run_says_how_to_go_on(tmp_path: Path) -> None:
    from resultfiles import block, writer

    with writer(tmp_path / "result.h5") as out:
        out.append(block(0, 3))
    done = call("info", tmp_path / "result.h5")
    assert f"resume with: flexmb resume {tmp_path}" in done.stdout


def test_help_shows_examples() -> None:
    for command in ("resume", "export"):
        assert "Example: flexmb" in call(command, "--help").stdout
        assert command in call("--help").stdout
