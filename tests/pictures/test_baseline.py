"""Pictures look as they did when a person looked at them, coarsely: no part is lost or moved.

``python -m tests.pictures.test_baseline`` draws them anew; look at each before it is committed.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import slidercrank

from flexmb import simulate
from flexmb.model import Model
from flexmb.results import Result
from flexmb.view import vtk_renderer
from flexmb.view.picture import render

HERE = Path(__file__).parent / "baseline"
SIZE = 320, 180
_CELL = 10  # pixels of an edge over which colours are averaged
_APART, _WORST = 0.01, 0.2  # mean and largest difference of averaged colours, 0 to 1


def crank(folder: Path) -> Path:
    """A flexible slider-crank, exaggerated, coloured by displacement."""
    return render(Result(slidercrank.make(folder)), 0.004, output=folder / "p.png", size=SIZE)


def several_views(folder: Path) -> Path:
    """The same from two cameras with names and frames."""
    run = Result(slidercrank.make(folder))
    look = {"camera": ["front", "isometric"], "labels": "all", "frames": True}
    return render(run, 0.012, output=folder / "p.png", size=(640, 360), **look)


def forces(folder: Path) -> Path:
    """Springs, dampers, stops, a brake, a bushing and a contact plane."""
    model = Model("Forces", folder=folder, gravity=[0, 0, -9.81])
    for k in range(6):
        model.add_marker(f"ground.p{k}", position=[k, 0, 0])
        z = 0.0 if k == 2 else -0.4
        model.add_body(f"b{k}", mass=1, inertia=[0.02, 0.02, 0.02], position=[k, 0, z])
        model.add_marker(f"b{k}.top", position=[0, 0, -z])
    pair = [[f"ground.p{k}", f"b{k}.top"] for k in range(6)]
    model.add_joint("j0", "revolute", between=pair[0], axis="y")
    model.add_force("s0", "rotational-stop", joint="j0", lower=-0.5, upper=0.8, stiffness=1e3)
    model.add_joint("j1", "revolute", between=pair[1], axis="y")
    friction = {"dynamic": 0.2, "radius": 0.02, "stiffness": 1e5, "damping": 100}
    model.add_force("f1", "joint-friction", joint="j1", **friction)
    model.add_joint("j2", "prismatic", between=pair[2], axis="z")
    model.add_force("s2", "translational-stop", joint="j2", lower=-0.3, upper=0.3, stiffness=1e5)
    model.add_force("k3", "spring-damper", between=["ground.p3", "b3"], stiffness=90, damping=1)
    model.add_force("r4", "bushing", between=pair[4], stiffness=[1e3] * 3)
    model.add_marker("ground.floor", position=[5, 0, -0.6])
    model.add_force(
        "c5", "contact", between=["ground.floor", "b5"],
        shapes=[{"type": "plane", "axis": "z"}, {"type": "sphere", "radius": 0.1}], stiffness=1e5,
    )  # fmt: skip
    return render(simulate(model, duration=0.05, output=folder), 0.0, output=folder / "p.png",
                  size=SIZE)  # fmt: skip


PICTURES = {one.__name__: one for one in (crank, several_views, forces)}


def averaged(file: Path) -> np.ndarray:
    """Colours (rows, columns, 3) of a picture, 0 to 1, averaged over square cells."""
    picture = matplotlib.image.imread(file)[:, :, :3]
    rows, columns = (length // _CELL for length in picture.shape[:2])
    cut = picture[: rows * _CELL, : columns * _CELL]
    return cut.reshape(rows, _CELL, columns, _CELL, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_like_its_baseline(name: str, tmp_path: Path) -> None:
    if not vtk_renderer.probe().works:
        pytest.skip("VTK does not render on this machine")
    drawn, baseline = averaged(PICTURES[name](tmp_path)), averaged(HERE / f"{name}.png")
    apart = np.abs(drawn - baseline)
    assert apart.mean() < _APART and apart.max() < _WORST, (
        "look at it; then see the docstring above"
    )


if __name__ == "__main__":
    HERE.mkdir(exist_ok=True)
    for name, draw in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            (HERE / f"{name}.png").write_bytes(draw(Path(folder)).read_bytes())
