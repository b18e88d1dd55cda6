"""Times of jumps, read off programs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flexmb.model.functions.discontinuities import (
    brief_changes,
    derivative_jumps,
    first_discontinuities,
    switch_times,
)
from flexmb.model.functions.expression import parse
from flexmb.model.functions.function import read_function

TABLE = [[0, 0], [1, 1], [2, 2], [3, 0]]  # straight on at 1


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("3*t**2 + sin(t)", ()),
        ("step(t, 1, 0, 2, 5)", (1.0, 2.0)),
        ("2 - 3*step(2*t - 1, 1, 0, 2, 5)/4", (1.0, 1.5)),
        ("step(5 - t, 1, 0, 2, 5)", (3.0, 4.0)),
        ("step(t, 1, 0, 20, 5)", (1.0,)),
        ("step(sin(t), 0, 0, 1, 1)", ()),  # not linear in time
        ("havsin(t, 1, 0, 2, 5) + step(t, 2, 0, 4, 1)", (1.0, 2.0, 4.0)),
        ("step5(t, 1, 0, 2, 5) + cycloidal(t, 1, 0, 2, 5)", ()),  # two smooth derivatives
        ("abs(t - 1) + sign(3 - 2*t)", (1.0, 1.5)),
        ("max(t, 2) + min(4 - t, 1)", (2.0, 3.0)),
        ("abs(sin(t))", ()),  # not linear in time
        ({"type": "table", "points": TABLE, "beyond": "hold"}, (2.0, 3.0)),
        ({"type": "table", "points": TABLE, "beyond": "repeat"}, (2.0, 3.0, 5.0)),
        ({"type": "spline", "points": TABLE, "beyond": "hold"}, (3.0,)),
        ({"type": "spline", "points": TABLE, "beyond": "extrapolate"}, ()),
        ({"type": "akima", "points": [[0, 1], [0.7, 1.7], [2.1, 3.1], [9, 10]]}, ()),  # a line
        ({"type": "trapezoidal", "t0": 1, "t1": 4, "y1": 1}, (1.0, 2.0, 3.0, 4.0)),
    ],
    ids=str,
)
def test_kinks_are_found(given, wanted):
    assert read_function(given).derivative_jumps(6.0) == pytest.approx(wanted, rel=1e-14)


def sine_spline(points):
    """A cubic spline through points of one period of a sine within 6 s."""
    t = np.linspace(0.0, 6.0, points)
    return {"type": "spline", "points": np.stack([t, np.sin(np.pi * t / 3)], axis=1).tolist()}


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("t**3 + sin(t)", ()),
        ("step(t, 1, 0, 2, 5)", (1.0, 2.0)),  # already the second one
        ("step5(2*t, 1, 0, 2, 5) + cycloidal(t, 3, 0, 4, 5)", (0.5, 1.0, 3.0, 4.0)),
        ({"type": "modified-sine", "t0": 1, "t1": 2, "y1": 1}, (1.0, 2.0)),
        ({"type": "spline", "points": [[0, 0], [1, 1], [3, 2], [4, 0], [6, 0]]}, (1.0, 3.0, 4.0)),
        (sine_spline(7), (1.0, 2.0, 4.0, 5.0)),  # about 3 it is odd, its third derivative even
        (sine_spline(601), ()),  # jumps by 1 % are left to steps, which are as short
    ],
    ids=str,
)
def test_jumps_of_the_third_derivative_are_found_too(given, wanted):
    ops = read_function(given).expression.ops
    assert derivative_jumps(ops, 6.0, derivatives=3) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("y", [[0, 1, 0, 1, 0, 1, 0], [0, 2, 0, 1, 2, 3, 4.1]])
def test_jumps_that_change_little_until_the_next_knot_may_be_left_out(y):
    """However large others are."""
    t = np.linspace(0.0, 6.0, 7)
    ops = read_function({"type": "spline", "points": np.stack([t, y], axis=1).tolist()})
    ops = ops.expression.ops
    jumps = np.diff(CubicSpline(t, y, bc_type="natural").c[0]) * 6.0  # third derivative at knots
    change = np.abs(jumps) / 6.0 / np.ptp(y)  # knots are 1 s apart
    for least in (
        0.5 * change.min(),
        1.5 * change.min(),
        np.median(change) * (1.0 + 1e-9),
        2.0 * change.max(),
    ):
        found = derivative_jumps(ops, 6.0, derivatives=3, least_change=float(least))
        assert found == pytest.approx(t[1:-1][change > least], rel=1e-14)
        as_load = {"derivatives": 3, "least_change": float(least) / 6.0, "of_integral": True}
        assert derivative_jumps(ops, 6.0, **as_load) == found  # of knots 1 s apart, of 6 s


def test_there_is_a_jump_at_every_kink_and_none_elsewhere():
    points = [[0, 1], [0.7, 3], [1.6, 2], [2.9, 2.5], [4, 1]]
    for form in ("akima", "spline", "table"):
        function = read_function({"type": form, "points": points, "beyond": "repeat"})
        jumps = function.derivative_jumps(7.0)
        for t in {*jumps, *(p[0] for p in points[1:]), 1.0, 3.3}:
            before, after = (np.array(function.value(t + s)) for s in (-1e-9, 1e-9))
            assert (np.abs(after - before).max() > 1e-3) == (t in jumps)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("2 + 3*sign(sin(2*t))", np.pi / 2 * np.arange(4)),
        ("max(0.5, cos(t))", [np.pi / 3, 5 * np.pi / 3]),
        ("step(t**2, 1, 0, 4, 1)", [1, 2]),
        ("abs(exp(t) - 2) + 7*min(t**2, 9)", [np.log(2), 3]),
        ("abs(t - 1) + sign(3 - 2*t)", []),  # linear: known already
        ("max(0, sin(t)**2)", []),  # only touched
        ("sign(sin(1e5*t))", [0]),  # the motion itself, but where it begins
        ("2 + sign(cos(1000*t))", np.pi * (np.arange(1910) + 0.5) / 1000),
        ("abs(log(t - 3))", []),  # not defined everywhere
    ],
)
def test_laws_that_change_with_a_function_of_time_are_found(given, wanted):
    assert sorted(switch_times(parse(given).ops, 6.0)) == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("asin(sin(2*t))", np.pi / 4 * np.array([1, 3, 5, 7])),
        ("2 - acos(cos(3*t))", np.pi / 3 * np.arange(1, 6)),
        ("sqrt(sin(2*t)**2)", np.pi / 2 * np.arange(1, 4)),
        ("atan(tan(2*t))", np.pi / 4 * np.array([1, 3, 5, 7])),
        ("1/cos(2*t)", np.pi / 4 * np.array([1, 3, 5, 7])),
        ("sin(10*t)/sin(2*t) + t/tan(t)", np.pi * np.array([0.5, 1, 1.5])),  # poles of tan, t/tan
        ("atan(cos(2*t)**-1)", np.pi / 4 * np.array([1, 3, 5, 7])),
        ("atan(1/tan(2*t))", np.pi / 4 * np.arange(1, 8)),
        ("atan2(sin(2*t), cos(2*t))", np.pi / 2 * np.array([1, 3])),
        ("asin(sin(3*sqrt(t)))", (np.pi / 6 * np.array([1, 3])) ** 2),  # not real before 0
        ("acos(cos(3*sqrt(6 - t)))", 6 - (np.pi / 3 * np.array([2, 1])) ** 2),  # nor after 6
        ("atan2(sin(t), 1.5 + cos(t))", []),  # never at half a turn
        ("asin(0.9*sin(t)) + sqrt(1 + sin(t)**2)", []),
        ("asin(t/7)", []),
    ],
)
def test_kinks_of_inverse_functions_are_found(given, wanted):
    assert sorted(switch_times(parse(given).ops, 6.0)) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("sin(t)", None),
        ("sin(t) + 100*exp(-((t - 2)/0.01)**2)", (1.96, 2.04)),
        ("1000*(tanh((t - 2)*1000) - tanh((t - 2.01)*1000))", (1.99, 2.02)),
        ("max(0, sin(t) - 0.9999)", (np.pi / 2 - 0.015, np.pi / 2 + 0.015)),
        ("step5(t, 2, 0, 2.01, 5) - cycloidal(t, 2.01, 0, 2.02, 5)", (1.99, 2.03)),
        ({"type": "spline", "points": [[0, 0], [1.99, 0], [2, 1], [2.01, 0], [6, 0]]}, None),
        ("abs(t - 1) + sign(3 - 2*t)", None),  # jumps, whose times are known
        ("max(0, sin(200*t) - 0.9)", None),  # switches, which are known
        ("1.5*t**5", None),  # growth is no pulse
        ("exp(2*t)", None),
    ],
    ids=str,
)
def test_brief_changes_are_seen(given, wanted):
    times = brief_changes(read_function(given).expression.ops, 6.0)
    assert bool(times) == bool(wanted)
    if wanted:
        low, high = wanted
        assert low < min(times) < sum(wanted) / 2 < max(times) < high


@pytest.mark.parametrize("pulses", [120, 1000, 2000, 4000])
@pytest.mark.parametrize("train", ["exp(-(cos(pi*t)/0.05)**2)", "((sin(pi*t)**8)**8)**8"])
def test_each_pulse_of_a_train_is_seen(train, pulses):
    """A sample of the run at each whole second, as of 20 000 over 4000 s, would see none."""
    times = brief_changes(parse(train).ops, float(pulses))
    assert np.sort(times) == pytest.approx(np.arange(pulses) + 0.5, abs=0.03)


@pytest.mark.parametrize("rise", ["step5", "cycloidal"])
@pytest.mark.parametrize("gap", [0.0, 0.5, 1.0, 1.3])
def test_rise_and_fall_of_a_pulse_are_seen_wherever_it_is(gap, rise):
    """However samples of the run fall on its ends, and however long it stays."""
    draw = np.random.default_rng(5)
    for _ in range(20):
        begin, length, end = draw.uniform(1, 5), 10 ** draw.uniform(-2.6, -1), draw.uniform(6, 9)
        up, down = (
            f"{rise}(t, {a!r}, 0, {a + length!r}, 1)" for a in (begin, begin + length * (1 + gap))
        )
        times = np.array(brief_changes(read_function(f"{up} - {down}").expression.ops, end))
        assert begin - length < times.min() < begin + length
        assert begin + length * (1 + gap) < times.max() < begin + length * (3 + gap)


def test_a_short_pulse_close_behind_a_long_one_has_times_of_its_own():
    long = "cycloidal(t, 2, 0, 2.05, 1) - cycloidal(t, 2.05, 0, 2.1, 1)"
    short = "cycloidal(t, 2.15, 0, 2.152, 1) - cycloidal(t, 2.152, 0, 2.154, 1)"
    times = np.array(brief_changes(read_function(f"{long} + {short}").expression.ops, 6.0))
    assert ((times > 2.149) & (times < 2.155)).sum() == 5
    assert ((times > 1.99) & (times < 2.11)).sum() == 5


@pytest.mark.parametrize("width", np.logspace(-5, 0, 11).tolist())
@pytest.mark.parametrize(
    "pulse", ["0.1*exp(-({s})**2)", "tanh({s})", "atan({s})", "0.3*t + 1/(1 + ({s})**2)"]
)
def test_short_pulses_do_not_jump(pulse, width):
    """What is halved meets their slopes, beside which all that was seen before is nothing."""
    for place in (5.0123, 10 / 3, 9.7):
        smooth = pulse.format(s=f"(t - {place})/{width!r}")
        assert not first_discontinuities(parse(smooth).ops, 10.0, 2)
        broken = f"{smooth} + 1e-3*sign(t - 2.345)"
        (jump, *_) = first_discontinuities(parse(broken).ops, 10.0, 2)
        assert (jump.kind, jump.time) == ("value", pytest.approx(2.345))
