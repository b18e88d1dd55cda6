"""Times at which a function of time jumps, has a kink, is undefined, or changes rapidly.

In: the postfix program of an expression (:mod:`flexmb.model.functions.expression`) and the duration
of a run. If the argument of an operation is linear in time, the times of its jumps and kinks are
known in closed form: ends of steps, corners of tables and profiles, zeros of abs and sign, changes
of min and max. Otherwise they are searched on 20 000 intervals of the run.

:func:`first_discontinuities` skips programs of smooth operations. Others are evaluated on both
sides of their known corners and at equally spaced times. An interval over which the function
changes by another amount than its slopes at both ends predict is halved until its length is
round-off. Two events within one interval (1/512 of the run) may be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import BINARY, UNARY, Program, evaluate, values_at
from flexmb.model.functions.expression import Ops, channel_of
from flexmb.model.functions.piecewise import Piecewise

_Function = Callable[[Array], Array]  # values (n,) at times (n,) [s]
Line = tuple[float, float] | None
"""Coefficients (a, b) of a + b t; None for a function that is not linear in t."""

# Rises whose second derivative jumps at their ends, and those whose third one does; for these the
# second one starts and ends at zero.
_JUMPING_RISES = {"cubicstep", "haversinestep"}
_BENT_RISES = _JUMPING_RISES | {"quinticstep", "cycloidalstep", "modifiedsinestep"}
# More repetitions of a periodic function than this are not events but the motion itself.
_MAX_REPETITIONS = 100_000
_INTERVALS = 512
_MAX_BISECTED = 12  # largest number of intervals that are bisected
_HALVINGS = 44
_AT_START = 1e-9  # fraction of the run that counts as its start
_JUMP = 1e-9  # a jump smaller than this fraction of the largest value is round-off
_MAX_CORNERS = 2000  # largest number of corners that are examined
# Operations that are undefined at, or jump at, some argument.
_UNSAFE = {"abs", "acos", "asin", "log", "sign", "sqrt", "tan"}
_UNSAFE |= {"/", "atan2", "max", "min", "pow", "powc"}


def derivative_jumps(
    ops: Program, end: float, *, at_begin: bool = False, derivatives: int = 2,
    least_change: float = 0.0, of_integral: bool = False,
) -> tuple[float, ...]:  # fmt: skip
    """Times in (0, end) [s], or in [0, end), at which value or derivatives jump, in order.

    Only those that are known in closed form, for arguments that are linear in time. Of the first
    two derivatives, or of three; `least_change` is that of `Piecewise.jumps`, or of the integral
    over the time.
    """
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
                least = least_change, end * abs(line[1]) * of_integral
                times.update(_jump_times(op, argument, line, end, derivatives, least))
            stack.append((-line[0], -line[1]) if op == "neg" and line is not None else None)
        else:  # not known in advance
            stack.append(None)
    return tuple(sorted(t for t in times if 0.0 < t < end or (at_begin and t == 0.0 < end)))


def _line(op: str, left: Line, right: Line) -> Line:
    """The sum, difference, product or quotient of two linear functions, if it is linear; else
    None."""
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


def _jump_times(
    op: str, argument: object, line: tuple[float, float], end: float, derivatives: int,
    least: tuple[float, float],
) -> list[float]:  # fmt: skip
    """Times at which an operation on a + b t, or one of its derivatives, jumps."""
    a, b = line
    if op in ("abs", "sign"):
        return [-a / b]
    if op in (_JUMPING_RISES if derivatives == 2 else _BENT_RISES):
        return [-a / b, (1.0 - a) / b]
    if not isinstance(argument, Piecewise):
        return []
    places = argument.jumps(derivatives, *(least if derivatives == 3 else ()))
    if argument.period > 0.0 and len(places):
        span = sorted((a, a + b * end))
        first = int(np.floor((span[0] - places[0]) / argument.period))
        last = int(np.ceil((span[1] - places[0]) / argument.period))
        if (last - first) * len(places) > _MAX_REPETITIONS:
            return []
        turns = np.arange(first, last + 1) * argument.period
        places = (places[None, :] + turns[:, None]).ravel()
    return [float(t) for t in (places - a) / b]


class Discontinuity(NamedTuple):
    """The first discontinuity of its kind."""

    kind: str  # "undefined", "value" or "rate"
    time: float  # [s]
    size: float  # of the jump, SI


def first_discontinuities(ops: Program, end: float, derivatives: int) -> list[Discontinuity]:
    """The first time of each kind within a run.

    Parameters
    ----------
    ops : program
        Program of a function of time alone.
    end : float
        Duration of the run [s].
    derivatives : int
        Number of derivatives that must be finite.

    Returns
    -------
    list of Discontinuity
        Where value or derivatives are not finite; else where the value and where the rate jumps.
    """
    program = tuple(ops)
    if end <= 0.0 or not any(_is_unsafe(*op) for op in program):
        return []
    times, jets = _samples(program, end)
    finite = np.all(np.isfinite(jets[:, : derivatives + 1]), axis=1)
    if not finite.all():
        return [_undefined(program, times, finite, derivatives)]
    return list(_jumps(program, end))


@lru_cache(maxsize=64)  # a study or an audit evaluates the functions of one scene many times
def _samples(ops: tuple[Any, ...], end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times on both sides of corners and at equal distances, and the jets at these times."""
    places = np.array(derivative_jumps(ops, end)[:_MAX_CORNERS])
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
    """The first jump of a derivative of a given order; jumps between two samples may be missed."""
    scale = np.abs(jets[:, order]).max()
    if order == 1:  # what the value would need to change by over the run
        scale = max(scale, np.abs(jets[:, 0]).max() / times[-1])
    if not scale > 0.0 or not np.isfinite(jets[:, order + 1]).any():
        return None
    errors = _misfit(times[:-1], jets[:-1], times[1:], jets[1:], order)
    corners = np.diff(times) <= 2.0 * np.spacing(times[1:])
    suspects = np.zeros(len(errors), bool)
    suspects[np.argsort(np.where(corners, 0.0, errors))[::-1][:_MAX_BISECTED]] = True
    for k in np.flatnonzero((corners | suspects) & (errors > _JUMP * scale)):
        low, high, a, b = times[k], times[k + 1], jets[k], jets[k + 1]
        largest = scale  # of the samples so far: a short pulse may lie between the initial ones
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            jet = np.array(evaluate(ops, middle))
            largest = np.fmax(largest, np.abs(jet[order]))
            left = _misfit(low, a, middle, jet, order)
            right = _misfit(middle, jet, high, b, order)
            if max(left, right, abs(jet[order + 1]) * np.spacing(high)) < 0.1 * _JUMP * scale:
                b = a  # no jump
                break
            if left >= right:
                high, b = middle, jet
            else:
                low, a = middle, jet
        size = abs(b[order] - a[order])
        if size > _JUMP * largest and high > _AT_START * times[-1]:  # nothing was before the start
            return Discontinuity(("value", "rate")[order], float(high), float(size))
    return None


def _misfit(low: Any, a: Any, high: Any, b: Any, order: int) -> Any:
    """Difference between the change over an interval and the mean slope at its ends times its
    length."""
    slopes = np.where(np.isfinite(s := a[..., order + 1] + b[..., order + 1]), s, 0.0)
    return np.abs(b[..., order] - a[..., order] - 0.5 * (high - low) * slopes)


# Samples of a run, and of one in which a function changes more than _MANY times; an event shorter
# than two intervals may be missed. They are primes: samples of a wave are at all its phases.
_SAMPLES, _CLOSE_SAMPLES, _MANY = 20_011, 200_003, 100
_RAPID_CHANGE = 10.0  # a change between samples is rapid above this multiple of the median change
_NO_CHANGE = 1e-6  # and above this fraction of the whole range
_RAPID_END = 0.5  # a rapid change has ended where changes are below this fraction of the limit
_LOW_DEGREE = 32  # polynomials of t, sines and cosines up to this degree have no pulses
_MAX_BRIEF_FRACTION = 0.2  # a change is brief if shorter than this fraction of the run


def brief_changes(ops: Ops, end: float) -> list[float]:
    """Times in (0, end) [s] of brief changes, such as a pulse ``exp(-((t - 5)/0.01)**2)``. They are
    five times from the beginning to the end of each: a time step from a state of rest might
    otherwise skip it. Of many, as in a train of pulses, they are the middles of those in which
    no formula is switched."""
    if _is_polynomial(ops):
        return []
    spans, groups = _brief_spans(ops, end, _SAMPLES)
    if len(spans) > _MANY:
        _, groups = _brief_spans(ops, end, _CLOSE_SAMPLES)
        events = np.sort([*derivative_jumps(ops, end), *switch_times(ops, end)])
        outside = groups + np.array([-2.0, 2.0]) * end / _CLOSE_SAMPLES
        inside = np.searchsorted(events, outside)
        places = groups[inside[:, 0] == inside[:, 1]].mean(axis=1)
        return [float(t) for t in places if 0.0 < t < end]
    begins, ends = groups.T[:, None]
    brief = spans[((begins <= spans[:, :1]) & (spans[:, 1:] <= ends)).any(axis=1)]
    beside = brief + np.array([-1.0, 1.0]) * (end / _SAMPLES)
    jumps = np.searchsorted(derivative_jumps(ops, end), beside)  # jumps are events in any case
    brief = brief[jumps[:, 0] == jumps[:, 1]]
    return [float(t) for t in np.linspace(brief[:, 0], brief[:, 1], 5).ravel() if 0.0 < t < end]


def _is_polynomial(ops: Ops) -> bool:
    """Whether a program is a polynomial of low degree of t, sines and cosines: it has no pulses."""
    degrees: list[float] = []
    for op, argument in ops:
        if op in ("const", "t"):
            degrees.append(float(op == "t"))
        elif op in ("+", "-", "*"):
            right, left = degrees.pop(), degrees.pop()
            degrees.append(left + right if op == "*" else max(left, right))
        elif op == "powc" and argument >= 0.0 and argument == int(argument):
            degrees[-1] *= argument
        elif op not in ("neg", "sin", "cos"):
            return False
    return degrees[0] <= _LOW_DEGREE


def _brief_spans(ops: Ops, end: float, samples: int) -> tuple[Array, Array]:
    """Begins and ends (n, 2) [s] of rapid changes, and of groups of them that are brief."""
    times = np.linspace(0.0, end, samples + 1)
    values = np.nan_to_num(values_at(ops, times, straight_rises=True), posinf=0.0, neginf=0.0)
    change = np.abs(np.diff(values))
    limit = max(_RAPID_CHANGE * float(np.median(change)), _NO_CHANGE * float(np.ptp(values)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], change > limit, [False]])))
    spans = times[edges].reshape(-1, 2)
    groups = _joined(spans, times[1])
    groups = groups[np.diff(groups)[:, 0] < _MAX_BRIEF_FRACTION * end]
    # outside of a pulse changes are small again; in growth they are not
    around = groups + np.diff(groups) * [-1.0, 1.0]
    after = np.interp(around, times[1:], change, left=0.0, right=0.0)
    return spans, groups[(after < _RAPID_END * limit).all(axis=1)]


def _joined(spans: Array, apart: float) -> Array:
    """Intervals (n, 2), those merged that are closer than the longer of them, such as rise and
    fall."""
    joined: list[list[float]] = []
    for begin, end in spans.tolist():
        first, last = joined[-1] if joined else (begin, -np.inf)
        if begin - last <= max(end - begin, last - first) + apart:
            joined[-1][1] = end
        else:
            joined.append([begin, end])
    return np.array(joined).reshape(-1, 2)


# Arguments at which operations switch to another formula. A larger number of switches than
# _MAX_CROSSINGS is the motion itself. An argument is linear in time if its second differences are
# below _LINEAR_TOLERANCE times its range. _START is the fraction of the run just after its start.
_SWITCH_VALUES: dict[str, tuple[float, ...]] = {
    **dict.fromkeys(("abs", "sign", "max", "min"), (0.0,)),
    **dict.fromkeys(("cubicstep", "haversinestep"), (0.0, 1.0)),
}
_MAX_CROSSINGS, _LINEAR_TOLERANCE, _START = 20_000, 1e-12, 1e-12
# Arguments at which operations have a kink if their argument turns there, as in `asin(sin(t))`, and
# how close to them counts; difference of times, over that of samples, that shows a turn.
_TURNS = {"asin": (-1.0, 1.0), "acos": (-1.0, 1.0), "sqrt": (0.0,)}
_SAME_VALUE, _TURN_SHARE = 1e-9, 0.01
# Times behind a pole, over the run, and the ratio of values at them from which on it is one.
_BESIDE_POLE, _POLE_GROWTH = (1e-7, 1e-6), 3.0


@lru_cache(maxsize=64)
def switch_times(ops: Ops, end: float) -> tuple[float, ...]:
    """Times in (0, end) [s] at which operations switch formulas, if their argument is not linear in
    time: zeros in ``abs(sin(t))``, equal arguments of max and min, ends of rises, corners; those of
    inverse functions in ``asin(sin(t))`` and ``atan2(sin(t), cos(t))``, poles of tan and of
    quotients; 0 if the argument of a sign is zero only at the start."""
    stack: list[Ops] = []
    times: list[float] = []
    for op, argument in ops:
        last = stack.pop() if op in BINARY or op in UNARY else ()
        first = stack.pop() if op in BINARY else ()
        stack.append((*first, *last, (op, argument)))
        if any(channel_of(inner) for inner, _ in (*first, *last)):
            continue
        places = _SWITCH_VALUES.get(op, ())
        if op in ("max", "min"):
            last = (*first, *last, ("-", 0.0))
        elif op == "tan":
            last, places = (*last, ("cos", 0.0)), (0.0,)
        elif op == "piecewise" and argument.period == 0.0:
            places = argument.jumps()
        if len(places):
            times += _times_at(partial(values_at, last), places, end)
            if op == "sign" and evaluate(last, 0.0)[0] == 0.0 != evaluate(last, _START * end)[0]:
                times.append(0.0)
        elif op in _TURNS:
            times += _turns_at(last, _TURNS[op], end)
        elif op == "/" or (op == "powc" and argument < 0.0):
            zeros = np.array(_times_at(partial(values_at, last), (0.0,), end))
            near, far = (np.abs(values_at(stack[-1], zeros + d * end)) for d in _BESIDE_POLE)
            times += zeros[near > _POLE_GROWTH * far].tolist()  # not those of sin(5*t)/sin(t)
        elif op == "atan2":  # of y and x
            zeros = np.array(_times_at(partial(values_at, first), (0.0,), end))
            times += zeros[values_at(last, zeros) < 0.0].tolist()
    return tuple(times) if len(times) <= _MAX_CROSSINGS else ()


def _turns_at(ops: Ops, places: Sequence[float], end: float) -> list[float]:
    """Times in (0, end) [s] at which a program turns at any of the values."""
    apart = _TURN_SHARE * end / _SAMPLES

    def change(t: Array) -> Array:
        before, after = (np.clip(t + step, 0.0, end) for step in (-apart, apart))
        return values_at(ops, after) - values_at(ops, before)

    turns = np.array(_times_at(change, (0.0,), end))
    away = np.abs(values_at(ops, turns)[:, None] - np.array(places)).min(axis=1, initial=np.inf)
    return [float(t) for t in turns[away <= _SAME_VALUE]]


def _times_at(function: _Function, places: Sequence[float], end: float) -> list[float]:
    """Times in (0, end) [s] at which a function, if not linear in time, has any of the values."""
    grid = np.linspace(0.0, end, _SAMPLES + 1)
    values = function(grid)
    if not np.isfinite(values).all():
        return []
    if np.abs(np.diff(values, 2)).max() <= _LINEAR_TOLERANCE * np.ptp(values):
        return []
    if any(len(_passages(values, place)) > _MANY for place in places):
        grid = np.linspace(0.0, end, _CLOSE_SAMPLES + 1)
        values = function(grid)
    times: list[float] = []
    for place in places:
        passed = _passages(values, place)
        if 0 < len(passed) <= _MAX_CROSSINGS:
            times += _crossings(function, place, grid[passed], grid[passed + 1])
    return times


def _passages(values: Array, place: float) -> NDArray[np.intp]:
    """Intervals of a grid, by number, over which values pass a value."""
    beyond = values > place
    return np.flatnonzero(beyond[1:] != beyond[:-1])


def _crossings(function: _Function, place: float, low: Array, high: Array) -> list[float]:
    """Times [s] at which a function has a value, one in each interval that has it on both sides."""
    first, last = (function(t) - place for t in (low, high))
    within = first * last < 0.0
    low, high, below = low[within], high[within], first[within] < 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        before = (function(middle) < place) == below
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    times: list[float] = (0.5 * (low + high)).tolist()
    return times
