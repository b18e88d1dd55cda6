"""The error of a run, measured by its scout: the same run with longer steps.

The scout selects its steps by error control; the fine run, whose rows are the result, takes
`refinement` times as many, spread as the scout's were, so that the errors of both differ by a
factor that is clear beforehand. Both advance chunk by chunk; of the scout nothing is stored but its
state at the border of a chunk.

Two runs of a method of order p on the same plan of steps, one with r times as many, differ by the
error of the coarser one less that of the finer one, rᵖ : 1, so that the finer one is off by their
difference over rᵖ − 1 (Richardson; Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, 1993, §II.4). In: rows of both runs, in order. Out: the largest error of positions,
velocities and reactions, each over the peak-to-peak of its sensor, with its name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import (
    DEFORMATION,
    FOR_SCALE,
    Part,
    by_part,
    compared,
    groups,
    round_off,
)  # fmt: skip
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.run_settings import (
    HIGH_ORDER,
    damps_vibrations,
    fine_settings,
    gyration,
    modal_reach,
    remembers_bristles,
    scout_rows,
    scout_settings,
)
from flexmb.analysis.monitors import SampledHistory
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.writer import OutputBlock

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
_SCOUT = "scout_"
_NO_MOTION = 1e-10  # of the size of the model, or of a radian, within the run
_SPUN = 0.1  # radians for each of those by which the first speeds turn a body within the run
# Ratio of errors where vibrations are damped: they move a sensor as the square of their period.
_DAMPED_RATIO = 2.6
# Difference of a pass below which that of the next one is compared with it; least share of the
# order that two passes may show.
_SAME_MOTION, _MIN_ORDER = 0.05, 0.5
_MORE_STEPS = 1.1  # of a scout over those of the pass before, from which on their order is told
# Of radau with states: if stiff, order 3 of a stage is left of 5 (Hairer & Wanner II, §IV.15). With
# 2, 1.5, 0.75, 0 of 66 runs of states miss the request 0, 1, 1, 1, are told less than a third 0, 1,
# 3, 3, more than 3 times 5, 2, 4, 0, at cost 1.09, 1, 0.94, 0.93; of 16 with slow states 7 with 2.
_ORDER_LOST = {True: 2.0, False: 1.5}
# Ratio of errors of explicit methods by the pass before, over that by the order, which is no surer:
# of 200 first passes of the judging scenes a tenth had 0.8 times that by the order or less, half
# 1.2, a tenth 2.7 or more (order 8; 0.9, 1.1 and 2.6 with order 5). Of 184 pairs of passes a
# twentieth fell by 0.54 times what the order says or less (0.59): only less is an order lost.
_LUCK = 2.0
_LEAST_ERROR = 1e-15  # over the peak-to-peak
_NONE, _REACTIONS = np.zeros(0, np.intp), ("N", "N m")
_PARTED = 0.1  # difference over the peak-to-peak from which on two runs are different motions


@dataclass(frozen=True)
class ErrorOf:
    """The largest error of one quantity."""

    error: float  # over its scale
    name: str  # of the sensor, body or joint
    time: float  # s, at which it is largest
    over: str = ""  # its scale, if not its peak-to-peak
    round_off: float = 0.0  # what of the error shorter steps do not lessen


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
        self._length = self._least.get("m", 0.0) / _NO_MOTION
        n = len(self.compared)
        every = self.compared
        self._of_unit = groups((one.unit, one.quantity == FOR_SCALE) for one in every)
        self._of_quantity = at = groups(one.quantity for one in every)
        self._units = np.array([one.unit for one in every])
        whole = np.ones(n, dtype=bool)
        self._parts = parts or [(whole, whole, 0.0)]
        self._rates, self._places = at.get("velocities", _NONE), at.get("positions", _NONE)
        row = {one.name + one.unit: k for k, one in enumerate(every)}
        own = [row.get(every[k].name + every[k].unit.removesuffix("/s"), n) for k in self._rates]
        self._motions = np.array(own, np.intp)  # of velocities; n: nowhere
        self._largest = np.zeros((2, n))  # difference so far; its time
        sizes = np.array([len(one.columns) for one in every], np.intp)
        widest, self._starts = sizes.max(initial=0), np.cumsum(sizes) - sizes
        self._range = np.stack([np.full((n, widest), np.inf), np.full((n, widest), -np.inf)])
        tables = np.repeat([one.table for one in every], sizes)
        columns = np.array([k for one in every for k in one.columns], np.intp)
        sized = [one.reach or (1.0,) * len(one.columns) for one in every]
        self._sizes_of = np.array([size for row in sized for size in row])
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
        self._results: dict[tuple[float, int], dict[str, ErrorOf]] = {}  # of the rows so far
        self.round_off = np.zeros(n)  # of a step
        self._scales = np.zeros(0)  # `_spans` of the rows so far, if they were asked for

    def arrays(self) -> dict[str, np.ndarray]:
        """All that there is so far, to be saved and filled in again."""
        return {
            "error_count": self._growth.count, "error_largest": self._largest,
            "error_range": self._range, "error_growth": self._growth.table,
            "error_samples": self._samples.table, "error_sampled": self._samples.count,
            "error_before": self._before, "error_round_off": self.round_off,
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
        values, theirs = np.empty((2, n, len(self._in_range)))
        low, high = (bound.reshape(-1) for bound in self._range)
        for table, (columns, places) in self._columns.items():
            values[:, places] = getattr(fine, table)[:n, columns]
            theirs[:, places] = getattr(coarse, table)[:n, columns]
        values, theirs = values * self._sizes_of, theirs * self._sizes_of
        low[self._in_range] = np.minimum(low[self._in_range], values.min(axis=0))
        high[self._in_range] = np.maximum(high[self._in_range], values.max(axis=0))
        gaps = np.maximum.reduceat(np.abs(values - theirs), self._starts, axis=1)
        gaps[np.isnan(gaps)] = np.inf
        so_far = np.maximum.accumulate(np.vstack([self._largest[0], gaps]), axis=0)[1:]
        rises = so_far[-1] > self._largest[0]
        self._largest[1, rises] = fine.t[gaps.argmax(axis=0)][rises]
        self._largest[0] = so_far[-1]
        self._growth.add(fine.t[:n], so_far[:, self._places])
        samples = np.hstack([values[:, self._sampled], gaps[:, self._places]])
        self._samples.add(fine.t[:n], samples)

    def largest(self, ratio: float, steps: int = 0) -> dict[str, ErrorOf]:
        """The largest error of each quantity; `ratio` is that of the errors of the two runs.

        Round-off of the steps is no error that falls with them: it adds up as a walk at random,
        which is by its standard deviation off.
        """
        key = ratio, steps
        if key in self._results:
            return self._results[key]
        spans, largest = self._spans(), dict[str, ErrorOf]()
        apart = np.divide(self._largest[0], spans, out=np.zeros(len(spans)), where=spans > 0.0)
        # once the runs have parted, the finer one is no better than the other
        different = self._largest[0] > _PARTED * np.maximum(spans, self._sizes())
        walk = math.sqrt(steps) * self.round_off
        walk = np.divide(walk, spans, out=np.zeros(len(spans)), where=spans > 0.0)
        falling = apart / (max(ratio, 1.0 + 1e-9) - 1.0)
        errors = np.where(different, apart, np.minimum(falling + walk, np.maximum(apart, falling)))
        for quantity, of in self._of_quantity.items():
            k = int(of[errors[of].argmax()])
            name, (low, high), over = self.compared[k].name, self._range[:, k], ""
            if spans[k] > (1 + 1e-9) * max((high - low).max(), 0.0):
                body = name.removeprefix("bodies.").removesuffix(DEFORMATION)
                flexible = body in self._gyration
                over = _OF_POINTS if flexible else _FLOORS[quantity]
            error, time = float(errors[k]), float(self._largest[1, k])
            largest[quantity] = ErrorOf(error, name, time, over, float(walk[k]))
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
        for own, beside, mass in self._parts:
            speed, rate = (size[beside & (units == u)].max(initial=0.0) for u in ("m/s", "rad/s"))
            least = mass * (speed**2 / (self._length or np.inf) + self._length * rate**2)
            force = max(least, size[beside & (units == "N")].max(initial=0.0))
            for unit, small in (("N", least), ("N m", force * self._length)):
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
        for own, beside, _ in self._parts:
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


class VerifiedRun:
    """Two runs of one model that advance together.

    Attributes
    ----------
    scout, fine : Integration
        The runs; the fine one follows the plan that the scout writes.
    error : MeasuredError
        Their difference so far.
    recorded, of_scout : (n,) array of bool
        Which of the times of the fine run are outputs, and at which it is compared with the scout.
    passes : array
        Record `PASSES` of the run.
    is_stiff : bool
        Whether stability limited the steps of an explicit method.
    """

    def __init__(
        self, scout: Integration, fine: Integration, error: MeasuredError, recorded: np.ndarray,
        of_scout: np.ndarray, passes: np.ndarray, is_stiff: bool,
    ) -> None:  # fmt: skip
        self.scout, self.fine, self.error, self.passes = scout, fine, error, passes
        self.recorded, self.of_scout, self.is_stiff = recorded, of_scout, is_stiff

    @property
    def difference(self) -> float:
        """Largest difference of positions, over their peak-to-peak."""
        largest = self.error.largest(2.0)
        return largest["positions"].error if "positions" in largest else 0.0

    @property
    def order(self) -> float:
        """That of the method, or less, where the difference fell less since the pass before.

        By the steps of both scouts: where these lock to a swing, a stricter tolerance gives hardly
        more. Not where they were different motions. The bristles of contacts follow with order one.
        """
        integrator, passes, now = self.fine.method, self.passes[0], self.difference
        bristles = remembers_bristles(self.fine.compiled)
        highest = float(integrator.order)
        implicit = integrator.stages == 0 and integrator.order >= HIGH_ORDER
        if implicit and self.fine.compiled.layout.coordinates:
            highest -= _ORDER_LOST[self.is_stiff]
        steps, last = self.scout.state.count[0]["steps"], passes["last_steps"]
        known = 0.0 < passes["last_difference"] < _SAME_MOTION and now > 0.0
        if not known or steps < _MORE_STEPS * last:
            return 1 if bristles else highest
        scatter = _LUCK if integrator.stages else 1.0
        order = math.log(scatter * passes["last_difference"] / now) / math.log(steps / last)
        return min(max(order, 1.0 if bristles else _MIN_ORDER * integrator.order), highest)

    @property
    def ratio(self) -> float:
        """Error of the scout over that of the fine run, which may add steps where it needs them."""
        fine, scout = (run.state.count[0]["steps"] for run in (self.fine, self.scout))
        finer = min(max(fine / max(scout, 1), 1.0), self.fine.settings.refinement)
        return float(finer**self.order)

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, integrator: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, recorded: np.ndarray, passes: np.ndarray, is_stiff: bool,
    ) -> VerifiedRun:  # fmt: skip
        """A run from a copy of a state, and its scout, at the local tolerance of the settings.

        `recorded` says which of the times (n,) of the run are outputs.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        of_scout = scout_rows(len(times))
        scout = Integration(
            compiled, integrator, scout_settings(settings, integrator), states[0], times[of_scout]
        )
        fine = Integration(
            compiled, integrator, fine_settings(settings, integrator), states[1], times, scout.plan
        )
        length, span = compiled.length, settings.end - settings.start
        spun = (np.abs(first.v[body.iv + 3 : body.iv + 6]).max() for body in compiled.layout.bodies)
        turn = max(1.0, _SPUN * span * float(max(spun, default=0.0)))
        least = {"m": length, "rad": turn, "m/s": length / span, "rad/s": turn / span}
        at_rest = {unit: _NO_MOTION * size for unit, size in least.items()}
        radii, modes = gyration(compiled), modal_reach(compiled)
        parts = by_part(compared(compiled.layout, model, modes), compiled, model)
        error = MeasuredError(compiled.layout, model, at_rest, span, radii, parts, modes)
        error.round_off[:] = round_off(error.compared, compiled, first.q)
        return cls(scout, fine, error, recorded, of_scout, passes, is_stiff)

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """One chunk of both, or the first row; returns the status, and the rows of the fine run."""
        scout, fine = self.scout, self.fine
        status = scout.integrate(0 if first else scout.chunk)
        coarse = scout.rows.read()
        rows: list[OutputBlock] = []
        done = 0
        end = scout.plan.knots[scout.plan.used[0] - 1]
        while first or fine.state.t[0] < end:
            fine_status = fine.integrate(0 if first else fine.chunk)
            block = fine.rows.read()
            both = block.rows(self._newest(self.of_scout, block))
            self.error.add(coarse.part(done, done + len(both.t)), both)
            done += len(both.t)
            rows.append(block.rows(self._newest(self.recorded, block)))
            if first or fine_status != method.FINE:
                status = max(status, fine_status)
                break
        return status, rows

    def _newest(self, which: np.ndarray, block: OutputBlock) -> np.ndarray:
        """Of rows of the fine run, those of its newest block."""
        behind = int(self.fine.state.count[0]["outputs"])
        return which[behind - len(block.t) : behind]

    def arrays(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs in addition to the state of the fine run."""
        return {
            **{_SCOUT + name: value for name, value in self.scout.state._asdict().items()},
            **self.error.arrays(),
        }

    def errors(self) -> dict[str, ErrorOf]:
        """The measured error of each quantity.

        Vibrations that the longer steps damp are damped by the shorter ones too, but for a band
        between, which may be all that a small sensor sees: no balance of energies tells.
        """
        damped, ratio = damps_vibrations(self.fine.compiled, self.fine.method), self.ratio
        if 0.0 < self.passes[0]["last_difference"] < _SAME_MOTION:
            luck = _LUCK if self.fine.method.stages else 1.0
            ratio = min(self.error.ratio_before() or ratio, luck * ratio)
        steps = int(self.fine.state.count[0]["steps"])
        return self.error.largest(min(ratio, _DAMPED_RATIO) if damped else ratio, steps)
