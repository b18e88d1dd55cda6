"""Films: the right frames at the right times, one view for all, and nothing half written."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import slidercrank
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from flexmb import film, film_modes, render, simulate
from flexmb.cli import app
from flexmb.errors import FlexmbError, FlexmbWarning, ViewError
from flexmb.model import Model
from flexmb.results import Result, reader
from flexmb.view import encoder, vtk_renderer
from flexmb.view.drawing import Drawing
from flexmb.view.film import MotionShot, draw_frames_in_parallel, plan
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import view_of

SMALL = {"size": (160, 90), "processes": 1}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def spinning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bar that turns ten times a second about a fixed axis, 100 rows a second."""
    model = Model("spinning bar")
    model.add_body("bar", mass=1, inertia=[1, 1, 1], angular_velocity=[0, 0, 20 * np.pi])
    model.add_marker("bar.tip", position=[1, 0, 0])
    model.add_joint("pivot", "revolute", between=["ground", "bar"], axis="z")
    folder = tmp_path_factory.mktemp("spinning")
    return simulate(model, duration=3.0, step=0.01, outputs=300, output=folder).path


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.seconds
def test_a_gif_has_the_frames_of_its_speed(run: Path, tmp_path: Path) -> None:
    span = Result(run).time[-1]
    before = _hash(run)
    path = film(run, tmp_path / "a.gif", fps=10, speed=span / 0.8, **SMALL)
    with Image.open(path) as picture:
        assert picture.size == (160, 90)
        frames = [np.asarray(f.convert("RGB"), int) for f in ImageSequence.Iterator(picture)]
        assert picture.info["duration"] == 100  # ms
    assert len(frames) == 9  # both ends
    moves = [np.abs(a - b).max() for a, b in zip(frames, frames[1:], strict=False)]
    assert min(moves) > 50
    assert _hash(run) == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_processes_draw_the_same_pictures(run: Path, tmp_path: Path) -> None:
    if not vtk_renderer.probe().works:
        pytest.skip("VTK does not render on this machine")
    span = Result(run).time[-1]
    for count in (1, 2):
        film(run, tmp_path / f"{count}", fps=5, speed=span, size=(160, 90), processes=count)
    names = [f"frame_{k:05d}.png" for k in range(1, 7)]
    assert sorted(path.name for path in (tmp_path / "2").iterdir()) == names
    for name in names:
        one, two = (np.asarray(Image.open(tmp_path / f"{count}" / name), int) for count in (1, 2))
        assert np.abs(one - two).max() <= 2  # whatever frames a process has drawn before


@pytest.mark.seconds
def test_a_picture_does_not_depend_on_those_drawn_before(tmp_path: Path) -> None:
    """Arrows lie in front of what they act on, by an offset that VTK keeps for all pictures."""
    if not vtk_renderer.probe().works:
        pytest.skip("VTK does not render on this machine")
    model = Model("pendulum")
    model.set_gravity([0, 0, -9.81])
    shape = {"type": "box", "size": [1.0, 0.1, 0.1]}
    model.add_body("bar", shape=shape, material="steel", position=[0.5, 0, 0])
    model.add_marker("bar.end", position=[-0.5, 0, 0])
    model.add_joint("pivot", "revolute", between=["ground", "bar.end"], axis="y")
    result, pictures = simulate(model, duration=0.1, outputs=2), []
    for k, words in enumerate(({}, {"forces": "reactions"}, {})):
        render(result, 0.0, size=(320, 180), output=tmp_path / f"{k}.png", **words)
        pictures.append(np.asarray(Image.open(tmp_path / f"{k}.png"), int))
    assert np.abs(pictures[1] - pictures[0]).max() > 50
    np.testing.assert_array_equal(pictures[2], pictures[0])


def _shot(run: Path, rate: float, speed: float, **view) -> MotionShot:
    mechanism = Mechanism(Result(run))
    schedule = plan(mechanism.result, rate, speed, None, None)
    drawing = Drawing(mechanism, view_of(mechanism, view), schedule.times)
    words = {**view, "exaggeration": drawing.factor}
    return MotionShot(run, schedule, words, (160, 90), drawing.scale)


@pytest.mark.seconds
def test_every_frame_lies_in_the_view_of_the_whole_motion(run: Path) -> None:
    shot = _shot(run, 50.0, 0.1)
    first, largest = shot.panels(0)[0], 0.0
    axes = first.camera.axes[:2]
    low, high = ((first.extent @ axes.T).min(axis=0), (first.extent @ axes.T).max(axis=0))
    size = (high - low).max()
    for k in range(len(shot.schedule.times)):
        content = shot.panels(k)[0]
        np.testing.assert_allclose(content.extent, first.extent)
        assert content.scale == first.scale
        seen = content.all_points() @ axes.T
        assert (seen.min(axis=0) > low - 0.02 * size).all()
        assert (seen.max(axis=0) < high + 0.02 * size).all()
        largest = max(largest, float(content.deformed[0].displacement.max()))
    assert first.scale.largest == pytest.approx(largest, rel=1e-12)


@pytest.mark.seconds
def test_a_followed_body_stays_in_its_place(run: Path) -> None:
    shot = _shot(run, 25.0, 0.02, follow="slider", exaggeration=1)
    mechanism = Mechanism(Result(run))
    places = []
    for k in (0, 5, 11):
        slider = mechanism.at(shot.schedule.times[k]).pose("slider").r
        places.append(shot.panels(k)[0].fitted_points().mean(axis=0) - slider)
    np.testing.assert_allclose(places, [places[0]] * 3, atol=1e-12)


def test_a_film_lasts_as_its_speed_says(spinning: Path) -> None:
    result = Result(spinning)
    assert plan(result, 25.0, None, None, None).speed == 1.0
    assert plan(result, 25.0, None, None, None).times == pytest.approx(np.arange(76) / 25.0)
    assert plan(result, 25.0, 0.5, 1.0, 2.0).times == pytest.approx(1.0 + np.arange(51) / 50.0)
    assert plan(result, 25.0, None, 0.0, 0.5).speed == 0.05  # 10 s, at most 6 at the next step
    assert plan(result, 25.0, 0.5, 0, 1).words == "2 times slower"
    assert plan(result, 25.0, 4.0, 0, 1).words == "4 times faster"


@pytest.mark.seconds
def test_a_rotation_that_the_frames_show_otherwise_is_reported(
    spinning: Path, tmp_path: Path
) -> None:
    """Ten turns a second: 144 degrees between frames at 25 a second, 72 at half the speed."""
    with pytest.warns(FlexmbWarning, match="144 degrees between two frames.*speed = 0.5"):
        film(spinning, tmp_path / "a.gif", end=0.2, speed=1, **SMALL)
    film(spinning, tmp_path / "b.gif", end=0.1, speed=0.5, **SMALL)  # warnings are errors here


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"speed": 0.0}, "above 0"),
        ({"speed": -1.0}, "above 0"),
        ({"speed": float("nan")}, "above 0"),
        ({"speed": 1e-9}, "frames and last"),
        ({"speed": 1e6}, "less than a frame"),
        ({"fps": 0}, "1 to 240"),
        ({"fps": 1e4}, "1 to 240"),
        ({"fps": float("nan")}, "1 to 240"),
        ({"start": -1.0}, "outside the run"),
        ({"end": 99.0}, "outside the run"),
        ({"end": float("nan")}, "a finite number is expected"),
        ({"start": 0.01, "end": 0.005}, "nothing moves"),
        ({"follow": "slidder"}, "nearest: slider"),
        ({"traces": ["rodd"]}, "nearest: rod"),
        ({"traces": ["rod.big_ned"]}, "big_end"),
        ({"color": "stress"}, "displacement"),
        ({"layer": "top"}, "von_mises"),
        ({"exaggeration": -1.0}, "zero or positive"),
        ({"size": (10, 10)}, "from 64 on"),
        ({"processes": 0}, "processes"),
        ({"output": "a.avi"}, ".mp4 or .gif"),
    ],
)
def test_bad_options_are_refused(run: Path, tmp_path: Path, options: dict, words: str) -> None:
    output = tmp_path / options.pop("output", "a.gif")
    with pytest.raises(FlexmbError, match=words):
        film(run, output, **{**SMALL, **options})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.seconds
def test_what_exists_is_replaced_only_by_force(run: Path, tmp_path: Path) -> None:
    few = {"end": 0.004, "speed": 0.02, **SMALL}
    path = tmp_path / "a.gif"
    path.write_bytes(b"mine")
    with pytest.raises(ViewError, match="--force"):
        film(run, path, **few)
    assert path.read_bytes() == b"mine"
    assert film(run, path, force=True, **few).stat().st_size > 1000
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "frame_99999.png").write_bytes(b"old")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(ViewError, match="--force"):
        film(run, folder, **few)
    film(run, folder, force=True, **few)
    assert (folder / "notes.txt").read_text() == "mine"
    assert not (folder / "frame_99999.png").exists()
    assert (folder / "frame_00001.png").exists()


@pytest.mark.parametrize("name", ["a.gif", "a.mp4", "frames"])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_what_stops_leaves_nothing(tmp_path: Path, name: str, error: BaseException) -> None:
    if name.endswith("mp4") and encoder.find_ffmpeg() is None:
        pytest.skip("no encoder")

    def frames():
        for k in range(8):
            if k == 6:
                raise error
            yield np.full((64, 64, 3), 20 * k, dtype=np.uint8)

    expected = ViewError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected, match="No space left" if isinstance(error, OSError) else None):
        encoder.write_film(frames(), tmp_path / name, 25.0, samples=2)
    assert list(tmp_path.iterdir()) == []


def test_a_gif_shows_the_frames_that_were_written(tmp_path: Path) -> None:
    frames = []
    for k in (0, 1, 1, 4, 0):
        frame = np.full((60, 80, 3), 250, dtype=np.uint8)
        frame[10 : 20 + k, 10 * k : 10 * k + 15] = (200, 30 * k, 40)
        frames.append(frame)
    path = tmp_path / "a.gif"
    encoder.write_film([*frames[:4], *frames], path, 20.0, samples=4)
    with Image.open(path) as picture:
        shown = [np.asarray(f.convert("RGB"), int) for f in ImageSequence.Iterator(picture)]
        assert picture.info["duration"] == 50
    assert len(shown) == len(frames)
    for one, frame in zip(shown, frames, strict=True):
        assert np.abs(one - frame).max() < 12


def test_mp4_needs_its_encoder(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder, "find_ffmpeg", lambda: None)
    with pytest.raises(ViewError, match="pip install imageio-ffmpeg"):
        film(run, tmp_path / "a.mp4", **SMALL)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.seconds
def test_an_mp4_has_all_frames(run: Path, tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    span = Result(run).time[-1]
    path = film(run, tmp_path / "a.mp4", fps=20, speed=span / 0.5, size=(161, 91), processes=1)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert (frames, seconds) == (11, pytest.approx(0.55, abs=0.06))
    with pytest.raises(ViewError, match="--force"):
        film(run, path, **SMALL)


@pytest.mark.seconds
def test_a_machine_without_vtk_makes_a_simple_film(run: Path, tmp_path: Path, without_vtk) -> None:
    path = film(run, tmp_path / "a.gif", end=0.002, speed=0.02, **SMALL)
    assert Image.open(path).n_frames == 3


@pytest.mark.seconds
def test_a_process_that_ends_early_is_reported(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    schedule = plan(Result(run), 25.0, 0.02, 0.0, 0.01)
    shot = MotionShot(run.parent / "gone.h5", schedule, {}, (160, 90))
    with pytest.raises(FlexmbError, match="gone.h5"):
        list(draw_frames_in_parallel(shot, [0, 1], 2))


def test_frames_of_a_long_run_are_read_one_by_one(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Result(run)
    times = np.linspace(0.0, whole.time[-1], 7)
    poses = [whole.pose("rod", t) for t in times]
    monkeypatch.setattr(reader, "_READ_AT_ONCE", 0)
    lean = Result(run)
    for t, pose in zip(times, poses, strict=True):
        for own, other in zip(lean.pose("rod", t), pose, strict=True):
            assert (own == other).all()
    assert "q" not in lean._tables


@pytest.mark.seconds
def test_a_film_of_modes_swings_to_both_sides(run: Path, tmp_path: Path) -> None:
    body = run.parent / "rod.flexbody.h5"
    path = film_modes(body, 1, fps=4, size=(320, 180), processes=1, output=tmp_path / "m.gif")
    with Image.open(path) as picture:
        frames = [np.asarray(f.convert("RGB"), int) for f in ImageSequence.Iterator(picture)]
    assert len(frames) == 8  # one vibration in 2 s
    assert (np.abs(frames[1] - frames[7]).max(axis=2) > 40).mean() < 0.002
    assert (np.abs(frames[0] - frames[4]).max(axis=2) > 40).mean() > 0.01


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--speed", "0"], "above 0"),
        (["--follow", "slidder"], "nearest: slider"),
        (["--fps", "9999"], "frames per second"),
        (["--end", "7"], "outside the run"),
        (["--modes", "1"], "flexible body"),
        (["--output", "a.xyz"], ".mp4 or .gif"),
    ],
)
def test_the_command_refuses_in_one_sentence(run: Path, arguments: list, words: str) -> None:
    outcome = CliRunner().invoke(app, ["film", str(run), *arguments])
    assert outcome.exit_code == 2
    assert words in outcome.output
    assert "Traceback" not in outcome.output


@pytest.mark.seconds
def test_the_command_makes_a_film_and_does_not_replace_it(run: Path, tmp_path: Path) -> None:
    arguments = ["film", str(run.parent), "-o", str(tmp_path / "a.gif"), "--size", "160x90"]
    arguments += ["--speed", "0.05", "--end", "0.01", "--trace", "slider,rod.big_end"]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    assert f"written: {tmp_path / 'a.gif'}" in outcome.output
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 2
    assert "--force" in outcome.output
