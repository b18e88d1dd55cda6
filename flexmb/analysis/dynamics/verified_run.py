"""A run and its scout, the same run with longer steps, which advance together.

The scout is the coarse run: it selects its steps by error control. The fine run, whose rows are the
result, takes `refinement` times as many steps, distributed as those of the scout. So the ratio of
their errors is known in advance. Both advance chunk by chunk. Of the scout only the state between
chunks is saved; its steps and the compared values stay in memory.

A chaotic motion amplifies any error exponentially in time (Lyapunov exponent; Hairer, Nørsett &
Wanner, Solving Ordinary Differential Equations I, 1993, §I.16). Errors of the method decrease with
the steps, round-off does not; the difference of the two runs, divided by the ratio of their errors,
does not show it. So if the differences have grown exponentially, or little error is requested, the
scout is run again on its own steps, with their ends shifted alternately by 1e-9 of a step. These
runs have the same errors of the method, but different round-off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from flexmb.analysis.chunked_run import Halt, meanwhile
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import JumpStates
from flexmb.analysis.dynamics.measured_error import (
    MIN_GROWTH,
    MeasuredError,
    QuantityError,
    error_statistics,
)
from flexmb.analysis.dynamics.run_settings import (
    damps_vibrations,
    fine_settings,
    least_fractional_exponent,
    scout_rows,
    scout_settings,
)
from flexmb.analysis.dynamics.vibration_error import DAMPED_RATIO
from flexmb.engine import method
from flexmb.engine.allocation import new_plan
from flexmb.engine.compile import Compiled
from flexmb.engine.state import Plan, State
from flexmb.errors import FlexmbError
from flexmb.model.model import Model
from flexmb.progress import Progress
from flexmb.results.output_block import OutputBlock

_SCOUT = "scout_"
# Two passes show the order of the method if the difference of the first is below _SAME_MOTION; the
# order is taken as at least _MIN_ORDER times that of the method.
_SAME_MOTION, _MIN_ORDER = 0.05, 0.5
# Least ratio of the scout's steps to those of the pass before from which the order is computed.
_MIN_STEP_GROWTH = 1.1
# Loss of order of radau with controller states (True: stiff). If stiff, the stage order 3 of 5 is
# left (Hairer & Wanner II, §IV.15). With a loss of 2, 1.5, 0.75, 0, of 66 runs with states 0, 1, 1,
# 1 miss the request, the reported error is less than a third in 0, 1, 3, 3 and more than three
# times the true one in 5, 2, 4, 0, at costs of 1.09, 1, 0.94, 0.93; with slow states 7 of 16 with
# 2.
_ORDER_LOST = {True: 2.0, False: 1.5}
# Scatter of the measured ratio of errors of an explicit method about that by its order. Of 200
# first passes a tenth had 0.8 or less times the expected ratio, half 1.2, a tenth 2.7 or more
# (order 8; 0.9, 1.1, 2.6 with order 5). From pass to pass errors fell by 0.54 of the expected
# factor or less in a twentieth of 184 pairs (0.59 with order 5): only below that is order lost.
_SCATTER = 2.0
# Where a motion multiplies errors, those of a scout may cancel by chance. So a run of several
# passes by an explicit method states at least the error of the pass before, by the two fine runs,
# reduced by the order of the method, but at most this share of the requested accuracy. Of 240 runs
# of chaotic pendulums 24 state less than a third of the error without it, 10 with it.
_EXPECTED_SHARE = 0.2
# A step that ends where a contact force d^n does has an error of order n + 1, if n is no whole
# number: its derivatives are infinite there. With radau and so many events over steps that they
# count, the order is taken as n and this, between n + 1 and 5. Of 112 runs with balls that bounce
# on a Hertzian contact, and a ratchet, 7 exceed twice the request without it, 0 with it; of some 40
# errors near the request 23 or 4 are stated as less than a third, 3 or 12 as more than three times,
# at a cost of 1.12. With n + 1: 0, 1, 21 at 1.27. With n = 1 all of 80 runs are right.
_FRACTIONAL_ORDER, _MIN_EVENTS = 1.5, 0.005
_STATIC_ORDER = 3.0  # order of positions with kinetostatic modes, whose rates are those of cubics
# Largest difference of the runs of a pass that follows a vibration, over the change from the pass
# before, which damped it: a run of 1.6 times as many steps then lacks at most a fifth of it.
_FOLLOWED_SHARE = 0.7
# Stability limits a scout if more than this share of all steps are at its stability limit.
_LIMITED_SHARE = 0.02
# Shift of the end of a step over its size; largest ratio of neighbouring steps whose end is
# shifted.
_KNOT_SHIFT, _EVEN_RATIO = 1e-9, 2.0
ANY_ERROR = 1e6  # rejection factor of repeated runs: the scout has accepted these steps
# Amplified round-off is measured if a bound of it exceeds _MIN_BOUND times the requested
# accuracy, and always for accuracies up to _CLOSE_ACCURACY, since errors of the method hide its
# growth where they are small with what multiplies them (a body about its middle axis): by one
# repeated run, and by three on given steps if that one shows more than _MIN_AMPLIFIED times the
# accuracy. The bound is _BOUND_FACTOR (True: explicit) times that by the growth of differences,
# which was exceeded by up to 70 (explicit) and 1000 (radau; chains of pendulums, near the origin
# and 1 km away).
_CLOSE_ACCURACY = 1e-7
_MIN_BOUND, _MIN_AMPLIFIED, _BOUND_FACTOR = 0.1, 0.0025, {True: 100.0, False: 1000.0}
_MAX_REPEATED_STEPS = 1.1  # steps of a repeated scout over those of the scout, at most


class Chunk(NamedTuple):
    """Times between the steps of a chunk of a scout [s], and the compared values in its rows."""

    knots: np.ndarray
    values: np.ndarray  # (k, components)


class Ahead(NamedTuple):
    """A chunk of a scout that the fine run has not reached, and the state before it."""

    before: State
    status: Future[int]


class VerifiedRun:
    """Two runs of one model that advance together.

    Attributes
    ----------
    scout, fine : Integration
        The runs; the fine one follows the plan that the scout writes.
    error : MeasuredError
        Their difference so far.
    recorded, of_scout, between : (n,) array of bool
        Which of the times of the fine run are outputs, at which the scout has rows too, and which
        others extend the ranges of its values.
    passes : array
        Record `PASSES` of the run.
    is_stiff : bool
        Whether an explicit method was replaced because stability limited its steps.
    jumps : JumpStates, optional
        States of the fine run at jumps and events, if the model is stiff.
    """

    def __init__(
        self, scout: Integration, fine: Integration, error: MeasuredError, recorded: np.ndarray,
        of_scout: np.ndarray, between: np.ndarray, passes: np.ndarray, is_stiff: bool,
        jumps: JumpStates | None,
    ) -> None:  # fmt: skip
        self.scout, self.fine, self.error, self.passes = scout, fine, error, passes
        self.recorded, self.of_scout, self.between = recorded, of_scout, between
        self.is_stiff, self.jumps = is_stiff, jumps
        self.chunks: list[Chunk] = []  # of the scout; of a resumed run those after it was resumed
        self._ahead: Ahead | None = None

    @property
    def difference(self) -> float:
        """Largest difference of positions, over their peak-to-peak."""
        largest = self.error.largest(2.0)
        return largest["positions"].error if "positions" in largest else 0.0

    @property
    def order(self) -> float:
        """The order of the method, or a lower one that the pass before shows.

        It is computed from the differences of both passes and the numbers of steps of their scouts,
        unless the runs of the pass before were different motions, or damped a vibration that these
        follow, or the numbers hardly differ.
        """
        integrator, passes = self.fine.method, self.passes[0]
        highest = float(integrator.order)
        implicit = integrator.stages == 0 and integrator.order >= method.HIGH_ORDER
        if implicit and self.fine.compiled.system.parts.coordinates["state"].any():
            highest -= _ORDER_LOST[self.is_stiff]
        if self.fine.settings.static_after_step == 1:
            highest = min(highest, _STATIC_ORDER)
        if implicit and self._has_many_events:
            exponent = least_fractional_exponent(self.fine.compiled)
            highest = min(highest, _FRACTIONAL_ORDER + exponent)
        steps, last = self.scout_state.count[0]["steps"], passes["last_steps"]
        same = 0.0 < passes["last_difference"] < _SAME_MOTION
        if not same or steps < _MIN_STEP_GROWTH * last or self._follows_a_damped_vibration:
            return highest
        if (now := self.difference) == 0.0:
            return highest
        scatter = _SCATTER if integrator.stages else 1.0
        order = math.log(scatter * passes["last_difference"] / now) / math.log(steps / last)
        return min(max(order, min(_MIN_ORDER * integrator.order, highest)), highest)

    @property
    def _follows_a_damped_vibration(self) -> bool:
        """Whether both runs of the pass before damped a vibration that those of this one follow.

        Errors of a vibration that is damped away are its amplitude, whatever the steps: such a pass
        shows no order. It was farther from this one than its two runs from each other, and these
        differ by less than its error.
        """
        before = self.error.ratio_before()
        if before <= 1.0 or not damps_vibrations(self.fine.compiled, self.fine.method):
            return False
        changed = float(self.passes[0]["last_difference"]) / (before - 1.0)
        return before < DAMPED_RATIO and self.difference < _FOLLOWED_SHARE * changed

    @property
    def _has_many_events(self) -> bool:
        """Whether so many steps end at events that their errors count."""
        count = self.fine.state.count[0]
        return bool(count["events"] > _MIN_EVENTS * count["steps"])

    @property
    def ratio(self) -> float:
        """Error of the scout over that of the fine run, by the order and the numbers of steps."""
        fine, scout = (st.count[0]["steps"] for st in (self.fine.state, self.scout_state))
        finer = min(max(fine / max(scout, 1), 1.0), self.fine.settings.refinement)
        return float(finer**self.order)

    @classmethod
    def of(
        cls, compiled: Compiled, model: Model, integrator: method.Method, settings: method.Settings,
        first: State, times: np.ndarray, recorded: np.ndarray, counted: np.ndarray,
        passes: np.ndarray, is_stiff: bool, jumps: JumpStates | None,
    ) -> VerifiedRun:  # fmt: skip
        """A run and its scout, each from a copy of a state, at the local tolerance of `settings`.

        `recorded` flags the outputs among the `times` (n,) of the run, `counted` those at which
        differences of both runs count; elsewhere rows are for ranges alone. The times of `jumps`
        are among `times`.
        """
        states = [State(*(array.copy() for array in first)) for _ in range(2)]
        compared = scout_rows(len(times), bool(compiled.system.events))
        of_scout = compared & counted
        scout = Integration(
            compiled, integrator, scout_settings(settings, integrator), states[0], times[of_scout]
        )
        plan = new_plan(scout.chunk)
        fine = Integration(
            compiled, integrator, fine_settings(settings, integrator), states[1], times, plan
        )
        error = MeasuredError.of(compiled, model, first, settings.end - settings.start)
        between = compared & ~counted
        return cls(scout, fine, error, recorded, of_scout, between, passes, is_stiff, jumps)

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """Integrate one chunk of both, or write the first row; the status, rows of the fine run."""
        scout, fine = self.scout, self.fine
        ahead, self._ahead = self._ahead, None
        status = ahead.status.result() if ahead else scout.integrate(0 if first else scout.chunk)
        coarse = scout.rows.read()
        rows, done = list[OutputBlock](), 0
        knots = scout.plan.knots[: scout.plan.used[0]].copy()
        fine.plan.knots[: len(knots)], fine.plan.used[0] = knots, len(knots)
        end = knots[-1]
        self.chunks.append(Chunk(knots, self.error.comparison.values(coarse)))
        with self._scout_ahead(is_idle=first or status != method.SUCCESS):
            while first or fine.state.t[0] < end:
                fine_status = fine.integrate(0 if first else fine.chunk)
                block = fine.rows.read()
                if self.jumps is not None:
                    self.jumps.add_rows(block)
                    self.jumps.add_events(fine.events())
                both = block.rows(self._newest(self.of_scout, block))
                self.error.add(coarse.part(done, done + len(both.t)), both)
                self.error.extend_ranges(block.rows(self._newest(self.between, block)))
                done += len(both.t)
                rows.append(block.rows(self._newest(self.recorded, block)))
                if first or fine_status != method.SUCCESS:
                    status = max(status, fine_status)
                    break
        if self.jumps is not None:
            self.jumps.add_steps(knots, fine.settings.refinement)
        return status, rows

    @contextmanager
    def _scout_ahead(self, is_idle: bool) -> Iterator[None]:
        """Meanwhile, integrate the next chunk of the scout, if there is one and it is not idle."""
        scout = self.scout
        if is_idle or scout.finished:
            yield
            return
        before = State(*(array.copy() for array in scout.state))
        with meanwhile(scout.integrate, scout.chunk) as status:
            self._ahead = Ahead(before, status)
            yield

    @property
    def scout_state(self) -> State:
        """The state of the scout where the fine run is."""
        return self.scout.state if self._ahead is None else self._ahead.before

    def _newest(self, which: np.ndarray, block: OutputBlock) -> np.ndarray:
        """The entries of `which` for the rows of the last block of the fine run."""
        behind = int(self.fine.state.count[0]["outputs"])
        return which[behind - len(block.t) : behind]

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays that a resumed run needs in addition to the state of the fine run."""
        return {
            **{_SCOUT + name: value for name, value in self.scout_state._asdict().items()},
            _SCOUT + "balance": self.scout.rows.balance.tally,
            **self.error.arrays(),
            **({} if self.jumps is None else {"jumps": self.jumps.table}),
        }

    def errors(self) -> dict[str, QuantityError]:
        """The measured error of each quantity.

        With a method that damps unresolved vibrations, only those in a band of frequencies differ
        between the two runs. They may be the whole motion of a sensor, and no energy balance shows
        it; so the ratio of errors is limited then.
        """
        damped, ratio = damps_vibrations(self.fine.compiled, self.fine.method), self.ratio
        damped |= self.fine.settings.static_after_step == 1
        same = 0.0 < self.passes[0]["last_difference"] < _SAME_MOTION
        if same and not self._follows_a_damped_vibration:
            luck = _SCATTER if self.fine.method.stages else 1.0
            ratio = min(self.error.ratio_before() or ratio, luck * ratio)
        ratio = min(ratio, self._expected_ratio())
        ratio = min(ratio, DAMPED_RATIO) if damped else ratio
        return self.error.largest(ratio, int(self.fine.state.count[0]["steps"]), self.is_limited)

    def _expected_ratio(self) -> float:
        """Ratio of errors with the error of the pass before, reduced by the order of the method."""
        passes, steps = self.passes[0], self.scout_state.count[0]["steps"]
        before = self.error.ratio_before()
        if before <= 1.0 or not self.multiplies_errors:
            return math.inf
        fell = float(passes["last_steps"] / max(steps, 1)) ** self.fine.method.order
        expected = passes["last_difference"] / (before - 1.0) * fell
        expected = min(expected, _EXPECTED_SHARE * self.fine.settings.accuracy)
        return 1.0 + float(self.difference / expected) if expected > 0.0 else math.inf

    @property
    def multiplies_errors(self) -> bool:
        """Whether the motion multiplies errors that an explicit method has made."""
        return self.fine.method.stages > 0 and self.error.growth() >= MIN_GROWTH

    @property
    def is_limited(self) -> bool:
        """Whether stability limits the steps of the scout."""
        steps, memory = self.fine.state.count[0]["steps"], self.scout_state.memory[0]
        return bool(memory["steps_at_stability_limit"] > _LIMITED_SHARE * steps)

    def statistics(self) -> dict[str, float | int | str]:
        """Entries of the summary of a run on its error."""
        return {
            "accuracy_asked": self.fine.settings.accuracy,
            "passes": int(self.passes[0]["count"]),
            "comparison_steps": int(self.scout_state.count[0]["steps"]),
            **error_statistics(self.errors()),
        }


def measure_round_off_growth(
    verified: VerifiedRun, accuracy: float, begin: State, progress: Progress
) -> None:
    """Add round-off that the motion amplifies to the measured error of a run.

    Parameters
    ----------
    verified : VerifiedRun
        The run and its scout, at their end.
    accuracy : float
        Requested accuracy. If it is not reached, round-off is measured in any case.
    begin : State
        First state.
    progress : Progress
        Called for every chunk.
    """
    error, scout = verified.error, verified.scout
    steps = int(scout.state.count[0]["steps"])
    exceeded = _BOUND_FACTOR[verified.fine.method.stages > 0]
    bound = exceeded * np.sqrt(steps) * error.round_off_share() * error.growth()
    worst = verified.errors().get("positions")
    close = accuracy <= _CLOSE_ACCURACY
    suspected = (close or bound > _MIN_BOUND * accuracy) and not verified.is_limited
    if worst is None or not (suspected or worst.error > accuracy):
        return
    try:
        chunks = verified.chunks
        if not chunks or chunks[0].knots[-1] > scout.settings.start:  # the run was resumed
            chunks = _repeated_chunks(verified, begin, progress)
        runs = [_rows_on_moved_steps(verified, begin, chunks, _KNOT_SHIFT, progress)]
        more = verified.fine.settings.refinement
        own = np.vstack([chunk.values for chunk in chunks])
        error.set_round_off([own, *runs], more)
        if error.amplified_round_off() > _MIN_AMPLIFIED * accuracy:
            of, halt = (verified, begin, chunks), Halt()
            with meanwhile(_rows_on_moved_steps, *of, -_KNOT_SHIFT, halt) as backwards, halt:
                runs.append(_rows_on_moved_steps(*of, 0.0, progress))
            error.set_round_off([*runs, backwards.result()], more)
    except FlexmbError:  # too many steps: the run itself has reported that
        return
    finally:
        error.drop_unamplified_round_off(steps)


def _repeated_chunks(verified: VerifiedRun, begin: State, progress: Progress) -> list[Chunk]:
    """The chunks of a scout repeated from its start, as far as it takes about as many steps."""
    scout, chunks = verified.scout, list[Chunk]()
    own = _restarted_scout(scout, scout.settings, begin)
    most = _MAX_REPEATED_STEPS * scout.state.count[0]["steps"]
    while not chunks or not own.finished:
        status = own.integrate(own.chunk if chunks else 0)
        knots = own.plan.knots[: own.plan.used[0]].copy()
        chunks.append(Chunk(knots, verified.error.comparison.values(own.rows.read())))
        if status != method.SUCCESS or own.state.count[0]["steps"] > most:
            break
        progress("integrate", 1.0, f"measures round-off, t = {own.state.t[0]:.4g} s")
    return chunks


def _restarted_scout(
    scout: Integration, settings: method.Settings, begin: State, plan: Plan | None = None
) -> Integration:
    """The scout of a run at its start, with a copy of the state."""
    state = State(*(array.copy() for array in begin))
    return Integration(scout.compiled, scout.method, settings, state, scout.times, plan)


def _rows_on_moved_steps(
    verified: VerifiedRun, begin: State, chunks: list[Chunk], shift: float, progress: Progress
) -> np.ndarray:
    """Compared values (k, components) in the rows of a run on the shifted steps of the scout.

    `shift` is relative to a step. Rows end where a step fails.
    """
    scout, rows = verified.scout, list[np.ndarray]()
    settings = scout.settings._replace(refinement=1.0, rejection_factor=ANY_ERROR)
    run = _restarted_scout(scout, settings, begin, new_plan(scout.chunk))
    for chunk in chunks:
        _set_moved_plan(run, chunk.knots, shift)
        status = method.SUCCESS
        while not rows or (status == method.SUCCESS and run.state.t[0] < chunk.knots[-1]):
            status = run.integrate(run.chunk if rows else 0)
            rows.append(verified.error.comparison.values(run.rows.read()))
        if status != method.SUCCESS:
            break
        progress("integrate", 1.0, f"measures round-off, t = {run.state.t[0]:.4g} s")
    return np.vstack(rows)


def _set_moved_plan(run: Integration, knots: np.ndarray, shift: float) -> None:
    """Set the plan of a run to `knots` (times between steps), alternately shifted by ± a share.

    Times of discontinuities are not shifted, nor those between steps of very different sizes, as
    near events.
    """
    n, events, plan = len(knots), run.time_events.ravel(), run.plan
    plan.used[0], plan.knots[:n] = n, knots
    steps, inner = np.diff(knots), knots[1 : n - 1]
    ratios = steps[1:] / steps[:-1]
    regular = (ratios > 1.0 / _EVEN_RATIO) & (ratios < _EVEN_RATIO)
    edges = np.concatenate([[-np.inf], events, [np.inf]])
    after = np.searchsorted(edges, inner)
    regular &= np.minimum(inner - edges[after - 1], edges[after] - inner) > _KNOT_SHIFT * steps[:-1]
    signs = np.where(np.arange(len(inner)) % 2, shift, -shift)
    plan.knots[1 : max(n - 1, 1)] += np.where(regular, signs * steps[:-1], 0.0)
