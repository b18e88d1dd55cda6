"""The reference: two tight runs that agree, or no errors at all."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.model import Model
from flexmb.studies.accuracy.reference import ReferenceSearch
from flexmb.studies.channel_errors import History, RunHistories, difference
from flexmb.studies.study_settings import Setting

SCENE = {
    "bodies": {"b": {"mass": 1, "inertia": [1, 1, 1]}},
    "dynamics": {"duration": 1, "step": 0.1},
}
T = np.linspace(0.0, 1.0, 11)


def reading(error: float) -> RunHistories:
    """A ramp from 0 to 1, wrong by `error` at its end."""
    return RunHistories([History("positions", "s", "position", (T * (1 + error))[:, None])], [1.0])


def search(steps: tuple[float, ...] = (0.1, 0.02)) -> ReferenceSearch:
    models = [Model.from_scene_dict({**SCENE, "dynamics": {"duration": 1, "step": h}})
              for h in steps]  # fmt: skip
    return ReferenceSearch([
        Setting({"step": h}, m, {}, m.to_scene_dict()["dynamics"])
        for h, m in zip(steps, models, strict=True)
    ])  # fmt: skip


def play(
    found: ReferenceSearch, errors: dict[str, float | None], readings: list[RunHistories]
) -> list[str]:
    """Let tight runs of each method have an error times step squared; the labels of all runs."""
    made = []
    while runs := found.next_runs(readings, 1e9):
        for tight in runs:
            made.append(tight.label)
            error = errors[tight.method]
            step = tight.changes["dynamics.step"]
            got = None if error is None else reading(error * step**2)
            found.add(tight, got, {"seconds": [0.1], "cpu_seconds": [0.1], "reason": "diverged"})
    return made


def test_two_methods_that_agree_end_the_search_early() -> None:
    found = search()
    readings = [reading(0.01), reading(4e-4)]
    made = play(found, {"generalized-alpha": 1.0, "explicit-rk": 0.1}, readings)
    assert len(made) == 3
    truth = found.reference(readings)
    assert truth.shown("positions")
    assert truth.reading is not None
    shown = [difference(one, truth.reading)["positions"].value for one in readings]
    assert shown == pytest.approx([0.01, 4e-4], rel=0.1)
    assert truth.floors["positions"] < min(shown)


def test_tight_runs_are_tighter_than_the_tightest_setting() -> None:
    found = search((0.1, 0.02))
    play(found, {"generalized-alpha": 1.0, "explicit-rk": 1.0}, [reading(4e-4)])
    steps = [one.run.changes["dynamics.step"] for one in found.candidates]
    assert max(steps) == 0.02 / 4


def test_a_method_that_fails_leaves_the_other_with_finer_steps() -> None:
    found = search()
    made = play(found, {"generalized-alpha": 1.0, "explicit-rk": None}, [reading(4e-4)])
    assert sum("explicit-rk" in label for label in made) == 1
    assert found.reference([reading(4e-4)]).shown("positions")


def test_smaller_errors_than_can_be_told_are_not_shown() -> None:
    found = search()
    readings = [reading(1e-7)]
    made = play(found, {"generalized-alpha": 1.0, "explicit-rk": 2.0}, readings)
    truth = found.reference(readings)
    assert len(made) == 5  # all stages
    assert truth.shown("positions")
    assert truth.floors["positions"] > 1e-7
    assert truth.reading is not None
    assert truth.floors["positions"] >= 10 * difference(readings[0], truth.reading)[
        "positions"].value * 0.1  # fmt: skip


def test_a_reference_that_does_not_converge_shows_no_errors_and_says_so() -> None:
    found = search()
    play(found, {"generalized-alpha": 4000.0, "explicit-rk": -9000.0}, [reading(0.1)])
    truth = found.reference([reading(0.1)])
    assert not truth.shown("positions")
    assert "does not converge in positions" in truth.sentence


def test_without_two_tight_runs_there_is_no_reference() -> None:
    found = search()
    play(found, {"generalized-alpha": None, "explicit-rk": None}, [reading(0.1)])
    truth = found.reference([reading(0.1)])
    assert truth.reading is None
    assert "no two tight runs ended well" in truth.sentence
    assert "diverged" in truth.sentence


def test_impatience_ends_the_search() -> None:
    found = search()
    readings = [reading(1e-9)]
    for tight in (*found.next_runs([], 0.0), *found.next_runs(readings, 0.0)):
        found.add(
            tight,
            reading(0.01 / tight.stage),
            {"seconds": [60.0], "cpu_seconds": [60.0], "reason": ""},
        )
    assert found.next_runs(readings, 30.0) == []


def test_with_error_control_the_tight_runs_ask_for_more_accuracy() -> None:
    numbers = {"method": "generalized-alpha", "accuracy": 1e-5}
    found = ReferenceSearch(
        [Setting({}, dynamics={**numbers, "accuracy": a}) for a in (1e-3, 1e-5)]
    )
    (first,) = found.next_runs([], 0.0)
    assert first.changes == {"dynamics.method": "generalized-alpha", "dynamics.accuracy": 1e-6}
    found.add(first, reading(1e-6), {"seconds": [0.1], "cpu_seconds": [0.1]})
    tighter, other = found.next_runs([reading(1e-5)], 1.0)
    assert tighter.changes["dynamics.accuracy"] == 1e-7
    assert other.changes["dynamics.method"] == "explicit-rk"


@pytest.mark.parametrize(
    "numbers", [{"step": 0.02}, {"accuracy": 1e-5}, {"accuracy": 1e-5, "method": "explicit-rk"}]
)
def test_no_tight_run_leaves_its_method_open(numbers: dict[str, float]) -> None:
    """One that confirms another is by another method for certain."""
    found = ReferenceSearch([Setting({}, dynamics={"method": "auto", **numbers})])
    seen = []
    while runs := found.next_runs([reading(1e-12)], 0.0):
        for tight in runs:
            seen.append(tight.changes["dynamics.method"])
            found.add(tight, reading(0.1**tight.stage), {"seconds": [0.1], "cpu_seconds": [0.1]})
    assert "auto" not in seen and len(set(seen)) == 2
