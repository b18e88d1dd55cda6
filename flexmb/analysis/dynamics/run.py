"""One integration under way: tables, state, room for the rows of a chunk, and what it costs."""

from __future__ import annotations

import math
import time

import numpy as np

from flexmb.engine import entries, method
from flexmb.engine.compile import Compiled
from flexmb.engine.control import round_off
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.units import hand_over
from flexmb.engine.work import new_output, new_plan, new_run, new_work, output_run
from flexmb.results import OutputBlock

__all__ = ["Balance", "Clock", "Run"]

# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
# Steps of a chunk at least: after each the state is saved.
_LEAST_CHUNK = 4
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
    times : (n,) array
        Times of all outputs [s].
    plan : Plan, optional
        Of the run to be followed; else this one writes its own.
    """

    def __init__(
        self,
        compiled: Compiled,
        chosen: method.Method,
        settings: method.Settings,
        state: State,
        times: np.ndarray,
        plan: Plan | None = None,
    ) -> None:
        self.compiled, self.method, self.settings, self.state = compiled, chosen, settings, state
        self.times = times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, chosen)
        stages = max(chosen.stages, 1)
        self.chunk = max(_LEAST_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.output = new_output(compiled.system, self._rows(), channels)
        run = new_run(
            compiled.system, state, self.work, chosen, settings, self.plan, self.output, times
        )
        self._handed, self._aside = hand_over(run), hand_over(output_run(run))
        self.unread = False
        self.largest_drift = np.zeros(2)
        self.balance = Balance()

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
        """Run some steps, or with 0 report the present state; returns the status."""
        self.output.rows[0] = 0  # an interruption before the first step leaves no old rows behind
        self.unread = True
        return entries.integrate(self._handed, steps, self._aside)

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """One chunk, or the first row; returns the status, and its rows."""
        status = self.march(0 if first else self.chunk)
        return status, [self.block()]

    def block(self) -> OutputBlock:
        """The rows of the last chunk."""
        self.unread = False
        n = int(self.output.rows[0])
        rows = OutputBlock(*(np.array(table[:n]) for table in self.output[:-1]))
        self.recall(rows.drift, rows.energy)
        return rows

    def recall(self, drift: np.ndarray, energy: np.ndarray) -> None:
        """Take drift (n, 2) and energy (n, energies) of rows into the statistics."""
        if len(energy):
            self.largest_drift = np.maximum(self.largest_drift, drift.max(axis=0))
            self.balance.add(energy)


class Balance:
    """Largest mismatch of energy and work, and what to compare it with."""

    def __init__(self) -> None:
        self.first: float | None = None
        self.error = 0.0
        self.least = np.array(np.inf)  # of every energy so far
        self.most = np.array(-np.inf)
        self.at_rest = 0.0

    def add(self, energy: np.ndarray) -> None:
        stored = energy[:, :4].sum(axis=1) - energy[:, 4:].sum(axis=1)
        if self.first is None:
            self.first = float(stored[0])
        self.error = max(self.error, float(np.abs(stored - self.first).max()))
        self.least = np.minimum(self.least, energy.min(axis=0))
        self.most = np.maximum(self.most, energy.max(axis=0))
        # in a scene at rest nothing but round-off of the stored energy moves
        self.at_rest = max(self.at_rest, _AT_REST * float(np.abs(energy).max()))

    @property
    def relative(self) -> float:
        """Mismatch over the largest energy that moved."""
        if self.first is None:
            return 0.0
        moved = max(float(np.max(self.most - self.least)), float(self.most[0]))
        scale = max(moved, self.at_rest)
        return self.error / scale if scale > 0.0 else 0.0
