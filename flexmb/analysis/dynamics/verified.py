"""A run beside a scout: the same motion with longer steps, which measures its error.

The scout chooses its steps by error control; the run that is kept takes `refinement` times as many,
spread as the scout's were, so that the errors of both differ by a known factor. Both march chunk by
chunk; nothing of the scout is kept but its state at the border of a chunk.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.analysis.dynamics.measured_error import ErrorOf, MeasuredError
from flexmb.analysis.dynamics.run import Run
from flexmb.analysis.dynamics.settings import (
    damps_vibrations,
    kept_settings,
    scout_rows,
    scout_settings,
)
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.model.model import Model
from flexmb.results import OutputBlock

__all__ = ["PACE", "VerifiedRun"]

_SCOUT = "scout_"
_AT_REST = 1e-10  # of the size of the model, or of a radian, within the run
# Ratio of errors where vibrations are damped: they move a sensor as the square of their period.
_DAMPED_RATIO = 2.6
# Difference of a pass below which that of the next one is compared with it; least share of the
# order that two passes may show.
_ALIKE, _LEAST_ORDER = 0.05, 0.5
PACE = "pace"
"""Its name among what is saved."""


class VerifiedRun:
    """Two runs of one model, marched together.

    Attributes
    ----------
    scout, kept : Run
        The runs; the kept one follows the plan that the scout writes.
    error : MeasuredError
        Their difference so far.
    recorded, of_scout : (n,) array of bool
        Which of the times of the kept run are outputs, and at which it is compared with the scout.
    pace : array
        That of the run, as `Prepared` has it.
    """

    def __init__(
        self, scout: Run, kept: Run, error: MeasuredError, recorded: np.ndarray,
        of_scout: np.ndarray, pace: np.ndarray,
    ) -> None:  # fmt: skip
        self.scout, self.kept, self.error = scout, kept, error
        self.recorded, self.of_scout, self.pace = recorded, of_scout, pace

    @property
    def difference(self) -> float:
        """Largest difference of positions, over their peak-to-peak."""
        found = self.error.largest(2.0)
        return found["positions"].error if "positions" in found else 0.0

    @property
    def order(self) -> float:
        """That of the method, or less, where the difference fell less since the pass before.

        Not where the runs were different motions then, whose difference says nothing.
        """
        chosen = self.kept.method
        tolerance, before, difference = self.pace[0], self.pace[3], self.pace[4]
        now = self.difference
        if not 0.0 < difference < _ALIKE or now == 0.0:
            return chosen.order
        seen = chosen.error_order * math.log(difference / now) / math.log(before / tolerance)
        return min(max(seen, _LEAST_ORDER * chosen.order), chosen.order)

    @property
    def ratio(self) -> float:
        """Error of the scout over that of the kept run, which may add steps where it needs them."""
        kept, scout = (run.state.count[0]["steps"] for run in (self.kept, self.scout))
        finer = min(max(kept / max(scout, 1), 1.0), self.kept.settings.refinement)
        return float(finer**self.order)

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, chosen: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, recorded: np.ndarray, pace: np.ndarray,
    ) -> VerifiedRun:  # fmt: skip
        """A run from a copy of a state, and its scout, at the local tolerance of the settings.

        `recorded` says which of the times (n,) of the run are outputs.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        of_scout = scout_rows(len(times))
        scout = Run(compiled, chosen, scout_settings(settings, chosen), states[0], times[of_scout])
        kept = Run(compiled, chosen, kept_settings(settings, chosen), states[1], times, scout.plan)
        length, span = compiled.length, settings.end - settings.start
        least = {"m": length, "rad": 1.0, "m/s": length / span, "rad/s": 1.0 / span}
        at_rest = {unit: _AT_REST * size for unit, size in least.items()}
        error = MeasuredError(compiled.layout, model, at_rest)
        return cls(scout, kept, error, recorded, of_scout, pace)

    def march(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """One chunk of both, or the first row; returns the status, and the rows of the kept run."""
        scout, kept = self.scout, self.kept
        status = scout.march(0 if first else scout.chunk)
        coarse = scout.block()
        rows: list[OutputBlock] = []
        done = 0
        end = scout.plan.knots[scout.plan.used[0] - 1]
        while first or kept.state.t[0] < end:
            told = kept.march(0 if first else kept.chunk)
            block = kept.block()
            both = block.rows(self._newest(self.of_scout, block))
            self.error.add(coarse.part(done, done + len(both.t)), both)
            done += len(both.t)
            rows.append(block.rows(self._newest(self.recorded, block)))
            if first or told != method.FINE:
                status = max(status, told)
                break
        return status, rows

    def _newest(self, which: np.ndarray, block: OutputBlock) -> np.ndarray:
        """Of rows of the kept run, those of its newest block."""
        behind = int(self.kept.state.count[0]["outputs"])
        return which[behind - len(block.t) : behind]

    def saved(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs beside the state of the kept run."""
        return {
            **{_SCOUT + name: value for name, value in self.scout.state._asdict().items()},
            **self.error.arrays(),
        }

    def errors(self) -> dict[str, ErrorOf]:
        """The measured error of each quantity.

        Vibrations that the longer steps damp are damped by the shorter ones too, but for a band
        between, which may be all that a small sensor sees: no balance of energies tells.
        """
        damped = damps_vibrations(self.kept.compiled, self.kept.method)
        return self.error.largest(min(self.ratio, _DAMPED_RATIO) if damped else self.ratio)
