"""Times at which a function of time, or one of its first two derivatives, jumps.

In: a postfix program. Out: the times in an interval, as far as they can be read off: ends of steps,
corners of tables and profiles whose argument is linear in time. Those of abs, sign, min and max are
not known.
"""

from __future__ import annotations

import numpy as np

from flexmb.model.functions import jets
from flexmb.model.functions.expression import Ops
from flexmb.model.functions.piecewise import Piecewise

__all__ = ["kinks_of"]

# Rises whose second derivative jumps at their ends; that of the others begins with zero.
_KINKED = {"cubicstep", "haversinestep"}
# More than so many times all over again are no events but the motion itself.
_MOST = 100_000

Line = tuple[float, float] | None
"""a + b t, or None for what is not linear in t."""


def kinks_of(ops: Ops, end: float) -> tuple[float, ...]:
    """Times in (0, end) [s], in order."""
    found: set[float] = set()
    stack: list[Line] = []
    for op, argument in ops:
        if op == "const":
            stack.append((argument, 0.0))
        elif op == "t":
            stack.append((0.0, 1.0))
        elif op in jets.BINARY:
            right = stack.pop()
            stack.append(_line(op, stack.pop(), right))
        elif op in jets.UNARY:
            line = stack.pop()
            if line is not None and line[1] != 0.0:
                found.update(_times(op, argument, line, end))
            stack.append((-line[0], -line[1]) if op == "neg" and line is not None else None)
        else:  # what is not known beforehand
            stack.append(None)
    return tuple(sorted(t for t in found if 0.0 < t < end))


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


def _times(op: str, argument: object, line: tuple[float, float], end: float) -> list[float]:
    """Where a function of a + b t has its kinks."""
    a, b = line
    if op in _KINKED:
        return [-a / b, (1.0 - a) / b]
    if not isinstance(argument, Piecewise):
        return []
    places = argument.jumps()
    if argument.period > 0.0 and len(places):
        span = sorted((a, a + b * end))
        first = int(np.floor((span[0] - places[0]) / argument.period))
        last = int(np.ceil((span[1] - places[0]) / argument.period))
        if (last - first) * len(places) > _MOST:
            return []
        turns = np.arange(first, last + 1) * argument.period
        places = (places[None, :] + turns[:, None]).ravel()
    return [float(t) for t in (places - a) / b]
