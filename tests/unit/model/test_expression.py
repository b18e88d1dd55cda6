"""Expressions: values, folding, and exact derivatives against independent differences."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from flexmb.model.functions.expression import FUNCTIONS, names_in, parse

SMOOTH = (
    "3.5",
    "2*t - 1",
    "sin(3*t)*exp(-t)",
    "(1 + t)**(2 + t)",
    "t**1.5 + t**-2",
    "tanh(t)/cosh(t) - sinh(t)*tan(t)",
    "asin(t/3) + acos(t/3) + atan(t)",
    "log(1 + t)*sqrt(t)",
    "-t**3",
    "2**t",
)
KINKED = ("step(t, 0.2, 1, 0.9, 3)", "abs(t - 0.5)", "min(t, 0.5)*max(1 - t, t*t)", "sign(t)*t")
ROUNDING = 1e-9  # second differences of complex-step first derivatives, step 1e-6


def _complex(ops, t):
    """Run a program on complex numbers: imag(f(t + ih))/h is df/dt to round-off."""
    stack = []
    for op, argument in ops:
        if op in ("const", "t"):
            stack.append(complex(argument) if op == "const" else t)
        elif op == "powc":
            stack.append(stack.pop() ** argument)
        elif op == "neg":
            stack.append(-stack.pop())
        elif op in ("+", "-", "*", "/", "pow"):
            b, a = stack.pop(), stack.pop()
            stack.append(
                {"+": a.__add__, "-": a.__sub__, "*": a.__mul__, "/": a.__truediv__}.get(
                    op, a.__pow__
                )(b)
            )
        else:
            stack.append(getattr(cmath, op)(stack.pop()))
    return stack.pop()


@pytest.mark.parametrize("text", SMOOTH)
@pytest.mark.parametrize("t", [0.37, 1.3])
def test_derivatives_agree_with_the_complex_step(text, t):
    expression = parse(text)

    def first(at):
        return _complex(expression.ops, complex(at, 1e-30)).imag / 1e-30

    f, f1, f2 = expression.value(t)
    h = 1e-5
    assert f == pytest.approx(_complex(expression.ops, complex(t)).real, rel=1e-13)
    assert f1 == pytest.approx(first(t), rel=1e-13, abs=1e-14)
    assert f2 == pytest.approx((first(t + h) - first(t - h)) / (2 * h), rel=1e-8, abs=ROUNDING)


@pytest.mark.parametrize("text", [*KINKED, "atan2(sin(t), 2 + cos(t))"])
@pytest.mark.parametrize("t", [0.1, 0.37, 0.7, 1.3])
def test_derivatives_agree_with_differences_away_from_kinks(text, t):
    expression, h = parse(text), 1e-4
    low, middle, high = (expression.value(t + dt) for dt in (-h, 0.0, h))
    assert middle[1] == pytest.approx((high[0] - low[0]) / (2 * h), rel=1e-6, abs=1e-7)
    assert middle[2] == pytest.approx((high[1] - low[1]) / (2 * h), rel=1e-6, abs=1e-6)


def test_a_step_is_level_outside_and_cubic_between():
    step = parse("step(t, 1, 2, 3, 6)")
    assert step.value(0.0) == (2.0, 0.0, 0.0)
    assert step.value(4.0) == (6.0, 0.0, 0.0)
    assert step.value(2.0) == pytest.approx((4.0, 3.0, 0.0))  # middle of 2 + 4 (3 s^2 - 2 s^3)


def test_constants_fold_to_one_operation():
    assert parse("2*pi*25").constant == pytest.approx(157.07963267948966)
    assert parse("30*deg").constant == pytest.approx(math.pi / 6)
    assert parse("r*2", {"r": 3.0}).ops == (("const", 6.0),)
    assert parse("-2**2").constant == -4.0  # as in mathematics
    assert len(parse("sqrt(2)*pi*t").ops) == 3


def test_zero_to_a_power_has_derivatives():
    assert parse("t**2").value(0.0) == (0.0, 0.0, 2.0)
    assert parse("t**1.5").value(0.0)[:2] == (0.0, 0.0)
    assert parse("sqrt(max(t - 1, 0))").value(0.5) == (0.0, 0.0, 0.0)


def test_outside_the_domain_the_value_is_not_finite_and_nothing_is_raised():
    for text in ("log(t - 1)", "sqrt(t - 1)", "1/t", "asin(t + 2)", "(t - 1)**0.5"):
        assert not np.isfinite(parse(text).value(0.0)[0]), text


def test_all_functions_can_be_called():
    arguments = {1: "0.5", 2: "0.5, 0.25", 5: "t, 0, 0, 1, 1"}
    for name, (count, usage) in FUNCTIONS.items():
        assert parse(f"{name}({arguments[count]})").ops, usage


def test_names_in_an_expression():
    assert names_in("a*sin(b*t) + a + pi") == ("a", "b", "t")


@pytest.mark.parametrize(
    ("root", "wanted"),
    [
        ("sqrt(v.x**2 + v.y*v.y)", "hypot(v.x, v.y)"),
        ("(v.x**2 + (2*v.y - 1)**2)**0.5", "hypot(v.x, 2*v.y - 1)"),
        ("sqrt((gap - 2)**2)", "abs(gap - 2)"),
    ],
)
def test_a_root_of_squares_of_channels_is_a_length(root, wanted):
    assert parse(root, channels=True).ops == parse(wanted, channels=True).ops


@pytest.mark.parametrize("root", ["sqrt(v.x**2 - v.y**2)", "sqrt(v.x**2 + 0.1)", "sqrt(v.x*v.y)"])
def test_other_roots_remain(root):
    assert parse(root, channels=True).ops[-1][0] == "sqrt"


def test_the_length_of_three_components():
    ops = parse("sqrt(v.x**2 + v.y**2 + v.z**2)", channels=True)
    channels = {f"v.{axis}": (size, 0.0, 0.0) for axis, size in zip("xyz", (2, -3, 6), strict=True)}
    assert ops.value(0.0, channels)[0] == pytest.approx(7, rel=1e-15)
    assert [op for op, _ in ops.ops if op == "hypot"] == ["hypot"] * 2
