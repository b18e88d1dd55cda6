"""Antiderivatives of functions of time, once and twice, as programs of the same kind.

In: a postfix program that gives a velocity or an acceleration. Out: one that gives the
displacement. Sums of polynomials, sines, exponentials, rises and piecewise polynomials whose
arguments are linear in time are integrated in closed form. Anything else is integrated numerically
over the run, by Chebyshev interpolation on intervals that are halved until the interpolation is
accurate (Trefethen, Approximation Theory and Approximation Practice, 2013, ch. 8).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from flexmb.errors import SceneError
from flexmb.model.functions.derivatives import BINARY, UNARY, evaluate
from flexmb.model.functions.discontinuities import derivative_jumps
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.functions.piecewise import Piecewise, shifted

_DEGREE = 12
_TOLERANCE = 1e-13  # largest error of interpolation, over the largest value during the run
# shortest interval over the run; a shorter one contains a jump, whose time is then known well
# enough
_MIN_INTERVAL = 1e-9
# fractions of an interval where the interpolation is checked, between its nodes
_CHECK_POINTS = (0.03, 0.21, 0.44, 0.68, 0.91)
_SAMPLES = 257  # samples from which the magnitude of the function is estimated
_MAX_PIECES = 200_000
_MAX_TERMS = 24  # largest number of terms of a product that is expanded

# C is the argument limited to 0 ... 1, M the part above 1. If both bounds are equal the first
# counts.
_WITHIN, _ABOVE = "min(1, max(0, t))", "max(t - 1, 0)"
_RISES = {
    key: parse(text.replace("C", _WITHIN).replace("M", _ABOVE)).ops
    for key, text in {
        ("haversinestep", 1): "C/2 - sin(pi*C)/(2*pi) + M",
        ("haversinestep", 2): "C**2/4 + (cos(pi*C) - 1)/(2*pi**2) + M/2 + M**2/2",
        ("cycloidalstep", 1): "C**2/2 + (cos(2*pi*C) - 1)/(4*pi**2) + M",
        ("cycloidalstep", 2): "C**3/6 + sin(2*pi*C)/(8*pi**3) - C/(4*pi**2) + M/2 + M**2/2",
    }.items()
}
_POLYNOMIAL_RISES = {
    "cubicstep": (0.0, 0.0, 3.0, -2.0),
    "quinticstep": (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
}
_WAVES = {
    ("sin", 1): ("cos", -1.0), ("sin", 2): ("sin", -1.0),
    ("cos", 1): ("sin", 1.0), ("cos", 2): ("cos", -1.0),
    ("exp", 1): ("exp", 1.0), ("exp", 2): ("exp", 1.0),
}  # fmt: skip


class _Term(NamedTuple):
    """A part of a program: its polynomial in t (lowest power first) if it is one, and its
    antiderivative."""

    polynomial: tuple[float, ...] | None
    integral: Ops | None


def antiderivative(ops: Ops, order: int, end: float | None) -> Ops:
    """The program of the antiderivative that is zero at t = 0; for order 2 its slope is zero there
    too.

    Parameters
    ----------
    ops : Ops
        The program of the function.
    order : int
        1 or 2: the number of integrations.
    end : float or None
        Last time [s] that is needed; None if it is not known.

    Raises
    ------
    SceneError
        There is neither a closed form nor an end, or the function has no value at some time.
    """
    program = _closed_form(ops, order)
    if program is None:
        if end is None:
            what = "its antiderivative is made over the length of the run: give dynamics.duration"
            raise SceneError(what)
        program = _numerical(ops, order, end)
    value, slope, _ = evaluate(program, 0.0)
    start = (value,) if order == 1 else (value, slope)
    return _sum(program, _program(tuple(-c for c in start)))


def _closed_form(ops: Ops, order: int) -> Ops | None:
    stack: list[_Term] = []
    for op, argument in ops:
        if op == "const":
            stack.append(_polynomial((argument,), order))
        elif op == "t":
            stack.append(_polynomial((0.0, 1.0), order))
        elif op in BINARY:
            right = stack.pop()
            stack.append(_binary(op, stack.pop(), right, order))
        elif op == "neg":
            stack.append(_scaled(stack.pop(), -1.0, order))
        elif op == "powc":
            stack.append(_power(stack.pop(), argument, order))
        elif op in UNARY:
            stack.append(_unary(op, argument, stack.pop().polynomial, order))
        else:
            stack.append(_Term(None, None))
    return stack.pop().integral


def _polynomial(c: tuple[float, ...], order: int) -> _Term:
    if len(c) > _MAX_TERMS:
        return _Term(None, None)
    integral = c
    for _ in range(order):
        integral = (0.0, *(a / (k + 1) for k, a in enumerate(integral)))
    return _Term(c, _program(integral))


def _program(c: tuple[float, ...]) -> Ops:
    """The program of a polynomial in t by Horner's scheme."""
    program: Ops = (("const", c[-1]),)
    for a in reversed(c[:-1]):
        program = (*program, ("t", 0.0), ("*", 0.0), ("const", a), ("+", 0.0))
    return program


def _sum(left: Ops, right: Ops) -> Ops:
    return (*left, *right, ("+", 0.0))


def _scaled(term: _Term, factor: float, order: int) -> _Term:
    if term.polynomial is not None:
        return _polynomial(tuple(factor * c for c in term.polynomial), order)
    if term.integral is None:
        return term
    return _Term(None, (*term.integral, ("const", factor), ("*", 0.0)))


def _binary(op: str, left: _Term, right: _Term, order: int) -> _Term:
    if op == "-":
        return _binary("+", left, _scaled(right, -1.0, order), order)
    a, b = left.polynomial, right.polynomial
    if op == "+" and a is not None and b is not None:
        return _polynomial(tuple(np.polynomial.polynomial.polyadd(a, b).tolist()), order)
    if op == "+" and left.integral is not None and right.integral is not None:
        return _Term(None, _sum(left.integral, right.integral))
    if op == "*" and b is not None and len(b) == 1:
        return _scaled(left, b[0], order)
    if op == "*" and a is not None and len(a) == 1:
        return _scaled(right, a[0], order)
    if op == "*" and a is not None and b is not None:
        return _polynomial(tuple(np.polynomial.polynomial.polymul(a, b).tolist()), order)
    if op == "/" and b is not None and len(b) == 1 and b[0] != 0.0:
        return _scaled(left, 1.0 / b[0], order)
    return _Term(None, None)


def _power(base: _Term, exponent: float, order: int) -> _Term:
    whole = exponent == int(exponent) and 1 <= exponent < _MAX_TERMS
    if base.polynomial is None or not whole:
        return _Term(None, None)
    power = np.polynomial.polynomial.polypow(base.polynomial, int(exponent))
    return _polynomial(tuple(power.tolist()), order)


def _unary(op: str, argument: object, line: tuple[float, ...] | None, order: int) -> _Term:
    """For a function of s = a + b t: its antiderivative in s, divided by b to the power of the
    order."""
    if line is None or len(line) != 2 or line[1] == 0.0:
        return _Term(None, None)
    s = _program(line)
    program: Ops | None = None
    if (op, order) in _WAVES:
        wave, sign = _WAVES[op, order]
        program = (*s, (wave, 0.0), ("const", sign), ("*", 0.0))
    elif (op, order) in _RISES:
        rise = _RISES[op, order]
        program = tuple(part for step in rise for part in (s if step[0] == "t" else (step,)))
    elif op in _POLYNOMIAL_RISES:
        program = _pieces(Piecewise.between([0.0, 1.0], [_POLYNOMIAL_RISES[op]], "hold"), s, order)
    elif isinstance(argument, Piecewise):
        program = _pieces(argument, s, order)
    if program is None:
        return _Term(None, None)
    return _Term(None, (*program, ("const", line[1] ** -order), ("*", 0.0)))


def _pieces(function: Piecewise, s: Ops, order: int) -> Ops:
    """Antiderivative of a piecewise polynomial of s; for a periodic one the mean is treated
    separately."""
    if function.period == 0.0:
        for _ in range(order):
            function = function.antiderivative()
        return (*s, ("piecewise", function))
    mean, rest = function.without_mean()
    for _ in range(order):
        rest = rest.repeated_antiderivative()
    power = (*s, ("powc", 2.0)) if order == 2 else s
    grown = (*power, ("const", mean / math.factorial(order)), ("*", 0.0))
    return _sum((*s, ("piecewise", rest)), grown)


def _numerical(ops: Ops, order: int, end: float) -> Ops:
    """Numerical antiderivative, piece by piece over [0, end]; it has no value beyond."""

    def f(t: float) -> float:
        value = evaluate(ops, t)[0]
        if not math.isfinite(value):
            raise SceneError(f"the value is {value:g} at t = {t:.6g} s, not finite")
        return value

    size = max(abs(f(t)) for t in np.linspace(0.0, end, _SAMPLES))
    corners = [0.0, *derivative_jumps(ops, end), end]
    # The last interval is pushed first, so that intervals are processed in order.
    todo = [(a, b) for a, b in zip(corners[:-1], corners[1:], strict=True)][::-1]
    knots, rows = [0.0], []
    while todo:
        a, b = todo.pop()
        row = _fitted(f, a, b, _TOLERANCE * size)
        if row is None and b - a > _MIN_INTERVAL * end:
            todo += [(0.5 * (a + b), b), (a, 0.5 * (a + b))]
            continue
        if row is None:
            row = np.zeros(_DEGREE + 1)
            row[:2] = f(a), (f(b) - f(a)) / (b - a)
        knots.append(b)
        rows.append(row)
        if len(rows) > _MAX_PIECES:
            raise SceneError(f"it changes too often to be integrated over {end:g} s")
    last, nothing = shifted(rows[-1], knots[-1] - knots[-2]), np.full(_DEGREE + 1, np.nan)
    # A time may exceed the end by round-off: the last polynomial extends slightly beyond it.
    curve = Piecewise(
        np.array([*knots, (1.0 + _MIN_INTERVAL) * end]), np.vstack([rows[0], *rows, last, nothing])
    )
    for _ in range(order):
        curve = curve.antiderivative()
    return (("t", 0.0), ("piecewise", curve))


def _fitted(f: Callable[[float], float], a: float, b: float, allowed: float) -> np.ndarray | None:
    """Coefficients about a of the interpolating polynomial; None if it is inaccurate in between."""
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    values = np.polynomial.chebyshev.chebinterpolate(
        np.vectorize(lambda x: f(middle + half * x), otypes=[float]), _DEGREE
    )
    for share in _CHECK_POINTS:
        x = 2.0 * share - 1.0
        off = np.polynomial.chebyshev.chebval(x, values) - f(middle + half * x)
        if abs(off) > allowed:
            return None
    inside = Chebyshev(values, domain=[0.0, b - a])
    power = inside.convert(kind=Polynomial, domain=[-1.0, 1.0], window=[-1.0, 1.0]).coef
    return np.concatenate([power, np.zeros(_DEGREE + 1 - len(power))])
