"""Sweeps of machines whose answers are known, from end to end."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from ishigami import ishigami, ishigami_indices
from scipy import stats
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import SceneError
from flexmb.studies.record_table import read_rows
from flexmb.studies.sweeps import sweep_report
from flexmb.studies.sweeps.sweep_runs import scalar_value

PROJECTILE = """
title = "Projectile"
gravity = [0, "-g", 0]
[parameters]
g = 9.80665
v = 20
angle = 0.7
x1 = 1
x2 = 1
x3 = 1
[bodies.ball]
mass = 2
inertia = [0.01, 0.01, 0.01]
velocity = ["v*cos(angle)", "v*sin(angle)", 0]
[sensors]
ball = { type = "position", of = "ball" }
speed = { type = "velocity", of = "ball" }
ishigami = { type = "expression", value = "sin(x1) + 7*sin(x2)**2 + 0.1*x3**4*sin(x1) + 0*ball.z" }
[dynamics]
duration = "2*v*sin(angle)/g"
step = "v*sin(angle)/g/20"
outputs = 40
"""
RANGE = "ball.x:final"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(PROJECTILE, encoding="utf-8")
    return path


def sweep(scene: Path, vary: dict[str, object], **settings: object) -> flexmb.Sweep:
    options = {"workers": 1, "output": scene.parent / "sweep", **settings}
    return flexmb.sweep(scene, vary, **options)  # type: ignore[arg-type]


def reach(v, angle=0.7, g=9.80665):
    return v**2 * np.sin(2 * angle) / g


def test_statistics_of_the_range_of_a_projectile(scene: Path) -> None:
    made = sweep(
        scene, {"v": "uniform(18, 22)"}, samples=32, sensors=[RANGE, "ball.y:max", "speed"]
    )
    np.testing.assert_allclose(made[RANGE], reach(made["v"]), rtol=1e-9)
    top = (made["v"] * np.sin(0.7)) ** 2 / (2 * 9.80665)
    np.testing.assert_allclose(made["ball.y:max"], top, rtol=1e-9)  # at the middle output
    np.testing.assert_allclose(made["speed:max"], made["v"], rtol=1e-9)  # of the vector
    one = made.statistics(RANGE)
    for quantile in one.quantiles:  # the range grows with the speed
        exact = reach(stats.uniform(18, 4).ppf(quantile.share))
        assert abs(quantile.value - exact) < 0.02 * exact
    mean = reach(1.0) * (22**3 - 18**3) / 12
    assert abs(one.mean - mean) < 1e-3 * mean
    assert one.mean_interval[0] < mean < one.mean_interval[1]
    largest, least = made.extremes(RANGE, 1)
    assert made["v"][largest[0]] == made["v"].max()
    assert made["v"][least[0]] == made["v"].min()


def test_the_command_of_a_worst_case_repeats_it_to_the_last_bit(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(scene.parent)
    made = sweep(
        scene, {"v": "normal(20, 1)", "bodies.ball.mass": "1..3"}, samples=4, sensors=[RANGE]
    )
    run = made.extremes(RANGE, 1)[0][0]
    words = shlex.split(made.command(run))
    assert words[:2] == ["flexmb", "run"]
    assert CliRunner().invoke(app, [*words[1:], "--no-picture"]).exit_code == 0
    result = flexmb.load_result(words[-1])
    assert result["ball.x"][-1] == made[RANGE][run]


def test_derivatives_and_shares_of_the_variance(scene: Path) -> None:
    made = sweep(
        scene, {"v": "normal(20, 0.1)", "angle": "normal(0.7, 0.01)"}, method="derivatives",
        sensors=[RANGE],
    )  # fmt: skip
    v, angle = made.derivatives(RANGE)
    exact = 2 * reach(20) / 20, 2 * 20**2 * np.cos(1.4) / 9.80665
    assert v.value == pytest.approx(exact[0], rel=1e-6)
    assert angle.value == pytest.approx(exact[1], rel=1e-6)
    parts = (exact[0] * 0.1) ** 2, (exact[1] * 0.01) ** 2
    assert v.share == pytest.approx(parts[0] / sum(parts), rel=1e-3)


def test_failed_runs_are_listed_and_left_out(scene: Path) -> None:
    made = sweep(scene, {"bodies.ball.mass": "-1..3:5", "v": [20, 21]}, sensors=[RANGE])
    assert len(made) == 10
    assert len(made.failures) == 4
    run, reason = made.failures[0]
    assert made.settings[run] == {"bodies.ball.mass": -1.0, "v": 20}
    assert "bodies.ball.mass: must be positive, is -1 kg" in reason
    assert made.statistics(RANGE).runs == 6
    assert any("4 of 10 runs failed" in line for line in made.summary())
    tables = {table.title: table for table in made.tables()}
    assert len(tables["Failed runs"].rows) == 4


def test_runs_are_used_again_and_more_samples_continue(scene: Path) -> None:
    knobs = {"v": "uniform(18, 22)"}
    first = sweep(scene, knobs, samples=4, sensors=[RANGE])
    more = sweep(scene, knobs, samples=8, sensors=[RANGE])
    assert (first.reused, more.reused) == (0, 4)
    np.testing.assert_array_equal(more[RANGE][:4], first[RANGE])
    rows = read_rows(scene.parent / "sweep" / "runs.parquet")
    assert len(rows) == 8
    other = sweep(scene, knobs, samples=4, sensors=["ball.y:max", RANGE])
    assert other.reused == 0  # they lack a scalar
    assert np.isfinite(other["ball.y:max"]).all()
    assert {"v", RANGE, "status", "reason", "notes", "seconds"} <= set(rows.column_names)
    scene.write_text(PROJECTILE.replace("mass = 2", "mass = 3"), encoding="utf-8")
    with pytest.raises(flexmb.FlexmbError, match="holds runs of another scene"):
        sweep(scene, knobs, samples=8, sensors=[RANGE])
    assert sweep(scene, knobs, samples=4, sensors=[RANGE], fresh=True).reused == 0


@pytest.mark.slow
def test_which_speed_reaches_how_far(scene: Path) -> None:
    """v = sqrt(g x / sin 2 angle); one file of a table for all runs."""
    made = sweep(scene, {"v": "10..30"}, find=[f"{RANGE} <= 50"])
    assert made.answer is not None
    [setting] = made.answer.settings
    assert setting["v"] == pytest.approx(np.sqrt(50 * 9.80665 / np.sin(1.4)), rel=1e-7)
    assert f"{RANGE} <= 50 for v from 10 to 22.3" in made.answer.sentences[0]
    best = sweep(scene, {"angle": "0.2..1.4"}, find=[f"maximise {RANGE}"], fresh=True)
    assert best.answer is not None
    assert best.answer.settings[0]["angle"] == pytest.approx(np.pi / 4, abs=1e-3)
    never = sweep(scene, {"v": "10..30"}, find=["ball.x:final >= 1 km"], fresh=True)
    assert never.answer is not None
    assert not never.answer.settings
    assert "no v from 10 to 30 gives ball.x:final >= 1 km" in never.answer.sentences[0]


def test_channels_at_rest_are_left_out_unless_they_are_named(scene: Path) -> None:
    made = sweep(scene, {"v": [18, 22]})
    assert "ball.x:max" in made.scalars
    assert not [name for name in made.scalars if name.startswith(("ball.z", "speed.z"))]
    idle = sweep(scene, {"v": [18, 22]}, sensors=["ball.z:max"])
    assert idle.scalars == ("ball.z:max",)
    assert idle.summary()[-1].startswith("no result differs by more than round-off")


@pytest.mark.slow
def test_files_of_a_sweep(scene: Path) -> None:
    made = sweep(scene, {"v": "uniform(18, 22)", "angle": "0.6..0.9"}, samples=16, sensors=[RANGE])
    names = {path.name for path in made.save()}
    assert names == {
        "runs.parquet", "sweep.md", "histograms.png", "scatter.png", "surfaces.png", "parallel.png"
    }  # fmt: skip
    text = (made.folder / "sweep.md").read_text(encoding="utf-8")
    assert "## Statistics" in text
    assert flexmb.report(made.folder).is_file()


def test_a_scene_with_a_sweep_is_written_and_read_again(scene: Path) -> None:
    table = '[sweep]\nvary = { v = "normal(v, v/3)", angle = "0.1..0.7*angle:7", x1 = [1, 2] }\n'
    scene.write_text(PROJECTILE + table, encoding="utf-8")
    model = flexmb.load_scene(scene)
    again = flexmb.Model.from_scene_dict(model.to_scene_dict(scene.parent), scene.parent)
    assert again.sweep == model.sweep


@pytest.mark.slow
def test_sensitivities_of_an_expression_over_parameters(scene: Path) -> None:
    """Ishigami as a sensor; its closed form is known."""
    made = sweep(
        scene, dict.fromkeys(("x1", "x2", "x3"), "uniform(-pi, pi)"), method="saltelli",
        samples=256, sensors=["ishigami:final"], overrides={"dynamics.outputs": 1},
    )  # fmt: skip
    x = np.stack([made[name] for name in ("x1", "x2", "x3")], axis=1)
    np.testing.assert_allclose(made["ishigami:final"], ishigami(x), rtol=1e-12, atol=1e-12)
    first, total = ishigami_indices()
    for one, exact, whole in zip(made.sobol_indices("ishigami:final"), first, total, strict=True):
        assert abs(one.first - exact) < 0.17  # three times the deviation of so few samples
        assert abs(one.total - whole) < 0.17


def test_all_mistakes_at_once_and_nothing_run(scene: Path) -> None:
    with pytest.raises(SceneError) as error:
        sweep(
            scene, {"vv": "1..2", "angle": "0.6..0.9", "bodies.ball.mas": [1]},
            sensors=["bal.x:max"], find=["ball.x:final = 3 kg"],
        )  # fmt: skip
    text = str(error.value)
    for what in (
        'the scene has no knob "vv"; nearest: v',
        'sensors[0]: there is no channel "bal.x"; nearest: ball.x',
        "find[0]: a length [m] is expected",
    ):
        assert what in text
    assert not (scene.parent / "sweep").exists()


def test_pictures_show_knobs_in_the_unit_that_the_scene_states(scene: Path) -> None:
    text = PROJECTILE.replace("angle = 0.7", "angle = '40 deg'")
    assert text != PROJECTILE
    scene.write_text(text, encoding="utf-8")
    vary = {"angle": "30 deg..60 deg", "v": "10..20"}
    made = sweep(scene, vary, samples=16, sensors=["ball.x:final"])
    figure = sweep_report.PICTURES["scatter"](made)
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert "angle [deg]" in labels and "v" in labels
    shown = figure.axes[labels.index("angle [deg]")].lines[0].get_xdata()
    np.testing.assert_allclose(np.sort(shown), np.sort(np.degrees(made["angle"])))
    surface = sweep_report.PICTURES["surfaces"](made).axes[0]
    assert "angle [deg]" in (surface.get_xlabel(), surface.get_ylabel())


def test_a_knob_stands_in_the_unit_that_the_scene_states_of_it(scene: Path) -> None:
    """In tables, answers and commands, as in pictures: angles of degrees were told in radians."""
    scene.write_text(PROJECTILE.replace("angle = 0.7", 'angle = "40 deg"'), encoding="utf-8")
    made = sweep(scene, {"angle": "30 deg..40 deg:3"}, sensors=[RANGE])
    (extremes,) = (table for table in made.tables() if table.title == "Extremes")
    assert [row[-1] for row in extremes.rows] == ["angle = 40 deg", "angle = 30 deg"]
    for run in range(3):
        change = shlex.split(made.command(run))[4]
        again = flexmb.simulate(flexmb.load_scene(scene, dict([change.split("=")])))
        assert change.endswith(" deg")
        assert again["ball.x"][-1] == made[RANGE][run]  # to the last bit
    assert reach(20, np.radians(35)) == pytest.approx(made[RANGE][1], rel=1e-6)
    slopes = sweep(scene, {"angle": "30 deg..40 deg"}, sensors=[RANGE], method="derivatives",
                   output=scene.parent / "slopes")  # fmt: skip
    (table,) = (one for one in slopes.tables() if one.title.startswith("Derivatives"))
    per_degree = 2 * 20**2 * np.cos(2 * np.radians(35)) / 9.80665 * np.pi / 180
    assert table.rows[0][1] == "angle [deg]"
    assert float(table.rows[0][2]) == pytest.approx(per_degree, rel=1e-4)
    assert float(table.rows[0][4]) == pytest.approx(10 / 12**0.5, rel=1e-3)
    ask = {"find": [f"{RANGE} = {reach(20, np.radians(35)):.6f}"], "output": scene.parent / "ask"}
    found = sweep(scene, {"angle": "30 deg..40 deg"}, **ask).summary()
    assert found[0].endswith(" deg")
    assert float(found[0].split()[-2]) == pytest.approx(35, abs=1e-4)
    assert "at angle = 30 deg and" in found[1]


CART = """
title = "Cart"
[parameters]
k = 400
c = 4
[bodies.cart]
mass = 2
inertia = [0.01, 0.01, 0.01]
[joints]
rail = { type = "prismatic", between = ["ground", "cart"], axis = "x" }
[forces]
pull = { type = "force", at = "cart", value = [10, 0, 0] }
spring = { type = "translational-spring-damper", joint = "rail", stiffness = "k", damping = "c" }
[sensors]
x = { type = "position", of = "cart" }
[dynamics]
duration = 3
outputs = 300
accuracy = 1e-8
"""


def overshoot(k=400.0, c=4.0, m=2.0, force=10.0):
    """The largest displacement of a cart that is pulled at once."""
    ratio = c / (2.0 * np.sqrt(k * m))
    return force / k * (1.0 + np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)))


def test_an_extreme_is_that_of_the_motion_between_the_rows(tmp_path):
    """Of rows alone it is 0.2 % low, its derivative 3 % off."""
    path = tmp_path / "scene.toml"
    path.write_text(CART, encoding="utf-8")
    done = sweep(path, {"c": [2, 4, 8]}, sensors=["x.x:max"])
    rows = {row["c"]: row["x.x:max"] for row in read_rows(done.folder / "runs.parquet").to_pylist()}
    for c, value in rows.items():
        assert value == pytest.approx(overshoot(c=c), rel=2e-5)


def test_extremes_of_rows():
    t = np.linspace(0.0, 2.0, 41)
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 2.0, 60))
    for times in (t, uneven):
        x = np.cos(3.0 * (times - 0.813)) + 0.2
        assert scalar_value("max", times, x) == pytest.approx(1.2, abs=3e-4)
        assert scalar_value("peak", times, -x) == pytest.approx(1.2, abs=3e-4)
        assert scalar_value("min", times, -x) == pytest.approx(-1.2, abs=3e-4)
        assert scalar_value("peak-to-peak", times, x) <= 2.0
    kink, spike, step = np.abs(t - 0.813), np.where(t == t[20], 5.0, t), 1.0 * (t > 0.9)
    for x in (kink, -kink, -kink - 0.1 * kink**2, spike, step, t, -t, t[:3], 0.0 * t, t * t):
        for word, wanted in (("max", x.max()), ("min", x.min())):
            assert scalar_value(word, t[: len(x)], x) == wanted
