"""Functions of time within a run: jumps and kinks of loads, and pulses that fixed steps miss.

A fixed step does not end at events. A pulse that begins and ends between two times at which the
steps evaluate functions has no effect, neither with steps nor with half of them, so that no
difference of the two shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from flexmb.engine.compile import Compiled
from flexmb.engine.method import Method
from flexmb.flexbody.arrays import Array
from flexmb.model.functions.derivatives import Program, evaluate
from flexmb.model.functions.discontinuities import brief_changes, derivative_jumps, switch_times
from flexmb.units import UnitSystem

KinkedFunction: TypeAlias = tuple[Array, Callable[[float], float], float]
"""Times of its jumps and kinks [s], its load as a function of time, and the range of that load."""
AT_ONCE = 1e-8  # duration of a jump over that of the run
_SIDE_DISTANCE = 1e-9  # distance from a jump of the times just before and after it, over the run
_MIN_JUMP = 1e-3  # least jump of a load over its range
# Search for kinks of nested functions: intervals, and least jump of the rate over the largest rate.
_KINK_GRID_INTERVALS, _MIN_RATE_JUMP = 2000, 0.01
# Least height of a missed pulse over the range of its function; least area over that of the
# function.
_MIN_HEIGHT, _MIN_AREA = 0.05, 1e-6
_INNER = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])  # places between two events
_GRID_INTERVALS = 500  # of the run, for range and area of a function
_MAX_PAIRS = 500  # most pairs of neighbouring events that are examined, the most apart
_STEPS_OF_PULSE = 4.0  # advised steps in a pulse
_MAX_TEXT = 60  # characters of a function in a sentence


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
        grid = np.linspace(0.0, duration, _KINK_GRID_INTERVALS + 1)
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


def rows_beside_brief_changes(compiled: Compiled, duration: float, n: int, most: int) -> int:
    """The first number of intervals from `n` up to `most` that puts no row within a brief change.

    They are equal parts of a run of `duration` [s] from t = 0. Such a change of a load takes less
    than one of them. A row within it shows a motion that no other row resolves. `n` if there is no
    such number.
    """
    brief = [
        (begin, end)
        for times, load, size in kinked_functions(compiled, duration)
        for begin, end in pairwise(times)
        if end - begin < duration / n and abs(load(end) - load(begin)) > _MIN_JUMP * size
    ]
    ends = np.array(brief).reshape(-1, 2) / duration + _SIDE_DISTANCE * np.array([1.0, -1.0])
    free = (k for k in range(n, most + 1) if np.all(np.ceil(ends[:, 0] * k) > ends[:, 1] * k))
    return next(free, n)


class Pulse(NamedTuple):
    """A pulse between the stages of fixed steps."""

    begin: float  # s
    end: float  # s
    area: float  # height times duration


def missed_pulses(
    compiled: Compiled, integrator: Method, step: float, duration: float, halved: bool,
    units: UnitSystem,
) -> Iterator[str]:  # fmt: skip
    """A sentence on each function of time with pulses that fixed steps miss.

    Parameters
    ----------
    step, duration : float
        Of the run [s].
    halved : bool
        Whether half steps measure the error.
    """
    stages = stage_times(integrator, halved)
    for program in compiled.functions:
        if program.channels or program.constant is not None:
            continue
        pulses = pulses_between_stages(program.ops, step * stages, step, duration)
        if not pulses:
            continue
        first, text = pulses[0], program.text
        text = text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]}..."
        length = min(one.end - one.begin for one in pulses)
        more, them = (f" and {len(pulses) - 1} others", "them") if pulses[1:] else ("", "it")
        half = " and half of them" if halved else ""
        yield (
            f'"{text}" has a pulse of {units.say(first.end - first.begin, "s", 2)} at '
            f"t = {units.say(first.begin, 's', 4)}{more} between the times at which steps of "
            f"{units.say(step, 's', 3)}{half} evaluate it, so that the run misses {them}: take "
            f"steps of {units.say(length / _STEPS_OF_PULSE, 's', 1)}, or leave out dynamics.step, "
            "as controlled steps end at pulses"
        )


def stage_times(integrator: Method, halved: bool) -> Array:
    """Times (n,) at which a step evaluates functions, over the step, from 0 to 1."""
    coefficients, stages = integrator.coefficients[0], integrator.stages
    own = np.array([1.0])
    if integrator.collocation or stages:
        own = np.asarray(coefficients.c)[: stages or integrator.collocation]
    if halved:
        own = np.concatenate([own, 0.5 * own, 0.5 + 0.5 * own])
    return np.unique(np.concatenate([[0.0], own, [1.0]]))


def pulses_between_stages(ops: Program, stages: Array, step: float, duration: float) -> list[Pulse]:
    """Pulses of a function of time between the times k `step` + `stages` [s], in order."""
    program = tuple(ops)
    times = {*derivative_jumps(program, duration, derivatives=3)}
    times |= {*switch_times(program, duration), *brief_changes(program, duration)}
    events = np.array(sorted(times))
    close = np.flatnonzero(np.diff(events) < step)
    if len(close) == 0:
        return []

    def values(at: Array) -> Array:
        return np.array([evaluate(program, float(t))[0] for t in at])

    grid = np.linspace(0.0, duration, _GRID_INTERVALS + 1)
    everywhere = np.union1d(grid, events)
    levels = values(everywhere)
    if len(close) > _MAX_PAIRS:
        middles = values(events[close] + 0.5 * np.diff(events)[close])
        ends = levels[np.searchsorted(everywhere, events)]
        own = np.array([ends[close], middles, ends[close + 1]])
        beside = np.array(
            [np.interp(events[close] + side, everywhere, levels) for side in (-step, step)]
        )
        apart = np.maximum(
            (own - beside.max(axis=0)).max(axis=0), (beside.min(axis=0) - own).max(axis=0)
        )
        close = np.sort(np.argsort(-apart, kind="stable")[:_MAX_PAIRS])
    inner = events[close, None] + np.diff(events)[close, None] * _INNER
    heights = values(inner.ravel()).reshape(inner.shape)
    size = float(np.ptp(np.concatenate([levels, heights.ravel()])))
    pulses: list[Pulse] = []
    for k, own in zip(close, heights, strict=True):
        begin, end = float(events[k]), float(events[k + 1])
        at = np.arange(np.floor(begin / step), np.floor(end / step) + 1)
        visible = values((at[:, None] * step + stages).ravel())
        height = max(float(own.max() - visible.max()), float(visible.min() - own.min()))
        if height <= _MIN_HEIGHT * size:
            continue
        area = height * (end - begin)
        if pulses and pulses[-1].end == begin:
            begin, area = pulses[-1].begin, area + pulses.pop().area
        pulses.append(Pulse(begin, end, area))
    least = _MIN_AREA * sum(0.5 * (a + b) * dt for (a, b), dt in zip(
        pairwise(np.abs(levels)), np.diff(everywhere), strict=True))  # fmt: skip
    return [one for one in pulses if one.area > least]
