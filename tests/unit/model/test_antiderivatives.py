"""Antiderivatives against adaptive quadrature, and their own derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from flexmb.errors import SceneError
from flexmb.model.functions.antiderivatives import antiderivative
from flexmb.model.functions.derivatives import evaluate
from flexmb.model.functions.discontinuities import derivative_jumps
from flexmb.model.functions.expression import parse
from flexmb.model.functions.function import read_function

END = 4.0
POINTS = [[0, 0], [1, 2], [1.2, 0.5], [3, 1]]
CLOSED = (
    "3",
    "2*t**3 - (1 + t)*(2 - t)/4",
    "2*sin(3*t + 1) - cos(t)/4 + exp(-t/2)*3",
    "step(t, 0.3, 0, 1, 2) + step5(t, 0.2, 1, 0.8, -1)",
    "havsin(t, 0.3, 0, 1, 2)",
    "cycloidal(2*t, 0.3, 0, 1, 2)",
    {"type": "trapezoidal", "t1": 1.0, "y1": 2},
    {"type": "table", "points": POINTS, "beyond": "repeat"},
    {"type": "akima", "points": POINTS, "beyond": "hold"},
    {"type": "spline", "points": POINTS, "beyond": "extrapolate"},
    {"type": "fourier", "frequency": 1, "cosine": [1, 2], "sine": [0.5, 0.1], "offset": 1},
)
PIECEWISE = (
    "modsine(t, 0.3, 0, 1, 2)",
    "sin(t**2)",
    "abs(t - 0.7)",
    "sqrt(1 + t)*t",
    "sign(sin(3*t))",
)
BREAKS = [0.15, 0.2, 0.3, 0.5, 0.7, 0.8, 1.0, np.pi / 3, 2 * np.pi / 3, np.pi]
TIMES = (0.4, 1.1, 3.9)


def by_quadrature(function, order, t):
    inside = sorted({*function.derivative_jumps(t), *(b for b in BREAKS if b < t)}) or None
    rate = lambda s: (t - s) ** (order - 1) * function.value(s)[0]  # noqa: E731
    return quad(rate, 0.0, t, points=inside, epsabs=1e-13, epsrel=1e-13, limit=300)[0]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("given", CLOSED + PIECEWISE, ids=str)
def test_it_is_what_quadrature_finds(given, order):
    function = read_function(given)
    found = antiderivative(function.expression.ops, order, END)
    jump = 2e-9 * END if given == PIECEWISE[-1] else 0.0  # whose places are known to 1e-9
    assert evaluate(found, 0.0)[:order] == pytest.approx((0.0,) * order, abs=1e-15)
    for t in TIMES:
        jet, wanted = evaluate(found, t), function.value(t)
        assert jet[0] == pytest.approx(by_quadrature(function, order, t), abs=1e-12 + jump)
        assert jet[order] == pytest.approx(wanted[0], abs=1e-12)
        if order == 1:
            assert jet[2] == pytest.approx(wanted[1], abs=2e-11)  # of an interpolated function


@pytest.mark.parametrize("given", CLOSED, ids=str)
def test_closed_forms_need_no_end(given):
    antiderivative(read_function(given).expression.ops, 2, None)


@pytest.mark.parametrize("given", PIECEWISE, ids=str)
def test_others_do(given):
    with pytest.raises(SceneError, match=r"give dynamics\.duration"):
        antiderivative(read_function(given).expression.ops, 1, None)


def test_thousands_of_turns_keep_their_digits():
    """A mean speed and a wave that repeats: 10000 s at 2 rad/s, to the last digits of 20000."""
    points = [[0, 1], [0.25, 3], [0.75, 1], [1, 3]]  # a mean of 2
    rate = read_function({"type": "table", "points": [*points[:3], [1.0, 3]], "beyond": "repeat"})
    found = antiderivative(rate.expression.ops, 1, None)
    mean = np.trapezoid([p[1] for p in points], [p[0] for p in points])
    assert evaluate(found, 10_000.0)[0] == pytest.approx(10_000.0 * mean, rel=1e-13)


def test_a_value_that_is_missing_is_told():
    with pytest.raises(SceneError, match=r"not finite"):
        antiderivative(read_function("log(t - 1)").expression.ops, 1, END)


def test_what_never_settles_is_told(monkeypatch):
    monkeypatch.setattr("flexmb.model.functions.antiderivatives._MAX_PIECES", 20)
    with pytest.raises(SceneError, match="changes too often"):
        antiderivative(read_function("sin(exp(3*t))").expression.ops, 1, END)


GENEVA = "max(0, r*(cos(2*pi*t + pi) - r)/(1 + r**2 - 2*r*cos(2*pi*t + pi)))"


@pytest.mark.parametrize("turns", [1, 50, 100, 200, 333.3, 1000, 2000])
def test_a_wheel_that_moves_and_rests_is_followed_for_any_time(turns):
    """Geneva drive: a quarter of a turn of the wheel for one of the crank, with kinks at both ends.

    Over whole turns nodes and places of a check may all lie where the wheel rests.
    """
    ratio = float(np.sqrt(0.5))
    speed = parse(f"2*pi*{GENEVA}", {"r": ratio}).ops
    found = antiderivative(speed, 1, float(turns))
    for t in np.linspace(0.0, turns, 37):
        a = 2 * np.pi * np.clip(t - np.floor(t) - 0.5, -0.125, 0.125)
        within = np.arctan2(ratio * np.sin(a), 1 - ratio * np.cos(a)) + np.pi / 4
        wanted = np.floor(t) * np.pi / 2 + within
        assert evaluate(found, t)[0] == pytest.approx(wanted, abs=4e-12 + 1e-14 * turns)
    jumps = derivative_jumps(found, float(turns))
    assert jumps == pytest.approx([k + s for k in range(int(turns)) for s in (0.375, 0.625)])
