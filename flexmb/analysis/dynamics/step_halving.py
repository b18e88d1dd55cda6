"""A run with fixed steps and the same run with steps half as long, which measures its error.

Steps of size h of a method of order p leave an error C hᵖ, half steps the error C (h/2)ᵖ. So the
error of the run is the difference of both over 1 - 2⁻ᵖ (Richardson; Hairer, Nørsett & Wanner,
Solving Ordinary Differential Equations I, 1993, §II.4). Where a force may jump within a step the
order is 1, and the error is twice the difference. The rows of the result are those of the longer
steps, for which the user asks; the shorter ones are only compared.
"""

from __future__ import annotations

import math

import numpy as np

from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.measured_error import MeasuredError, QuantityError, error_statistics
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.method import time_round_off
from flexmb.engine.state import State
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import UnitSystem

_HALVED = "halved_"  # prefix of the arrays of the run with half steps in a saved state
_SAME_STEP = 1e-6  # share of a step that is round-off of times


class StepHalving:
    """A run with fixed steps and one with half steps, which advance together.

    Attributes
    ----------
    run, halved : Integration
        The runs; the rows of `run` are the result.
    error : MeasuredError
        Their difference so far.
    failed : (1,) array
        Time at which the run with half steps failed, and nothing is compared any more; infinite: it
        did not [s].
    """

    def __init__(self, run: Integration, halved: Integration, error: MeasuredError) -> None:
        self.run, self.halved, self.error = run, halved, error
        self.failed = np.array([math.inf])
        self._in_rows = np.isin(halved.times, run.times)  # of the times of the half steps

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, integrator: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, compared: np.ndarray,
    ) -> StepHalving:  # fmt: skip
        """Both runs, each from a copy of a state.

        The run has rows at `times` (n,) [s]. The one with half steps has them at `compared`, which
        contains these, so that peak-to-peak ranges are known if outputs are few.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        half = settings._replace(step=0.5 * settings.step)
        return cls(
            Integration(compiled, integrator, settings, states[0], times),
            Integration(compiled, integrator, half, states[1], compared),
            MeasuredError.of(compiled, model, first, settings.end - settings.start),
        )

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """Integrate one chunk of both, or write the first row; the status and rows of the run."""
        run, halved = self.run, self.halved
        status = run.integrate(0 if first else run.chunk)
        rows, end = run.rows.read(), float(run.state.t[0]) - time_round_off(run.settings)
        done = 0
        while self.failed[0] == math.inf and (first or halved.state.t[0] < end):
            left = (run.state.t[0] - halved.state.t[0]) / halved.settings.step
            steps = 0 if first else min(halved.chunk, math.ceil(left - _SAME_STEP))
            of_halved = halved.integrate(steps)
            block = halved.rows.read()
            behind = int(halved.state.count[0]["outputs"])
            both = block.rows(self._in_rows[behind - len(block.t) : behind])
            if len(block.t):
                self.error.comparison.update_range(self.error.comparison.values(block))
            self.error.add(rows.part(done, done + len(both.t)), both)
            done += len(both.t)
            if of_halved != method.SUCCESS:
                self.failed[0] = halved.state.t[0]
            if first:
                break
        return status, [rows]

    @property
    def _order(self) -> int:
        """The order of the method, 1 where forces of the motion may jump within a step.

        Not where functions of time jump: of 24 runs across such a jump, 2 report less than half of
        the error and 3 more than three times it with the order of the method; with 1 none and 9.
        """
        jumps = self.run.compiled.system.events
        return 1 if jumps else int(self.run.method.order)

    @property
    def _failed_steps(self) -> int:
        """Number of steps of the run that failed; shorter ones took their place in both runs."""
        return int(self.run.state.count[0]["failed"])

    def errors(self) -> dict[str, QuantityError]:
        """The measured error of each quantity, by the rows that both runs have."""
        steps = int(self.run.state.count[0]["steps"])
        return self.error.largest(2.0 - 0.5**self._order, steps)

    def statistics(self) -> dict[str, float | int | str]:
        """Entries of the summary of the run on its error, which failed steps leave unknown."""
        unknown = self._failed_steps > 0 or self.failed[0] < math.inf
        return {
            "comparison_steps": int(self.halved.state.count[0]["steps"]),
            **({} if unknown else error_statistics(self.errors())),
        }

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays that a resumed run needs in addition to the state of the run."""
        return {
            **{_HALVED + name: value for name, value in self.halved.state._asdict().items()},
            **self.error.arrays(),
            _HALVED + "failed": self.failed,
        }

    def note(self, units: UnitSystem) -> str:
        """A sentence if steps failed, so that the error is not known, or ""."""
        if self._failed_steps:
            step = units.say(self.run.settings.step, "s", 4)
            return (
                f"{self._failed_steps} steps of {step} failed and were divided, as half steps are, "
                "so that no error is measured: shorten dynamics.step, or give accuracy in its place"
            )
        if self.failed[0] == math.inf:
            return ""
        time = units.say(float(self.failed[0]), "s", 4)
        return (
            f"half steps, which measure the error, failed at t = {time}, so that none is known: "
            "shorten dynamics.step, or give accuracy in its place"
        )
