"""Plots of channels: what is drawn, in which units, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import slidercrank
from resultfiles import writer

from flexmb import Model, kinematics
from flexmb.analysis.linear.linearization import ModeSweep
from flexmb.errors import ResultFileError, ViewError
from flexmb.results import Result
from flexmb.view.history import history_figure, plot_history
from flexmb.view.modes import root_locus_figure
from flexmb.view.plot import new_figure


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return Result(slidercrank.make(tmp_path_factory.mktemp("run")))


def test_one_panel_for_each_unit_over_a_common_time(result: Result) -> None:
    figure = history_figure(result, ["slider.x", "slider.y", "crank_angle"])
    position, angle = figure.axes
    assert position.get_ylabel() == "position [mm]"
    assert angle.get_ylabel() == "angle [rad]"
    assert angle.get_xlabel() == "time [ms]"
    assert len(position.lines) == 2
    t, x = position.lines[0].get_data()
    np.testing.assert_allclose(t, 1e3 * result.time)
    np.testing.assert_allclose(x, 1e3 * result["slider.x"])
    assert angle.get_xlim() == pytest.approx((0.0, 80.0))


def test_a_scene_in_other_units_is_drawn_in_them(result: Result) -> None:
    other = Result(result.path)
    other.model["units"] = "cm-g-s"
    position, speed = history_figure(other, ["slider.x", "speed.x"]).axes
    assert position.get_ylabel() == "position [cm]"
    assert speed.get_ylabel() == "velocity [cm/s]"
    assert speed.get_xlabel() == "time [s]"
    t, x = position.lines[0].get_data()
    np.testing.assert_allclose(t, result.time)
    np.testing.assert_allclose(x, 100 * result["slider.x"])


def test_a_channel_without_unit_is_drawn_as_it_is(result: Result) -> None:
    (axes,) = history_figure(result, ["rod.p.0"]).axes
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), result["rod.p.0"])


def test_the_scene_chooses_else_all_that_moves(result: Result) -> None:
    assert len(history_figure(result).axes) == 3  # what [view] history names
    bare = Result(result.path)
    del bare.model["view"]["history"]
    names = [line.get_label() for axes in history_figure(bare).axes for line in axes.lines]
    assert names == ["slider.x", "speed.x", "crank_angle"]


def test_the_file_is_written_and_no_window_system_is_touched(result, tmp_path: Path) -> None:
    path = plot_history(result, output=tmp_path / "new" / "history.png")
    assert path.stat().st_size > 10_000
    assert plot_history(result, ["slider.x"], tmp_path / "h.svg").stat().st_size > 1000


def test_the_file_of_a_run_is_plotted_like_the_run(result: Result, tmp_path: Path) -> None:
    assert plot_history(result.path, output=tmp_path / "a.png").is_file()
    assert plot_history(str(result.path), ["slider.x"], tmp_path / "b.png").is_file()


@pytest.mark.parametrize("output", ["history.doc", "", "file/history.png"])
def test_a_file_that_cannot_be_is_refused(result: Result, tmp_path: Path, output: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ViewError):
        plot_history(result, output=tmp_path / output)


def test_an_unknown_channel_names_its_neighbours(result: Result) -> None:
    with pytest.raises(ResultFileError, match="nearest: slider.x"):
        history_figure(result, ["slidr.x"])


def test_a_result_without_rows_is_refused(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        pass
    with pytest.raises(ViewError, match="no rows"):
        history_figure(Result(out.path), ["slider.x"])


def test_a_line_far_from_the_others_has_axes_of_its_own(tmp_path: Path) -> None:
    """The top of a mast sways by millimetres, metres above the ground."""
    model = Model("mast", folder=tmp_path)
    model.add_body("mast", mass=1, inertia=[1, 1, 1])
    model.add_joint("sway", "prismatic", between=["ground", "mast"], axis="x")
    model.add_driver("sway", joint="sway", stroke="0.01*sin(t)")
    model.add_sensor("top", "position", of="mast")
    model.add_sensor("bend", "expression", value="0.5*top.x + 8", unit="m")
    run = kinematics(model, duration=3.0, outputs=20, output=tmp_path)
    low, high = history_figure(run).axes
    assert [line.get_label() for line in (*low.lines, *high.lines)] == ["top.x", "bend"]
    (together,) = history_figure(run, ["top.x", "bend"]).axes
    assert len(together.lines) == 2


def test_the_power_of_ten_of_an_axis_stands_clear_of_the_legend(tmp_path: Path) -> None:
    model = Model("press", folder=tmp_path)
    model.add_body("ram", mass=1, inertia=[1, 1, 1])
    model.add_joint("guide", "prismatic", between=["ground", "ram"], axis="x")
    model.add_driver("stroke", joint="guide", stroke="sin(t)")
    model.add_sensor("power", "expression", value="3e7*sin(t)", unit="W")
    figure = history_figure(kinematics(model, duration=3.0, output=tmp_path), ["power"])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    power, name = axes.yaxis.get_offset_text(), axes.get_legend()
    assert power.get_text()
    assert power.get_window_extent().x1 < name.get_window_extent().x0 - 5


@pytest.mark.parametrize("width", [4.6, 7.6, 9.6])
def test_long_titles_fit_into_the_figure(width: float) -> None:
    figure = new_figure(width, 3.0, "Slider-crank with a flexible connecting rod: " + 3 * "WHISK ")
    figure.subplots()
    figure.draw_without_rendering()
    assert figure._suptitle.get_window_extent().x1 < figure.bbox.x1


def test_a_root_locus_without_damping_is_a_line() -> None:
    """Round-off in the damping is not blown up to the width of the plot."""
    imaginary = np.array([[50.0, 4000.0], [60.0, 4500.0]])
    noise = np.array([[0.0, 0.0], [1e-7, -2e-7]])
    sweep = ModeSweep("speed", np.array([0.0, 1.0]), noise + 1j * imaginary, np.zeros(2), ())
    assert root_locus_figure(sweep).axes[0].get_xlim() == pytest.approx((-4.5e-3, 4.5e-3))
    sweep = ModeSweep("speed", np.array([0.0, 1.0]), 1e6 * noise + 1j * imaginary, np.zeros(2), ())
    assert root_locus_figure(sweep).axes[0].get_xlim() == pytest.approx((-0.215, 0.115))
