"""A run and its passes: the same run again, more accurately or by another method.

A run under error control is integrated again from its start with a stricter local tolerance until
the error measured with its scout is small enough; and by the method for stiff motions if stability
limits the steps of an explicit one.

A rough run before the first pass gives the error scales: how far and how fast each part of the
model will move. Local errors are relative to displacement and velocity so far. A machine that
starts from rest has not moved yet, so its stiff components would be resolved as if their first
small vibration were the whole motion. Nothing else is taken from the rough run: wrong scales cost
steps or another pass, but no accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.analysis.chunked_run import PhaseTimer
from flexmb.analysis.dynamics.damped_vibrations import (
    follow_events,
    follow_vibrations,
    measure_damped_vibrations,
)
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.jump_states import JumpStates
from flexmb.analysis.dynamics.lasting_motion import measure_lasting_motion
from flexmb.analysis.dynamics.run_settings import (
    compared_times,
    local_tolerance,
    output_times,
    seen_times,
    set_first_round_off,
    with_tolerance,
)
from flexmb.analysis.dynamics.step_halving import StepHalving
from flexmb.analysis.dynamics.verified_run import VerifiedRun, measure_round_off_growth
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.method import Settings
from flexmb.engine.method_selection import AUTO, STIFF_METHOD, make_integrator
from flexmb.engine.state import State
from flexmb.errors import FlexmbError
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import METHODS, DynamicsSpec
from flexmb.progress import Progress
from flexmb.results import BodyDamping
from flexmb.results.output_block import OutputBlock

MAX_PASSES = 4
"""Largest number of passes of a run."""
PASSES = np.dtype([
    ("tolerance", "f8"),  # local tolerance
    ("count", "i8"),  # passes so far
    ("method", "i8"),  # index of the method in METHODS
    ("last_steps", "f8"),  # steps of the scout of the pass before; 0: there was none
    ("last_difference", "f8"),  # difference of the two runs of the pass before
])  # fmt: skip
"""Record of the passes of a run, saved with its state."""

# Prefixes of the arrays of the first state in a saved state, without and with error scales.
_FIRST, _BEGIN = "first_", "begin_"
STAGNATION_RATIO = 0.5
"""Ratio of the difference of the two runs to that of the pass before, above which shorter steps do
not help."""
DIFFERENT_MOTION = 0.01
"""Difference of two runs from which on they are different motions, over the peak-to-peak."""
# Measured over requested error, the first being accurate within a factor of about three: the
# largest one without another pass (times three less than twice the request), and the one that the
# next pass aims at (times three good enough).
_GOOD_ENOUGH, _AIMED_ERROR = 0.6, 0.15
# Largest growth of the number of steps from pass to pass; passes after which one without progress
# means that shorter steps do not help; growth of the difference from which on round-off dominates
# (of 304 runs at 1e-9 to 1e-12, two reached 10 and 13).
_MAX_MORE_STEPS, _MIN_PASSES, _WORSE_FACTOR = 5.0, 2, 10.0
_MIN_TOLERANCE = 3e-14  # just above round-off
# Unstable fixed steps from which on a failure is due to instability; rate times step, above which
# the rate is one of growing errors, not of the motion.
_MAX_UNSTABLE_STEPS, _MAX_RATE = 50, 1e6
# A run is stiff if more than _STIFF_SHARE of at least _MIN_STEPS steps are unstable; a run that
# fails is unstable if more than _UNSTABLE_SHARE are.
_MIN_STEPS, _STIFF_SHARE, _UNSTABLE_SHARE = 200, 0.35, 0.01
# Rough run: local tolerance; least displacement, over the size of the model.
_ROUGH, _MIN_MOTION = 1e-3, 1e-3
# The typical velocity of a driven motion, which limits steps before it is reached, is at most this
# many times the mean one: for a uniform motion or a power of time. Jumps are known when they occur.
_SPEED_FACTOR = 10.0

_MIN_VIBRATION = 1e-3  # least vibration of a reaction that is measured, over its range

_DRIFT_SENTENCE = (
    "stabilization makes forces of the drift of joints that are beyond measure: the pose is "
    "singular, or the gains are large for the steps; method = "
    '"explicit-rk" has neither drift nor gains'
)


@dataclass(frozen=True)
class PreparedDynamics:
    """A run that is ready: only its integration can still fail."""

    run: Integration
    model: Model
    timer: PhaseTimer
    notes: tuple[str, ...]
    settings: Settings  # settings without a scout
    first: State  # first state
    begin: State  # copy of it, with the error scales of a rough run
    passes: np.ndarray  # (1,) record `PASSES`
    rows_before: int = 0  # rows that are in the file already
    not_unique: tuple[str, ...] = ()  # joints and drivers whose reactions are not unique
    verified: VerifiedRun | None = None  # `run` together with its scout
    halving: StepHalving | None = None  # `run` with fixed steps together with half steps
    dampings: tuple[BodyDamping, ...] = ()

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return tuple(METHODS)[int(self.passes[0]["method"])]

    @property
    def spec(self) -> DynamicsSpec:
        """The section [dynamics] of the scene."""
        assert self.model.dynamics is not None
        return self.model.dynamics

    @property
    def comparison(self) -> VerifiedRun | StepHalving | None:
        """The run together with another one that measures its error, if there is one."""
        return self.verified or self.halving

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays that a resumed run needs."""
        return {
            **self.run.state._asdict(),
            **{_FIRST + name: value for name, value in self.first._asdict().items()},
            **{_BEGIN + name: value for name, value in self.begin._asdict().items()},
            "passes": self.passes,
            **self.run.tallies(),
            **({} if self.comparison is None else self.comparison.arrays()),
        }

    def advance(self, first: bool = False) -> tuple[int, list[OutputBlock]]:
        """Integrate one chunk, or write the first row; returns the status and the rows."""
        if self.comparison is not None:
            return self.comparison.advance(first)
        status = self.run.integrate(0 if first else self.run.chunk)
        return status, [self.run.rows.read()]

    def with_tolerance(self, tolerance: float) -> PreparedDynamics:
        """The same run from its start with another local tolerance."""
        assert self.verified is not None
        settings = self.settings._replace(max_rotation=1.0)
        settings = with_tolerance(settings, self.spec, self.run.method, tolerance)
        again, before = self._restarted(self.method, settings), self.passes[0]
        last = float(self.verified.scout_state.count[0]["steps"]), self.verified.difference
        if self.verified.errors()["positions"].begin >= 0.0:
            last = 0.0, 0.0  # both runs damped a vibration that the next ones may resolve
        again.passes[0] = (tolerance, before["count"] + 1, before["method"], *last)
        assert again.verified is not None
        if last[0]:
            again.verified.error.compare(self.verified.error)
        if not self.verified.multiplies_errors:  # the first errors count most then
            _set_error_scales(again, self.run.state)
        return again

    def as_last_pass(self) -> PreparedDynamics:
        """The same run from its start as the last pass."""
        again = self._restarted(self.method, self.settings)
        again.passes["count"] = MAX_PASSES
        _set_error_scales(again, self.begin)
        return again

    def by_method(self, name: str) -> PreparedDynamics:
        """The same run from its start by another integrator."""
        tolerance = local_tolerance(self.spec, make_integrator(self.spec, name))
        return self._restarted(name, self.settings._replace(tolerance=tolerance, max_rotation=1.0))

    def _restarted(self, name: str, settings: Settings) -> PreparedDynamics:
        return prepared_run(
            self.run.compiled, self.model, name, self.first, settings, timer=self.timer,
            notes=self.notes, not_unique=self.not_unique,
        )  # fmt: skip


def prepared_run(
    compiled: Compiled, model: Model, name: str, state: State, settings: Settings, **fields: Any
) -> PreparedDynamics:
    """A run from a state with a method; with a scout if its error is controlled."""
    spec = model.dynamics
    assert spec is not None
    integrator, times = make_integrator(spec, name), output_times(spec)
    verified = halving = None
    passes = np.array([(settings.tolerance, 1, tuple(METHODS).index(name), 0.0, 0.0)], PASSES)
    state.q_first[:], state.v_first[:] = state.q, state.v
    set_first_round_off(compiled, state)
    begin = State(*(array.copy() for array in state))
    if spec.verify is not False and settings.step == 0.0:
        compared, jumps, seen = compared_times(spec), None, seen_times(spec)
        if settings.stiff == 1:  # for explicit methods too: an implicit one may replace them
            jumps = JumpStates(compiled, settings, seen)
            compared, seen = np.union1d(compared, jumps.before), jumps.outputs
        verified = VerifiedRun.of(
            compiled, model, integrator, settings, begin, compared, np.isin(compared, times),
            np.isin(compared, seen), passes, spec.method == AUTO and name == STIFF_METHOD, jumps,
        )  # fmt: skip
        run = verified.fine
    elif spec.verify:
        halving = StepHalving.of(
            compiled, model, integrator, settings, begin, times, compared_times(spec)
        )
        run = halving.run
    else:
        own = State(*(array.copy() for array in begin))
        run = Integration(compiled, integrator, settings, own, times)
    return PreparedDynamics(
        run, model, first=state, begin=begin, settings=settings, verified=verified, halving=halving,
        passes=passes, **fields,
    )  # fmt: skip


def needs_rough_run(prepared: PreparedDynamics) -> bool:
    """Whether a rough run is made first: for implicit methods under error control.

    Not for methods of order 2 if the model has scalar states: the rough run does not show in
    advance how fast these change.
    """
    controlled, first = prepared.settings.step == 0.0, prepared.passes[0]["count"] == 1
    mechanical = not prepared.run.compiled.layout.coordinates
    implicit = prepared.run.method.stages == 0 and (mechanical or prepared.method == STIFF_METHOD)
    return implicit and controlled and bool(first)


def rough_run(prepared: PreparedDynamics, progress: Progress) -> None:
    """Set the error scales of a run from a rough run."""
    own, settings = prepared.run, prepared.settings
    rough = settings._replace(
        interval=settings.end - settings.start, tolerance=_ROUGH, accuracy=_ROUGH,
        least_motion=_MIN_MOTION,
    )  # fmt: skip
    state = State(*(array.copy() for array in prepared.first))
    state.q_first[:], state.v_first[:] = state.q, state.v
    run, status = Integration(own.compiled, own.method, rough, state), method.SUCCESS
    least = state.q_scale.copy()  # scales at rest: below, the rough run shows nothing
    try:
        while status == method.SUCCESS and not run.finished:
            status = run.integrate(run.chunk)
            progress("integrate", 0.0, f"looks ahead, t = {state.t[0]:.4g} s")
    except FlexmbError:  # too many steps: the run itself reports that, if it occurs there too
        return
    if status == method.SUCCESS:
        _set_error_scales(prepared, state, state.q_scale > least)


def _set_error_scales(
    prepared: PreparedDynamics, like: State, moves: np.ndarray | bool = True
) -> None:
    """Raise the error scales of coordinates that move to those of another run."""
    memory, done = like.memory, like.t[0] - prepared.settings.start
    mean = memory["travel"][0] / done if done else 0.0
    usual = max(memory["usual_speed"][0], min(_SPEED_FACTOR * mean, memory["max_velocity"][0]))
    runs = [prepared.run] if prepared.verified is None else [prepared.run, prepared.verified.scout]
    for state in (prepared.begin, *(run.state for run in runs)):
        np.maximum(state.q_scale, like.q_scale, out=state.q_scale, where=moves)
        np.maximum(state.v_scale, like.v_scale, out=state.v_scale, where=moves)
        state.memory["usual_speed"] = max(state.memory["usual_speed"][0], usual)


def complete_measured_error(prepared: PreparedDynamics, progress: Progress) -> None:
    """Complete the measured error at the end of a pass.

    Vibrations that the steps damp are added; after the last pass more of them, and round-off that
    the motion amplifies.
    """
    verified = prepared.verified
    if verified is None:
        return
    jumps = None if verified.fine.method.stages else verified.jumps
    if jumps is not None:
        worst = verified.errors().get("reactions")
        least = max(_MIN_VIBRATION, worst.error if worst else 0.0)
        vibrations = verified.error.vibrations
        own = verified.fine, prepared.settings, prepared.first, jumps, vibrations, least
        measure_damped_vibrations(*own)
        if stricter_tolerance(prepared) is None:
            positions = verified.errors().get("positions")
            measure_lasting_motion(*own[:-1], positions.error if positions else 0.0)
        if worst is not None and stricter_tolerance(prepared) is None:
            follow_vibrations(*own)
            follow_events(*own)
    if stricter_tolerance(prepared) is None:
        measure_round_off_growth(verified, prepared.settings.accuracy, prepared.begin, progress)


def stricter_tolerance(prepared: PreparedDynamics) -> float | None:
    """The local tolerance of the next pass, or None if the measured error is small enough."""
    verified, settings = prepared.verified, prepared.settings
    if verified is None or prepared.passes[0]["count"] >= MAX_PASSES:
        return None
    worst = verified.errors().get("positions")
    if worst is None or worst.error <= _GOOD_ENOUGH * settings.accuracy or is_stagnant(prepared):
        return None
    integrator, share = verified.fine.method, _AIMED_ERROR * settings.accuracy / worst.error
    factor = share ** (integrator.error_order / verified.order)
    stricter = settings.tolerance * max(factor, _MAX_MORE_STEPS**-integrator.error_order)
    return max(float(stricter), _MIN_TOLERANCE)


def is_worse(prepared: PreparedDynamics) -> bool:
    """Whether the two runs of a pass differ ten times as much as those of the pass before.

    Then round-off dominates the shorter steps but did not dominate the longer ones; if it dominates
    both, the differences are closer. Not if the runs of the pass before were different motions.
    """
    verified, last = prepared.verified, float(prepared.passes[0]["last_difference"])
    return verified is not None and 0.0 < _WORSE_FACTOR * last < min(
        verified.difference, DIFFERENT_MOTION
    )


def is_stagnant(prepared: PreparedDynamics) -> bool:
    """Whether shorter steps do not help.

    The tolerance is the smallest one, only round-off is too large, or the last pass improved
    little.
    """
    verified = prepared.verified
    assert verified is not None
    passes, worst = prepared.passes[0], verified.errors()["positions"]
    finest = prepared.settings.tolerance <= 2.0 * _MIN_TOLERANCE
    if finest or worst.error - worst.round_off <= _GOOD_ENOUGH * prepared.settings.accuracy:
        return True
    little = verified.difference > STAGNATION_RATIO * passes["last_difference"] > 0.0
    return bool(passes["count"] > _MIN_PASSES and little)


def may_change_method(prepared: PreparedDynamics) -> bool:
    """Whether the run may change to the method for stiff motions."""
    automatic = prepared.spec.method == AUTO and prepared.settings.step == 0.0
    return automatic and prepared.method != STIFF_METHOD


def limited_by_stability(prepared: PreparedDynamics) -> bool:
    """Whether stability, not accuracy, limits the steps of an explicit method."""
    run, state = prepared.run, prepared.run.state
    if prepared.verified is not None:
        run, state = prepared.verified.scout, prepared.verified.scout_state
    count, stiff = state.count[0], state.memory[0]["steps_at_stability_limit"]
    tried = count["steps"] + count["rejected"]
    limited = run.is_limited or (tried > _MIN_STEPS and bool(stiff > _STIFF_SHARE * tried))
    return may_change_method(prepared) and limited


def unstable_step(run: Integration, name: str, failed: bool) -> str:
    """The sentence on fixed steps with which an explicit method is unstable, or ""."""
    memory, steps, h = run.state.memory[0], run.state.count[0]["steps"], run.settings.step
    few = min(_UNSTABLE_SHARE * steps, _MAX_UNSTABLE_STEPS) if failed else _STIFF_SHARE * steps
    if h == 0.0 or memory["steps_at_stability_limit"] <= few:
        return _DRIFT_SENTENCE if failed and run.method.stabilised else ""
    where = "beyond" if failed else "at"
    limit = f"the limit of stability of {name}"
    if 0.0 < h * memory["fastest_rate"] < _MAX_RATE:
        longest = run.method.coefficients[0].stable / float(memory["fastest_rate"])
        limit += f", about {longest:.1g} s at the fastest rate of this motion"
    rest = "" if failed else ", and the fastest vibrations may be wrong"
    return (
        f"the step of {h:.3g} s is {where} {limit}{rest}: shorten it, or use method = "
        f'"{STIFF_METHOD}"'
    )


def keeps_failing(run: Integration) -> bool:
    """Whether fixed steps of an explicit method fail again and again by instability."""
    unstable = run.state.memory[0]["steps_at_stability_limit"]
    return bool(
        run.settings.step > 0.0
        and min(run.state.count[0]["failed"], unstable) > _MAX_UNSTABLE_STEPS
    )
