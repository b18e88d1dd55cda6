"""The stack kernel against the readable jets of the model."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.engine.functions import lower, stack_for
from flexmb.engine.jit import entry
from flexmb.engine.kernels.function import OPCODES, evaluate
from flexmb.model.expression import parse

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
)
LAST_DIGITS = 1e-13  # other order of sums; elementary functions differ by an ulp


@entry
def evaluated(table, k, t, stack):
    return evaluate(table, k, t, stack)


@pytest.fixture(scope="module")
def table():
    return lower([parse(text) for text in TEXTS])


@pytest.mark.parametrize("k", range(len(TEXTS)), ids=TEXTS)
def test_kernel_agrees_with_jets(table, k):
    stack = stack_for(table)
    for t in (0.0, 0.37, 0.5, 1.3):
        with np.errstate(all="ignore"):
            found = np.array(evaluated(table, k, t, stack))
        wanted = np.array(parse(TEXTS[k]).value(t))
        np.testing.assert_allclose(found, wanted, rtol=LAST_DIGITS, atol=1e-15)


def test_every_operation_is_exercised(table):
    assert set(table.ops) == set(OPCODES.values())


def test_the_stack_is_as_deep_as_needed():
    shallow = lower([parse("t + t + t + t")])
    deep = lower([parse("t + (t + (t + t))")])
    assert (shallow.depth, deep.depth) == (2, 4)


def test_no_functions_make_an_empty_table():
    table = lower([])
    assert table.ops.shape == (0,) and table.start.tolist() == [0]
    assert table.ops.dtype == np.int32 and table.args.dtype == np.float64
