"""Channels by name, energy balance, what notebooks show, tables of text, copies."""

from __future__ import annotations

import csv
import dataclasses
import gc
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import slidercrank
from resultfiles import FakeLayout, block, writer

from flexmb.errors import OutputError, ResultFileError
from flexmb.flexbody import rigid_body, save
from flexmb.results import Result
from flexmb.results.reader import TemporaryFolder
from flexmb.results.writer import ResultWriter


@pytest.fixture
def result(tmp_path: Path) -> Result:
    with writer(tmp_path / "result.h5") as out:
        out.append(block(0, 11))
        known = {"steps": 70, "seconds_integrate": 0.5, "seconds_compile": 2}
        out.finish(known, "finished")
    return Result(out.path)


def test_every_number_over_time_has_a_name(result: Result) -> None:
    assert result.channels() == ("slider.x", "slider.y", "slider.z", "turn")
    rows = block(0, 11)
    columns = {
        "energy.strain": (rows.energy, 1, "J"),
        "drift.velocity": (rows.drift, 1, ""),
        "rod.r.y": (rows.q, 8, "m"),
        "crank.p.3": (rows.q, 6, ""),
        "rod.eta.1": (rows.q, 15, ""),
        "rod.r_dot.x": (rows.v, 6, "m/s"),
        "rod.w.z": (rows.v, 11, "rad/s"),
        "rod.eta_dot.0": (rows.v, 12, "1/s"),
    }
    for name, (table, column, unit) in columns.items():
        np.testing.assert_array_equal(result[name], table[:, column], name)
        assert result.unit(name) == unit
        assert name in result
    assert len(result.channels("coordinates")) == 16 + 14
    assert "slider" not in result


def test_scalar_coordinates_stand_behind_the_bodies(tmp_path: Path) -> None:
    names = ("joints.slot.position", "forces.coil")
    layout = dataclasses.replace(FakeLayout(), coordinates=names, nq=18, nv=16)
    rows = block(0, 3, layout)
    rows.q[:, 17], rows.v[:, 14] = 7.0, 8.0
    with ResultWriter(tmp_path / "r.h5", layout, 3, scene={"title": ""}) as out:
        out.append(rows)
    result = Result(out.path)
    assert list(result["forces.coil"]) == [7.0] * 3
    assert list(result["joints.slot.position.rate"]) == [8.0] * 3
    assert [result.unit(f"joints.slot.position{end}") for end in ("", ".rate")] == ["m", "m/s"]


def test_an_unknown_name_shows_the_nearest_of_all_kinds(result: Result) -> None:
    with pytest.raises(ResultFileError, match='no channel "energy.strian"; nearest: energy.strain'):
        result["energy.strian"]
    with pytest.raises(ResultFileError, match='of the kind "sensor"; nearest: sensors'):
        result.channels("sensor")


def test_the_balance_is_stored_energy_less_work_since_the_start(tmp_path: Path) -> None:
    layout = dataclasses.replace(FakeLayout(), energies=("kinetic", "spring", "driver_work"))
    rows = block(0, 4, layout)
    rows.energy[:] = [[5, 1, 0], [6, 2, 2], [4, 4.5, 2], [1, 5, 0.5]]
    with ResultWriter(tmp_path / "r.h5", layout, 4, scene={"title": ""}) as out:
        out.append(rows)
    result = Result(out.path)
    np.testing.assert_allclose(result.balance, [0, 0, 0.5, -0.5])
    np.testing.assert_array_equal(result["energy.balance"], result.balance)


def test_wall_times_by_phase(result: Result) -> None:
    assert result.seconds == {"integrate": 0.5, "compile": 2.0}


def test_notebooks_get_a_table_and_lines(tmp_path: Path) -> None:
    result = Result(slidercrank.make(tmp_path))
    html = result._repr_html_()
    page = ElementTree.fromstring(f"<x>{html.replace('&nbsp;', ' ').replace('<br>', '<br/>')}</x>")
    cells = [cell.text for cell in page.iter("td")]
    assert "finished" in cells and "8000" in cells
    lines = [e for e in page.iter() if e.tag.endswith("polyline")]
    assert len(lines) == 3  # those the scene's view names
    heights = [float(p.split(",")[1]) for p in lines[0].attrib["points"].split()]
    x = result["slider.x"][:: max(1, len(result.time) // 400)]
    assert np.argmin(heights) == np.argmax(x)  # upwards is more
    assert 0 < min(heights) < max(heights) < 120


def test_a_title_of_markup_is_no_markup(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5", scene={"title": "<b>&"}) as out:
        pass
    html = Result(out.path)._repr_html_()
    assert "&lt;b&gt;&amp;" in html and "<b>" not in html
    assert "svg" not in html  # no rows, no lines


def test_a_table_of_text_reads_back_to_the_last_digit(tmp_path: Path) -> None:
    result = Result(slidercrank.make(tmp_path))
    path = result.to_csv(tmp_path / "new" / "x.csv", ["slider.x", "speed.x", "energy.kinetic"])
    with path.open(newline="", encoding="ascii") as file:
        header, *rows = csv.reader(file)
    assert header == ["time [s]", "slider.x [m]", "speed.x [m/s]", "energy.kinetic [J]"]
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 0], result.time)
    np.testing.assert_array_equal(table[:, 1], result["slider.x"])
    with result.to_csv(tmp_path / "all.csv").open() as file:
        assert len(next(csv.reader(file))) == 1 + len(result.channels())


def test_tables_of_nothing_are_refused(result: Result, tmp_path: Path) -> None:
    with pytest.raises(ResultFileError) as caught:
        result.to_csv(tmp_path / "x.csv", ["turm", "turn", "slider.q"])
    first, second = caught.value.problems
    assert first.nearest[0] == "turn"
    assert second.nearest[0].startswith("slider.")
    with pytest.raises(OutputError, match="cannot be written"):
        result.to_csv(tmp_path)
    with writer(tmp_path / "empty.h5") as out:
        pass
    with pytest.raises(ResultFileError, match="holds no output rows"):
        Result(out.path).to_csv(tmp_path / "x.csv")
    assert not (tmp_path / "x.csv").exists()


def test_the_ending_of_a_file_names_its_format(result: Result, tmp_path: Path) -> None:
    text = result.export(tmp_path / "x.txt", ["turn"]).read_text()
    assert text == result.to_csv(tmp_path / "x.CSV", ["turn"]).read_text()
    assert result.export(tmp_path / "x.CSV").is_file()
    with pytest.raises(OutputError, match=r'no output format has the ending "\.cvs"') as caught:
        result.export(tmp_path / "x.cvs")
    assert caught.value.problems[0].nearest == (".csv",)
    assert not (tmp_path / "x.cvs").exists()


def test_a_copy_stands_by_itself(tmp_path: Path) -> None:
    original = Result(slidercrank.make(tmp_path / "run"))
    copy = original.save(tmp_path / "kept")
    named = original.save(tmp_path / "shelf" / "seven.h5")
    q = original.q.copy()
    for file in (tmp_path / "run").iterdir():
        file.unlink()
    for saved in (copy, named, Result(tmp_path / "kept")):
        np.testing.assert_array_equal(saved.q, q)
        assert saved.flexbodies["rod"].is_file()
    assert [p.name for p in sorted((tmp_path / "shelf").iterdir())] == [
        "rod.flexbody.h5",
        "seven.h5",
    ]
    assert copy.save(tmp_path / "kept").path == copy.path  # onto itself: nothing to do


def test_a_copy_replaces_no_body_of_another_result(tmp_path: Path) -> None:
    original = Result(slidercrank.make(tmp_path / "run"))
    (tmp_path / "other").mkdir()
    save(rigid_body(1.0, inertia=1.0), tmp_path / "other" / "rod.flexbody.h5")
    with pytest.raises(OutputError, match="belongs to another result"):
        original.save(tmp_path / "other")
    assert not (tmp_path / "other" / "result.h5").exists()


def test_a_run_under_way_is_not_copied(tmp_path: Path) -> None:
    with writer(tmp_path / "r.h5") as out:
        out.append(block(0, 3))
        with pytest.raises(OutputError, match="save the result when it has ended"):
            Result(out.path).save(tmp_path / "copy")


@pytest.mark.seconds
def test_a_temporary_folder_lives_as_long_as_a_result_of_it() -> None:
    scratch = TemporaryFolder()
    folder = scratch.path
    with writer(folder / "result.h5") as out:
        out.append(block(0, 3))
    one, two = Result(folder), Result(folder / "result.h5")
    del scratch, out
    gc.collect()
    del one
    gc.collect()
    assert len(two.q) == 3
    del two
    gc.collect()
    assert not folder.exists()
