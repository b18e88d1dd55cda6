"""One integration under way: tables, state, room for the rows of a chunk, and what it costs."""

from __future__ import annotations

import math
import time

import numpy as np

from flexmb.engine import entries, method
from flexmb.engine.compile import Compiled
from flexmb.engine.control import round_off
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.tables import ENERGIES
from flexmb.engine.units import hand_over
from flexmb.engine.work import equal_times, new_output, new_plan, new_run, new_work, output_run
from flexmb.errors import FlexmbError
from flexmb.results import OutputBlock

__all__ = ["Balance", "Clock", "Run"]

# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
# Steps of a chunk at least: after each the state is saved.
_LEAST_CHUNK = 4
# Steps between two looks at how long the rest of a run will take, and steps for it that are too
# many; fewer where stability limits them, which another method is free of.
_LOOK_EVERY = 5_000
_MOST_STEPS, _MOST_STABLE_STEPS = 1e9, 1e7
# Share of steps at the limit of stability that makes a run one that stability limits.
_OFTEN = 0.35
# Share of the stored energy below which an exchange of energy is that of a scene at rest.
_AT_REST = 1e-6


class Clock:
    """Wall time by phase."""

    def __init__(self) -> None:
        self.last = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def lap(self, phase: str) -> None:
        now = time.perf_counter()
        self.seconds[f"seconds_{phase}"] = now - self.last
        self.last = now


class Run:
    """One integration: tables, state, scratch and room for the rows of one chunk.

    Parameters
    ----------
    compiled, chosen, settings, state : Compiled, Method, Settings, State
        What is integrated, how, and where it begins.
    times : (n,) array, optional
        Times of all outputs [s]; `settings.interval` apart by default.
    plan : Plan, optional
        Of the run to be followed; else this one writes its own.
    """

    def __init__(
        self,
        compiled: Compiled,
        chosen: method.Method,
        settings: method.Settings,
        state: State,
        times: np.ndarray | None = None,
        plan: Plan | None = None,
    ) -> None:
        self.compiled, self.method, self.settings, self.state = compiled, chosen, settings, state
        self.times = equal_times(settings) if times is None else times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, chosen)
        stages = max(chosen.stages, 1)
        self.chunk = max(_LEAST_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.output = new_output(compiled.system, self._rows(), channels)
        run = new_run(
            compiled.system, state, self.work, chosen, settings, self.plan, self.output, self.times
        )
        self._handed, self._aside = hand_over(run), hand_over(output_run(run))
        self.unread = False
        self._seen: tuple[int, float, float] | None = None  # steps, time, steps at the limit
        self.largest_drift = np.zeros(2)
        self.balance = Balance()

    def tallies(self) -> dict[str, np.ndarray]:
        """What is known of all rows so far, to be kept and filled in again."""
        return {"largest_drift": self.largest_drift, "balance": self.balance.tally}

    def _rows(self) -> int:
        """Room for the outputs of one chunk; of a few of them at least."""
        settings, most = self.settings, max(8, _CHUNK_WORK * 10 // self.compiled.layout.nq)
        every = settings.interval / settings.step if settings.step else 1.0
        rows = min(math.ceil(self.chunk / every) + 1, len(self.times), most)
        return max(rows, self._most_in_a_step()) + 4

    def _most_in_a_step(self) -> int:
        """The largest number of outputs within a fixed step."""
        if not self.settings.step:
            return 0
        ends = self.times + self.settings.step * (1.0 + 1e-5)
        return int((np.searchsorted(self.times, ends) - np.arange(len(self.times))).max(initial=0))

    @property
    def share_done(self) -> float:
        """How much of the time span is done."""
        settings = self.settings
        if self.finished:
            return 1.0
        return float((self.state.t[0] - settings.start) / (settings.end - settings.start))

    @property
    def finished(self) -> bool:
        """Whether the run has reached its end."""
        settings = self.settings
        return bool(self.state.t[0] >= settings.end - round_off(settings))

    def march(self, steps: int) -> int:
        """Run some steps, or with 0 report the present state; returns the status.

        Raises
        ------
        FlexmbError
            Steps under error control have become so short that the run would not end.
        """
        if self.settings.step == 0.0:
            self._refuse_endless()
        self.output.rows[0] = 0  # an interruption before the first step leaves no old rows behind
        self.unread = True
        return entries.integrate(self._handed, steps, self._aside)

    def _refuse_endless(self) -> None:
        """Stop a run whose rest would take far too many steps."""
        done, t = int(self.state.count[0]["steps"]), float(self.state.t[0])
        stiff = float(self.state.memory[0]["steps_at_stability_limit"])
        if self._seen is None:
            self._seen = done, t, stiff
        steps, passed = done - self._seen[0], t - self._seen[1]
        if steps < _LOOK_EVERY:
            return
        limited = stiff - self._seen[2] > _OFTEN * steps
        self._seen = done, t, stiff
        left = (self.settings.end - t) / passed * steps if passed > 0.0 else math.inf
        if left > (_MOST_STABLE_STEPS if limited else _MOST_STEPS):
            raise FlexmbError(_endless(t, passed / steps, left, limited))

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """One chunk, or the first row; returns the status, and its rows."""
        status = self.march(0 if first else self.chunk)
        return status, [self.block()]

    def block(self) -> OutputBlock:
        """The rows of the last chunk."""
        self.unread = False
        n = int(self.output.rows[0])
        rows = OutputBlock(*(np.array(table[:n]) for table in self.output[:-1]))
        if n:
            np.maximum(self.largest_drift, rows.drift.max(axis=0), out=self.largest_drift)
            self.balance.add(rows.energy)
        return rows


def _endless(t: float, step: float, left: float, limited: bool) -> str:
    where = (
        f"at t = {t:.6g} s steps of {step:.2g} s leave {left:.2g} of them for the rest of the run"
    )
    if limited:
        return (
            f"{where}: stability of an explicit method limits them, not accuracy; "
            'method = "radau" has no such limit'
        )
    return (
        f"{where}: look for a singular pose, or forces that jump again and again; ask for less "
        "accuracy, or try another method or a fixed step"
    )


class Balance:
    """Largest mismatch of energy and work, and what to compare it with.

    Attributes
    ----------
    tally : (17,) array
        Least and greatest of every energy so far (7, 7), and behind them the first mismatch, the
        largest departure from it, and what an exchange at rest may be; NaN: no row yet.
    """

    def __init__(self) -> None:
        n = len(ENERGIES)
        self.tally = np.full(2 * n + 3, np.nan)
        self._least, self._most = self.tally[:n], self.tally[n : 2 * n]
        self._rest = self.tally[2 * n :]

    @property
    def error(self) -> float:
        """Largest departure of stored energy less works from its first value [J]."""
        return float(np.nan_to_num(self._rest[1]))

    def add(self, energy: np.ndarray) -> None:
        """Take in energies (n, 7) of further rows."""
        stored = energy[:, :4].sum(axis=1) - energy[:, 4:].sum(axis=1)
        if np.isnan(self._rest[0]):
            self._rest[0] = stored[0]
        off = float(np.abs(stored - self._rest[0]).max())
        # in a scene at rest nothing but round-off of the stored energy moves
        at_rest = _AT_REST * float(np.abs(energy).max())
        self._rest[1:] = np.fmax(self._rest[1:], (off, at_rest))
        np.fmin(self._least, energy.min(axis=0), out=self._least)
        np.fmax(self._most, energy.max(axis=0), out=self._most)

    @property
    def relative(self) -> float:
        """Mismatch over the largest energy that moved."""
        if np.isnan(self._rest[0]):
            return 0.0
        moved = max(float((self._most - self._least).max()), float(self._most[0]))
        scale = max(moved, float(self._rest[2]))
        return self.error / scale if scale > 0.0 else 0.0
