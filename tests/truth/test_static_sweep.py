"""Equilibria over a parameter: limit points, loss of stability and of equilibrium, closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError
from flexmb.model import Model

STIFFNESS, RISE = 1000.0, 0.4
LENGTH = math.hypot(1.0, RISE)

SCENE = """
[ground.markers]
left = { position = [-1, 0, 0] }
right = { position = [1, 0, 0] }
[bodies.top]
mass = 1.0
inertia = [1, 1, 1]
position = [0, 0.4, 0]
[joints.guide]
type = "prismatic"
between = ["ground", "top"]
axis = "y"
[forces.left]
type = "spring-damper"
between = ["ground.left", "top"]
stiffness = 1000
[forces.right]
type = "spring-damper"
between = ["ground.right", "top"]
stiffness = 1000
[forces.load]
type = "force"
at = "top"
value = [0, "-40*t", 0]
[sensors.top]
type = "position"
of = "top"
[statics]
"""


def truss(load: float | str) -> Model:
    """Two inclined springs (von Mises truss), pushed down by a load."""
    made = Model("truss")
    made.add_marker("ground.left", position=[-1, 0, 0])
    made.add_marker("ground.right", position=[1, 0, 0])
    made.add_body("top", mass=1.0, inertia=[1, 1, 1], position=[0, RISE, 0])
    made.add_joint("guide", "prismatic", between=["ground", "top"], axis="y")
    for side in ("left", "right"):
        made.add_force(
            side, "spring-damper", between=[f"ground.{side}", "top"], stiffness=STIFFNESS,
            free_length=LENGTH,
        )  # fmt: skip
    made.add_force("load", "force", at="top", value=[0, f"-({load})", 0])
    made.add_sensor("top", "position", of="top")
    return made


def column(load: float) -> Model:
    """An upright bar on a torsion spring of 12 N m, loaded at its end, 2 m up."""
    made = Model("column", gravity=[0, 0, 0])
    made.add_body("bar", mass=1.0, center=[0, 1, 0], inertia=[1, 1, 1])
    made.add_marker("bar.tip", position=[0, 2, 0])
    made.add_joint("foot", "revolute", between=["ground", "bar"], axis="z")
    made.add_force("spring", "rotational-spring-damper", joint="foot", stiffness=12.0)
    made.add_force("load", "force", at="bar.tip", value=[0, -load, 0])
    made.add_sensor("tilt", "angle", joint="foot")
    return made


def test_the_limit_load_of_a_truss_is_that_of_its_closed_form():
    # P(y) = 2 k y (l0/sqrt(1 + y^2) - 1) is largest where 1 + y^2 = l0^(2/3)
    y = math.sqrt(LENGTH ** (2 / 3) - 1)
    limit = 2 * STIFFNESS * y * (LENGTH / math.hypot(1, y) - 1)
    sweep = flexmb.sweep_statics(truss, "load", np.linspace(0, 40, 9))
    [event] = sweep.events
    assert event.kind == "limit point"
    assert event.low <= limit <= event.high
    assert event.high - event.low < 0.01
    assert sweep.stable.all()
    loads = -sweep["top.y"] * 2 * STIFFNESS * (1 - LENGTH / np.hypot(1, sweep["top.y"]))
    assert np.abs(loads - sweep.values).max() < 1e-9


@pytest.mark.seconds
def test_the_limit_point_over_time_is_that_over_the_load():
    over_load = flexmb.sweep_statics(truss, "load", np.linspace(0, 40, 9)).events[0]
    over_time = flexmb.sweep_statics(truss("40*t"), "time", np.linspace(0, 1, 9)).events[0]
    assert 40 * over_time.low == pytest.approx(over_load.low, abs=0.01)
    result = flexmb.statics
    with pytest.warns(flexmb.FlexmbWarning, match=r"between t = 0.55 s and 0.6 s the .* jumps"):
        result(truss("40*t"), duration=1.0, outputs=20)


def test_a_motion_that_is_only_fast_is_no_limit_point():
    smooth = flexmb.sweep_statics(truss, "load", [30.0, 40.0, 50.0, 400.0, 2000.0])
    assert smooth.events == ()
    assert flexmb.sweep_statics(truss, "load", [0.0, -500.0, -501.0, -5000.0]).events == ()


def test_a_column_loses_its_stability_at_its_buckling_load():
    sweep = flexmb.sweep_statics(column, "load", [0.0, 5.0, 10.0])
    [event] = sweep.events
    assert event.kind == "stability lost"
    assert event.low <= 12.0 / 2.0 <= event.high  # k/L
    assert event.high - event.low < 2e-3
    assert sweep.stable.tolist() == [True, True, False]
    about_foot = 1.0 + 1.0 * 1.0**2
    assert sweep.points[2].growth == pytest.approx(math.sqrt((20.0 - 12.0) / about_foot), rel=1e-6)


def test_an_equilibrium_that_vanishes_is_told_with_what_moves_on():
    def softening(load: float) -> Model:  # the spring's force has the maximum 5 N at 1 m
        made = Model("block")
        made.add_body("block", mass=1.0, inertia=[1, 1, 1])
        made.add_joint("guide", "prismatic", between=["ground", "block"], axis="x")
        made.add_force(
            "spring", "translational-spring-damper", joint="guide",
            spring_force="10*x/(1 + x**2)",
        )  # fmt: skip
        made.add_force("load", "force", at="block", value=[load, 0, 0])
        made.add_sensor("place", "position", of="block")
        return made

    sweep = flexmb.sweep_statics(softening, "load", [0.0, 2.0, 4.0, 8.0])
    [event] = sweep.events
    assert event.kind == "no equilibrium"
    assert event.low <= 5.0 <= event.high
    assert "bodies.block moves on along +x" in event.sentence
    assert sweep.values.tolist() == [0.0, 2.0, 4.0]


@pytest.mark.seconds
def test_the_command_writes_a_table_and_a_plot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("truss.toml").write_text(SCENE, encoding="utf-8")
    words = ["statics", "truss.toml", "--vary", "time=0..1:5", "-o", "a.svg", "--table", "a.csv"]
    run = CliRunner().invoke(app, words)
    assert run.exit_code == 0, run.output
    assert "limit point between time = " in run.output
    lines = Path("a.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("time [s],top.x [m]") and len(lines) == 6
    run = CliRunner().invoke(app, ["statics", "truss.toml"])
    assert run.output.count(" yes ") == 2, run.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--vary", "time=abc"], "is not of the form"),
        (["--vary", "lod=0,1"], "lod"),
        (["--output", "a.png"], "--vary computes"),
        (["--vary", "time=0..1:3", "-o", "a.txt"], "must end in .png"),
        (["--channels", "topp.x"], 'unknown channel of a sensor "topp.x"; nearest: top.x'),
    ],
)
def test_mistakes_are_said(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    Path("truss.toml").write_text(SCENE, encoding="utf-8")
    run = CliRunner().invoke(app, ["statics", "truss.toml", *words])
    assert run.exit_code == 2
    assert message in run.stderr


def test_a_model_in_memory_has_no_parameter():
    with pytest.raises(FlexmbError, match="a function that makes the model"):
        flexmb.sweep_statics(truss(1.0), "load", [1.0, 2.0])


HANGING = """
title = "Bar that is pulled aside"
gravity = [0, -9.81, 0]
parameters = { F = 5 }
[bodies.bar]
mass = 2
center = [0, -0.5, 0]
inertia = [0.1, 0.1, 0.1]
markers.end = { position = [0, -1, 0] }
[joints]
pin = { type = "revolute", between = ["ground", "bar"], axis = "z" }
[forces]
push = { type = "force", at = "bar.end", value = ["F", 0, 0] }
[sensors]
end = { type = "position", of = "bar.end" }
angle = { type = "angle", joint = "pin" }
zero = { type = "expression", value = "end.x - sin(angle)" }
[statics]
"""


def test_the_table_of_a_sweep_shows_no_round_off(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(HANGING)
    run = CliRunner().invoke(app, ["statics", str(path), "--vary", "F=0..20:5"])
    assert run.exit_code == 0, run.output
    assert "end.x" in run.output and "e-1" not in run.output


PIN = """
title = "pin"
plane = "xy"
gravity = [0, -9.81, 0]
[bodies.bar]
mass = 1.0
inertia = [1, 1, 1]
center = [0.5, 1.0, 0]
[joints.pin]
type = "revolute"
between = ["ground", "bar"]
axis = "z"
"""
STAY = """
[forces.stay]
type = "rotational-spring-damper"
joint = "pin"
stiffness = 50.0
"""


def test_a_scene_without_sensors_has_no_channels_to_draw(tmp_path, monkeypatch):
    """Empty axes were drawn."""
    monkeypatch.chdir(tmp_path)
    Path("pin.toml").write_text(PIN + STAY, encoding="utf-8")
    words = ["statics", "pin.toml", "--vary", "time=0,1"]
    run = CliRunner().invoke(app, [*words, "-o", "a.svg"])
    assert run.exit_code == 2 and "the scene has no sensor" in run.output, run.output
    assert not Path("a.svg").exists()
    assert CliRunner().invoke(app, words).exit_code == 0


@pytest.mark.parametrize(("center", "is_steady"), [("[0.5, 1.0, 0]", False), ("[0, 1, 0]", True)])
def test_growth_where_a_state_is_not_steady_is_no_instability(
    tmp_path, monkeypatch, center, is_steady
):
    """An inverted pendulum that leans begins to fall; upright it may stay, and is unstable."""
    monkeypatch.chdir(tmp_path)
    Path("pin.toml").write_text(PIN.replace("[0.5, 1.0, 0]", center), encoding="utf-8")
    run = CliRunner().invoke(app, ["modes", "pin.toml", "--about", "undeformed"])
    assert run.exit_code == 0, run.output
    said = " ".join(run.output.split())
    assert ("unstable: a mode grows by a factor of e in" in said) == is_steady
    assert ("does not show whether it is stable" in said) != is_steady
