"""The window without a desktop: its frames, its clock, and the camera that stays the user's."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import slidercrank
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.errors import ViewError
from flexmb.results import Result
from flexmb.view import vtk_renderer, window
from flexmb.view.film import shoot

pytestmark = pytest.mark.skipif(
    not vtk_renderer.probe().works, reason="VTK does not render on this machine"
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run"))


def test_the_user_keeps_the_camera_while_the_machine_moves(run: Path, monkeypatch) -> None:
    shot = shoot(Result(run), 25.0, 0.04, None, None, (), {"size": (160, 90)})
    verdict = vtk_renderer.probe()
    now = [100.0]
    monkeypatch.setattr(window.clock, "monotonic", lambda: now[0])
    with vtk_renderer.open_scene(1, shot.size, 1, verdict) as scene:
        scene.is_window = True
        player = window.Player(shot, scene)
        assert player.count == 51
        before = scene.image().astype(int)
        scene.plotter.camera.azimuth = 30
        eye = scene.plotter.camera.position
        turned = scene.image().astype(int)
        player.go_to(17)
        moved = scene.image().astype(int)
        assert scene.plotter.camera.position == pytest.approx(eye)
        assert (np.abs(turned - before).max(axis=2) > 30).mean() > 0.01
        assert (np.abs(moved - turned).max(axis=2) > 30).mean() > 0.01
        player.tick()
        assert player.number == 17  # it does not play
        player.toggle()
        now[0] += 0.5  # 12 frames at 25 a second
        player.tick()
        assert player.number == 29
        now[0] += 1.0
        player.tick()
        assert player.number == 3  # from the beginning again
        player.toggle()
        now[0] += 1.0
        player.tick()
        assert player.number == 3
        player.run()  # returns at once where there is no window


def test_without_a_desktop_a_window_is_refused(run: Path, monkeypatch) -> None:
    monkeypatch.setattr(window, "has_desktop", lambda: False)
    with pytest.raises(ViewError, match="no desktop"):
        window.open_window(run)


@pytest.mark.seconds
def test_the_command_writes_a_page_where_there_is_no_desktop(
    run: Path, tmp_path: Path, monkeypatch
) -> None:
    pytest.importorskip("plotly")
    monkeypatch.setattr(window, "has_desktop", lambda: False)
    monkeypatch.setattr(window, "has_display", lambda: False)
    page = tmp_path / "a.html"
    outcome = CliRunner().invoke(app, ["view", str(run), "-o", str(page)])
    assert outcome.exit_code == 0, outcome.output
    assert "no desktop" in outcome.output
    text = page.read_text(encoding="utf-8")
    assert 'id="play"' in text
    assert "Slider-crank" in text
    assert not re.search(r'<(script|link|img|iframe)[^>]+(src|href)="?http', text)
    for arguments, words in (
        (["-o", str(page)], "--force"),
        (["-o", "a.png"], ".html"),
        (["--page", "--speed", "2"], "belongs to the window"),
    ):
        outcome = CliRunner().invoke(app, ["view", str(run), *arguments])
        assert outcome.exit_code == 2
        assert words in outcome.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.html"]
