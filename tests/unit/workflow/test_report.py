"""Reports: one page that needs nothing else, with all of a run, safe whatever names say."""

from __future__ import annotations

import base64
import csv
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import slidercrank
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError, ViewError
from flexmb.results import Result
from flexmb.view import html_page, page_motion
from flexmb.view.drawing import Drawing
from flexmb.view.html_page import packed, table, tag
from flexmb.view.mechanism import Mechanism
from flexmb.workflow import comparison_page, result_page

pytest.importorskip("plotly")
HOSTILE = '<script>alert("1")</script> & "Ünïcode" </style>'


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are tested elsewhere, and the JavaScript of plotly is 5 MB."""

    def picture(run, color, time, words, view=None) -> html_page.Html:
        return tag("figure", tag("figcaption", f"{color} {words} {view or ''}"))

    for module in (result_page, comparison_page):
        monkeypatch.setattr(module, "picture_of", picture)
    monkeypatch.setattr("plotly.offline.get_plotlyjs", lambda: "/* plotly */")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run") / "crank").parent


class Reader(HTMLParser):
    """Tags, attributes that load something, and the text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded, self.tags, self.words = list[str](), list[str](), list[str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loaded += [str(v) for k, v in attrs if k in ("src", "href", "data", "action")]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def data_of(text: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])


def unpacked(numbers: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(numbers["data"]), "<" + numbers["kind"])


def test_the_page_needs_nothing_else_and_has_every_part(folder: Path, tmp_path) -> None:
    path = flexmb.report(folder, output=tmp_path / "r.html")
    text = path.read_text(encoding="utf-8")
    page = Reader(text)
    assert all(source.startswith("data:") for source in page.loaded)
    assert "default-src 'none'" in text
    words = " ".join(page.words)
    for part in ("In motion", "Pictures", "Plots", "What was simulated", "Effects", "Provenance",
                 "Accuracy and cost", "Modes of the flexible bodies", "flexmb audit"):  # fmt: skip
        assert part in words
    assert {chart["id"] for chart in data_of(text)["charts"]} <= set(
        re.findall(r'id="(\w+)"', text)
    )


def test_a_notebook_shows_the_parts_asked_for(folder: Path, tmp_path) -> None:
    page = flexmb.report_page(folder, parts=["plots", "motion"], file=tmp_path / "p.html")
    words = " ".join(Reader(page.html).words)
    assert "In motion" in words and "Plots" in words
    assert "Provenance" not in words and "Pictures" not in words
    frame = Reader(page._repr_html_())
    assert frame.tags == ["iframe"]  # the page is text of an attribute
    assert not list(tmp_path.iterdir())
    assert page.save().read_text(encoding="utf-8") == page.html


def test_words_of_the_view_reach_the_pictures_and_wrong_ones_are_refused(folder, tmp_path) -> None:
    view = {"camera": ["front", "top"], "color": "body"}
    page = flexmb.report_page(folder, parts=["pictures"], view=view)
    assert "'top'" in " ".join(Reader(page.html).words)
    with pytest.raises(ViewError, match="camera"):
        flexmb.report(folder, output=tmp_path / "r.html", view={"camera": "frontt"})
    with pytest.raises(ViewError, match='no part "plot"; nearest: plots'):
        flexmb.report(folder, output=tmp_path / "r.html", parts=["plot"])
    with pytest.raises(ViewError, match="one run"):
        flexmb.report(folder, folder, output=tmp_path / "r.html", parts=["plots"])
    assert not list(tmp_path.iterdir())


def test_names_of_users_are_text(folder: Path, tmp_path) -> None:
    run = Result(folder)
    run.model["title"] = HOSTILE
    text = flexmb.report(run, output=tmp_path / "r.html", motion=False).read_text(encoding="utf-8")
    page = Reader(text)
    assert page.tags.count("script") == 3 and page.tags.count("style") == 1
    assert HOSTILE in " ".join(page.words)
    assert "<script>alert" not in text


def test_charts_hold_the_channels(folder: Path, tmp_path) -> None:
    run = Result(folder)
    text = flexmb.report(run, output=tmp_path / "r.html", motion=False).read_text(encoding="utf-8")
    data = data_of(text)
    assert "motion" not in data or data["motion"] is None
    chart = data["charts"][0]
    assert chart["x"] == "time [ms]" and chart["y"] == "position [mm]"
    line = chart["lines"][0]
    np.testing.assert_allclose(unpacked(line["x"]), 1e3 * run.time, rtol=1e-12)
    np.testing.assert_allclose(unpacked(line["y"]), 1e3 * run["slider.x"], rtol=1e-6)


def moved(data: dict[str, Any], frame: int, factor: float) -> dict[int, list[np.ndarray]]:
    """Points of all parts of all meshes, as page.js places them."""
    placed: dict[int, list[np.ndarray]] = {}
    for k, mesh in enumerate(data["meshes"]):
        for part in mesh["parts"]:
            points = unpacked(part["points"]).reshape(-1, 3).astype(float)
            if part["shapes"]:
                shapes = unpacked(part["shapes"]).reshape(-1, points.size).astype(float)
                amounts = unpacked(part["amounts"]).reshape(-1, len(shapes))[frame]
                points = points + (factor if part["flexible"] else 1.0) * (
                    amounts @ shapes
                ).reshape(-1, 3)
            if part["motion"]:
                m = unpacked(part["motion"]).reshape(-1, 12)[frame].astype(float)
                points = points @ m[:9].reshape(3, 3).T + m[9:]
            placed.setdefault(k, []).append(points)
    return placed


@pytest.mark.slow
def test_the_machine_moves_as_pictures_show_it(folder: Path) -> None:
    """The packed numbers give the points of a drawing, exaggerated as it is, and undeformed."""
    run = Result(folder)
    scene = page_motion.moving_scene(run)
    times = unpacked(scene.data["times"])
    assert len(times) >= 60 and times[-1] == pytest.approx(run.time[-1])
    drawing = Drawing(Mechanism(run), times=times.tolist())
    assert scene.factor == drawing.factor > 1.0
    for frame in (0, 17, len(times) - 1):
        content = drawing.content(float(times[frame]))
        (body,) = content.deformed
        colored = next(k for k, mesh in enumerate(scene.data["meshes"]) if mesh["colored"])
        size = np.ptp(body.points, axis=0).max()
        used = np.unique(body.faces)
        (points,) = moved(scene.data, frame, scene.factor)[colored]
        np.testing.assert_allclose(points, body.points[used], atol=2e-4 * size)
        (points,) = moved(scene.data, frame, 0.0)[colored]
        np.testing.assert_allclose(points, body.undeformed[used], atol=1e-5 * size)
        part = scene.data["meshes"][colored]["parts"][0]
        shares = unpacked(part["values"]).reshape(len(times), -1)[frame] / 255
        low, high = scene.data["limits"]
        expected = body.values[used] * content.scale.factor
        np.testing.assert_allclose(low + (high - low) * shares, expected, atol=high / 400)
        rigid = [solid.points for solid in content.solids]
        drawn = [
            p for k, parts in moved(scene.data, frame, 1.0).items() if k != colored for p in parts
        ]
        assert len(drawn) == len(rigid)
        far = max(min(_distance(p, q) for q in drawn) for p in rigid)
        assert far < 1e-5 * size


def _distance(p: np.ndarray, q: np.ndarray) -> float:
    if np.abs(p.mean(axis=0) - q.mean(axis=0)).max() > 1.0:
        return np.inf
    low, high = (np.abs(f(p, axis=0) - f(q, axis=0)).max() for f in (np.min, np.max))
    return float(max(low, high))


def test_frames_of_a_body_that_turns_often_are_of_its_last_turns(tmp_path) -> None:
    made = flexmb.Model("wheel")
    made.add_body("wheel", mass=1.0, inertia=[0.1] * 3, angular_velocity=[0, 0, 2 * np.pi * 50])
    run = flexmb.simulate(made, duration=0.5, outputs=50, step=1e-3)
    times, note = page_motion.frame_times(run)
    turns = 50 * (times[-1] - times[0])
    assert (len(times) - 1) / turns >= 23.5 and "the last" in note
    calm = flexmb.Model("still")
    calm.add_body("wheel", mass=1.0, inertia=[0.1] * 3)
    times, note = page_motion.frame_times(flexmb.simulate(calm, duration=2.0, step=0.1))
    assert times[0] == 0.0 and times[-1] == pytest.approx(2.0) and not note


def test_several_runs_are_compared(folder: Path, tmp_path) -> None:
    other = tmp_path / "other"
    slidercrank.make(other)
    text = flexmb.report(folder, other, output=tmp_path / "c.html").read_text(encoding="utf-8")
    words = " ".join(Reader(text).words)
    assert "2 runs beside each other: crank, other" in words and "Differences" in words
    assert [line["name"] for line in data_of(text)["charts"][0]["lines"]] == [
        "slider.x, crank", "slider.x, other",
    ]  # fmt: skip


def test_a_study_is_reported_from_its_folder(tmp_path) -> None:
    rows = [
        {"step": 10**-k, "status": "finished", "reason": "", "error_positions": 10.0**-k,
         "cpu_seconds_integrate": 0.01 * 2**k} for k in (1, 2, 3)
    ]  # fmt: skip
    rows.append({"step": 1.0, "status": "failed", "reason": HOSTILE})
    with (tmp_path / "study.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), restval="")
        writer.writeheader()
        writer.writerows(rows)
    (tmp_path / "study.md").write_text(
        "### A study\n\n- ten times less costs more\n", encoding="utf-8"
    )
    text = flexmb.report(tmp_path).read_text(encoding="utf-8")
    assert (tmp_path / "report.html").is_file()
    page = Reader(text)
    assert "ten times less costs more" in " ".join(page.words) and HOSTILE in page.words
    (chart,) = data_of(text)["charts"]
    np.testing.assert_allclose(unpacked(chart["lines"][0]["y"]), [0.1, 0.01, 0.001])
    (tmp_path / "study.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(FlexmbError, match="not the table of a study"):
        flexmb.report(tmp_path)


def test_without_plotly_it_is_said_how_to_get_it(folder: Path, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(html_page, "find_spec", lambda name: None)
    with pytest.raises(ViewError, match=r"pip install 'flexmb\[report\]'"):
        flexmb.report(folder, output=tmp_path / "r.html")
    assert not list(tmp_path.iterdir())


def test_the_command_and_its_mistakes(folder: Path, tmp_path) -> None:
    def run(*words: object) -> tuple[int, str]:
        done = CliRunner().invoke(app, ["report", *map(str, words)])
        return done.exit_code, " ".join(done.output.split())

    file = tmp_path / "r.html"
    code, said = run(folder, "-o", file, "--no-motion")
    assert code == 0 and said.startswith(f"written: {file} (")
    assert "exists; give --force" in run(folder, "-o", file)[1]
    assert run(folder, "-o", file, "--no-motion", "--force")[0] == 0
    assert run("nothing") == (2, "error: nothing: there is no such result")
    code, said = run(folder, "-o", tmp_path / "r.pdf")
    assert code == 2 and "must end in .html" in said
    (tmp_path / "bad.h5").write_bytes(b"no result")
    assert run(tmp_path / "bad.h5")[0] == 2


def test_elements_are_escaped() -> None:
    assert tag("p", HOSTILE, title='"').startswith('<p title="&quot;">&lt;script&gt;')
    assert "<td>&lt;b&gt;</td>" in table(("a",), [("<b>",)])
    assert table(("a",), []) == ""
    np.testing.assert_array_equal(unpacked(packed([1.5, -2.0])), [1.5, -2.0])
