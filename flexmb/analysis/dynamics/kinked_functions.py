"""Functions of time that jump or bend within a run, and the loads that go with them."""

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
"""Times of its jumps and bends, the load that goes with it, the range of that."""
AT_ONCE = 1e-8  # of a run: what a jump takes
_BESIDE = 1e-9  # of a run: beside a jump
_JUMP = 1e-3  # of the range of a load: its jumps are larger
_LOOKS, _BEND = 2000, 0.01  # for bends of nested functions: times, and share of the largest rate


def kinked_functions(compiled: Compiled, duration: float) -> Sequence[KinkedFunction]:
    """Functions of time with jumps or bends, at the beginning too.

    The load of a driver goes with its second derivative, else with the value.
    """
    driven = set(compiled.system.rows["fun"].tolist())
    bent = []
    for k, program in enumerate(compiled.functions):
        times = [] if program.channels else _kinks(tuple(program.ops), duration)
        if times:
            order = 2 if k in driven else 0
            shape = partial(lambda ops, order, t: evaluate(ops, t)[order], program.ops, order)
            beside = (t + s * duration for t in times for s in (-_BESIDE, _BESIDE))
            values = [shape(t) for t in (0.0, *beside, duration)]
            bent.append((np.array(times), shape, float(np.ptp(values)) or 1.0))
    return bent


def _kinks(ops: Program, duration: float) -> list[float]:
    """Times at which a function of time jumps or bends: those known, and of nested min and max."""
    times = set(derivative_jumps(ops, duration, at_begin=True))
    if any(op in ("min", "max") for op, _ in ops):
        grid = np.linspace(0.0, duration, _LOOKS + 1)
        jets = np.array([evaluate(ops, float(t)) for t in grid])
        bend = np.diff(jets[:, 1]) - np.diff(grid) * (jets[1:, 2] + jets[:-1, 2]) / 2
        for k in np.flatnonzero(np.abs(bend) > _BEND * np.abs(jets[:, 1]).max()):
            a, b = grid[k], grid[k + 1]
            while b - a > AT_ONCE * duration:  # to where the rate is another
                middle = 0.5 * (a + b)
                rate = evaluate(ops, float(middle))[1]
                nearer = abs(rate - jets[k, 1]) < abs(rate - jets[k + 1, 1])
                a, b = (middle, b) if nearer else (a, middle)
            times.add(0.5 * (a + b))
    return sorted(times)


def rows_behind_jumps(compiled: Compiled, t: Array) -> list[int]:
    """Rows (of times t) that are the first behind a jump of what drives a model."""
    duration = float(t[-1] - t[0])
    rows = set()
    for times, load, size in kinked_functions(compiled, float(t[-1])):
        for time in times:
            sides = [load(time + s * _BESIDE * duration) for s in (-1.0, 1.0)]
            if abs(sides[1] - sides[0]) <= _JUMP * size:
                continue
            row = int(np.searchsorted(t, time - _BESIDE * duration))
            if row < len(t) and abs(t[row] - time) <= _BESIDE * duration:
                now = load(float(t[row]))
                row += abs(now - sides[0]) < abs(now - sides[1])
            if 0 < row < len(t):
                rows.add(row)
    return sorted(rows)
