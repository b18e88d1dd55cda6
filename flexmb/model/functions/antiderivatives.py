"""Antiderivatives of functions of time, once and twice, as programs of the same kind.

In: a postfix program that gives a velocity or an acceleration. Out: one that gives the
displacement. Sums of polynomials, sines, exponentials, rises and piecewise polynomials whose
arguments are linear in time are integrated in closed form. Anything else is integrated numerically
over the run, by Chebyshev interpolation on intervals that are halved until the interpolation is
accurate (Trefethen, Approximation Theory and Approximation Practice, 2013, ch. 8).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.chebyshev import chebder, chebpts1, chebval, chebvander
from numpy.typing import NDArray

from flexmb.errors import SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import BINARY, UNARY, evaluate, values_at
from flexmb.model.functions.discontinuities import derivative_jumps, switch_times
from flexmb.model.functions.expression import Ops, parse
from flexmb.model.functions.piecewise import Piecewise, shifted

_DEGREE = 12
_TOLERANCE = 1e-13  # largest error of interpolation, over the largest value during the run
# shortest interval over the run; a shorter one contains a jump, whose time is then known well
# enough
_MIN_INTERVAL = 1e-9
_MAX_PIECES = 200_000
# Nodes of the interpolation in (-1, 1), and places between them where it is checked, at fractions
# that no wave has as its period; matrices from values at nodes to Chebyshev's series, and from
# there to powers of x + 1.
_NODES = chebpts1(_DEGREE + 1)
_CHECK_POINTS = np.sin(np.sqrt([0.03, 0.2, 0.7, 1.3, 2.1]) * [-1.0, 1.0, -1.0, 1.0, -1.0])
_TO_SERIES = chebvander(_NODES, _DEGREE) * np.r_[1.0, np.full(_DEGREE, 2.0)] / (_DEGREE + 1)
_TO_POWERS = np.zeros((_DEGREE + 1, _DEGREE + 1))
for _k in range(_DEGREE + 1):
    _TO_POWERS[_k, : _k + 1] = Chebyshev.basis(_k, domain=[0.0, 2.0]).convert(kind=Polynomial).coef
# Samples of the run at which the interpolation is checked too: a prime number of intervals.
_SAMPLES = 20_011
_ROUNDINGS = 4.0  # of t, whose effect on the function is allowed
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
    times = np.linspace(0.0, end, _SAMPLES + 1)
    samples = _finite_values(ops, times)
    size = float(np.abs(samples).max())
    corners = np.unique([0.0, *derivative_jumps(ops, end), *switch_times(ops, end), end])
    todo, done = np.column_stack([corners[:-1], corners[1:]]), 0
    pieces, rows = [], []
    while len(todo):
        if done + len(todo) > _MAX_PIECES:
            raise SceneError(f"it changes too often to be integrated over {end:g} s")
        coefficients, fits = _fitted(ops, todo, times, samples, size)
        short = ~fits & (todo[:, 1] - todo[:, 0] <= _MIN_INTERVAL * end)
        coefficients[short] = _straight(ops, todo[short])
        pieces.append(todo[fits | short])
        rows.append(coefficients[fits | short])
        done += len(rows[-1])
        low, high = todo[~fits & ~short].T
        middle = 0.5 * (low + high)
        todo = np.column_stack([low, middle, middle, high]).reshape(-1, 2)
    intervals, table = np.concatenate(pieces), np.concatenate(rows)
    forward = np.argsort(intervals[:, 0])
    knots, table = np.append(0.0, intervals[forward, 1]), table[forward]
    last, nothing = shifted(table[-1], knots[-1] - knots[-2]), np.full(_DEGREE + 1, np.nan)
    # A time may exceed the end by round-off: the last polynomial extends slightly beyond it.
    curve = Piecewise(
        np.append(knots, (1.0 + _MIN_INTERVAL) * end), np.vstack([table[0], table, last, nothing])
    )
    for _ in range(order):
        curve = curve.antiderivative()
    return (("t", 0.0), ("piecewise", curve))


def _finite_values(ops: Ops, times: Array) -> Array:
    values = values_at(ops, times.ravel()).reshape(times.shape)
    lost = np.argwhere(~np.isfinite(values))
    if len(lost):
        value, t = values[tuple(lost[0])], times[tuple(lost[0])]
        raise SceneError(f"the value is {value:g} at t = {t:.6g} s, not finite")
    return values


def _fitted(
    ops: Ops, intervals: Array, times: Array, samples: Array, size: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Polynomials on intervals (n, 2): coefficients (n, p) about their begin, and which are
    accurate.

    They are so at places in between and at the samples of the run. What the round-off of t changes
    is no error.
    """
    middle, half = intervals.mean(axis=1), 0.5 * np.diff(intervals)[:, 0]
    at = middle[:, None] + half[:, None] * np.concatenate([_NODES, _CHECK_POINTS])
    values = _finite_values(ops, at)
    series = values[:, : len(_NODES)] @ _TO_SERIES
    off = np.abs(series @ chebvander(_CHECK_POINTS, _DEGREE).T - values[:, len(_NODES) :])
    slope = np.abs(chebder(series, axis=1) @ chebvander(_NODES, _DEGREE - 1).T).max(axis=1) / half
    allowed = _TOLERANCE * size + _ROUNDINGS * np.spacing(intervals[:, 1]) * slope
    fits: NDArray[np.bool_] = (off <= allowed[:, None]).all(axis=1)
    owner = np.searchsorted(intervals[:, 0], times, side="right") - 1
    own = np.flatnonzero((owner >= 0) & (times <= intervals[owner, 1]) & fits[owner])
    x = np.clip((times[own] - middle[owner[own]]) / half[owner[own]], -1.0, 1.0)
    wrong = np.abs(chebval(x, series[owner[own]].T, tensor=False) - samples[own])
    fits[owner[own][wrong > 2.0 * allowed[owner[own]]]] = False
    return series @ _TO_POWERS / half[:, None] ** np.arange(_DEGREE + 1), fits


def _straight(ops: Ops, intervals: Array) -> Array:
    """Straight lines on intervals (n, 2) that contain a jump."""
    first, last = _finite_values(ops, intervals).T
    rows = np.zeros((len(intervals), _DEGREE + 1))
    rows[:, 0], rows[:, 1] = first, (last - first) / (intervals[:, 1] - intervals[:, 0])
    return rows
