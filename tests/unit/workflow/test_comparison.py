"""Models of one object compared: differences with known sizes, counts, mistakes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quickreturn import quick_return
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError, ResultFileError
from flexmb.model import Model
from flexmb.workflow.comparison import _sampler


def slider(
    path: str = "sin(t)",
    *,
    units: str = "SI",
    sensor: str = "place",
    duration: float = 2.0,
    outputs: int = 50,
    kind: str = "position",
) -> Model:
    """A body that a driver moves along x."""
    made = Model("slider", units=units)
    made.add_body("block", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
    made.add_driver("motor", joint="guide", stroke=path)
    made.add_sensor(sensor, kind, of="block")
    made.set_kinematics(duration=duration, outputs=outputs)
    return made


def compare(*models: Any, folder: Path, **more: Any) -> flexmb.workflow.comparison.Comparison:
    return flexmb.compare(*models, output=folder, **more)


def test_a_difference_has_its_size_share_and_time(tmp_path):
    made = compare(slider(), slider("sin(t) + 0.1*t"), folder=tmp_path)
    [x, y, z] = made.differences
    assert (x.channel, x.unit, x.moves) == ("place.x", "m", True)
    assert x.largest == pytest.approx(0.2, rel=1e-12)
    assert x.relative == pytest.approx(0.2 / np.sin(np.arange(51) * 0.04).max(), rel=1e-12)
    assert x.time == pytest.approx(2.0)
    assert not (y.moves or z.moves)
    assert y.largest == 0.0
    assert made.largest == x.relative


def test_units_differ_and_the_motion_does_not(tmp_path):
    made = compare(slider(), slider("1000*sin(t)", units="mm-t-s"), folder=tmp_path)
    assert made.largest < 1e-12


@pytest.mark.parametrize(("outputs", "error"), [(73, 2e-7), (7, 2e-3)])
def test_rows_at_other_times_are_interpolated_and_the_error_is_said(tmp_path, outputs, error):
    made = compare(slider(), slider(outputs=outputs), folder=tmp_path)
    assert 0.0 < made.largest < error
    [note] = made.notes
    stated = float(note.partition("about ")[2].split()[0])
    assert made.largest < 3.0 * stated < 100.0 * made.largest


def test_results_that_overlap_in_part_are_compared_there(tmp_path):
    short = flexmb.kinematics(slider(duration=1.0, outputs=25))
    made = compare(slider(), short, folder=tmp_path)
    assert made.largest < 1e-12
    [note] = made.notes
    assert note.startswith("compared from 0 s to 1 s")


def test_a_body_that_should_stand_still_is_judged_by_what_moves(tmp_path):
    tilted = slider()
    tilted.joints.clear()
    tilted.add_joint("guide", "prismatic", between=["ground", "block"], axis=[1, 0.5, 0])
    straight = slider("sqrt(1.25)*sin(t)")
    tilted.drivers.clear()
    tilted.add_driver("motor", joint="guide", stroke="sqrt(1.25)*sin(t)")
    straight.drivers.clear()
    straight.add_driver("motor", joint="guide", stroke="sin(t)")
    y = compare(straight, tilted, folder=tmp_path).differences[1]
    assert not y.moves
    assert y.relative == pytest.approx(0.5, rel=1e-9)


def test_counts_are_the_books(tmp_path):
    models = [quick_return(variant) for variant in "ABC"]
    made = compare(*models, folder=tmp_path)
    counts = [(m.mobility.coordinates, m.mobility.count - m.mobility.drivers) for m in made.models]
    assert counts == [(15, 14), (12, 11), (9, 8)]  # Hong & Liu (2011), section 1.6
    assert all(math.isfinite(one.seconds) and one.cpu_seconds > 0 for one in made.models)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (slider(sensor="places"), ["no common channel", "place.x, place.y", "nearest: places.x"]),
        (slider(kind="velocity"), ["no common channel"]),
    ],
)
def test_models_without_a_common_sensor_are_refused_with_what_each_has(tmp_path, other, words):
    with pytest.raises(ResultFileError) as error:
        compare(slider(), other, folder=tmp_path)
    assert all(word in str(error.value) for word in words)


def test_results_of_other_times_say_which(tmp_path):
    first = flexmb.statics(spring(), time=1.0)
    second = flexmb.statics(spring(), time=2.0)
    with pytest.raises(ResultFileError, match=r"no time in common: .* 1 s to 1 s; .* 2 s to 2 s"):
        compare(first, second, folder=tmp_path)


def spring() -> Model:
    made = slider()
    made.drivers.clear()
    made.kinematics = None
    made.add_force("hold", "translational-spring-damper", joint="guide", stiffness=10.0)
    return made


def test_all_broken_files_are_told_before_anything_runs(tmp_path):
    (tmp_path / "torn.h5").write_text("nothing")
    run = CliRunner().invoke(
        app, ["compare", str(tmp_path / "torn.h5"), str(tmp_path / "none.toml")]
    )
    assert run.exit_code == 2
    assert "torn.h5: is not an HDF5 file" in run.stderr
    assert "none.toml: no such file" in run.stderr


def test_one_model_is_nothing_to_compare():
    with pytest.raises(FlexmbError, match="comparing needs two or more"):
        flexmb.compare(slider())


def test_the_command_draws_and_ends_in_code_3_beyond_what_is_allowed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flexmb.kinematics(slider(), output=tmp_path / "a")
    flexmb.kinematics(slider("1.1*sin(t)"), output=tmp_path / "b")
    run = CliRunner().invoke(app, ["compare", "a", "b", "-o", "plot.svg", "--within", "1e-3"])
    assert run.exit_code == 3, run.output
    assert "place.x   b" in run.output
    assert "still in all models: place.y, place.z" in run.output
    assert "<svg" in (tmp_path / "plot.svg").read_text(encoding="utf-8")


def test_the_error_of_rows_between_others_is_that_of_the_spline():
    """Of the fourth order: with half of the rows it is sixteen times as large."""
    times, at = np.linspace(-3.0, 3.0, 81), np.linspace(-2.5, 2.5, 1001)
    rows, noise = _sampler(times, at, 0.0)
    error = np.abs(rows(np.exp(-(times**2))) - np.exp(-(at**2))).max()
    assert noise(np.exp(-(times**2))) == pytest.approx(error, rel=0.2)
