"""Questions of a designer about functions whose answers are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model.reading import ReadContext
from flexmb.model.scenes.sweep import read_distribution, read_question
from flexmb.studies.sweeps.design_search import Answer, DesignSearch, Target


def ask(
    function: Callable[..., dict[str, float]],
    present: dict[str, float],
    *questions: str,
    **knobs: str,
) -> Answer:
    def run(settings: list[dict[str, Any]]) -> list[dict[str, Any]]:
        rows = []
        for setting in settings:
            try:
                rows.append({"status": "finished", "reason": "", **function(**setting)})
            except ArithmeticError as error:
                rows.append({"status": "failed", "reason": str(error), "x:max": math.nan})
        return rows

    targets = []
    for text in questions:
        one = read_question(text)
        bound = float(one.bound) if one.bound else math.nan
        targets.append(Target(one, ":".join(one.scalar), bound))
    ranges = {k: read_distribution(v, ReadContext({})) for k, v in knobs.items()}
    return DesignSearch(ranges, targets, run, present).answer()


def test_all_roots_of_one_knob() -> None:
    answer = ask(lambda d: {"x:max": math.sin(d)}, {"d": 1}, "x:max <= 0.5", d="0..12")
    roots = [setting["d"] for setting in answer.settings]
    exact = [math.pi / 6, 5 * math.pi / 6, 13 * math.pi / 6, 17 * math.pi / 6]
    assert roots == pytest.approx(exact, rel=1e-7)
    assert "from 0 to 0.5235" in answer.sentences[0]
    assert "2.61799" in answer.sentences[0]


def test_a_value_over_a_logarithmic_range() -> None:
    answer = ask(lambda k: {"x:max": k}, {"k": 1}, "x:max = 2", k="log-uniform(1e-3, 1e3)")
    assert answer.settings[0]["k"] == pytest.approx(2.0, rel=1e-7)


def test_without_a_bracket_it_says_between_what_the_scalar_stays() -> None:
    answer = ask(lambda d: {"x:max": d * d}, {"d": 1}, "x:max >= 20", d="0..3")
    assert not answer.settings
    assert "no d from 0 to 3 gives x:max >= 20: x:max is 0 at d = 0 and 9 at d = 3" in str(answer)
    always = ask(lambda d: {"x:max": d * d}, {"d": 1}, "x:max <= 20", d="0..3")
    assert always.sentences[0].startswith("x:max <= 20 holds for every d from 0 to 3")


def test_a_jump_is_no_root() -> None:
    answer = ask(lambda d: {"x:max": 1.0 if d < 1.234 else 5.0}, {"d": 1}, "x:max = 2", d="0..3")
    assert "x:max jumps there: from 1 to 5 at d = 1.234" in " ".join(answer.sentences)
    assert not answer.settings


def test_a_root_among_runs_that_fail() -> None:
    def stuck(d: float) -> dict[str, float]:
        if 1 < d < 1.5:
            raise ArithmeticError("the crank is stuck")
        return {"x:max": d * d}

    text = " ".join(ask(stuck, {"d": 1}, "x:max = 2", d="0..3").sentences)
    assert "crosses 2 between d = 0.9375 and 1.5, where runs fail" in text
    assert "2 of 17 runs of the scan failed, first at d = 1.125: the crank is stuck" in text


def test_a_constrained_minimum_of_two_knobs() -> None:
    """(a - 1)^2 + 3 (b - 2)^2 + a b with a + b >= 2.5: a = 5/12, b = 25/12 by Lagrange."""
    answer = ask(
        lambda a, b: {"x:max": (a - 1) ** 2 + 3 * (b - 2) ** 2 + a * b, "y:max": a + b},
        {"a": 0, "b": 0}, "minimise x:max", "y:max >= 2.5", a="-3..3", b="-3..3",
    )  # fmt: skip
    [best] = answer.settings
    assert best == pytest.approx({"a": 5 / 12, "b": 25 / 12}, abs=2e-3)
    assert best["a"] + best["b"] >= 2.5


def test_of_many_answers_the_nearest_to_the_scene_as_it_stands() -> None:
    answer = ask(
        lambda a, b: {"x:max": a * a + b * b}, {"a": 1, "b": 1}, "x:max = 4", a="0..3", b="0..3"
    )
    assert answer.settings[0] == pytest.approx({"a": math.sqrt(2), "b": math.sqrt(2)}, abs=5e-3)
    a, b = answer.settings[0].values()
    assert a * a + b * b == pytest.approx(4.0, abs=1e-4)
    never = ask(lambda a, b: {"x:max": a + b}, {"a": 1, "b": 1}, "x:max >= 9", a="0..3", b="0..3")
    assert not never.settings
    assert "nothing was found that meets x:max >= 9; nearest is a = 3, b = 3" in never.sentences[0]


def test_questions_that_cannot_be_sought() -> None:
    with pytest.raises(SceneError, match="has no range to search in"):
        ask(lambda m: {"x:max": 1.0}, {"m": 1}, "x:max = 2", m="steel,copper")
    with pytest.raises(SceneError, match="one scalar can be minimised"):
        ask(lambda a: {"x:max": a}, {"a": 1}, "minimise x:max", "maximise x:max", a="0..1")


def test_half_of_a_logarithmic_range_is_its_geometric_mean() -> None:
    ranges = {"k": "log-uniform(1, 10000)", "d": "1..10000"}
    knobs = {name: read_distribution(text, ReadContext({})) for name, text in ranges.items()}
    search = DesignSearch(knobs, [], lambda settings: [], {})
    assert search._values(np.array([0.5, 0.5])) == pytest.approx({"k": 100.0, "d": 5000.5})
    assert search._share("k", 100.0) == pytest.approx(0.5)
