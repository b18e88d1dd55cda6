"""Splines and tables that do not cover the run are told when a scene is read, with their cure."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import flexmb
from flexmb.errors import SceneError
from flexmb.model import Model

SCENE = """
[bodies.cart]
mass = 1
inertia = [1, 1, 1]
[joints.rail]
type = "prismatic"
between = ["ground", "cart"]
axis = "x"
{what}
[dynamics]
duration = 1
step = 1e-2
"""
DRIVER = '[drivers.lead]\njoint = "rail"\nstroke = {{ {form} }}\n'
FORCE = '[forces.push]\ntype = "force"\nat = "cart"\nvalue = [0, {{ {form} }}, 0]\n'


def problem(tmp_path, what, **overrides):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(what=what))
    with pytest.raises(SceneError) as caught:
        flexmb.load_scene(path, overrides)
    return str(caught.value)


@pytest.mark.parametrize("form", ["table", "spline", "akima"])
@pytest.mark.parametrize(
    ("entry", "where"), [(DRIVER, "drivers.lead.stroke"), (FORCE, "forces.push.value[1]")]
)
def test_points_that_end_or_begin_within_the_run(tmp_path, form, entry, where):
    points = "points = [[0, 0], [0.2, 1], [0.4, 1], [0.6, 2], [0.7, 3]]"
    told = problem(tmp_path, entry.format(form=f'type = "{form}", {points}'))
    assert (
        f"{where}: its points end at 0.7 s, the run at 1 s; give more points, or say what holds"
        in told
    )
    points = "points = [[0.1, 0], [0.2, 1], [0.4, 1], [0.6, 2], [2, 3]]"
    told = problem(tmp_path, entry.format(form=f'type = "{form}", {points}'))
    assert f"{where}: its points begin at 0.1 s, the run at 0; give more points" in told


def test_a_file_that_ends_before_the_run(tmp_path):
    (tmp_path / "motion.csv").write_text("t,y\n0,0\n0.5,1\n")
    told = problem(tmp_path, DRIVER.format(form='type = "table", file = "motion.csv"'))
    assert "drivers.lead.stroke: its points end at 0.5 s, the run at 1 s" in told


@pytest.mark.parametrize("beyond", ["hold", "extrapolate", "repeat"])
def test_what_goes_on_is_no_mistake(tmp_path, beyond):
    points = f'points = [[0, 0], [0.2, 1], [0.5, 0]], beyond = "{beyond}"'
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(what=FORCE.format(form=f'type = "table", {points}')))
    assert not flexmb.load_scene(path).problems()


def test_points_to_the_very_end_are_no_mistake(tmp_path):
    points = 'type = "spline", points = [[0, 0], [0.3, 1], [0.7, 1], [1, 0]]'
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(what=DRIVER.format(form=points)))
    assert not flexmb.load_scene(path).problems()
    told = problem(
        tmp_path, DRIVER.format(form=points), **{"dynamics.duration": "1.1", "dynamics.step": "0.1"}
    )
    assert "its points end at 1 s, the run at 1.1 s" in told


def test_a_longer_run_is_refused_where_its_table_ends():
    model = Model("cart")
    model.add_body("cart", mass=1, inertia=[1, 1, 1])
    push = {"type": "table", "points": [[0, 0], [1, 1]]}
    model.add_force("push", "force", at="cart", value=[push, 0, 0])
    model.set_dynamics(duration=1, step=0.1, outputs=10)
    result = flexmb.simulate(model)
    with pytest.raises(SceneError, match="its points end at 1 s, the run at 2 s"):
        flexmb.resume(result, duration=2)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"dynamics.outputs": "1e9"}, "dynamics.outputs: at most 10000000, is 1e+09"),
        ({"dynamics.step": "1e-12"}, "dynamics.step: at most 1e+10 steps are run: at least"),
        ({"dynamics.step": "5e-324"}, "dynamics.step: is too small, 4.94066e-324 in SI"),
    ],
)
def test_a_run_without_an_end_is_refused(changes, sentence):
    scene = Path(__file__).parents[2] / "cases/pendulum/scene.toml"
    with pytest.raises(SceneError) as caught:
        flexmb.load_scene(scene, changes)
    assert sentence in str(caught.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are of POSIX")
def test_a_pipe_is_no_scene(tmp_path):
    """It would be waited for."""
    os.mkfifo(tmp_path / "scene.toml")
    with pytest.raises(SceneError, match=r"scene\.toml: is no file"):
        flexmb.load_scene(tmp_path / "scene.toml")
