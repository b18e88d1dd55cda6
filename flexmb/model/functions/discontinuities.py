"""Where a function of time is undefined or jumps, over a whole run.

In: the postfix program of a function of time alone. Out: the first time at which it has no value,
at which its value jumps, or at which its rate jumps. Programs of smooth operations are not looked
at. The others are evaluated at both sides of their corners, as far as these can be read off, and at
equal distances; intervals whose ends do not fit the slopes are halved until they are as short as
round-off allows. What happens twice within one interval (1/512 of the run) may be missed there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.model.functions.derivatives import Program, derivative_jumps, evaluate
from flexmb.model.functions.piecewise import Piecewise

_INTERVALS = 512
_SUSPECTS = 12  # intervals that are halved
_HALVINGS = 44
_SAME = 1e-9  # share of the run that is the start
_JUMP = 1e-9  # of the largest value; smaller jumps are round-off
_CORNERS = 2000  # that are looked at

# Operations that are undefined, or jump, somewhere.
_UNSAFE = {"abs", "acos", "asin", "log", "sign", "sqrt", "tan"}
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
    ops = tuple(ops)
    if end <= 0.0 or not any(_is_unsafe(*op) for op in ops):
        return []
    places = np.array(derivative_jumps(ops, end)[:_CORNERS])
    sides = np.nextafter(places, -np.inf), places, np.nextafter(places, np.inf)
    times = np.unique(np.concatenate([np.linspace(0.0, end, _INTERVALS + 1), *sides]))
    jets = np.array([evaluate(ops, t) for t in times])
    finite = np.isfinite(jets[:, : derivatives + 1]).all(axis=1)
    if not finite.all():
        return [_undefined(ops, times, finite, derivatives)]
    found = (_first_jump(ops, times, jets, order) for order in (0, 1))
    return [jump for jump in found if jump is not None]


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
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            jet = np.array(evaluate(ops, middle))
            if _misfit(low, a, middle, jet, order) >= _misfit(middle, jet, high, b, order):
                high, b = middle, jet
            else:
                low, a = middle, jet
        size = abs(b[order] - a[order])
        if size > _JUMP * scale and high > _SAME * times[-1]:  # nothing was before the start
            return Discontinuity(("value", "rate")[order], float(high), float(size))
    return None


def _misfit(low: Any, a: Any, high: Any, b: Any, order: int) -> Any:
    """How far the change over an interval is from the mean slope at its ends."""
    slopes = np.nan_to_num(a[..., order + 1] + b[..., order + 1], posinf=0.0, neginf=0.0)
    return np.abs(b[..., order] - a[..., order] - 0.5 * (high - low) * slopes)
