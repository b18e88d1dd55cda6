"""Second-order derivatives of a function of time.

In: the postfix program of an expression (:mod:`flexmb.model.functions.expression`) and a time. Out:
a jet (f, df/dt, d2f/dt2), by the chain rule, exact to round-off. Outside the domain of a function
(logarithm of a negative number, division by zero) the result is not finite and nothing is raised:
the caller reports. This is the readable reference of the compiled kernel of the engine.
Source: Griewank and Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 13.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import Array

Jet = tuple[float, float, float]
Program = Iterable[tuple[str, Any]]


def _times(g: float, a: float) -> float:
    """Product in which an exact zero times an infinite slope is zero (sqrt of a constant zero)."""
    return np.float64(0.0) if a == 0.0 else g * a


def _chain(g: Jet, a: Jet) -> Jet:
    """g(a(t)) from the derivatives of g at a and the jet of a."""
    return g[0], _times(g[1], a[1]), _times(g[2], a[1] * a[1]) + _times(g[1], a[2])


def _tan(a: float) -> Jet:
    f = np.tan(a)
    return f, 1 + f * f, 2 * f * (1 + f * f)


def _asin(a: float) -> Jet:
    w = 1 - a * a
    return np.arcsin(a), 1 / np.sqrt(w), a / (w * np.sqrt(w))


def _acos(a: float) -> Jet:
    w = 1 - a * a
    return np.arccos(a), -1 / np.sqrt(w), -a / (w * np.sqrt(w))


def _atan(a: float) -> Jet:
    w = 1 / (1 + a * a)
    return np.arctan(a), w, -2 * a * w * w


def _tanh(a: float) -> Jet:
    f = np.tanh(a)
    return f, 1 - f * f, -2 * f * (1 - f * f)


def _sqrt(a: float) -> Jet:
    f = np.sqrt(a)
    return f, 0.5 / f, -0.25 / (a * f)


def _rise(inside: Callable[[float], Jet]) -> Callable[[float], Jet]:
    """A function that is 0 for s <= 0, `inside` for 0 < s < 1, and 1 for s >= 1."""
    return lambda s: (float(s >= 1), 0.0, 0.0) if s <= 0 or s >= 1 else inside(s)


@_rise
def _cubic_step(s: float) -> Jet:
    """3 s^2 - 2 s^3 for 0 < s < 1."""
    return s * s * (3 - 2 * s), 6 * s * (1 - s), 6 - 12 * s


@_rise
def _quintic_step(s: float) -> Jet:
    """10 s^3 - 15 s^4 + 6 s^5 for 0 < s < 1."""
    r = s * (1 - s)
    return s**3 * (10 + s * (6 * s - 15)), 30 * r * r, 60 * r * (1 - 2 * s)


@_rise
def _haversine_step(s: float) -> Jet:
    """(1 - cos(pi s))/2 for 0 < s < 1."""
    a = np.pi * s
    return np.sin(a / 2) ** 2, np.pi / 2 * np.sin(a), np.pi**2 / 2 * np.cos(a)


@_rise
def _cycloidal_step(s: float) -> Jet:
    """s - sin(2 pi s)/(2 pi) for 0 < s < 1."""
    a = 2 * np.pi * s
    return s - np.sin(a) / (2 * np.pi), 2 * np.sin(a / 2) ** 2, 2 * np.pi * np.sin(a)


@_rise
def _modified_sine_step(s: float) -> Jet:
    """Modified sine: a fast sine in the first and last eighth, a slow one in between.

    Norton, Cam Design and Manufacturing Handbook, 2nd ed. (2009), section 3.6.
    """
    unit = 1 / (4 + np.pi)
    if 0.125 < s < 0.875:
        a = 4 * np.pi * s / 3 - np.pi / 6
        f = unit * (2 + np.pi * s - 2.25 * np.cos(a))
        return f, np.pi * unit * (1 + 3 * np.sin(a)), 4 * np.pi**2 * unit * np.cos(a)
    a = 4 * np.pi * s
    f = unit * (np.pi * s - 0.25 * np.sin(a)) + (4 * unit if s > 0.5 else 0.0)
    return f, 2 * np.pi * unit * np.sin(a / 2) ** 2, 4 * np.pi**2 * unit * np.sin(a)


CHAIN: dict[str, Callable[[float], Jet]] = {
    "sin": lambda a: (np.sin(a), np.cos(a), -np.sin(a)),
    "cos": lambda a: (np.cos(a), -np.sin(a), -np.cos(a)),
    "tan": _tan,
    "asin": _asin,
    "acos": _acos,
    "atan": _atan,
    "sinh": lambda a: (np.sinh(a), np.cosh(a), np.sinh(a)),
    "cosh": lambda a: (np.cosh(a), np.sinh(a), np.cosh(a)),
    "tanh": _tanh,
    "exp": lambda a: (np.exp(a), np.exp(a), np.exp(a)),
    "log": lambda a: (np.log(a), 1 / a, -1 / (a * a)),
    "sqrt": _sqrt,
    "abs": lambda a: (abs(a), np.sign(a), 0.0),
    "sign": lambda a: (np.sign(a), 0.0, 0.0),
    "cubicstep": _cubic_step,
    "quinticstep": _quintic_step,
    "haversinestep": _haversine_step,
    "cycloidalstep": _cycloidal_step,
    "modifiedsinestep": _modified_sine_step,
}
"""Functions of one argument: name to (g, g', g'') at a."""


def _power(c: float, a: float) -> Jet:
    """a to a constant power; for integer powers the derivatives at a = 0 are finite."""
    second = np.float64(0.0) if c == 1 else c * (c - 1) * a ** (c - 2)
    return a**c, c * a ** (c - 1), second


def _multiply(a: Jet, b: Jet) -> Jet:
    return a[0] * b[0], a[1] * b[0] + a[0] * b[1], a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2]


def _divide(a: Jet, b: Jet) -> Jet:
    f = a[0] / b[0]
    f1 = (a[1] - f * b[1]) / b[0]
    return f, f1, (a[2] - 2 * f1 * b[1] - f * b[2]) / b[0]


def _pow(a: Jet, b: Jet) -> Jet:
    f, log, ratio = a[0] ** b[0], np.log(a[0]), a[1] / a[0]
    g1 = b[1] * log + b[0] * ratio
    g2 = b[2] * log + 2 * b[1] * ratio + b[0] * (a[2] / a[0] - ratio * ratio)
    return f, f * g1, f * (g2 + g1 * g1)


def _atan2(y: Jet, x: Jet) -> Jet:
    d = x[0] * x[0] + y[0] * y[0]
    f1 = (x[0] * y[1] - y[0] * x[1]) / d
    n1 = x[0] * y[2] - y[0] * x[2]
    return np.arctan2(y[0], x[0]), f1, (n1 - 2 * f1 * (x[0] * x[1] + y[0] * y[1])) / d


def _hypot(a: Jet, b: Jet) -> Jet:
    f = np.hypot(a[0], b[0])
    n = 1 / f if f > 0 else 0.0
    f1 = (a[0] * a[1] + b[0] * b[1]) * n
    return f, f1, (a[1] ** 2 + a[0] * a[2] + b[1] ** 2 + b[0] * b[2] - f1 * f1) * n


def _lesser(a: Jet, b: Jet) -> Jet:
    if a[0] == b[0]:
        return a[0], 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
    return b if b[0] < a[0] else a


def _negative(a: Jet) -> Jet:
    return -a[0], -a[1], -a[2]


BINARY: dict[str, Callable[[Jet, Jet], Jet]] = {
    "+": lambda a, b: (a[0] + b[0], a[1] + b[1], a[2] + b[2]),
    "-": lambda a, b: (a[0] - b[0], a[1] - b[1], a[2] - b[2]),
    "*": _multiply,
    "/": _divide,
    "pow": _pow,
    "atan2": _atan2,
    "hypot": _hypot,
    "min": _lesser,
    "max": lambda a, b: _negative(_lesser(_negative(a), _negative(b))),
}
"""Functions of two arguments. At equal arguments of min or max the slope is the mean of both."""


UNARY = {*CHAIN, "neg", "powc", "piecewise"}
"""All operations on a single jet."""


def evaluate(ops: Program, t: float, variables: Mapping[str, Jet] | None = None) -> Jet:
    """Run a postfix program at time ``t`` [s].

    Parameters
    ----------
    ops : iterable of (str, float)
        Operations with their arguments; ``@name`` loads a channel.
    t : float
        Time [s].
    variables : mapping, optional
        Jets of the channels that the program names.

    Returns
    -------
    tuple of float
        Value, first and second derivative with respect to time.
    """
    stack: list[Jet] = []
    with np.errstate(all="ignore"):
        for op, argument in ops:
            if op == "const":
                stack.append((np.float64(argument), np.float64(0.0), np.float64(0.0)))
            elif op == "t":
                stack.append((np.float64(t), np.float64(1.0), np.float64(0.0)))
            elif op.startswith("@"):
                # programs without channels only, if there are no variables
                assert variables is not None
                f, f1, f2 = variables[op[1:]]
                stack.append((np.float64(f), np.float64(f1), np.float64(f2)))
            elif op == "neg":
                a = stack.pop()
                stack.append((-a[0], -a[1], -a[2]))
            elif op == "powc":
                a = stack.pop()
                stack.append(_chain(_power(argument, a[0]), a))
            elif op == "piecewise":
                a = stack.pop()
                stack.append(_chain(argument.jet(a[0]), a))
            elif op in CHAIN:
                a = stack.pop()
                stack.append(_chain(CHAIN[op](a[0]), a))
            else:
                b = stack.pop()
                stack.append(BINARY[op](stack.pop(), b))
    (f, f1, f2) = stack.pop()
    return float(f), float(f1), float(f2)


_ARRAYS: dict[str, Callable[..., Array]] = {
    **{"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "pow": np.power},
    **{"min": np.minimum, "max": np.maximum, "atan2": np.arctan2, "hypot": np.hypot},
    **{"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "neg": np.negative},
    **{"sin": np.sin, "cos": np.cos, "tan": np.tan, "sinh": np.sinh, "cosh": np.cosh},
    **{"tanh": np.tanh, "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "abs": np.abs},
    "sign": np.sign,
}


def _modified_sine_of_array(s: Array) -> Array:
    middle = 2 + np.pi * s - 2.25 * np.cos(4 * np.pi * s / 3 - np.pi / 6)
    ends = np.pi * s - 0.25 * np.sin(4 * np.pi * s) + 4 * (s > 0.5)
    curve: Array = np.where((s > 0.125) & (s < 0.875), middle, ends) / (4 + np.pi)
    return curve


_ARRAY_RISES: dict[str, Callable[[Array], Array]] = {
    "cubicstep": lambda s: s * s * (3 - 2 * s),
    "quinticstep": lambda s: s**3 * (10 + s * (6 * s - 15)),
    "haversinestep": lambda s: np.sin(0.5 * np.pi * s) ** 2,
    "cycloidalstep": lambda s: s - np.sin(2 * np.pi * s) / (2 * np.pi),
    "modifiedsinestep": _modified_sine_of_array,
}
"""Rises by their argument between 0 and 1."""


def values_at(ops: Program, times: Array, *, straight_rises: bool = False) -> Array:
    """Values (n,) of a program at times (n,) [s], with channels as 1: for a search over a run.

    With `straight_rises` rises are straight lines, which change alike from begin to end.
    """
    stack: list[Any] = []
    with np.errstate(all="ignore"):
        for op, argument in ops:
            if op == "t":
                stack.append(times)
            elif op == "const" or op.startswith("@"):
                stack.append(np.full_like(times, argument if op == "const" else 1.0))
            elif op in BINARY:
                right, left = stack.pop(), stack.pop()
                stack.append(_ARRAYS[op](left, right))
            elif op == "powc":
                stack.append(stack.pop() ** argument)
            elif op in _ARRAY_RISES:
                s = np.clip(stack.pop(), 0.0, 1.0)
                stack.append(s if straight_rises else _ARRAY_RISES[op](s))
            else:
                stack.append((argument.values if op == "piecewise" else _ARRAYS[op])(stack.pop()))
    return np.asarray(stack[0])
