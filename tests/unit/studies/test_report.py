"""What is concluded from the rows of a study, on rows made by hand."""

from __future__ import annotations

import csv
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from flexmb.errors import FlexmbError, ViewError
from flexmb.studies.accuracy.report import Study, cost_of_a_digit
from flexmb.studies.accuracy.rows import Error, Row
from flexmb.studies.channel_errors import error_text
from flexmb.studies.study_settings import headings, label
from flexmb.view.work_precision import Curve, pareto_figure


def row(step: float, modes: int, error: float, time: float, floor: float = 1e-12) -> Row:
    return Row(
        {"dynamics.step": step, "bodies.rod.modes": modes}, "finished", group="g",
        physics=f"p{modes}", finest=modes == 8, duration=2.0,
        statistics={"steps": 10, "seconds_compile": 0.1},
        errors={"positions": Error(error, floor, "tip", True),
                "reactions": Error(10 * error, floor, "pin", True),
                "energy": Error(1e-3, 1e-3, "", True)},
        seconds=(time, 9 * time, 0.5 * time), cpu_seconds=(time, time, time),
    )  # fmt: skip


def made(tmp_path: Path, rows: list[Row]) -> Study:
    return Study(
        "A | scene", "scene.toml", tmp_path, rows, 0.01, 3, 2, 0, {"g": "reference: tight"},
        [("modes=4", 1.5)],
    )  # fmt: skip


@pytest.fixture
def study(tmp_path: Path) -> Study:
    rows = [row(h, m, h**2 + (1e-3 if m == 4 else 0.0), 1 / h * m) for m in (4, 8)
            for h in (0.1, 0.03, 0.01, 0.003)]  # fmt: skip
    rows.append(Row({"dynamics.step": 1.0, "bodies.rod.modes": 4}, "failed", "fell | apart", "g"))
    return made(tmp_path, rows)


def test_the_cheapest_setting_is_the_fastest_that_meets_the_target(study: Study) -> None:
    best = study.cheapest()
    assert best is not None
    assert best.values == {"dynamics.step": 0.03, "bodies.rod.modes": 4}
    strict = study.cheapest("positions", 1e-4)
    assert strict is not None
    assert strict.values["bodies.rod.modes"] == 8
    assert study.cheapest("reactions", 1e-9) is None
    every = study.cheapest("all")
    assert every is not None
    assert every.errors["reactions"].value <= study.target


def test_times_are_medians_and_failed_runs_have_none(study: Study) -> None:
    assert study.rows[0].time == 1 / 0.1 * 4
    assert np.isnan(study.seconds[-1])
    assert np.isnan(study.errors("all")[-1])


def test_order_two_costs_the_square_root_of_ten_per_digit(study: Study) -> None:
    """Time ~ 1/step and error ~ step²; the coarse model, which stops improving, is left out."""
    found = cost_of_a_digit(study, "positions")
    assert found == pytest.approx(np.sqrt(10.0), rel=1e-9)


def test_an_unknown_quantity_names_its_neighbours(study: Study) -> None:
    with pytest.raises(FlexmbError, match="nearest: positions"):
        study.errors("position")


def test_tables_show_everything_also_what_failed(study: Study, tmp_path: Path) -> None:
    columns, rows = study.table()
    assert columns[:2] == ("step", "modes")
    assert rows[-1] == ("1", "4", *["✗"] * 5)
    text = study.markdown()
    assert text.count("\n| ") == len(rows) + 1
    assert "✗ step=1, modes=4: fell | apart" in text
    assert "--set dynamics.step=0.03 --set bodies.rod.modes=4" in text
    assert "<td>✗</td>" in study._repr_html_()
    with study.to_csv(tmp_path / "s.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(one["error_positions"]) for one in read[:-1]] == [
        r.errors["positions"].value for r in study.rows[:-1]
    ]
    assert read[-1]["status"] == "failed"
    assert float(read[0]["seconds_per_simulated_second"]) == study.rows[0].time / 2.0


def test_what_cannot_be_told_from_the_reference_is_a_bound(tmp_path: Path) -> None:
    small, hopeless = row(0.1, 4, 1e-9, 1.0, floor=1e-7), row(0.2, 4, 1e-9, 1.0)
    hopeless.errors["positions"] = Error(0.3, 2.0, "tip", False)
    study = made(tmp_path, [small, hopeless])
    assert [cells[2] for cells in study.table()[1]] == ["< 1.0e-7", "?"]
    assert study.errors("positions")[0] == 1e-7
    assert study.cheapest() is small


@pytest.mark.seconds
def test_plots_have_a_panel_for_each_quantity(study: Study, tmp_path: Path) -> None:
    files = study.save()
    assert [path.name for path in files] == [
        "study.csv", "study.md", "work_precision.png", "pareto.png",
    ]  # fmt: skip
    assert all(path.stat().st_size > 1000 for path in files[2:])
    figure = study.plot()
    assert [axes.get_title("left") for axes in figure.axes] == ["positions", "reactions", "energy"]
    drawn = figure.axes[0].get_lines()[0].get_xydata()
    assert drawn == pytest.approx(
        np.array([[r.time, r.errors["positions"].value] for r in study.rows[:4]])
    )


def test_words_beside_the_front_never_cover_each_other() -> None:
    """Twenty points on top of each other, at the right edge: few words, all inside."""
    times = [1.0 + 0.001 * i for i in range(20)]
    crowd = Curve("", times, [1e-3 / t for t in times], ["accuracy=1e-4"] * 20)
    alone = Curve("", [0.01], [1.0], ["accuracy=1e-1"])
    panels = {"positions": [crowd, alone]}
    figure = pareto_figure(panels, {"positions": 1e-6}, target=0.01, title="t")
    figure.canvas.draw()
    (axes,) = figure.axes
    boxes = [text.get_window_extent() for text in axes.texts]
    assert 2 <= len(boxes) < 6
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes)


def test_without_any_run_there_is_nothing_to_draw(tmp_path: Path) -> None:
    study = made(tmp_path, [Row({"a": 1}, "failed", "why", "g")])
    assert study.save() == [tmp_path / "study.csv", tmp_path / "study.md"]
    with pytest.raises(ViewError, match="no run has an error"):
        study.plot()


def test_headings_are_as_short_as_they_can_be_told_apart() -> None:
    knobs = ("bodies.a.modes", "bodies.b.modes", "dynamics.step", "r")
    assert list(headings(knobs).values()) == ["a.modes", "b.modes", "step", "r"]
    assert label({"dynamics.step": 1e-5, "mesh": "../x/fine.msh"}) == "step=1e-5, mesh=fine.msh"
    assert (
        label({"a": 1e-4, "b": 0.000316, "c": 0.01, "d": 20.0}) == "a=1e-4, b=3.16e-4, c=0.01, d=20"
    )
    assert error_text(1.52e-6) == "1.5e-6"
