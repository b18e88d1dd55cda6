"""A run beside a scout: the same motion with longer steps, which measures its error.

The scout chooses its steps by error control; the run that is kept takes `refinement` times as many,
spread as the scout's were, so that the errors of both differ by a known factor. Both march chunk by
chunk; nothing of the scout is kept but its state at the border of a chunk.
"""

from __future__ import annotations

import numpy as np

from flexmb.analysis.dynamics.measured_error import ErrorOf, MeasuredError
from flexmb.analysis.dynamics.run import Run
from flexmb.analysis.dynamics.settings import kept_settings, scout_settings
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.model.model import Model
from flexmb.results import OutputBlock

__all__ = ["PACE", "VerifiedRun"]

_SCOUT = "scout_"
_AT_REST = 1e-10  # of the size of the model, or of a radian, within the run
PACE = "pace"
"""Name of local tolerance, number of passes and method among what is saved."""


class VerifiedRun:
    """Two runs of one model, marched together.

    Attributes
    ----------
    scout, kept : Run
        The runs; the kept one follows the plan that the scout writes.
    error : MeasuredError
        Their difference so far.
    recorded : (n,) array of bool
        Which of the times at which they are compared are outputs.
    """

    def __init__(self, scout: Run, kept: Run, error: MeasuredError, recorded: np.ndarray) -> None:
        self.scout, self.kept, self.error, self.recorded = scout, kept, error, recorded

    @property
    def ratio(self) -> float:
        """Error of the scout over that of the kept run."""
        kept, scout = (run.state.count[method.STEPS] for run in (self.kept, self.scout))
        order = self.kept.method.order
        return float(max(kept / max(scout, 1), 1.0) ** order)

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, chosen: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, recorded: np.ndarray,
    ) -> VerifiedRun:  # fmt: skip
        """A run from a copy of a state, and its scout, at the local tolerance of the settings.

        They are compared at `times` (n,); `recorded` says which of these are outputs.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        scout = Run(compiled, chosen, scout_settings(settings, chosen), states[0], times)
        kept = Run(compiled, chosen, kept_settings(settings, chosen), states[1], times, scout.plan)
        length, span = compiled.length, settings.end - settings.start
        least = {"m": length, "rad": 1.0, "m/s": length / span, "rad/s": 1.0 / span}
        at_rest = {unit: _AT_REST * size for unit, size in least.items()}
        return cls(scout, kept, MeasuredError(compiled.layout, model, at_rest), recorded)

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
            self.error.add(coarse.part(done, done + len(block.t)), block)
            done += len(block.t)
            rows.append(self._outputs(block))
            if first or told != method.FINE:
                status = max(status, told)
                break
        return status, rows

    def _outputs(self, block: OutputBlock) -> OutputBlock:
        """The rows of the newest block of the kept run that are outputs."""
        behind = int(self.kept.state.count[method.OUTPUTS])
        return block.rows(self.recorded[behind - len(block.t) : behind])

    def saved(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs beside the state of the kept run."""
        return {
            **{_SCOUT + name: value for name, value in self.scout.state._asdict().items()},
            **self.error.arrays(),
        }

    def errors(self) -> dict[str, ErrorOf]:
        """The measured error of each quantity."""
        return self.error.largest(self.ratio)
