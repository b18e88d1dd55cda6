"""The error of a run, measured by its scout: the same run with longer steps.

Two runs with a method of order p use the same plan of steps, one with r times as many. Their errors
have the ratio rᵖ : 1, so the error of the finer one is their difference over rᵖ − 1 (Richardson;
Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, 1993, §II.4). In: rows of both
runs, in order. Out: the largest error of positions, velocities, accelerations and reactions, each
over the peak-to-peak range of its sensor, with its name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import (
    NO_MOTION,
    RoundOff,
    RowComparison,
    by_part,
    compared,
)
from flexmb.analysis.dynamics.run_settings import gyration
from flexmb.analysis.dynamics.vibration_error import (
    DAMPED_RATIO,
    RATES,
    LoadedBody,
    VibrationError,
    loaded_bodies,
)
from flexmb.analysis.monitors import SampledHistory
from flexmb.engine.bodies.flexible_body import modal_reach
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.results.run_summary import MEASURED_QUANTITIES

_NONE = np.zeros(0, np.intp)
_LEAST_ERROR = 1e-15  # over the peak-to-peak
# Difference over the peak-to-peak from which on two runs are different motions.
_DIFFERENT_MOTION = 0.1
# The same of the velocities of a motion that multiplies errors, which may be a small part of the
# positions of a machine that runs on: of two rotors with backlash 1e-3, and 0.08 of their
# velocities.
_DIFFERENT_VELOCITIES = 0.03
# Growth of the differences over that of the square of time from which a motion multiplies errors;
# two chaotic pendulums had 20 and 213, an orbit 3, a driven pendulum that keeps its errors 10.
MIN_GROWTH = 10.0
# Student's t for three runs: 19 of 20 errors are within so many standard deviations.
_QUANTILE_OF_THREE = 4.30
# Rotation that counts as rest is relative to 1 rad, or to this share of the rotation of a body at
# its first angular velocity over the run.
_SPIN_SHARE = 0.1


@dataclass(frozen=True)
class QuantityError:
    """The largest error of one quantity."""

    error: float  # over its scale
    name: str  # of the sensor, body or joint
    time: float  # time of the largest error, s
    over: str = ""  # its scale in words, if not its peak-to-peak
    round_off: float = 0.0  # part of the error that shorter steps do not reduce
    of_values: float = 0.0  # round-off of the values themselves
    begin: float = -math.inf  # start of the vibration that steps damp, if that is the error [s]


class MeasuredError:
    """Differences of two runs of one model at the same outputs; rows are added in order.

    Parameters
    ----------
    comparison : RowComparison
        The quantities that are compared.
    places : RoundOff, optional
        Round-off of a step in these quantities.

    Attributes
    ----------
    vibrations : VibrationError
        Errors by vibrations that the steps of both runs damp, so that they do not differ.
    round_off : (k,) array
        Round-off of a step in each quantity, the largest so far.
    """

    def __init__(
        self, comparison: RowComparison, places: RoundOff | None = None,
        loaded: Sequence[list[LoadedBody]] = (),
    ) -> None:  # fmt: skip
        self.comparison, self._round_off_of = comparison, places
        self.vibrations = VibrationError(comparison, loaded)
        n, positions = len(comparison.compared), comparison.positions
        self._largest = np.zeros((2, n))  # largest difference so far, and its time
        self._sampled = comparison.columns_of(positions)
        widths = [len(comparison.compared[k].columns) for k in positions]
        self._sampled_starts = np.cumsum(widths, dtype=np.intp) - widths
        self._growth = SampledHistory(len(positions))  # differences of positions over time
        # positions of the fine run and differences, of this pass and of the pass before
        self._samples = SampledHistory(len(self._sampled) + len(positions))
        self._before = np.full_like(self._samples.table, np.nan)
        self.round_off = np.zeros(n)
        self._of_values = np.zeros(n)  # round-off of values, which does not add up
        self._amplified = np.zeros(n)  # measured round-off at the end
        self._cache: dict[tuple[float, int, bool, bool, bytes], dict[str, QuantityError]] = {}

    @classmethod
    def of(cls, compiled: Compiled, model: Model, first: State, span: float) -> MeasuredError:
        """No differences yet of two runs of `span` [s] from a first state."""
        length = compiled.length
        spun = (np.abs(first.v[body.iv + 3 : body.iv + 6]).max() for body in compiled.layout.bodies)
        turn = max(1.0, _SPIN_SHARE * span * float(max(spun, default=0.0)))
        least = {"m": length, "rad": turn}
        at_rest = {
            unit + rate: NO_MOTION * size / span**order
            for unit, size in least.items()
            for order, rate in enumerate(("", "/s", "/s^2"))
        }
        radii, flexible = gyration(compiled), [one.name for one in compiled.layout.bodies if one.m]
        modes = {name: modal_reach(compiled.flexbodies[name]) for name in flexible}
        parts = by_part(compared(compiled.layout, model, modes), compiled, model)
        comparison = RowComparison(compiled.layout, model, at_rest, span, radii, parts, modes)
        loaded = loaded_bodies(comparison, compiled, model)
        return cls(comparison, RoundOff(comparison.compared, compiled, model), loaded)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays, which are saved and restored with the state of the run."""
        return {
            "error_count": self._growth.count, "error_largest": self._largest,
            "error_range": self.comparison.range, "error_growth": self._growth.table,
            "error_samples": self._samples.table, "error_sampled": self._samples.count,
            "error_last_pass": self._before, "error_round_off": self.round_off,
            "error_damped": self.vibrations.table, "error_of_values": self._of_values,
        }  # fmt: skip

    def compare(self, before: MeasuredError) -> None:
        """Store the samples of the pass before, for `ratio_before`."""
        self._before[:] = before._samples.table

    def add(self, coarse: OutputBlock, fine: OutputBlock) -> None:
        """Add the same rows of both runs, as far as both have them (SI).

        Parameters
        ----------
        coarse, fine : OutputBlock
            Rows (k, ...) of the scout and of the fine run.
        """
        n = min(len(fine.t), len(coarse.t))
        if n == 0:
            return
        self._cache.clear()
        if self._round_off_of is not None:
            np.maximum(self.round_off, self._round_off_of.of(fine), out=self.round_off)
            of_values = self._round_off_of.of_values(fine)
            np.maximum(self._of_values, of_values, out=self._of_values)
        comparison, positions = self.comparison, self.comparison.positions
        values = comparison.values(fine.part(0, n))
        gaps = comparison.differences(comparison.values(coarse.part(0, n)), values)
        comparison.update_range(values)
        t = fine.t[:n]
        so_far = np.maximum.accumulate(np.vstack([self._largest[0], gaps]), axis=0)[1:]
        rises = so_far[-1] > self._largest[0]
        self._largest[1, rises] = t[gaps.argmax(axis=0)][rises]
        self._largest[0] = so_far[-1]
        self._growth.add(t, so_far[:, positions])
        self._samples.add(t, np.hstack([values[:, self._sampled], gaps[:, positions]]))

    def extend_ranges(self, fine: OutputBlock) -> None:
        """Extend the ranges by rows that the scout does not have."""
        if len(fine.t):
            self._cache.clear()
            self.comparison.update_range(self.comparison.values(fine))

    def set_round_off(self, runs: Sequence[Array], steps: float) -> None:
        """Set the amplified round-off from values (k, components) of runs that differ only by it.

        It is their standard deviation, times √`steps` for a random walk of `steps` times as many
        steps; of three runs so much more that 19 of 20 errors are at most three times as large.
        """
        n = min(map(len, runs))
        squares = [
            self.comparison.differences(one[:n], other[:n]) ** 2
            for k, one in enumerate(runs)
            for other in runs[:k]
        ]
        self._cache.clear()
        few = _QUANTILE_OF_THREE / 3.0 if len(runs) == 3 else 1.0
        self._amplified = few * np.sqrt(0.5 * steps * np.mean(squares, axis=0).max(axis=0))

    def amplified_round_off(self) -> float:
        """Largest measured round-off of a position at the end, over its peak-to-peak."""
        own = self.comparison.shares(self._amplified)[self.comparison.positions]
        return float(own.max(initial=0.0))

    def round_off_share(self) -> float:
        """Largest round-off of a step in a position, over its peak-to-peak."""
        own = self.comparison.shares(self.round_off)[self.comparison.positions]
        return float(np.finfo(float).eps + own.max(initial=0.0))

    def growth(self) -> float:
        """Largest ratio of the growth of the position difference to that of the square of time.

        From any time at which it was above round-off until the runs were different motions.
        """
        spans, rows = self.comparison.scales()[self.comparison.positions], self._growth.count[1]
        moves, table = spans > 0.0, self._growth.table[:rows]
        if rows < 2 or not moves.any():
            return 1.0
        apart = (table[:, 1:][:, moves] / spans[moves]).max(axis=1)
        last = min(int(np.searchsorted(apart, _DIFFERENT_MOTION)), rows - 1)
        past = table[:, 0] - table[0, 0]
        seen = np.flatnonzero(apart[:last] > self.round_off_share())
        grown = apart[last] / apart[seen] * (past[seen] / past[last]) ** 2
        return float(grown.max(initial=1.0))

    def round_off_amplification(self, steps: int) -> float:
        """Amplification of round-off by the motion: measured at the end, over that of a random
        walk.

        After n steps a walk of the velocities leaves n^1.5 times the round-off of one step in
        positions (Brouwer's law).
        """
        walk = self.round_off_share() * steps * math.sqrt(steps)
        return self.amplified_round_off() / max(walk, _LEAST_ERROR)

    def drop_unamplified_round_off(self, steps: int) -> None:
        """Ignore the measured round-off if the motion does not amplify it.

        The longer steps of a scout have more of it, and errors of Newton's method as well.
        """
        if self.round_off_amplification(steps) <= 1.0:
            self._amplified[:] = 0.0
            self._cache.clear()

    def largest(
        self, ratio: float, steps: int = 0, limited: bool = False
    ) -> dict[str, QuantityError]:
        """The largest error of each quantity; `ratio` is that of the errors of the two runs.

        Round-off does not fall with the step. It adds up as a random walk, whose standard deviation
        is added, or as much as perturbed runs have shown. If stability limits the coarse run
        (`limited`), its reactions oscillate within its tolerance and beyond: that is no other
        motion, and the error of a reaction of the fine run is at most its own largest value.
        """
        table, largest = self.vibrations.table, dict[str, QuantityError]()
        key = ratio, steps, limited, self.vibrations.is_damped, table.tobytes()
        if key in self._cache:
            return self._cache[key]
        errors, walk, comparison = *self._errors(ratio, steps, limited), self.comparison
        damped = comparison.shares(table[0])
        of_values = comparison.shares(self._of_values)
        times = np.where(damped > errors, table[1], self._largest[1])
        begin = np.where(damped > errors, table[2], -math.inf)
        errors = np.maximum(errors, damped)
        for quantity, of in comparison.of_quantity.items():
            k = int(of[errors[of].argmax()])
            over, name = comparison.scale_in_words(k), comparison.compared[k].name
            error, time = float(errors[k]), float(times[k])
            largest[quantity] = QuantityError(
                error, name, time, over, float(walk[k]), float(of_values[k]), float(begin[k])
            )
        self._cache[key] = largest
        return largest

    def _errors(self, ratio: float, steps: int, limited: bool) -> tuple[Array, Array]:
        """Errors (k,) by the difference of the two runs, and their part by round-off (k,)."""
        comparison = self.comparison
        scales, apart = comparison.scales(), comparison.shares(self._largest[0])
        # if the runs are different motions, the finer one is no better than the other
        different = self._largest[0] > _DIFFERENT_MOTION * np.maximum(
            scales, comparison.motion_sizes()
        )
        different |= self._parts_within_a_motion(apart)
        least = np.maximum(self._amplified, self._of_values)
        walk = comparison.shares(np.maximum(math.sqrt(steps) * self.round_off, least))
        falling = apart / (max(ratio, 1.0 + 1e-9) - 1.0)
        if self.vibrations.is_damped:  # what both runs have lost of it does not fall
            for of in (comparison.of_quantity.get(one, _NONE) for one in RATES):
                falling[of] = np.maximum(falling, apart / (DAMPED_RATIO - 1.0))[of]
        if limited and not different[comparison.positions].any():
            different[comparison.reactions] = False
        most = np.maximum(np.maximum(apart, falling), comparison.shares(least))
        errors = np.where(different, apart, np.minimum(falling + walk, most))
        if limited:
            own, of = comparison.shares(comparison.largest_values()), comparison.reactions
            errors[of] = np.minimum(errors[of], own[of])
        return errors, walk

    def _parts_within_a_motion(self, apart: Array) -> bool:
        """Whether the runs are different motions within a larger one that they share.

        Their velocities show it, if the motion multiplies errors. `apart` (k,) are the largest
        differences over the scales.
        """
        of = self.comparison.of_quantity.get("velocities", _NONE)
        part = apart[of].max(initial=0.0) > _DIFFERENT_VELOCITIES
        return bool(part and self.growth() >= MIN_GROWTH)

    def ratio_before(self) -> float:
        """Ratio of the errors of the two runs of the pass before, by this pass; 0: not known."""
        spans = self.comparison.scales()[self.comparison.positions]
        n = len(spans)
        if np.isnan(self._before[0, 0]) or not spans.any():
            return 0.0
        rows = self._samples.count[1]
        now, before = (table[:rows, 1:] for table in (self._samples.table, self._before))
        error = np.abs(now - before)[:, :-n].max(axis=0)
        error = np.maximum.reduceat(error, self._sampled_starts)
        apart = before[:, -n:].max(axis=0)
        moves = spans > 0.0
        worst = (error[moves] / spans[moves]).max()
        return float(1.0 + (apart[moves] / spans[moves]).max() / max(worst, _LEAST_ERROR))

    def reached_until(self, accuracy: float) -> float:
        """Last time before positions of the runs differ by more than this [s]; infinite: never."""
        spans, until = self.comparison.scales(), np.inf
        for column, k in enumerate(self.comparison.positions, start=1):
            if spans[k] == 0.0:
                continue
            beyond = np.flatnonzero(self._growth.table[:, column] > accuracy * spans[k])
            if len(beyond):
                until = min(until, float(self._growth.table[max(beyond[0] - 1, 0), 0]))
            elif self._largest[0, k] > accuracy * spans[k]:
                until = min(until, float(self._largest[1, k]))
        return until


def error_statistics(errors: Mapping[str, QuantityError]) -> dict[str, float | str]:
    """Entries of the summary of a run on the errors of its quantities."""
    statistics: dict[str, float | str] = {}
    for quantity, worst in errors.items():
        if quantity in MEASURED_QUANTITIES:
            statistics[f"measured_error_of_{quantity}"] = worst.error
            statistics[f"worst_of_{quantity}"] = f"{worst.name} at t = {worst.time:.4g} s"
            if worst.over:
                statistics[f"scale_of_{quantity}"] = worst.over
    return statistics
