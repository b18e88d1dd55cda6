"""The stack kernel against the readable jets of the model."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import stack_for

from flexmb.engine.compiled_units import call
from flexmb.engine.function import OPCODES, VAR, count_switches, lower, put_switches, run_program
from flexmb.engine.state import EVENT_FUNCTION
from flexmb.model.functions.expression import parse
from flexmb.model.functions.function import read_function

TEXTS = (
    "3.0",
    "2*t",
    "sin(3*t)*exp(-t) + cos(t)",
    "step(t, 0.2, 1, 0.9, 3)",
    "atan2(sin(t), 2 + cos(t))",
    "(1 + t)**(2 + t)",
    "t**1.5 + t**2 + (1 + t)**-3",
    "min(t, 0.5)*max(1 - t, t*t)",
    "tanh(t)/cosh(t) - sinh(t)*tan(t)",
    "asin(t/3) + acos(t/3) + atan(t)",
    "abs(t - 0.5) + sign(t)",
    "log(1 + t)*sqrt(1 + t)",
    "-t**3",
    "sqrt(max(t - 1, 0))",
    "log(t - 5)",
    "1/(t - t)",
    "step5(t, 0.2, 1, 0.9, 3)*havsin(t, 0.2, 1, 0.9, 3)",
    "cycloidal(t, 0.2, 1, 0.9, 3)",
    "modsine(t, 0.2, 1, 1.9, 3) + modsine(t, 0.36, 1, 0.5, 3) + modsine(t, 0.35, 1, 1.9, 3)",
    "hypot(t, 2 - t) + hypot(gap - 0.4, 0*t)",
    "gap**2*tip.x + sin(tip.x*t)",
)
POINTS = [[0, 1], [0.2, 3], [0.5, 2], [0.9, 2], [1.1, -1]]
FORMS = (
    {"type": "trapezoidal", "y1": 3, "speed": 4, "acceleration": 9},
    {"type": "spline", "points": POINTS, "beyond": "extrapolate"},
    {"type": "akima", "points": POINTS, "beyond": "repeat"},
    {"type": "table", "points": POINTS, "beyond": "hold"},
    {"type": "table", "points": POINTS},
)
FUNCTIONS = [parse(text, channels=True) for text in TEXTS]
FUNCTIONS += [read_function(form).expression for form in FORMS]
NUMBERS = {"gap": 1, "tip.x": 0}
VARIABLES = {"gap": (0.4, -0.3, 0.2), "tip.x": (1.7, 0.6, -1.1)}
JETS = np.array([VARIABLES["tip.x"], VARIABLES["gap"]])
LAST_DIGITS = 1e-13  # other order of sums; elementary functions differ by an ulp


def evaluated(table, k, t, variables, stack):
    """Value, first and second derivative, by compiled code."""
    value = call(run_program, table, k, t, variables, stack)
    return value, stack[0, 1], stack[0, 2]


@pytest.fixture(scope="module")
def table():
    return lower(FUNCTIONS, NUMBERS)


@pytest.mark.parametrize("k", range(len(FUNCTIONS)), ids=[f.text for f in FUNCTIONS])
def test_kernel_agrees_with_jets(table, k):
    stack = stack_for(table)
    for t in (0.0, 0.37, 0.5, 1.1, 1.3):
        with np.errstate(all="ignore"):
            found = np.array(evaluated(table, k, t, JETS, stack))
        wanted = np.array(FUNCTIONS[k].value(t, VARIABLES))
        np.testing.assert_allclose(found, wanted, rtol=LAST_DIGITS, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "slope", "curvature"),
    [("min(t, 1 - t)", 0, 0), ("max(t, 2*t - 0.5)", 1.5, 0), ("max(4*t*t, 1)", 2, 4),
     ("min(t, t)", 1, 0), ("max(0.5 - t, 0)", -0.5, 0)],
)  # fmt: skip
def test_at_a_tie_the_derivative_is_the_mean_of_both_sides(text, slope, curvature):
    """At t = 1/2, where a difference quotient over both sides tends to the mean as well."""
    function = parse(text)
    table = lower([function])
    jet = evaluated(table, 0, 0.5, np.zeros((1, 3)), stack_for(table))
    h = 2.0**-20
    quotient = (function.value(0.5 + h)[0] - function.value(0.5 - h)[0]) / (2 * h)
    assert jet[1:] == (slope, curvature) == function.value(0.5)[1:]
    assert jet[1] == pytest.approx(quotient, abs=1e-5)


def test_every_operation_is_exercised(table):
    assert set(table.ops) == {*OPCODES.values(), VAR}


def test_partial_derivatives_come_from_seeding_one_variable():
    """∂/∂gap of gap² x + sin(gap t) is 2 gap x + t cos(gap t): the rate with that of gap alone one,
    less the rate with none."""
    table = lower([parse("gap**2*tip.x + sin(gap*t)", channels=True)], NUMBERS)
    t, (x, gap) = 0.8, (1.7, 0.4)
    rates = [
        evaluated(table, 0, t, np.array([[x, 0.0, 0.0], [gap, seed, 0.0]]), stack_for(table))[1]
        for seed in (0.0, 1.0)
    ]
    wanted = 2 * gap * x + t * np.cos(gap * t)
    assert rates[1] - rates[0] == pytest.approx(wanted, rel=LAST_DIGITS)


def test_functions_with_channels_are_told_apart():
    table = lower([parse("t"), parse("gap*t", channels=True)], NUMBERS)
    assert table.live.tolist() == [0, 1]


def test_equal_piecewise_polynomials_are_stored_once(table):
    twice = lower([*FUNCTIONS, read_function(FORMS[1]).expression], NUMBERS)
    assert len(twice.data) == len(table.data)


def test_the_stack_is_as_deep_as_needed():
    shallow = lower([parse("t + t + t + t")])
    deep = lower([parse("t + (t + (t + t))")])
    assert (shallow.depth, deep.depth) == (2, 4)


def test_no_functions_make_an_empty_table():
    table = lower([])
    assert table.ops.shape == (0,) and table.start.tolist() == [0]
    assert table.ops.dtype == np.int32 and table.args.dtype == np.float64


def distances(expression, gap=0.0, t=0.3, moves=False):
    """From where the laws of a program change, at a value of a channel."""
    table, n = lower([expression], NUMBERS, moves), count_switches(expression, moves)
    events = np.zeros(n, EVENT_FUNCTION)
    jets = np.array([[0.0, 0, 0], [gap, 0, 0]])
    assert call(put_switches, table, 0, t, jets, stack_for(table), events, 0) == n
    assert np.isnan(events["rate"]).all()
    kinds = {OPCODES["sign"]: [2.0], OPCODES["hypot"]: [3.0, 4.0]}
    wanted = [kinds.get(op, [1.0] * n)[:n] for op, n in zip(table.ops, table.switches, strict=True)]
    np.testing.assert_array_equal(events["of_law"], [kind for some in wanted for kind in some])
    return events["value"]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("gap**2 + sin(gap)", []),
        ("abs(t - 0.1)*max(t, 0.2) + step(t, 0, 1, 1, 2)", []),  # known beforehand
        ("t*abs(gap - 0.1) + sign(2*gap)", [0.3, 0.8]),
        ("min(gap, 0.7) - max(3*t, gap)", [-0.3, 0.5]),
        ("step(gap, 0.2, 1, 0.6, 2)", [0.5, -0.5]),
        ("max(-1, min(1, 5*gap))", [-1.0, -2.0]),  # of the inner one first
        ("gap*hypot(gap, 3*gap - 1) + hypot(t, 2)", [0.4, 0.2]),  # both at zero
    ],
)
def test_where_a_law_changes_with_a_channel(text, wanted):
    found = distances(parse(text, channels=True), gap=0.4)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15)


def test_corners_of_a_table_are_crossed_one_by_one():
    """The sign changes at every corner, and the distance is that of the nearest one."""
    table = read_function({"type": "table", "points": POINTS}).expression
    for x, away in ((0.15, 0.05), (0.22, -0.02), (0.65, 0.15), (0.89, 0.01), (1.0, -0.1)):
        found = distances(table, t=x, moves=True)
        np.testing.assert_allclose(found, [away], rtol=0, atol=1e-15)
    assert len(distances(table)) == 0  # over time its corners are known beforehand


def test_smooth_and_dense_curves_have_no_corners_to_look_for():
    x = np.linspace(0, 1, 80)
    points = np.stack([x, np.sin(9 * x)], axis=1).tolist()
    for form in ({"type": "spline", "points": POINTS}, {"type": "table", "points": points}):
        assert count_switches(read_function(form).expression, moves=True) == 0
