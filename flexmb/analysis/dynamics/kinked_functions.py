"""Functions of time with jumps or kinks within a run, and the loads that they cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import Program, evaluate
from flexmb.model.functions.discontinuities import derivative_jumps

KinkedFunction: TypeAlias = tuple[Array, Callable[[float], float], float]
"""Times of its jumps and kinks [s], its load as a function of time, and the range of that load."""
AT_ONCE = 1e-8  # duration of a jump over that of the run
_SIDE_DISTANCE = 1e-9  # distance from a jump of the times just before and after it, over the run
_MIN_JUMP = 1e-3  # least jump of a load over its range
# Search for kinks of nested functions: intervals, and least jump of the rate over the largest rate.
_GRID_INTERVALS, _MIN_RATE_JUMP = 2000, 0.01


def kinked_functions(compiled: Compiled, duration: float) -> Sequence[KinkedFunction]:
    """Functions of time with jumps or kinks, including those at the start.

    The load of a driver is its second derivative, that of other functions the value.
    """
    driven = set(compiled.system.rows["fun"].tolist())
    bent = []
    for k, program in enumerate(compiled.functions):
        times = [] if program.channels else _kink_times(tuple(program.ops), duration)
        if times:
            order = 2 if k in driven else 0
            shape = partial(lambda ops, order, t: evaluate(ops, t)[order], program.ops, order)
            beside = (t + s * duration for t in times for s in (-_SIDE_DISTANCE, _SIDE_DISTANCE))
            values = [shape(t) for t in (0.0, *beside, duration)]
            bent.append((np.array(times), shape, float(np.ptp(values)) or 1.0))
    return bent


def _kink_times(ops: Program, duration: float) -> list[float]:
    """Times of jumps and kinks of a function of time, including those of nested min and max [s]."""
    times = set(derivative_jumps(ops, duration, at_begin=True))
    if any(op in ("min", "max") for op, _ in ops):
        grid = np.linspace(0.0, duration, _GRID_INTERVALS + 1)
        jets = np.array([evaluate(ops, float(t)) for t in grid])
        bend = np.diff(jets[:, 1]) - np.diff(grid) * (jets[1:, 2] + jets[:-1, 2]) / 2
        for k in np.flatnonzero(np.abs(bend) > _MIN_RATE_JUMP * np.abs(jets[:, 1]).max()):
            a, b = grid[k], grid[k + 1]
            while b - a > AT_ONCE * duration:  # bisection by the rate
                middle = 0.5 * (a + b)
                rate = evaluate(ops, float(middle))[1]
                nearer = abs(rate - jets[k, 1]) < abs(rate - jets[k + 1, 1])
                a, b = (middle, b) if nearer else (a, middle)
            times.add(0.5 * (a + b))
    return sorted(times)


def rows_behind_jumps(compiled: Compiled, t: Array) -> list[int]:
    """Numbers of the rows (at times t) that are the first after a jump of a load or driver."""
    duration = float(t[-1] - t[0])
    rows = set()
    for times, load, size in kinked_functions(compiled, float(t[-1])):
        for time in times:
            sides = [load(time + s * _SIDE_DISTANCE * duration) for s in (-1.0, 1.0)]
            if abs(sides[1] - sides[0]) <= _MIN_JUMP * size:
                continue
            row = int(np.searchsorted(t, time - _SIDE_DISTANCE * duration))
            if row < len(t) and abs(t[row] - time) <= _SIDE_DISTANCE * duration:
                now = load(float(t[row]))
                row += abs(now - sides[0]) < abs(now - sides[1])
            if 0 < row < len(t):
                rows.add(row)
    return sorted(rows)
