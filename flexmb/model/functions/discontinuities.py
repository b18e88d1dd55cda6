"""Where a function of time jumps, bends, is undefined, or changes within a short time.

In: the postfix program of an expression (:mod:`flexmb.model.functions.expression`) and the duration
of a run. Times of jumps are those that can be read off: ends of steps, corners of tables and
profiles, zeros of abs and sign, changes of min and max, where arguments are linear in time; where
they are not, they are searched at 20 000 places of the run.

First discontinuities: programs of smooth operations are not looked at. The others are evaluated at
both sides of their corners and at equal distances; intervals whose ends do not fit the slopes are
halved until they are as short as round-off allows. What happens twice within one interval (1/512 of
the run) may be missed there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import BINARY, CHAIN, UNARY, Program, evaluate
from flexmb.model.functions.expression import Ops, channel_of
from flexmb.model.functions.piecewise import Piecewise

Line = tuple[float, float] | None
"""a + b t, or None for what is not linear in t."""

# Rises whose second derivative jumps at their ends; that of the others begins with zero.
_JUMPING_RISES = {"cubicstep", "haversinestep"}
# More than so many times all over again are no events but the motion itself.
_MAX_REPETITIONS = 100_000
_INTERVALS = 512
_MAX_BISECTED = 12  # intervals that are bisected
_HALVINGS = 44
_AT_START = 1e-9  # share of the run that is the start
_JUMP = 1e-9  # of the largest value; smaller jumps are round-off
_MAX_CORNERS = 2000  # that are examined
# Operations that are undefined, or jump, somewhere.
_UNSAFE = {"abs", "acos", "asin", "log", "sign", "sqrt", "tan"}
_UNSAFE |= {"/", "atan2", "max", "min", "pow", "powc"}


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
    """The first jump of the derivative of an order, of those that are seen."""
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
        if size > _JUMP * largest and high > _AT_START * times[-1]:  # nothing was before the start
            return Discontinuity(("value", "rate")[order], float(high), float(size))
    return None


def _misfit(low: Any, a: Any, high: Any, b: Any, order: int) -> Any:
    """How far the change over an interval is from the mean slope at its ends."""
    slopes = np.where(np.isfinite(s := a[..., order + 1] + b[..., order + 1]), s, 0.0)
    return np.abs(b[..., order] - a[..., order] - 0.5 * (high - low) * slopes)


# With these operations alone a function changes all the time.
_EVEN = {"const", "t", "neg", "+", "-", "*", "sin", "cos"}
_ARRAYS: dict[str, Callable[..., Array]] = {
    **{"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "pow": np.power},
    **{"min": np.minimum, "max": np.maximum, "atan2": np.arctan2, "hypot": np.hypot},
    **{"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "neg": np.negative},
    **{"sin": np.sin, "cos": np.cos, "tan": np.tan, "sinh": np.sinh, "cosh": np.cosh},
    **{"tanh": np.tanh, "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "abs": np.abs},
    **{name: lambda s: np.clip(s, 0.0, 1.0) for name in CHAIN if name.endswith("step")},
    "sign": np.sign,
}
_SAMPLES = 20_000  # of a run; what lasts for less than two of them may be missed
_RAPID_CHANGE = 10.0  # over the median change between samples
_NO_CHANGE = 1e-6  # of all
_RAPID_END = 0.5  # of that limit: a rapid change has ended below it
_LOW_POWER = 8  # a polynomial of this degree has no pulses
_SPAN, _SPANS = 0.2, 100  # share of the run that is not brief; more than so many are the motion


def brief_changes(ops: Ops, end: float) -> list[float]:
    """Times in (0, end) [s] from the beginning to the end of each brief change, such as a pulse
    ``exp(-((t - 5)/0.01)**2)``, five of each: a step from a state of rest would pass over it."""
    if {op for op, n in ops if op != "powc" or n not in range(_LOW_POWER + 1)} <= _EVEN:
        return []
    times = np.linspace(0.0, end, _SAMPLES + 1)
    with np.errstate(all="ignore"):
        values = np.nan_to_num(_values(ops, times), posinf=0.0, neginf=0.0)
    change = np.abs(np.diff(values))
    limit = max(_RAPID_CHANGE * float(np.median(change)), _NO_CHANGE * float(np.ptp(values)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], change > limit, [False]])))
    spans = times[edges].reshape(-1, 2)
    if len(spans) > _SPANS:
        return []
    groups = _joined(spans, times[1])
    groups = groups[np.diff(groups)[:, 0] < _SPAN * end]
    around = groups + np.diff(groups) * [-1.0, 1.0]  # where a pulse is over and growth is not
    after = np.interp(around, times[1:], change, left=0.0, right=0.0)
    groups = groups[(after < _RAPID_END * limit).all(axis=1)]
    begins, ends = groups.T[:, None]
    brief = spans[((begins <= spans[:, :1]) & (spans[:, 1:] <= ends)).any(axis=1)]
    beside = brief + np.array([-1.0, 1.0]) * times[1]
    jumps = np.searchsorted(derivative_jumps(ops, end), beside)  # these are events anyhow
    brief = brief[jumps[:, 0] == jumps[:, 1]]
    return [float(t) for t in np.linspace(brief[:, 0], brief[:, 1], 5).ravel() if 0.0 < t < end]


def _joined(spans: Array, apart: float) -> Array:
    """Spans (n, 2), those as one that are closer than the longer of them, such as rise and fall."""
    joined: list[list[float]] = []
    for begin, end in spans.tolist():
        first, last = joined[-1] if joined else (begin, -np.inf)
        if begin - last <= max(end - begin, last - first) + apart:
            joined[-1][1] = end
        else:
            joined.append([begin, end])
    return np.array(joined).reshape(-1, 2)


# Where operations change their laws; times, of which more are the motion itself; second differences
# over the range of what is straight.
_LAWS: dict[str, tuple[float, ...]] = {
    **dict.fromkeys(("abs", "sign", "max", "min"), (0.0,)),
    **dict.fromkeys(("cubicstep", "haversinestep"), (0.0, 1.0)),
}
_MAX_CROSSINGS, _STRAIGHT, _START = 2000, 1e-12, 1e-12


def switch_times(ops: Ops, end: float) -> list[float]:
    """Times in (0, end) [s] where operations change their laws by arguments that are not linear in
    time: zeros in ``abs(sin(t))``, equal arguments of max and min, ends of rises, corners; 0 where
    a sign is that of zero at the begin alone."""
    stack: list[Ops] = []
    times: list[float] = []
    for op, argument in ops:
        last = stack.pop() if op in BINARY or op in UNARY else ()
        first = stack.pop() if op in BINARY else ()
        stack.append((*first, *last, (op, argument)))
        places = _LAWS.get(op, ())
        if op in ("max", "min"):
            last = (*first, *last, ("-", 0.0))
        elif op == "piecewise" and argument.period == 0.0:
            places = argument.jumps()
        if len(places) and not any(channel_of(inner) for inner, _ in last):
            times += _times_at(last, places, end)
            if op == "sign" and evaluate(last, 0.0)[0] == 0.0 != evaluate(last, _START * end)[0]:
                times.append(0.0)
    return times if len(times) <= _MAX_CROSSINGS else []


def _times_at(ops: Ops, places: Sequence[float], end: float) -> list[float]:
    """Times (0, end) [s] at which a program of time that is not linear passes any of the places."""
    from scipy.optimize import brentq  # takes 0.2 s

    grid = np.linspace(0.0, end, _SAMPLES + 1)
    with np.errstate(all="ignore"):
        values = _values(ops, grid)
        bent = np.abs(np.diff(values, 2)).max() > _STRAIGHT * np.ptp(values)
    if not (np.isfinite(values).all() and bent):
        return []
    times: list[float] = []
    for place in places:
        beyond = values > place
        passed = np.flatnonzero(beyond[1:] != beyond[:-1])
        for k in passed if len(passed) <= _MAX_CROSSINGS else ():
            low, high = grid[k], grid[k + 1]
            ends = [evaluate(ops, t)[0] - place for t in (low, high)]
            if ends[0] * ends[1] < 0.0:
                times.append(brentq(lambda t: evaluate(ops, t)[0] - place, low, high, xtol=1e-300))  # noqa: B023
    return times


def _values(ops: Ops, times: Array) -> Array:
    """Values (n,) of a program at times (n,) [s]; channels are 1, and steps straight."""
    stack: list[Any] = []
    for op, argument in ops:
        if op == "t":
            stack.append(times)
        elif op == "const" or channel_of(op):
            stack.append(np.full_like(times, argument if op == "const" else 1.0))
        elif op in BINARY:
            right, left = stack.pop(), stack.pop()
            stack.append(_ARRAYS[op](left, right))
        elif op == "powc":
            stack.append(stack.pop() ** argument)
        else:
            stack.append((argument.values if op == "piecewise" else _ARRAYS[op])(stack.pop()))
    return np.asarray(stack[0])
