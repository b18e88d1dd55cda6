"""Pictures have the size that was asked for, show something, and differ where they should."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import slidercrank

from flexmb import load_result, run_scene, simulate
from flexmb.errors import ViewError
from flexmb.model import Model
from flexmb.results import Result
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism
from flexmb.view.picture import render


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return Result(slidercrank.make(tmp_path_factory.mktemp("run")))


def _pixels(path: Path) -> np.ndarray:
    return matplotlib.image.imread(path)[:, :, :3]


def _drawn(picture: np.ndarray) -> np.ndarray:
    """Which pixels differ from the background."""
    return np.abs(picture - picture[2, 2]).max(axis=2) > 0.1


@pytest.mark.seconds
def test_the_picture_shows_the_mechanism(result: Result, tmp_path: Path, drawn_by: str) -> None:
    picture = _pixels(render(result, output=tmp_path / "a.png", size=(800, 450)))
    assert picture.shape[:2] == (450, 800)
    inside = _drawn(picture)[90:400, 40:690]
    assert 0.02 < inside.mean() < 0.5
    columns = np.flatnonzero(inside.any(axis=0))
    assert columns[-1] - columns[0] > 0.7 * 650  # the view is fitted to the mechanism
    yellow = (picture[:, :700, 0] > 0.7) & (picture[:, :700, 2] < 0.3) & (picture[:, :700, 1] > 0.6)
    assert yellow.any()  # the top of the scale, on the rod


@pytest.mark.seconds
def test_time_and_exaggeration_change_the_picture(result, tmp_path: Path, drawn_by: str) -> None:
    small = {"size": (400, 225)}
    first = _pixels(render(result, 0.004, output=tmp_path / "a.png", **small))
    later = _pixels(render(result, 0.012, output=tmp_path / "b.png", **small))
    plain = _pixels(render(result, 0.004, output=tmp_path / "c.png", exaggeration=1, **small))
    assert (_drawn(first) != _drawn(later)).mean() > 0.01
    assert (_drawn(first) != _drawn(plain)).mean() > 0.005


@pytest.mark.seconds
def test_the_simple_picture_says_what_is_missing(result, tmp_path: Path, without_vtk) -> None:
    picture = _pixels(render(result, output=tmp_path / "a.png", size=(800, 450)))
    assert _drawn(picture)[-30:].mean() > 0.005


def test_a_relative_direction_or_option_that_cannot_be_is_refused(result, tmp_path: Path) -> None:
    for options in (
        {"color": "stress"},
        {"exaggeration": "much"},
        {"exaggeration": -1.0},
        {"size": (10, 10)},
        {"output": tmp_path / "a.jpg"},
        {"output": tmp_path},
    ):
        with pytest.raises(ViewError):
            render(result, **{"output": tmp_path / "a.png", **options})
    assert list(tmp_path.iterdir()) == []


def test_springs_massless_links_and_driven_distances_are_drawn_between_their_markers() -> None:
    model = Model("lines")
    model.add_marker("ground.up", position=[0, 2, 0])
    for k, x in enumerate((1.0, 2.0, 3.0)):
        model.add_body(f"b{k}", mass=1, inertia=[1, 1, 1], position=[x, 0, 0])
    model.add_joint("link", "distance", between=["ground.up", "b0"])
    model.add_driver("cylinder", between=["ground.up", "b1"], distance="sqrt(8) + 0.1*t")
    model.add_force("spring", "spring-damper", between=["ground.up", "b2"], stiffness=1)
    run = simulate(model, duration=0.1, step=0.01)
    solids = Drawing(Mechanism(run, 0.0)).content().solids
    ends = {}
    for name, at in (("link", 1.0), ("cylinder", 2.0), ("spring", 3.0)):
        points = np.vstack([solid.points for solid in solids if solid.name == name])
        ends[name] = np.linalg.norm(points - [at, 0, 0], axis=1).min()
        assert np.linalg.norm(points - [0, 2, 0], axis=1).min() < 0.1
    assert max(ends.values()) < 0.1


@pytest.mark.seconds
def test_an_exaggerated_body_stays_on_its_joints(tmp_path: Path) -> None:
    scene = Path(__file__).parents[2] / "cases/flexible_four_bar/scene.toml"
    run = run_scene(scene, output=tmp_path, pictures=False)
    mechanism = Mechanism(load_result(run.result), 0.4395)
    points, undeformed, displacement = mechanism.surface("coupler", 50.0)
    assert displacement.max() > 1e-3
    for joint in ("coupler.A", "coupler.B"):
        pin = mechanism.point(joint)
        assert np.linalg.norm(undeformed - pin, axis=1).min() < 0.02
        assert np.linalg.norm(points - pin, axis=1).min() < 0.02
