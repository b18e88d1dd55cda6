"""Values of functions of time at many times: those of one time after another."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.model.functions.derivatives import evaluate, values_at
from flexmb.model.functions.function import read_function

TIMES = np.linspace(0.0, 4.0, 201)
RISES = [
    f"{rise}(t, 0.5, -1, 3, 2)" for rise in ("step", "step5", "havsin", "cycloidal", "modsine")
]


@pytest.mark.parametrize(
    "given",
    [
        *RISES,
        "min(t, 2)*max(sin(t), 0.3) - abs(t - 1)**2.5/(1 + t)",
        "atan2(t, 1 - t) + hypot(t, 2) + asin(t/5) - acos(t/9) + atan(t)",
        "sinh(t) + cosh(t)*tanh(t) - tan(t/3) + log(1 + t)*sqrt(t) + exp(-t) + sign(t - 2) + t**t",
        {"type": "akima", "points": [[0, 0], [1, 2], [1.2, 0.5], [3, 1]], "beyond": "repeat"},
        {"type": "table", "points": [[0, 0], [1, 2], [3, 0]], "beyond": "hold"},
    ],
    ids=str,
)
def test_they_are_those_of_one_time_after_another(given):
    ops = read_function(given).expression.ops
    wanted = [evaluate(ops, t)[0] for t in TIMES]
    np.testing.assert_allclose(values_at(ops, TIMES), wanted, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("given", RISES)
def test_straight_rises_change_alike(given):
    ops = read_function(given).expression.ops
    inside = values_at(ops, np.linspace(0.5, 3.0, 51), straight_rises=True)
    np.testing.assert_allclose(inside, np.linspace(-1.0, 2.0, 51), atol=1e-14)
