"""The error of a run, measured by its scout: the same run with longer steps.

Two runs of a method of order p on the same plan of steps, one with r times as many, differ by the
error of the coarser one less that of the finer one, rᵖ : 1, so that the finer one is off by their
difference over rᵖ − 1 (Richardson; Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, 1993, §II.4). In: rows of both runs, in order. Out: the largest error of positions,
velocities and reactions, each over the peak-to-peak of its sensor, with its name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import (
    DEFORMATION,
    FOR_SCALE,
    Part,
    RoundOff,
    compared,
    groups,
)
from flexmb.analysis.dynamics.vibration_amplitudes import vibration_amplitudes
from flexmb.analysis.monitors import SampledHistory
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

# What moves by less than this share of the largest motion of its kind is at rest: positions below
# 5000 times round-off, others below what projections leave of them near singular poses.
_POSITIONS_AT_REST, _AT_REST = 1e-12, 1e-9
# All are judged over their own peak-to-peak, but reactions over no less than this share of the
# largest of their unit and its square of all inertia forces, moments also of the largest force
# times the size, in their part of the model: below are errors alone. Velocities over no less than
# this share of their own largest, those of bodies also than what moves them within the run as far
# as they move.
_LEAST_SHARE = 1e-3
_FLOORS = {
    "reactions": f"{_LEAST_SHARE:g} of the largest of its unit",
    "velocities": f"its mean speed or {_LEAST_SHARE:g} of its largest",
}
_OF_POINTS = "the motion of the body's points"
NO_MOTION = 1e-10  # of the size of the model, or of a radian, within the run
_LEAST_ERROR = 1e-15  # over the peak-to-peak
_NONE, _REACTIONS = np.zeros(0, np.intp), ("N", "N m")
_FOLLOWED = 3.0  # times what a run has of a vibration, from which on it has lost it
_PARTED = 0.1  # difference over the peak-to-peak from which on two runs are different motions


@dataclass(frozen=True)
class ErrorOf:
    """The largest error of one quantity."""

    error: float  # over its scale
    name: str  # of the sensor, body or joint
    time: float  # s, at which it is largest
    over: str = ""  # its scale, if not its peak-to-peak
    round_off: float = 0.0  # what of the error shorter steps do not lessen
    begin: float = -math.inf  # of the vibration that steps damp, where that is the error [s]


class MeasuredError:
    """Differences of two runs of one model at the same outputs, whose rows it takes in order.

    Parameters
    ----------
    layout, model : Layout, Model
        Channels, and sensors with units. Bodies are compared where nothing senses a motion.
    least : mapping of str to float, optional
        Motion by unit below which a sensor counts as at rest.
    duration : float
        Of the run [s].
    gyration : mapping of str to float, optional
        Radius of gyration of each flexible body about the origin of its frame [m]: the frame counts
        with the motion of its points, which alone are seen.
    parts : list of Part, optional
        Whose reactions count together; by default all do, without forces of inertia.
    reach : mapping of str to (m,) array, optional
        What one unit of each modal coordinate of a body moves a point [m].
    """

    def __init__(
        self, layout: Layout, model: Model, least: Mapping[str, float] | None = None,
        duration: float = math.inf, gyration: Mapping[str, float] | None = None,
        parts: Sequence[Part] = (), reach: Mapping[str, Array] | None = None,
    ) -> None:  # fmt: skip
        self.compared, self._duration = compared(layout, model, reach), duration
        self._gyration, self._least = gyration or {}, least or {}
        every, n = self.compared, len(self.compared)
        self._of_unit = groups((one.unit, one.quantity == FOR_SCALE) for one in every)
        self._of_quantity = at = groups(one.quantity for one in every)
        self._units = np.array([one.unit for one in every])
        whole = np.ones(n, dtype=bool)
        self._parts = parts or [Part(whole, whole, 0.0, self._least.get("m", 0.0) / NO_MOTION)]
        self._rates, self._places = at.get("velocities", _NONE), at.get("positions", _NONE)
        row = {one.name + one.unit: k for k, one in enumerate(every)}
        own = [row.get(every[k].name + every[k].unit.removesuffix("/s"), n) for k in self._rates]
        self._motions = np.array(own, np.intp)  # of velocities; n: nowhere
        self._largest = np.zeros((2, n))  # difference so far; its time
        self._damped = np.zeros((3, n))  # by vibrations that steps damp; its time; where they begin
        sizes = np.array([len(one.columns) for one in every], np.intp)
        widest, self._starts = sizes.max(initial=0), np.cumsum(sizes) - sizes
        self._range = np.stack([np.full((n, widest), np.inf), np.full((n, widest), -np.inf)])
        tables = np.repeat([one.table for one in every], sizes)
        columns = np.array([k for one in every for k in one.columns], np.intp)
        units = (one.reach or np.ones(len(one.columns)) for one in every)
        self._sizes_of = np.concatenate([_NONE, *units])
        self._columns = {  # in each table, and where they stand in all that is compared
            str(table): (columns[tables == table], np.flatnonzero(tables == table))
            for table in np.unique(tables)
        }
        self._in_range = np.flatnonzero(np.arange(widest) < sizes[:, None])
        self._sampled = np.flatnonzero(np.isin(np.repeat(np.arange(n), sizes), self._places))
        self._sampled_starts = np.cumsum(sizes[self._places]) - sizes[self._places]
        self._growth = SampledHistory(len(self._places))  # of the differences of positions
        # positions of the fine run and differences, of this pass and of the one before
        self._samples = SampledHistory(len(self._sampled) + len(self._places))
        self._before = np.full_like(self._samples.table, np.nan)
        self._results: dict[tuple[float, int, bool], dict[str, ErrorOf]] = {}  # of the rows so far
        self.round_off = np.zeros(n)  # of a step, by the places so far
        self.places: RoundOff | None = None
        self._multiplied = np.zeros(n)  # round-off in the end, as measured
        self._scales = np.zeros(0)  # `_spans` of the rows so far, if they were asked for

    def arrays(self) -> dict[str, np.ndarray]:
        """All that there is so far, to be saved and filled in again."""
        return {
            "error_count": self._growth.count, "error_largest": self._largest,
            "error_range": self._range, "error_growth": self._growth.table,
            "error_samples": self._samples.table, "error_sampled": self._samples.count,
            "error_before": self._before, "error_round_off": self.round_off,
            "error_damped": self._damped,
        }  # fmt: skip

    def compare(self, before: MeasuredError) -> None:
        """Take the pass before for comparison."""
        self._before[:] = before._samples.table

    def add(self, coarse: OutputBlock, fine: OutputBlock) -> None:
        """Take the same rows of both runs, as far as both have them (SI).

        Parameters
        ----------
        coarse, fine : OutputBlock
            Rows (k, ...) of the scout and of the fine run.
        """
        n = min(len(fine.t), len(coarse.t))
        if n == 0:
            return
        self._results.clear()
        self._scales = np.zeros(0)
        if self.places is not None:
            np.maximum(self.round_off, self.places.of(fine), out=self.round_off)
        low, high = (bound.reshape(-1) for bound in self._range)
        values, gaps = self._compare(coarse.part(0, n), fine.part(0, n))
        low[self._in_range] = np.minimum(low[self._in_range], values.min(axis=0))
        high[self._in_range] = np.maximum(high[self._in_range], values.max(axis=0))
        so_far = np.maximum.accumulate(np.vstack([self._largest[0], gaps]), axis=0)[1:]
        rises = so_far[-1] > self._largest[0]
        self._largest[1, rises] = fine.t[gaps.argmax(axis=0)][rises]
        self._largest[0] = so_far[-1]
        self._growth.add(fine.t[:n], so_far[:, self._places])
        samples = np.hstack([values[:, self._sampled], gaps[:, self._places]])
        self._samples.add(fine.t[:n], samples)

    def values(self, rows: OutputBlock) -> Array:
        """Values (n, components) of all that is compared."""
        values = np.empty((len(rows.t), len(self._in_range)))
        for table, (columns, places) in self._columns.items():
            values[:, places] = getattr(rows, table)[:, columns]
        values *= self._sizes_of
        return values

    def _compare(self, coarse: OutputBlock, fine: OutputBlock) -> tuple[Array, Array]:
        """Values of the fine rows (n, components), and differences (n, k)."""
        values = self.values(fine)
        return values, self._gaps(self.values(coarse), values)

    def _gaps(self, values: Array, theirs: Array) -> Array:
        """Differences (n, k) of values (n, components)."""
        gaps = np.maximum.reduceat(np.abs(values - theirs), self._starts, axis=1)
        gaps[np.isnan(gaps)] = np.inf
        return np.asarray(gaps)

    def reaction_share(self, row: OutputBlock) -> float:
        """The largest reaction of a row, over the scale of its joint."""
        return self.reaction_difference(replace(row, reactions=np.zeros_like(row.reactions)), row)

    def reaction_difference(self, coarse: OutputBlock, fine: OutputBlock) -> float:
        """The largest difference of a reaction in rows, over the scale of its joint."""
        gaps, of = self._compare(coarse, fine)[1], self._of_quantity.get("reactions", _NONE)
        return float(self._shares(gaps.max(axis=0, initial=0.0))[of].max(initial=0.0))

    def reaction_swing(self, rows: OutputBlock) -> float:
        """The largest amplitude of a reaction in a second half of rows, over its scale."""
        of = self._of_quantity.get("reactions", _NONE)
        return float(self._shares(self._swings(rows))[of].max(initial=0.0))

    def add_damped(
        self, coarse: OutputBlock, fine: OutputBlock, begin: float,
        quantities: Collection[str] = (), output: float = 0.0,
    ) -> float:  # fmt: skip
        """Take rows of the run, and of one that follows vibrations which begin at a time [s]; of
        all that is compared, or of these quantities. Returns the largest share of a reaction.

        Where they end before the first output, what vibrates goes on as it decays in them.
        """
        if not len(fine.t):
            return 0.0
        self._results.clear()
        _, gaps = self._compare(coarse, fine)
        largest, times = gaps.max(axis=0), fine.t[gaps.argmax(axis=0)]
        if fine.t[-1] < output:
            largest = np.minimum(gaps[len(gaps) // 2 :].max(axis=0), self._swings(fine, output))
            times = np.full(len(largest), output)
        self._widen_damped(largest, times, begin, quantities)
        of = self._of_quantity.get("reactions", _NONE)
        return float(self._shares(largest)[of].max(initial=0.0))

    def add_lost(
        self, rows: OutputBlock, fine: OutputBlock, begin: float, quantities: Collection[str],
        longest: float,
    ) -> None:  # fmt: skip
        """Take late rows of the run, and earlier, even ones of a run that follows vibrations: of
        those of a period up to `longest` [s] that are left by their own damping, and lost."""
        self._results.clear()
        at = float(rows.t[0])
        left, own = self._swings(fine, at, longest), self._swings(rows)
        lost = np.where(left > _FOLLOWED * own, left - own, 0.0)
        self._widen_damped(lost, np.full(len(lost), at), begin, quantities)

    def _widen_damped(
        self, largest: Array, times: Array, begin: float, quantities: Collection[str]
    ) -> None:
        """Take errors (k,) by a vibration, of these quantities or all, where they are larger."""
        counts = [not quantities or one.quantity in quantities for one in self.compared]
        more = (largest > self._damped[0]) & counts
        self._damped[0, more], self._damped[1, more] = largest[more], times[more]
        self._damped[2, more] = begin

    def _swings(self, rows: OutputBlock, at: float = -math.inf, longest: float = math.inf) -> Array:
        """Amplitudes (k,) of vibrations in the second half of rows; see `vibration_amplitudes`."""
        return vibration_amplitudes(rows.t, self.values(rows), self._starts, at, longest)

    def set_round_off(self, runs: Sequence[Array], steps: float) -> None:
        """Take the values (k, components) of runs that differ by round-off alone.

        It is the standard deviation of what they show; of a walk of `steps` times as many steps.
        """
        n = min(map(len, runs))
        squares = [
            self._gaps(one[:n], other[:n]) ** 2 for k, one in enumerate(runs) for other in runs[:k]
        ]
        self._results.clear()
        self._multiplied = np.sqrt(0.5 * steps * np.mean(squares, axis=0).max(axis=0))

    def multiplied_share(self) -> float:
        """Largest round-off in the end of a position, as measured, over its peak-to-peak."""
        return float(self._shares(self._multiplied)[self._places].max(initial=0.0))

    def round_off_share(self) -> float:
        """Largest round-off of a step in a position, over its peak-to-peak."""
        own = self._shares(self.round_off)[self._places]
        return float(np.finfo(float).eps + own.max(initial=0.0))

    def growth(self) -> float:
        """Times that the difference of positions grew faster than the square of the time.

        From any moment on at which it was above round-off, until the runs were different motions.
        """
        spans, rows = self._spans()[self._places], self._growth.count[1]
        moves, table = spans > 0.0, self._growth.table[:rows]
        if rows < 2 or not moves.any():
            return 1.0
        apart = (table[:, 1:][:, moves] / spans[moves]).max(axis=1)
        last = min(int(np.searchsorted(apart, _PARTED)), rows - 1)
        past = table[:, 0] - table[0, 0]
        seen = np.flatnonzero(apart[:last] > self.round_off_share())
        grown = apart[last] / apart[seen] * (past[seen] / past[last]) ** 2
        return float(grown.max(initial=1.0))

    def multiplication(self, steps: int) -> float:
        """Times that round-off in the end, as measured, is what steps leave of it in their places.

        Of their number to the power of 1.5, as a walk of speeds leaves it (Brouwer's law).
        """
        walk = self.round_off_share() * steps * math.sqrt(steps)
        return self.multiplied_share() / max(walk, _LEAST_ERROR)

    def forget_walk(self, steps: int) -> None:
        """Leave out round-off that is not multiplied: the longer steps of a scout have more of it,
        and what Newton's method leaves of theirs besides."""
        if self.multiplication(steps) <= 1.0:
            self._multiplied[:] = 0.0
            self._results.clear()

    def damped(self, joints: Collection[str] | None = None) -> tuple[str, float, float]:
        """The joint whose reactions lack most of vibrations, what they lack over their scale, and
        when these begin [s]; of all joints, or of those given."""
        of, shares = self._of_quantity.get("reactions", _NONE), self._shares(self._damped[0])
        own = [k for k in of if joints is None or self.compared[k].name in joints]
        if not own:
            return "", 0.0, 0.0
        k = own[int(shares[own].argmax())]
        return self.compared[k].name, float(shares[k]), float(self._damped[2, k])

    def largest(self, ratio: float, steps: int = 0, limited: bool = False) -> dict[str, ErrorOf]:
        """The largest error of each quantity; `ratio` is that of the errors of the two runs.

        Round-off of the steps is no error that falls with them: it adds up as a walk at random,
        which is by its standard deviation off, or as large as measured. A scout that is `limited`
        by stability rings by what its tolerance allows, in reactions by far more, and these are no
        other motion; nor is a reaction of the finer, stable run off by more than it has itself.
        """
        key = ratio, steps, limited
        if key in self._results:
            return self._results[key]
        spans, largest = self._spans(), dict[str, ErrorOf]()
        apart, damped = self._shares(self._largest[0]), self._shares(self._damped[0])
        # once the runs have parted, the finer one is no better than the other
        different = self._largest[0] > _PARTED * np.maximum(spans, self._sizes())
        walk = self._shares(np.maximum(math.sqrt(steps) * self.round_off, self._multiplied))
        falling = apart / (max(ratio, 1.0 + 1e-9) - 1.0)
        reactions = self._of_quantity.get("reactions", _NONE)
        if limited and not different[self._places].any():
            different[reactions] = False
        errors = np.where(different, apart, np.minimum(falling + walk, np.maximum(apart, falling)))
        if limited:
            own = self._shares(self._largest_values())[reactions]
            errors[reactions] = np.minimum(errors[reactions], own)
        times = np.where(damped > errors, self._damped[1], self._largest[1])
        begin = np.where(damped > errors, self._damped[2], -math.inf)
        errors = np.maximum(errors, damped)
        for quantity, of in self._of_quantity.items():
            k = int(of[errors[of].argmax()])
            name, (low, high), over = self.compared[k].name, self._range[:, k], ""
            if spans[k] > (1 + 1e-9) * max((high - low).max(), 0.0):
                body = name.removeprefix("bodies.").removesuffix(DEFORMATION)
                flexible = body in self._gyration
                over = _OF_POINTS if flexible else _FLOORS[quantity]
            error, time = float(errors[k]), float(times[k])
            largest[quantity] = ErrorOf(error, name, time, over, float(walk[k]), float(begin[k]))
        self._results[key] = largest
        return largest

    def ratio_before(self) -> float:
        """Ratio of the errors of the two runs of the pass before, whose truth is this one; or 0."""
        n, spans = len(self._places), self._spans()[self._places]
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
        """Last time before the runs' positions are apart by more; infinite: they never are [s]."""
        spans, until = self._spans(), np.inf
        for column, k in enumerate(self._places, start=1):
            if spans[k] == 0.0:
                continue
            beyond = np.flatnonzero(self._growth.table[:, column] > accuracy * spans[k])
            if len(beyond):
                until = min(until, float(self._growth.table[max(beyond[0] - 1, 0), 0]))
            elif self._largest[0, k] > accuracy * spans[k]:
                until = min(until, float(self._largest[1, k]))
        return until

    def _shares(self, values: Array) -> Array:
        """Values (k,) over the scale of each; 0 for what is at rest."""
        spans = self._spans()
        return np.asarray(np.divide(values, spans, out=np.zeros(len(spans)), where=spans > 0.0))

    def _spans(self) -> Array:
        """Scale of each: its peak-to-peak, or more; 0 for what is at rest against others."""
        if len(self._scales):
            return self._scales
        low, high = self._range
        spans = np.where(np.isfinite(low), high - low, 0.0).max(axis=1, initial=0.0)
        for (unit, _), same in self._of_unit.items():
            if unit in _REACTIONS:
                continue
            share = _POSITIONS_AT_REST if unit in ("m", "rad") else _AT_REST
            least = max(share * spans[same].max(), self._least.get(unit, 0.0))
            spans[same[spans[same] <= least]] = 0.0
        size, rates, units = self._largest_values(), self._rates, self._units
        for own, beside, mass, length in self._parts:
            speed, rate = (size[beside & (units == u)].max(initial=0.0) for u in ("m/s", "rad/s"))
            least = mass * (speed**2 / (length or np.inf) + length * rate**2)
            force = max(least, size[beside & (units == "N")].max(initial=0.0))
            for unit, small in (("N", least), ("N m", force * length)):
                same = units == unit
                largest = max(size[beside & same].max(initial=0.0), _LEAST_SHARE * small)
                spans[own & same] = np.maximum(spans[own & same], _LEAST_SHARE * largest)
        self._join_frames(spans)
        mean = np.append(spans, 0.0)[self._motions] / self._duration
        scale = np.maximum(np.maximum(spans[rates], mean), _LEAST_SHARE * size[rates])
        spans[rates] = np.where(spans[rates] > 0.0, scale, 0.0)
        self._scales = np.asarray(spans)
        return self._scales

    def _largest_values(self) -> Array:
        size = np.abs(np.where(np.isfinite(self._range), self._range, 0.0)).max(axis=0)
        return np.asarray(size.max(axis=1, initial=0.0))

    def _sizes(self) -> Array:
        """What each may be far below and yet part of the same motion: reactions, the largest of
        their unit; velocities, their own largest; positions, nothing."""
        size, below = self._largest_values(), np.zeros(len(self.compared))
        below[self._rates] = size[self._rates]
        for own, beside, *_ in self._parts:
            for unit in _REACTIONS:
                same = self._units == unit
                below[own & same] = size[beside & same].max(initial=0.0)
        return below

    def _join_frames(self, spans: Array) -> None:
        """Let frame and deformation of a flexible body count with the motion of its points."""
        places = {one.name + one.unit: k for k, one in enumerate(self.compared)}
        for name, reach in self._gyration.items():
            # Euler parameters change by half the angle
            for rate, turns in (("", 2.0), ("/s", 1.0)):
                sizes = {"m": 1.0, "rad": reach * turns, f"{DEFORMATION}m": 1.0}
                rows = {f"bodies.{name}{end}{rate}": size for end, size in sizes.items()}
                own = [places[row] for row in rows if row in places]
                if own:
                    size = np.array([size for row, size in rows.items() if row in places])
                    spans[own] = (spans[own] * size).max() / size
