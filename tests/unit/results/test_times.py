"""Times on the command line and in Python are read as in scenes: with units, by parameters."""

from __future__ import annotations

import numpy as np
import pytest
from restscenes import G
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError, ResultFileError, SceneError
from flexmb.model import Model
from flexmb.model.scenes.parameters import read_quantity, read_span, read_times
from flexmb.view.film import plan


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A pendulum for 0.6 s in millimetres, seconds, with a parameter."""
    made = Model("swing", units="mm-t-s", gravity=[0, -1000 * G, 0], parameters={"beat": 0.2})
    made.add_body("bar", mass=2e-3, center=[0, -500, 0], inertia=[200, 200, 300],
                  angular_velocity=[0, 0, 3])  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    made.add_force("push", "force", at="bar", value=["t", 0, 0])
    made.add_sensor("turn", "angle", joint="pin")
    path = tmp_path_factory.mktemp("swing") / "result.h5"
    flexmb.simulate(made, duration=0.6, outputs=6, step=1e-3, verify=False, output=path)
    return flexmb.load_result(path)


def call(*words):
    done = CliRunner().invoke(app, [*map(str, words)])
    return done.exit_code, " ".join(done.output.split())


def test_numbers_units_and_parameters(swing):
    scene = swing.model
    for text, value in ((0.3, 0.3), ("0.3", 0.3), ("300 ms", 0.3), ("beat/2", 0.1)):
        assert read_quantity(scene, text, "time", "s") == value
    assert read_times(scene, "100 ms, min(beat, 1),0.3") == [0.1, 0.2, 0.3]
    assert read_times(scene, [0.1, "200 ms"]) == [0.1, 0.2]
    assert read_span(scene, "100 ms..beat*2") == (0.1, 0.4) == read_span(scene, (0.1, "400 ms"))
    assert swing.row_at("250 ms") == (2, pytest.approx(0.5))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("30 mm", 'time: a time [s] is expected, given "30 mm"'),
        ("30ms", '"30ms" is written "30 ms"'),
        ("2*bet", 'time: unknown name "bet"'),
        ("", "time: "),
        ("0.1,,0.2", "time: "),
    ],
)
def test_what_is_no_time_is_told(swing, text, said):
    with pytest.raises(SceneError) as caught:
        read_times(swing.model, text)
    assert said in str(caught.value)


def test_all_that_is_wrong_is_told_at_once(swing):
    with pytest.raises(SceneError) as caught:
        read_times(swing.model, "1 kg, 0.1, 1 mm")
    assert str(caught.value).count("a time [s] is expected") == 2
    for text in ("0.1", "..0.2", "0.1..", "0.1..0.2..0.3"):
        with pytest.raises(SceneError, match="must be two times"):
            read_span(swing.model, text)
    with pytest.raises(SceneError, match="20 s to 0.4 s do not; each end has a unit of its own"):
        read_span(swing.model, "20..400 ms")


def test_python_takes_them_too(swing, tmp_path):
    assert flexmb.linearize(swing, time="300 ms").time == pytest.approx(0.3)
    assert plan(swing, 25.0, None, "100 ms", "0.5").times[0] == 0.1
    picture = flexmb.render(swing, "100 ms,0.2", output=tmp_path / "a.png", size=(320, 160))
    assert picture.stat().st_size > 1000
    with pytest.raises(SceneError, match="start: a time"):
        plan(swing, 25.0, None, "100 mm", None)
    np.testing.assert_array_equal(swing.pose("bar", "100 ms").r, swing.pose("bar", 0.1).r)


def test_a_state_is_that_of_the_nearest_output_and_lies_within_the_run(swing):
    assert flexmb.linearize(swing, time=0.6 * (1 + 1e-12)).time == pytest.approx(0.6)
    assert flexmb.linearize(swing, time=0.26).time == pytest.approx(0.3)
    with pytest.raises(ResultFileError, match="t = 7 s lies outside the run"):
        flexmb.linearize(swing, time=7)


@pytest.mark.parametrize(
    "words",
    [
        ["render", "RUN", "--time", "30 mm", "-o", "a.png"],
        ["film", "RUN", "--end", "30 mm", "-o", "a.gif"],
        ["plot", "RUN", "turn", "--times", "30 mm..1", "-o", "a.png"],
        ["modes", "RUN", "--time", "30 mm"],
        ["response", "RUN", "--time", "30 mm", "--input", "push.x", "--sensor", "turn"],
        ["resume", "RUN", "--duration", "30 mm"],
    ],
)
def test_every_command_refuses_what_is_no_time(swing, tmp_path, words):
    told = [swing.path.parent if word == "RUN" else word for word in words]
    code, said = call(*(tmp_path / w if str(w).startswith("a.") else w for w in told))
    assert code == 2 and 'a time [s] is expected, given "30 mm"' in said, said


def test_every_command_takes_units(swing, tmp_path):
    run = swing.path.parent
    for words in (
        ["render", run, "--time", "0.1,200 ms", "--size", "320x160", "-o", tmp_path / "a.png"],
        ["plot", run, "turn", "--times", "100 ms..500 ms", "-o", tmp_path / "a.svg"],
        ["modes", run, "--time", "beat"],
    ):
        code, said = call(*words)
        assert code == 0, said
    assert "at t = 0.2 s" in said


def test_an_equilibrium_over_times_with_units(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'units = "mm-t-s"\n[bodies.cart]\nmass = 1e-3\ninertia = [1, 1, 1]\n'
        '[joints.rail]\ntype = "prismatic"\nbetween = ["ground", "cart"]\naxis = "x"\n'
        '[forces.spring]\ntype = "translational-spring-damper"\njoint = "rail"\nstiffness = 2\n'
        '[forces.push]\ntype = "force"\nat = "cart"\nvalue = ["4*t", 0, 0]\n'
        '[sensors.s]\ntype = "stroke"\njoint = "rail"\n'
    )
    swept = flexmb.sweep_statics(scene, "time", ["100 ms", 0.5])
    np.testing.assert_allclose(swept.values, [0.1, 0.5], rtol=1e-14)
    code, said = call(
        "statics", scene, "--vary", "time=0 ms..500 ms:3", "--table", tmp_path / "a.csv"
    )
    assert code == 0 and "0.25" in said, said
    last = (tmp_path / "a.csv").read_text().splitlines()[-1].split(",")
    assert float(last[0]) == 0.5 and float(last[-1]) == pytest.approx(1.0)
    assert "not of the form" in call("statics", scene, "--vary", "time=0 ms..1 s:3")[1]
    with pytest.raises(FlexmbError, match='a plain number is expected, given "3 mm"'):
        flexmb.sweep_modes(scene, "push", ["3 mm"])
