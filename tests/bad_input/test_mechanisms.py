"""Mechanisms that cannot move as asked: `flexmb check` and `flexmb run` say so in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
from coldcache import cold_cache  # noqa: F401  a fixture
from mechanisms import crank_slider, four_bar, quick_return
from scenefiles import write_scene
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.model import Model


def conflicting() -> Model:
    """A crank-slider whose crank and slider are both driven, alike at the start only."""
    model = crank_slider("RSUT", driven=True)
    model.add_driver("push", joint="guide", stroke="0.1*sin(t)")
    return model


def out_of_reach() -> Model:
    model = quick_return("B")
    model.add_driver("push", joint="ram_guide", stroke="2 + t")
    return model


def on_the_wrong_branch() -> Model:
    model = Model("hinge")
    turned = {"axis": "x", "angle": 3.0}
    model.add_body("flap", mass=1, inertia=[1, 1, 1], orientation=turned)
    model.add_joint("hinge", "revolute", between=["ground", "flap"])
    return model


def of_no_direction() -> Model:
    model = Model("distance", gravity="none")
    for name in ("a", "b"):
        model.add_body(name, mass=1, inertia=[1, 1, 1])
    model.add_joint("rod", "distance", between=["a", "b"], length=1.0)
    return model


CASES = {
    "locked": (
        lambda: four_bar(tilt=0.2, driven=True),
        "drivers.motor: has nothing to drive: the mechanism is locked, its joints A, B, C, D "
        "prevent every motion; to free one motion exchange B: revolute -> spherical and C: "
        "revolute -> cylindrical",
    ),
    "conflicting drivers": (
        conflicting,
        "drivers.motor: drivers.motor and drivers.push, through joints bearing, pin, wrist, guide, "
        "prescribe the same motion, and contradict each other at t = ",
    ),
    "out of reach": (
        out_of_reach,
        "drivers.push: the joints close alone, but not in the pose asked for at t = 0: it is out "
        "of reach",
    ),
    "no direction": (of_no_direction, "assembly: the initial positions cannot be assembled"),
    "wrong branch": (
        on_the_wrong_branch,
        "joints.hinge: assembles with its sides turned against each other: axes that it makes "
        "equal are 171.9 deg apart as placed; turn a marker or body",
    ),
}


def scene(folder: Path, case: str) -> tuple[Path, str]:
    make, sentence = CASES[case]
    model = make()
    model.set_dynamics(duration=1, step=1e-3)
    return write_scene(model, folder / "scene.toml"), f"error: {sentence}"


@pytest.mark.parametrize("case", CASES)
def test_check(tmp_path: Path, case: str) -> None:
    path, sentence = scene(tmp_path, case)
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 2
    assert done.stderr.startswith(sentence), done.stderr


@pytest.mark.usefixtures("cold_cache")
@pytest.mark.parametrize("case", CASES)
def test_run(tmp_path: Path, case: str) -> None:
    """Before anything is compiled."""
    path, sentence = scene(tmp_path, case)
    done = CliRunner().invoke(app, ["run", str(path), "-o", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert sentence in done.stderr, done.stderr
