"""Outputs at listed times: those and no others, as true as at equal intervals, by every method."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from samebytes import assert_same_bytes

import flexmb
from flexmb.analysis.dynamics import integration as module
from flexmb.errors import SceneError
from flexmb.model import Model

SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"
TURN, R, L = 0.04, 0.15, 0.45
UNEVEN = [0.0, 1e-5, 1.1e-5, 0.0013, 0.01, "0.3*turn", "13 ms", 0.02, 0.0399, "turn"]
TIMES = np.array([0.0, 1e-5, 1.1e-5, 0.0013, 0.01, 0.3 * TURN, 0.013, 0.02, 0.0399, TURN])
STEPS = {
    "explicit-rk": {"accuracy": 1e-6},
    "radau": {"accuracy": 1e-5},
    "generalized-alpha": {"accuracy": 1e-4, "verify": False},
    "generalized-alpha, fixed": {"step": "turn/1500"},
    "radau, fixed": {"step": "turn/700"},
}
pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def scene(outputs, method="explicit-rk", **fields) -> Model:
    knobs = {"duration": "turn", "outputs": outputs, "method": method.partition(",")[0]}
    model = flexmb.load_scene(SCENE)
    model.checks.clear()
    model.set_dynamics(**{**knobs, **(fields or STEPS[method])})
    return model


@pytest.mark.parametrize("method", STEPS)
def test_rows_are_those_of_the_list_and_true(method: str) -> None:
    run = flexmb.simulate(scene(UNEVEN, method))
    np.testing.assert_allclose(run.time, TIMES, rtol=1e-14)
    angle = 2 * np.pi / TURN * TIMES
    x = R * np.cos(angle) + np.sqrt(L**2 - (R * np.sin(angle)) ** 2)
    np.testing.assert_allclose(run["slider.x"], x, atol=2e-6)
    np.testing.assert_allclose(run["crank_angle"], angle, atol=1e-12)
    assert run.drift.max(axis=0)[0] < 1e-11
    dense = flexmb.simulate(scene(4000, method))  # every listed time is one of its rows
    at = np.rint(TIMES / 1e-5).astype(int)
    listed = [k for k, time in enumerate(TIMES) if np.isclose(dense.time[at[k]], time, rtol=1e-12)]
    assert len(listed) == len(TIMES) - 1
    force = run.reaction("wrist_pin").force
    other = dense.reaction("wrist_pin").force[at]
    np.testing.assert_allclose(force[listed], other[listed], atol=2e-3 * np.abs(other).max())


def test_what_is_recorded_does_not_change_the_steps() -> None:
    """With fixed steps of a method without Newton's iterations to the last bit."""
    for method in ("explicit-rk", "generalized-alpha"):
        numbers = (1, 800, [0.007, "turn"])
        runs = [flexmb.simulate(scene(n, method, step="turn/800")) for n in numbers]
        for run in runs[1:]:
            assert run.statistics["steps"] == 800
            np.testing.assert_allclose(run.q[-1], runs[0].q[-1], rtol=0, atol=1e-12)
            if method == "explicit-rk":
                assert run.q[-1].tobytes() == runs[0].q[-1].tobytes()


def test_one_output_has_a_measured_error_and_full_statistics() -> None:
    run = flexmb.simulate(scene(["12 ms"], accuracy=1e-4))  # the time of the scene's picture
    dense = flexmb.simulate(scene(100, accuracy=1e-4))
    assert len(run.time) == 1
    name = "measured_error_of_positions"
    assert run.statistics[name] == pytest.approx(dense.statistics[name], rel=0.5)


@pytest.mark.slow
def test_many_times_within_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * 20)
    times = np.concatenate([np.linspace(0.01, 0.01001, 300), [0.0301, 0.031]])
    for fields in ({"step": "turn/400"}, {"accuracy": 1e-5}):
        run = flexmb.simulate(scene(times, **fields))
        np.testing.assert_allclose(run.time, times, rtol=1e-14)
        speed = 2 * np.pi / TURN
        np.testing.assert_allclose(run["crank_angle"], speed * times, atol=1e-11)


@pytest.mark.parametrize("fields", [{"step": "turn/2000"}, {"accuracy": 1e-3}], ids=str)
def test_a_resumed_run_keeps_its_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fields: dict[str, object]
) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * 150)
    path = Path(shutil.copy(SCENE, tmp_path / "scene.toml"))
    inside = np.sort(np.random.default_rng(3).uniform(0.0, TURN, 60)).tolist()
    times = [0.0, *inside, TURN]  # the scene's known answers are at both ends
    overrides = {f"dynamics.{key}": str(value) for key, value in fields.items()}
    overrides |= {"dynamics.outputs": str(times)}

    def interrupt(phase: str, share: float, detail: str = "") -> None:
        if phase == "integrate" and share > 0.3:
            raise KeyboardInterrupt

    whole = flexmb.simulate(flexmb.load_scene(path, overrides), output=tmp_path / "whole")
    part = flexmb.simulate(
        flexmb.load_scene(path, overrides), output=tmp_path / "part", progress=interrupt
    )
    assert part.status == "stopped"
    assert 0 < len(part.time) < len(times)
    assert_same_bytes(flexmb.resume(part).path, whole.path)
    with pytest.raises(SceneError, match="listed one by one"):
        flexmb.resume(part, duration=0.08)


def test_pictures_and_tables_of_uneven_rows(tmp_path: Path) -> None:
    run = flexmb.simulate(scene(UNEVEN), output=tmp_path)
    assert len(run.to_csv(tmp_path / "rows.csv").read_text().splitlines()) == 1 + len(TIMES)
    run.plot("slider.x", output=tmp_path / "plot.png")
    pose = run.pose("crank", 0.0399)
    assert pose.A[1, 0] == pytest.approx(np.sin(2 * np.pi * 0.0399 / TURN))


def test_the_scene_keeps_the_list(tmp_path: Path) -> None:
    model = scene(UNEVEN)
    again = Model.from_scene_dict(model.to_scene_dict())
    assert again.dynamics == model.dynamics
    assert again.dynamics.n_rows == len(UNEVEN)


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        ([0.0, 0.01, 0.01], r"outputs\[2\]: times must increase: 0.01 s does not lie after 0.01 s"),
        ([0.0, 0.05], r"outputs\[1\]: 0.05 s lies outside the run, which goes from 0 to 0.04 s"),
        ([-0.01, 0.02], r"outputs\[0\]: -0.01 s lies outside the run"),
        ([0.0, float("nan")], r"outputs\[1\]: a finite number is expected, given nan"),
        ([0.0, "3 mm"], r"outputs\[1\]: .*mm"),
        ([], "outputs: the list of output times is empty"),
        (10**8, "outputs: at most 10000000, is 1e\\+08"),
        (0, "outputs: a whole number from 1 on is expected"),
    ],
)
def test_mistakes_are_told_with_their_place(outputs: object, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(outputs)


def test_known_answers_where_nothing_is_recorded_are_told() -> None:
    model = flexmb.load_scene(SCENE)
    model.set_dynamics(duration="turn", outputs=[0.03, "turn"])
    problems = [str(problem) for problem in model.problems()]
    assert any("nothing is recorded at" in problem for problem in problems), problems


@pytest.mark.parametrize("knobs", [*STEPS.values(), {"step": 0.11, "method": "explicit-rk"}])
@pytest.mark.parametrize("outputs", [7, 13])
def test_the_last_row_is_at_the_end(outputs, knobs):
    """7 and 13 times a part of 1.7 s are 2e-16 s more."""
    made = Model("flight")
    made.add_body("ball", mass=1, inertia=[1] * 3, velocity=[1, 0, 0])
    step = {"step": 0.11} if "step" in knobs else {}
    result = flexmb.simulate(made, duration=1.7, outputs=outputs, **{**knobs, **step})
    assert result.time[-1] == 1.7
    assert result.time == pytest.approx(np.arange(outputs + 1) * 1.7 / outputs, abs=1e-15)
