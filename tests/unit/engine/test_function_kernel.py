"""The stack kernel against the readable jets of the model."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.functions import lower, stack_for
from flexmb.engine.jit import entry
from flexmb.engine.kernels.function import OPCODES, evaluate
from flexmb.model.expression import parse
from flexmb.model.functions import read_function

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
)
POINTS = [[0, 1], [0.2, 3], [0.5, 2], [0.9, 2], [1.1, -1]]
FORMS = (
    {"type": "trapezoidal", "y1": 3, "speed": 4, "acceleration": 9},
    {"type": "spline", "points": POINTS, "beyond": "extrapolate"},
    {"type": "akima", "points": POINTS, "beyond": "repeat"},
    {"type": "table", "points": POINTS, "beyond": "hold"},
    {"type": "table", "points": POINTS},
)
FUNCTIONS = [parse(text) for text in TEXTS] + [read_function(form).expression for form in FORMS]
LAST_DIGITS = 1e-13  # other order of sums; elementary functions differ by an ulp


@entry
def evaluated(table, k, t, stack):
    return evaluate(table, k, t, stack)


@pytest.fixture(scope="module")
def table():
    return lower(FUNCTIONS)


@pytest.mark.parametrize("k", range(len(FUNCTIONS)), ids=[f.text for f in FUNCTIONS])
def test_kernel_agrees_with_jets(table, k):
    stack = stack_for(table)
    for t in (0.0, 0.37, 0.5, 1.1, 1.3):
        with np.errstate(all="ignore"):
            found = np.array(evaluated(table, k, t, stack))
        wanted = np.array(FUNCTIONS[k].value(t))
        np.testing.assert_allclose(found, wanted, rtol=LAST_DIGITS, atol=1e-15)


def test_every_operation_is_exercised(table):
    assert set(table.ops) == set(OPCODES.values())


def test_equal_piecewise_polynomials_are_stored_once(table):
    twice = lower([*FUNCTIONS, read_function(FORMS[1]).expression])
    assert len(twice.data) == len(table.data)


def test_the_stack_is_as_deep_as_needed():
    shallow = lower([parse("t + t + t + t")])
    deep = lower([parse("t + (t + (t + t))")])
    assert (shallow.depth, deep.depth) == (2, 4)


def test_no_functions_make_an_empty_table():
    table = lower([])
    assert table.ops.shape == (0,) and table.start.tolist() == [0]
    assert table.ops.dtype == np.int32 and table.args.dtype == np.float64
