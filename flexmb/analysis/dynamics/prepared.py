"""A run that is ready to march, and the same run by another method or with another tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.analysis.dynamics.run import Clock, Run
from flexmb.analysis.dynamics.settings import (
    Steps,
    compared_times,
    local_tolerance,
    output_times,
    time_grid,
    with_tolerance,
)
from flexmb.analysis.dynamics.verified import PACE, VerifiedRun
from flexmb.engine.compile import Compiled
from flexmb.engine.integrators import chosen_method
from flexmb.engine.method import Settings
from flexmb.engine.state import State
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import METHODS

__all__ = ["MOST_PASSES", "Prepared", "prepared_run"]

MOST_PASSES = 4
"""Passes of a run at most, each with a stricter tolerance by the error measured."""

_FIRST = "first_"  # before the names of the first state among what is saved


@dataclass(frozen=True)
class Prepared:
    """A run that is ready to march: nothing can fail any more but the motion itself."""

    run: Run
    grid: Steps
    model: Model
    clock: Clock
    notes: tuple[str, ...]
    settings: Settings  # of the run, were it alone
    first: State  # where it begins
    pace: np.ndarray  # as `new_pace` says
    rows_before: int = 0  # rows that are in the file already
    doubtful: tuple[str, ...] = ()  # joints and drivers whose reactions are not unique
    verified: VerifiedRun | None = None  # with the scout of `run`

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return tuple(METHODS)[int(self.pace[2])]

    def saved(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs."""
        own = {
            **self.run.state._asdict(),
            **{_FIRST + name: value for name, value in self.first._asdict().items()},
            PACE: self.pace,
            **self.run.tallies(),
        }
        return own if self.verified is None else {**own, **self.verified.saved()}

    def stricter(self, tolerance: float) -> Prepared:
        """The same run from its start with another local tolerance."""
        spec = self.model.dynamics
        assert spec is not None
        first = self.settings._replace(turn=1.0)
        settings = with_tolerance(first, spec, self.run.method, self.run.compiled, tolerance)
        again = self._again(self.method, settings)
        assert self.verified is not None
        again.pace[1] = self.pace[1] + 1.0
        again.pace[3:] = self.settings.tolerance, self.verified.difference
        return again

    def last(self) -> Prepared:
        """The same run from its start, which is not made again."""
        again = self._again(self.method, self.settings)
        again.pace[1] = MOST_PASSES
        return again

    def by(self, name: str) -> Prepared:
        """The same run from its start by another integrator."""
        spec = self.model.dynamics
        assert spec is not None
        chosen = chosen_method(spec, name)
        tolerance = local_tolerance(spec, chosen, self.run.compiled)
        return self._again(name, self.settings._replace(tolerance=tolerance, turn=1.0))

    def _again(self, name: str, settings: Settings) -> Prepared:
        return prepared_run(
            self.run.compiled, self.model, name, self.first, settings, self.clock,
            notes=self.notes, doubtful=self.doubtful,
        )  # fmt: skip


def new_pace(settings: Settings, name: str) -> np.ndarray:
    """Local tolerance, passes so far, number of the method; of the pass before its tolerance, and
    the difference of its two runs (0: there was none)."""
    return np.array([settings.tolerance, 1.0, tuple(METHODS).index(name), 0.0, 0.0])


def prepared_run(
    compiled: Compiled, model: Model, name: str, state: State, settings: Settings,
    clock: Clock, **known: Any,
) -> Prepared:  # fmt: skip
    """A run from a state by an integrator, with a scout where it controls its error."""
    spec = model.dynamics
    assert spec is not None
    chosen, times, verified = chosen_method(spec, name), output_times(spec), None
    pace = new_pace(settings, name)
    if spec.verify is not False and settings.step == 0.0:
        compared = compared_times(spec)
        recorded = np.isin(compared, times)
        verified = VerifiedRun.of(
            compiled, model, chosen, settings, state, compared, recorded, pace
        )
        run = verified.kept
    else:
        run = Run(compiled, chosen, settings, State(*(array.copy() for array in state)), times)
    return Prepared(
        run, time_grid(spec), model, clock, first=state, settings=settings, verified=verified,
        pace=pace, **known,
    )  # fmt: skip
