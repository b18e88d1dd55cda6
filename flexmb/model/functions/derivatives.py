"""Second-order derivatives of a function of time, and where it jumps or is undefined.

In: the postfix program of an expression (:mod:`flexmb.model.functions.expression`) and a time. Out:
a jet (f, df/dt, d2f/dt2), by the chain rule, exact to round-off. Outside the domain of a function
(logarithm of a negative number, division by zero) the result is not finite and nothing is raised:
the caller reports. This is the readable reference of the compiled kernel of the engine. Times of
jumps are those that can be read off: ends of steps, corners of tables and profiles, zeros of abs
and sign, changes of min and max, where arguments are linear in time.
Source: Griewank and Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 13.

Over a whole run, programs of smooth operations are not looked at. The others are evaluated at both
sides of their corners and at equal distances; intervals whose ends do not fit the slopes are halved
until they are as short as round-off allows. What happens twice within one interval (1/512 of the
run) may be missed there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.model.functions.piecewise import Piecewise

Jet = tuple[float, float, float]
Program = Iterable[tuple[str, Any]]


# Rises whose second derivative jumps at their ends; that of the others begins with zero.
_JUMPING_RISES = {"cubicstep", "haversinestep"}
# More than so many times all over again are no events but the motion itself.
_MAX_REPETITIONS = 100_000
Line = tuple[float, float] | None
_INTERVALS = 512
_SUSPECTS = 12  # intervals that are halved
_HALVINGS = 44
_SAME = 1e-9  # share of the run that is the start
_JUMP = 1e-9  # of the largest value; smaller jumps are round-off
_CORNERS = 2000  # that are looked at
# Operations that are undefined, or jump, somewhere.
_UNSAFE = {"abs", "acos", "asin", "log", "sign", "sqrt", "tan"}


def _times(g: float, a: float) -> float:
    """Product in which an exact zero wins over an infinite slope (sqrt of a constant zero)."""
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
    """A function that is 0 up to s = 0, 1 from s = 1, and this one between."""
    return lambda s: (float(s >= 1), 0.0, 0.0) if s <= 0 or s >= 1 else inside(s)


@_rise
def _cubic_step(s: float) -> Jet:
    """3 s^2 - 2 s^3 between."""
    return s * s * (3 - 2 * s), 6 * s * (1 - s), 6 - 12 * s


@_rise
def _quintic_step(s: float) -> Jet:
    """10 s^3 - 15 s^4 + 6 s^5 between."""
    r = s * (1 - s)
    return s**3 * (10 + s * (6 * s - 15)), 30 * r * r, 60 * r * (1 - 2 * s)


@_rise
def _haversine_step(s: float) -> Jet:
    """(1 - cos(pi s))/2."""
    a = np.pi * s
    return np.sin(a / 2) ** 2, np.pi / 2 * np.sin(a), np.pi**2 / 2 * np.cos(a)


@_rise
def _cycloidal_step(s: float) -> Jet:
    """s - sin(2 pi s)/(2 pi) between."""
    a = 2 * np.pi * s
    return s - np.sin(a) / (2 * np.pi), 2 * np.sin(a / 2) ** 2, 2 * np.pi * np.sin(a)


@_rise
def _modified_sine_step(s: float) -> Jet:
    """An eighth each of a fast sine at the ends, a slow one between.

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
    """a to a constant power; integer powers have no trouble at a = 0."""
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
"""Functions of two. Where min or max are undecided (equal values) their slope is the mean."""


UNARY = {*CHAIN, "neg", "powc", "piecewise"}
"""All operations on one jet."""


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
                assert variables is not None  # whoever has no channels asks no such program
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


"""a + b t, or None for what is not linear in t."""


def derivative_jumps(ops: Program, end: float, *, at_begin: bool = False) -> tuple[float, ...]:
    """Times in (0, end) [s], or in [0, end), in order."""
    times: set[float] = set()
    stack: list[Line] = []
    for op, argument in ops:
        if op == "const":
            stack.append((argument, 0.0))
        elif op == "t":
            stack.append((0.0, 1.0))
        elif op in BINARY:
            right, left = stack.pop(), stack.pop()
            if op in ("min", "max") and left and right and left[1] != right[1]:
                times.add((right[0] - left[0]) / (left[1] - right[1]))
            stack.append(_line(op, left, right))
        elif op in UNARY:
            line = stack.pop()
            if line is not None and line[1] != 0.0:
                times.update(_jump_times(op, argument, line, end))
            stack.append((-line[0], -line[1]) if op == "neg" and line is not None else None)
        else:  # what is not known beforehand
            stack.append(None)
    return tuple(sorted(t for t in times if 0.0 < t < end or (at_begin and t == 0.0 < end)))


def _line(op: str, left: Line, right: Line) -> Line:
    """The sum, difference, product or ratio where it is linear."""
    if left is None or right is None:
        return None
    (a, b), (c, d) = left, right
    if op in "+-":
        sign = 1.0 if op == "+" else -1.0
        return a + sign * c, b + sign * d
    if op == "*" and (b == 0.0 or d == 0.0):
        return a * c, a * d + b * c
    if op == "/" and d == 0.0 and c != 0.0:
        return a / c, b / c
    return None


def _jump_times(op: str, argument: object, line: tuple[float, float], end: float) -> list[float]:
    """Where a function of a + b t or a derivative jumps."""
    a, b = line
    if op in ("abs", "sign"):
        return [-a / b]
    if op in _JUMPING_RISES:
        return [-a / b, (1.0 - a) / b]
    if not isinstance(argument, Piecewise):
        return []
    places = argument.jumps()
    if argument.period > 0.0 and len(places):
        span = sorted((a, a + b * end))
        first = int(np.floor((span[0] - places[0]) / argument.period))
        last = int(np.ceil((span[1] - places[0]) / argument.period))
        if (last - first) * len(places) > _MAX_REPETITIONS:
            return []
        turns = np.arange(first, last + 1) * argument.period
        places = (places[None, :] + turns[:, None]).ravel()
    return [float(t) for t in (places - a) / b]


_UNSAFE |= {"/", "atan2", "max", "min", "pow", "powc"}


class Discontinuity(NamedTuple):
    """The first of its kind."""

    kind: str  # "undefined", "value" or "rate"
    time: float  # [s]
    size: float  # of the jump, SI


def first_discontinuities(ops: Program, end: float, derivatives: int) -> list[Discontinuity]:
    """The first time of each kind within a run.

    Parameters
    ----------
    ops : program
        Of time alone.
    end : float
        Of the run [s].
    derivatives : int
        How many derivatives must be finite.

    Returns
    -------
    list of Discontinuity
        Where value or derivatives are not finite, where the value jumps, and where the rate does.
    """
    program = tuple(ops)
    if end <= 0.0 or not any(_is_unsafe(*op) for op in program):
        return []
    times, jets = _samples(program, end)
    finite = np.all(np.isfinite(jets[:, : derivatives + 1]), axis=1)
    if not finite.all():
        return [_undefined(program, times, finite, derivatives)]
    return list(_jumps(program, end))


@lru_cache(maxsize=64)  # a study or an audit asks for those of one scene again and again
def _samples(ops: tuple[Any, ...], end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times at both sides of corners and at equal distances, and the jets there."""
    places = np.array(derivative_jumps(ops, end)[:_CORNERS])
    sides = np.nextafter(places, -np.inf), places, np.nextafter(places, np.inf)
    times = np.unique(np.concatenate([np.linspace(0.0, end, _INTERVALS + 1), *sides]))
    return times, np.array([evaluate(ops, t) for t in times])


@lru_cache(maxsize=64)
def _jumps(ops: tuple[Any, ...], end: float) -> tuple[Discontinuity, ...]:
    jumps = (_first_jump(ops, *_samples(ops, end), order) for order in (0, 1))
    return tuple(jump for jump in jumps if jump is not None)


def _is_unsafe(op: str, argument: object) -> bool:
    if op == "powc":
        return not (float(argument).is_integer() and argument >= 0)  # type: ignore[arg-type, operator]
    return op in _UNSAFE or isinstance(argument, Piecewise)


def _undefined(
    ops: Program, times: NDArray[np.float64], finite: NDArray[np.bool_], derivatives: int
) -> Discontinuity:
    k = int(np.argmin(finite))
    if k == 0:
        return Discontinuity("undefined", 0.0, np.nan)
    low, high = times[k - 1], times[k]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if np.isfinite(evaluate(ops, middle)[: derivatives + 1]).all():
            low = middle
        else:
            high = middle
    return Discontinuity("undefined", float(high), np.nan)


def _first_jump(
    ops: Program, times: NDArray[np.float64], jets: NDArray[np.float64], order: int
) -> Discontinuity | None:
    """The first jump of the derivative of an order, of those that are seen."""
    scale = np.abs(jets[:, order]).max()
    if order == 1:  # what the value would need to change by over the run
        scale = max(scale, np.abs(jets[:, 0]).max() / times[-1])
    if not scale > 0.0 or not np.isfinite(jets[:, order + 1]).any():
        return None
    errors = _misfit(times[:-1], jets[:-1], times[1:], jets[1:], order)
    corners = np.diff(times) <= 2.0 * np.spacing(times[1:])
    suspects = np.zeros(len(errors), bool)
    suspects[np.argsort(np.where(corners, 0.0, errors))[::-1][:_SUSPECTS]] = True
    for k in np.flatnonzero((corners | suspects) & (errors > _JUMP * scale)):
        low, high, a, b = times[k], times[k + 1], jets[k], jets[k + 1]
        largest = scale  # of what is seen: a short pulse may lie between the places at first
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            jet = np.array(evaluate(ops, middle))
            largest = np.fmax(largest, np.abs(jet[order]))
            left = _misfit(low, a, middle, jet, order)
            right = _misfit(middle, jet, high, b, order)
            if max(left, right, abs(jet[order + 1]) * np.spacing(high)) < 0.1 * _JUMP * scale:
                b = a  # smooth
                break
            if left >= right:
                high, b = middle, jet
            else:
                low, a = middle, jet
        size = abs(b[order] - a[order])
        if size > _JUMP * largest and high > _SAME * times[-1]:  # nothing was before the start
            return Discontinuity(("value", "rate")[order], float(high), float(size))
    return None


def _misfit(low: Any, a: Any, high: Any, b: Any, order: int) -> Any:
    """How far the change over an interval is from the mean slope at its ends."""
    slopes = np.where(np.isfinite(s := a[..., order + 1] + b[..., order + 1]), s, 0.0)
    return np.abs(b[..., order] - a[..., order] - 0.5 * (high - low) * slopes)
