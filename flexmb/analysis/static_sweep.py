"""Equilibria over a parameter or time: one branch, its stability, and its end.

In: a function that makes the model for a value, and values. Out: a `StaticSweep` with an
equilibrium for each value, each found from the one before, and events between values. Events are
limit points, where a branch ends and the machine moves to another equilibrium; values from which
there is no equilibrium; and changes of stability. An event is located by bisection. If halving the
interval halves the distance of the equilibria at its ends, the branch is continuous; if the
distance remains, it is a jump.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexmb.analysis.equilibrium_search import Equilibrium, find_equilibrium, separation
from flexmb.analysis.monitors import Indicator
from flexmb.engine.compile import Compiled
from flexmb.errors import AssemblyError, SceneError
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results.channels import HistoryTable
from flexmb.results.export import export_table

Array = np.ndarray

_MAX_BISECTIONS = 12
# If bisection reduces a distance to less than this share of it, the branch is continuous.
_JUMP_SHARE = 0.2
# A jump is suspected if the distance per change of the parameter is so many times that before, or
# if the first distance, over the model size or in radians, is larger than the second number.
_DISTANCE_RATIO = 2.0
_FIRST_DISTANCE = 0.01
_ZERO_DISTANCE = 1e-6  # distance over the model size that is round-off


class SystemAt(NamedTuple):
    """The model for one value of the parameter, and the time of its functions [s]."""

    compiled: Compiled
    model: Model
    time: float = 0.0


@dataclass(frozen=True)
class SweepEvent:
    """An event between two values of the parameter.

    Attributes
    ----------
    kind : str
        "limit point", "no equilibrium", "stability lost" or "stability gained".
    low, high : float
        Values between which it is; `low` is on the side of the previous value of the sweep.
    sentence : str
        Description for the user.
    place : int
        Number of values before it.
    """

    kind: str
    low: float
    high: float
    sentence: str
    place: int = 0


@dataclass(frozen=True)
class SweepPoint:
    """One value of a sweep: its equilibrium, channels in the scene's units, and stability."""

    value: float
    equilibrium: Equilibrium
    channels: Array
    growth: float  # largest Re λ [1/s]; NaN where there are no modes
    stable: bool
    limits: tuple[Indicator, ...] = ()  # that flexible bodies exceed

    @property
    def q(self) -> Array:
        """Positions (nq,), global, SI."""
        return self.equilibrium.q


@dataclass(frozen=True)
class StaticSweep:
    """Equilibria over a parameter.

    Attributes
    ----------
    parameter : str
        Its name, or "time".
    points : tuple of SweepPoint
        One for each value, up to the last that has an equilibrium.
    names, units : tuple of str
        Channels of sensors, and their units in the scene's system.
    events : tuple of SweepEvent
        In the order of the values.
    """

    parameter: str
    points: tuple[SweepPoint, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    events: tuple[SweepEvent, ...]

    @property
    def values(self) -> Array:
        """(n,) values of the parameter, in the scene's units."""
        return np.array([point.value for point in self.points])

    @property
    def notes(self) -> list[str]:
        """A sentence on each limit of flexible bodies, at the first value that exceeds it."""
        notes: dict[tuple[str, str], str] = {}
        for point in self.points:
            for one in point.limits:
                text = f"{self.parameter} = {point.value:g}: {one.text()}"
                notes.setdefault((one.body, one.quantity), text)
        return list(notes.values())

    @property
    def table(self) -> Array:
        """(n, k) channels."""
        return np.array([point.channels for point in self.points])

    @property
    def stable(self) -> Array:
        """(n,) whether each equilibrium is stable."""
        return np.array([point.stable for point in self.points])

    def to_csv(self, path: str | Path) -> Path:
        """Write all channels, growth and stability over the parameter to a CSV file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        one = self.points[0].equilibrium.model
        first = one.units.label("s") if self.parameter == "time" else ""
        values = [(p.value, *p.channels, p.growth, float(p.stable)) for p in self.points]
        names = (self.parameter, *self.names, "growth", "stable")
        units = (first, *self.units, "1/s", "")
        return export_table(HistoryTable(one.title, names, units, np.array(values)), Path(path))

    def __getitem__(self, channel: str) -> Array:
        """A channel over the values (n,)."""
        if channel not in self.names:
            raise SceneError.unknown_name("channel of a sensor", channel, self.names)
        column: Array = self.table[:, self.names.index(channel)]
        return column


def sweep_equilibria(
    system_at: Callable[[float], SystemAt],
    parameter: str,
    values: Sequence[float],
    *,
    progress: Progress = silent,
) -> StaticSweep:
    """Follow an equilibrium over the values of a parameter.

    Parameters
    ----------
    system_at : callable
        Makes the model for a value.
    parameter : str
        Its name, for sentences.
    values : sequence of float
        In the order of the sweep; the search for the first equilibrium begins at the placed pose.
    progress : Progress
        Called for every value.

    Raises
    ------
    AssemblyError
        The first value has no equilibrium, or its positions cannot be closed.
    SceneError
        A value changes which coordinates the model has.
    """
    path = _Path(system_at, parameter)
    points = [path.point(values[0], None)]
    events: list[SweepEvent] = []
    way = 0.0  # distance of the last two equilibria per change of the parameter
    for k, value in enumerate(values[1:], start=1):
        progress("statics", k / len(values), f"{parameter} = {value:g}")
        before = points[-1]
        try:
            point = path.point(value, before)
        except AssemblyError as error:
            events.append(replace(path.end(before, value, error), place=k))
            break
        far = path.way(before, point)
        faster = (
            far > _DISTANCE_RATIO * way * abs(value - before.value)
            if k > 1
            else far > _FIRST_DISTANCE
        )
        jump = path.jump(before, point) if faster and far > _ZERO_DISTANCE else None
        event = jump
        if jump is None and point.stable != before.stable:
            event = path.stability(before, point)
        if event is not None:
            events.append(replace(event, place=k))
        points.append(point)
        way = 0.0 if jump is not None else far / abs(value - before.value)
    progress("statics", 1.0)
    one = points[0].equilibrium
    names = tuple(one.compiled.layout.channels)
    units = tuple(
        one.model.units.label(one.model.channel_unit(name) or "", raised=True) for name in names
    )
    return StaticSweep(parameter, tuple(points), names, units, tuple(events))


class _Path:
    """A branch of equilibria, and the location of events on it."""

    def __init__(self, system_at: Callable[[float], SystemAt], parameter: str) -> None:
        self._system_at, self._name = system_at, parameter

    def point(self, value: float, before: SweepPoint | None) -> SweepPoint:
        """The equilibrium at a value, found from the one at another value."""
        compiled, model, time = self._system_at(value)
        start = None
        if before is not None:
            start = before.q
            if _columns(compiled) != _columns(before.equilibrium.compiled):
                raise SceneError(
                    f"{self._name} = {value:g} changes which coordinates the model has: an "
                    "equilibrium is followed over values that keep its bodies and modes"
                )
        equilibrium = find_equilibrium(compiled, model, time=time, start=start)
        growth, stable = equilibrium.growth()
        limits = tuple(equilibrium.limits())
        return SweepPoint(value, equilibrium, equilibrium.channels(), growth, stable, limits)

    @staticmethod
    def way(a: SweepPoint, b: SweepPoint) -> float:
        """Distance of two equilibria, over the model size or in radians."""
        return _apart(a, b)[0]

    def jump(self, low: SweepPoint, high: SweepPoint) -> SweepEvent | None:
        """The limit point between two values; None if the branch is continuous."""
        whole = self.way(low, high)
        for _ in range(_MAX_BISECTIONS):
            try:
                middle = self.point(0.5 * (low.value + high.value), low)
            except AssemblyError:
                break
            if self.way(low, middle) <= self.way(middle, high):
                low = middle
            else:
                high = middle
            if self.way(low, high) < _JUMP_SHARE * whole:
                return None
        far, body = _apart(low, high)
        return SweepEvent(
            "limit point", low.value, high.value,
            f"limit point between {self._name} = {low.value:.9g} and {high.value:.9g}: the "
            f"equilibrium ends there, and the machine goes to another one, {far:.3g} of the model "
            f"size (or radians) away, most of bodies.{body}",
        )  # fmt: skip

    def end(self, low: SweepPoint, value: float, error: AssemblyError) -> SweepEvent:
        """The value from which there is no equilibrium."""
        high = value
        for _ in range(_MAX_BISECTIONS):
            middle = 0.5 * (low.value + high)
            try:
                low = self.point(middle, low)
            except AssemblyError as later:
                high, error = middle, later
        return SweepEvent(
            "no equilibrium", low.value, high,
            f"from {self._name} = {high:.9g} on there is no equilibrium (there is one at "
            f"{low.value:.9g}): {error}",
        )  # fmt: skip

    def stability(self, low: SweepPoint, high: SweepPoint) -> SweepEvent:
        """The value at which an equilibrium loses or gains its stability."""
        before, lost = low.stable, low.stable
        for _ in range(_MAX_BISECTIONS):
            middle = self.point(0.5 * (low.value + high.value), low)
            low, high = (middle, high) if middle.stable == before else (low, middle)
        word = "lost" if lost else "gained"
        return SweepEvent(
            f"stability {word}", low.value, high.value,
            f"stability is {word} between {self._name} = {low.value:.9g} and {high.value:.9g}",
        )  # fmt: skip


def _columns(compiled: Compiled) -> tuple[object, ...]:
    """Columns that must be the same in two models if one begins at the other's equilibrium."""
    layout = compiled.layout
    return layout.bodies, layout.coordinates, layout.channels


def _apart(a: SweepPoint, b: SweepPoint) -> tuple[float, str]:
    """Distance of two equilibria, over the model size or in radians, and its body."""
    compiled = a.equilibrium.compiled
    return separation(compiled, a.equilibrium.state.q, compiled.layout.of_equations(b.q)[0])
