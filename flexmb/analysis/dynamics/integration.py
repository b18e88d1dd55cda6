"""One integration under way: tables, state, and room for the rows of a chunk."""

from __future__ import annotations

import math

import numpy as np

from flexmb.analysis.procedure import ChunkRows
from flexmb.engine import entries, method
from flexmb.engine.compile import Compiled
from flexmb.engine.control import round_off
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.units import hand_over
from flexmb.engine.work import equal_times, new_plan, new_run, new_work, output_run
from flexmb.errors import FlexmbError

# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
# Steps of a chunk at least: after each the state is saved.
_MIN_CHUNK = 4
# Steps between two looks at how long the rest of a run will take, and steps for it that are too
# many; fewer where stability limits them, which another method is free of.
_CHECK_EVERY = 5_000
_MAX_STEPS, _MAX_STABLE_STEPS = 1e9, 1e7
# Share of steps at the limit of stability that makes a run one that stability limits.
_STIFF_SHARE = 0.35


class Integration:
    """One integration: tables, state, scratch and room for the rows of one chunk.

    Parameters
    ----------
    compiled, integrator, settings, state : Compiled, Method, Settings, State
        What is integrated, how, and where it begins.
    times : (n,) array, optional
        Times of all outputs [s]; `settings.interval` apart by default.
    plan : Plan, optional
        Of the run to be followed; else this one writes its own.
    """

    def __init__(
        self,
        compiled: Compiled,
        integrator: method.Method,
        settings: method.Settings,
        state: State,
        times: np.ndarray | None = None,
        plan: Plan | None = None,
    ) -> None:
        self.compiled, self.method = compiled, integrator
        self.settings, self.state = settings, state
        self.times = equal_times(settings) if times is None else times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, integrator)
        stages = max(integrator.stages, 1)
        self.chunk = max(_MIN_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.rows = ChunkRows(compiled, self._max_rows())
        run = new_run(
            compiled.system, state, self.work, integrator, settings, self.plan, self.rows.output,
            self.times,
        )  # fmt: skip
        self._run, self._output_run = hand_over(run), hand_over(output_run(run))
        self._checkpoint: tuple[int, float, float] | None = None  # steps, time, steps at the limit

    def tallies(self) -> dict[str, np.ndarray]:
        """What all rows so far tell, to be saved and filled in again."""
        return {"largest_drift": self.rows.largest_drift, "balance": self.rows.balance.tally}

    def _max_rows(self) -> int:
        """Outputs of one chunk at most; room for a few of them at least."""
        settings, most = self.settings, max(8, _CHUNK_WORK * 10 // self.compiled.layout.nq)
        every = settings.interval / settings.step if settings.step else 1.0
        rows = min(math.ceil(self.chunk / every) + 1, len(self.times), most)
        return max(rows, self._max_rows_of_step()) + 4

    def _max_rows_of_step(self) -> int:
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

    def integrate(self, steps: int) -> int:
        """Run some steps, or with 0 report the present state; returns the status.

        Raises
        ------
        FlexmbError
            Steps under error control have become so short that the run would not end.
        """
        if self.settings.step == 0.0:
            self._refuse_endless()
        self.rows.clear()
        return entries.integrate(self._run, steps, self._output_run)

    def _refuse_endless(self) -> None:
        """Stop a run whose rest would take far too many steps."""
        done, t = int(self.state.count[0]["steps"]), float(self.state.t[0])
        stiff = float(self.state.memory[0]["steps_at_stability_limit"])
        if self._checkpoint is None:
            self._checkpoint = done, t, stiff
        steps, passed = done - self._checkpoint[0], t - self._checkpoint[1]
        if steps < _CHECK_EVERY:
            return
        limited = stiff - self._checkpoint[2] > _STIFF_SHARE * steps
        self._checkpoint = done, t, stiff
        left = (self.settings.end - t) / passed * steps if passed > 0.0 else math.inf
        if left > (_MAX_STABLE_STEPS if limited else _MAX_STEPS):
            raise FlexmbError(_endless(t, passed / steps, left, limited))


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
