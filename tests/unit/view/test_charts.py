"""Charts of channels: what is on which axis, overlays of results, spectra of known signals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import slidercrank
from resultfiles import FakeLayout, block, writer

from flexmb.errors import FlexmbError, ResultFileError, ViewError
from flexmb.results import Result
from flexmb.results.output_block import OutputBlock
from flexmb.view.charts import (
    amplitudes,
    campbell_of_run,
    energy_figure,
    hodograph_figure,
    participation_figure,
    phase_figure,
    reactions_figure,
    spectrum_figure,
    xy_figure,
)
from flexmb.view.history import envelope, history_figure, run_labels, select_series


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return Result(slidercrank.make(tmp_path_factory.mktemp("run") / "crank"))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Result:
    made = Result(slidercrank.make(tmp_path_factory.mktemp("run") / "slow"))
    made.model["units"] = "mm-t-s"
    return made


def signal(path: Path, t: np.ndarray, x: np.ndarray) -> Result:
    """A fake run whose first channel, a position, is x(t), and whose angle is 10 t^2."""
    rows = block(0, len(t))
    sensors = rows.sensors.copy()
    sensors[:, 0], sensors[:, 3] = x, 10 * t**2
    rows = OutputBlock(**{**vars_of(rows), "t": t, "sensors": sensors})
    with writer(path, len(t) - 1) as out:
        out.append(rows)
    return Result(path)


def vars_of(rows: OutputBlock) -> dict[str, np.ndarray]:
    return {name: getattr(rows, name) for name in ("q", "v", "vd", "lam", "reactions", "energy",
                                                   "drift")}  # fmt: skip


def test_results_are_drawn_into_one_another_in_the_units_of_the_first(result, other) -> None:
    (axes,) = history_figure([result, other], ["slider.x"]).axes
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["slider.x, crank", "slider.x, slow"]
    first, second = (line.get_data() for line in axes.lines)
    assert axes.get_ylabel() == "position [mm]"
    np.testing.assert_allclose(first[1], 1e3 * result["slider.x"])
    np.testing.assert_allclose(second[1], first[1], rtol=1e-12)  # the same motion, stated in mm
    assert axes.lines[0].get_color() != axes.lines[1].get_color()


def test_wildcards_mean_all_that_fit_and_stems_the_magnitude(result) -> None:
    names = [one.channel for one in select_series([result], ["slider.[xy]", "slider.x"])]
    assert names == ["slider.x", "slider.y"]
    (one,) = select_series([result], ["slider"])
    expected = np.sqrt(sum(result[f"slider.{axis}"] ** 2 for axis in "xyz"))
    assert one.label == "|slider|"
    np.testing.assert_allclose(one.values(result.units), expected)


def test_all_unknown_names_are_told_at_once(result) -> None:
    with pytest.raises(ResultFileError) as error:
        history_figure(result, ["slidr.x", "crank_angel"])
    assert "nearest: slider.x" in str(error.value) and "nearest: crank_angle" in str(error.value)


def test_results_without_common_channels_need_names(result, tmp_path) -> None:
    fake = signal(tmp_path / "r.h5", np.linspace(0, 1, 5), np.zeros(5))
    fake.model["sensors"] = {"slider": {"type": "position"}, "turn": {"type": "angle"}}
    strange = Result(fake.path)
    del strange.model["sensors"]
    with pytest.raises(ViewError, match="no channels in common"):
        history_figure([result, no_channels(tmp_path)])
    assert len(history_figure([result, fake], ["slider.x"]).axes[0].lines) == 2


def no_channels(folder: Path) -> Result:
    layout = FakeLayout(channels=())
    from flexmb.results.writer import ResultWriter

    with ResultWriter(folder / "n.h5", layout, 4, scene={"title": "none"}) as out:
        out.append(block(0, 5, layout))
    return Result(folder / "n.h5")


def test_results_are_labelled_by_what_differs() -> None:
    class At:
        def __init__(self, path: str) -> None:
            self.path = Path(path)

    assert run_labels([At("/a/x/result.h5")]) == ("",)  # type: ignore[list-item]
    assert run_labels([At("/a/x/result.h5"), At("/b/y/result.h5")]) == ("x", "y")  # type: ignore[list-item]
    same = [At("/a/x/run/result.h5"), At("/a/y/run/result.h5")]
    assert run_labels(same) == ("x", "y")  # type: ignore[arg-type]
    assert run_labels([At("/a/x/1.h5"), At("/a/x/2.h5")]) == ("1", "2")  # type: ignore[list-item]
    assert len(set(run_labels([same[0], same[0]]))) == 2  # type: ignore[list-item]


def test_a_channel_over_another(result) -> None:
    (axes,) = xy_figure(result, ["slider.x"], "crank_angle").axes
    x, y = axes.lines[0].get_data()
    np.testing.assert_allclose(x, result["crank_angle"])
    np.testing.assert_allclose(y, 1e3 * result["slider.x"])
    assert axes.get_xlabel() == "crank_angle [rad]"
    with pytest.raises(ViewError, match="means 3 channels"):
        xy_figure(result, ["slider.x"], "slider.*")


def test_a_phase_plot_differentiates_what_has_no_rate(tmp_path) -> None:
    t = np.linspace(0, 2.0, 401)
    (axes,) = phase_figure(signal(tmp_path / "r.h5", t, np.sin(3 * t)), ["slider.x"]).axes
    x, x_dot = axes.lines[0].get_data()
    assert axes.get_ylabel() == "velocity [m/s]" and axes.get_xlabel() == "slider.x [mm]"
    np.testing.assert_allclose((x_dot / 3) ** 2 + (1e-3 * x) ** 2, 1.0, atol=1e-5)


def test_a_phase_plot_takes_the_rate_that_is_stored(result) -> None:
    (axes,) = phase_figure(result, ["crank.r.x"]).axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), result["crank.r_dot.x"])


def test_the_spectrum_of_a_sine_is_its_amplitude(tmp_path) -> None:
    t = np.linspace(0, 4.0, 4001)
    x = 5.0 + 0.3 * np.sin(2 * np.pi * 25.0 * t) + 0.02 * np.sin(2 * np.pi * 100.0 * t)
    f, a = amplitudes(t[:-1], x[:-1])
    assert f[np.argmax(a)] == pytest.approx(25.0, abs=1e-9)
    assert a.max() == pytest.approx(0.3, rel=1e-6)
    assert a[np.argmin(abs(f - 100.0))] == pytest.approx(0.02, rel=1e-4)
    uneven = t + 0.2e-3 * np.sin(40 * t)  # outputs at uneven times
    x = 0.3 * np.sin(2 * np.pi * 25.0 * uneven)
    (axes,) = spectrum_figure(signal(tmp_path / "u.h5", uneven, x), ["slider.x"]).axes
    line = axes.lines[0].get_xydata()
    at, height = line[np.argmax(line[:, 1])]
    assert at == pytest.approx(25.0, abs=0.26) and height == pytest.approx(300.0, rel=0.02)
    assert axes.get_ylabel() == "amplitude of position [mm]"


def test_a_campbell_diagram_of_a_run_up(tmp_path) -> None:
    """A vibration that follows the speed stands on the first order."""
    t = np.linspace(0, 4.0, 4001)
    made = signal(tmp_path / "r.h5", t, np.sin(10 * t**2))  # angular speed 20 t = 2 x "turn" rate
    made.model["sensors"]["turn"] = {"type": "angle", "derivative": 1}  # 10 t^2 as a speed
    figure = campbell_of_run(made, ["slider.x"])
    table = figure.axes[0].collections[0].get_array().reshape(-1, 24)
    times = np.linspace(*figure.axes[0].get_xlim(), 25)
    frequencies = np.linspace(0, figure.axes[0].get_ylim()[1], table.shape[0])
    ridge = frequencies[table.argmax(axis=0)]
    middle = 0.5 * (times[1:] + times[:-1])
    assert np.abs(ridge - 20 * middle / (2 * np.pi))[3:-1].max() < 2 * frequencies[1]
    orders = campbell_of_run(made, ["slider.x"], "turn").axes[0]
    assert len(orders.lines) == 4
    speed, first = orders.lines[0].get_data()
    np.testing.assert_allclose(first, speed / (2 * np.pi))


def test_a_hodograph_has_equal_scales_and_both_large_components(result) -> None:
    (axes,) = hodograph_figure(result, ["slider"]).axes
    assert axes.get_xlabel() == "x [mm]" and axes.get_aspect() == 1.0
    with pytest.raises(ResultFileError, match="one component"):
        hodograph_figure(result, ["slider.x"])


def test_energies_reactions_and_modes_need_no_names(result) -> None:
    assert energy_figure(result).axes
    assert reactions_figure(result).axes
    assert participation_figure(result).axes
    with pytest.raises(ResultFileError, match="no reaction"):
        reactions_figure(result, ["nothing"])
    with pytest.raises(ResultFileError, match="no flexible body"):
        participation_figure(result, ["crank"])


def test_what_cannot_be_drawn_is_refused(result, tmp_path) -> None:
    with pytest.raises(ViewError, match="one unit"):
        phase_figure(result, ["slider.x", "crank_angle"])
    with pytest.raises(ViewError, match="16 outputs"):
        spectrum_figure(signal(tmp_path / "s.h5", np.linspace(0, 1, 9), np.zeros(9)), ["slider.x"])
    with pytest.raises(ViewError, match="no two outputs"):
        history_figure(result, ["slider.x"], (7.0, 8.0))
    with pytest.raises(ViewError, match="too many"):
        history_figure(result, ["*.origin.*"])
    with pytest.raises(FlexmbError, match="one channel of one result"):
        campbell_of_run(result, ["slider.?"])


def test_a_long_line_keeps_every_extreme() -> None:
    x = np.linspace(0, 1, 1_000_003)
    y = np.sin(40 * x)
    y[[123_456, 777_777, 1_000_002]] = 5.0, -7.0, 3.0
    u, v = envelope(x, y)
    assert len(u) < 10_000
    assert v.max() == 5.0 and v.min() == -7.0 and v[-1] == 3.0
    assert (np.diff(u) > 0).all() and u[0] == 0.0
    short = envelope(x[:100], y[:100])
    assert short[0] is not x and len(short[0]) == 100
