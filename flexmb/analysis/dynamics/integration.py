"""One integration of a model: its tables, state and rows; sentences on why it cannot continue."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from flexmb.analysis.chunked_run import ChunkRows
from flexmb.analysis.dynamics.run_settings import set_least_motion
from flexmb.analysis.singular_poses import singular_pose_sentence
from flexmb.engine import method
from flexmb.engine.allocation import equal_times, new_plan, new_run, new_work, output_run
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled, kinks_of_functions
from flexmb.engine.compiled_calls import integrate
from flexmb.engine.compiled_units import packed_record
from flexmb.engine.method import time_round_off
from flexmb.engine.method_selection import STIFF_METHOD
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.status_messages import worst_place
from flexmb.errors import FlexmbError
from flexmb.results.output_block import OutputBlock

# Steps of a chunk times velocity coordinates: about 0.1 s of computing time.
_CHUNK_WORK = 200_000
# Alternation of multipliers: number of rows that are reported from an output on; an alternation
# belongs to an output if it is within this many steps of it; steps within this share of a step are
# the same. It is reported if its amplitude is at least _MIN_ALTERNATION of the range of the
# multiplier (or of _LEAST_SPAN times the largest range) and _GROWTH_TO_REPORT times the amplitude
# reported before. At most _MAX_REPEATED_SHARE of all steps, and a chunk, are repeated for it.
_ROWS_REPORTED, _STEPS_NEAR_OUTPUT, _SAME_TIME = 6, 4, 1e-6
_MIN_ALTERNATION, _GROWTH_TO_REPORT, _LEAST_SPAN, _MAX_REPEATED_SHARE = 0.02, 1.5, 1e-3, 0.1
_MIN_CHUNK = 4  # steps
# A run is refused if the rest of it would take too many steps at the present rate: more than the
# first number, or than the second over velocity coordinates times stages. _MAX_STABLE_STEPS holds
# if the stability of an explicit method limits the steps, since another method has no such limit.
# The check is made every _CHECK_EVERY steps.
_CHECK_EVERY = 5_000
# Checks in a row after which runs of implicit methods are refused: short steps at the front of a
# relaxation oscillation pass.
_MAX_ENDLESS_CHECKS = 8
_MAX_STEPS, _MAX_STABLE_STEPS = (1e9, 1e11), (1e7, 2e9)
_MAX_STATIC_STEPS = 1e5  # of explicit methods, for bodies with quasi-static and dynamic modes
# Share of steps at the stability limit above which stability limits the steps of a run.
_STIFF_SHARE = 0.35


class Integration:
    """One integration: tables, state, scratch and room for the rows of one chunk.

    Parameters
    ----------
    compiled, integrator, settings, state : Compiled, Method, Settings, State
        The model, the method with its settings, and the first state, which is advanced in place.
    times : (n,) array, optional
        Times of all outputs [s]; by default at intervals of `settings.interval`.
    plan : Plan, optional
        Steps of another run to follow; by default this run writes a plan of its own.
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
        if settings.step == 0.0 and not state.q_scale.any():
            set_least_motion(compiled, integrator, settings, state)
        self.times = equal_times(settings) if times is None else times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, integrator)
        stages = max(integrator.stages, 1)
        self.chunk = max(_MIN_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.rows = ChunkRows(compiled, self._max_rows())
        self.time_events = compiled.system.time_events
        # a new begin at a kink excites stiff vibrations, which methods of low order keep long
        rough = integrator.order < method.HIGH_ORDER and settings.stiff
        if settings.step == 0.0 and not settings.determinate and not rough:
            kinks = kinks_of_functions(
                compiled, settings.end, settings.accuracy, explicit=integrator.stages > 0
            )
            events = np.concatenate([self.time_events, kinks])
            self.time_events = events[np.argsort(events[:, 0])]
        run = new_run(
            compiled.system._replace(time_events=self.time_events), state, self.work, integrator,
            settings, self.plan, self.rows.output, self.times,
        )  # fmt: skip
        self._run = packed_record(run)
        self._output_run = packed_record(output_run(run), like=self._run)
        self._checkpoint: tuple[int, float, float] | None = None  # steps, time, steps at the limit
        self._endless = 0  # checks in a row at which the rest would take too many steps
        self._refusal = ""
        self.is_limited = False  # the rest would take too many steps, since stability limits them

    def count_outputs(self) -> None:
        """Set the number of outputs written to those up to the time of the state.

        The state may come from a run with other output times.
        """
        if not self.state.count[0]["outputs"]:
            return  # the run has not begun
        until = self.state.t[0] + method.time_round_off(self.settings)
        self.state.count["outputs"] = np.searchsorted(self.times, until, side="right")

    def tallies(self) -> dict[str, np.ndarray]:
        """Arrays with maxima and energy balance of all rows so far, saved for a resumed run."""
        return {"largest_drift": self.rows.largest_drift, "balance": self.rows.balance.tally}

    def _max_rows(self) -> int:
        """Number of output rows for which a chunk has room."""
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

    def events(self) -> np.ndarray:
        """States after events of the last chunk (n, width); columns as in `engine.state.Events`."""
        events = self.work.events
        return np.asarray(events.states[: events.taken[1]])

    @property
    def share_done(self) -> float:
        """Share of the time span that is integrated; 1 at the end."""
        start, end = self.settings.start, self.settings.end
        return 1.0 if self.finished else float((self.state.t[0] - start) / (end - start))

    @property
    def finished(self) -> bool:
        """Whether the run has reached its end."""
        settings = self.settings
        return bool(self.state.t[0] >= settings.end - time_round_off(settings))

    def integrate(self, steps: int) -> int:
        """Integrate a number of steps, or with 0 write the present output; returns the status.

        Raises
        ------
        FlexmbError
            Steps under error control have become so short that the run would not end.
        """
        if self._refusal:
            raise FlexmbError(self._refusal)
        self.rows.clear()
        status = integrate(self._run, steps, self._output_run)
        if self.settings.step == 0.0 and not self.finished:
            self._look_ahead()
        return status

    def _look_ahead(self) -> None:
        """Set the refusal of a run whose rest would take far too many steps."""
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
        most, work = _MAX_STABLE_STEPS if limited else _MAX_STEPS
        static = static_modes_sentence(self.compiled, self.method, beside_dynamic=True)
        most = _MAX_STATIC_STEPS if static else most
        endless = left > min(most, work / (self.compiled.layout.nv * max(self.method.stages, 1)))
        self._endless = self._endless + 1 if endless else 0
        if endless and (self.method.stages > 0 or self._endless == _MAX_ENDLESS_CHECKS):
            cause = static
            if not (static or limited):
                cause = singular_pose_sentence(
                    self.compiled, self.state.q, self.state.q_first, self.method
                )
            self._refusal = _endless(t, passed / steps, left, limited, cause)
            self.is_limited = limited and not cause


class StepRows:
    """Rows of consecutive fixed steps at outputs near which multipliers alternate step by step.

    Outputs alone do not show an alternation, and the multipliers of the method are not the reported
    reactions. So the chunk up to these outputs is integrated again and each step is reported; at
    most one chunk and a tenth of all steps are repeated.

    Parameters
    ----------
    own : Integration
        The run.
    looks : bool
        Whether alternation is to be examined.
    """

    def __init__(self, own: Integration, looks: bool) -> None:
        settings = own.settings
        self._own = own
        self._looks = looks and settings.interval > (1.0 + method.STEP_ROUND_OFF) * settings.step
        self._largest = np.zeros(own.compiled.layout.nc)
        self._repeated = 0  # number of steps integrated again
        self._begin = own.state  # copy of the state before the chunk, once there is one

    def begin(self) -> None:
        """Store the state before a chunk."""
        if self._looks:
            self._begin = State(*(array.copy() for array in self._own.state))

    def rows(self) -> Iterator[OutputBlock]:
        """After a chunk: rows of single steps where multipliers alternate most over their range."""
        own, seen = self._own, self._own.work.alternation
        while self._looks and own.state.count[0]["steps"]:
            weights = own.compiled.system.row_weights
            spans = (seen.high - seen.low) / weights
            spans = np.maximum(spans, _LEAST_SPAN * spans.max(initial=0.0)) * weights
            new = (seen.size > _GROWTH_TO_REPORT * self._largest) & (
                seen.size > _MIN_ALTERNATION * spans
            )
            if not new.any():
                break
            k = int(np.where(new, seen.size / np.where(new, spans, 1.0), 0.0).argmax())
            near = np.abs(seen.time - seen.time[k]) < _STEPS_NEAR_OUTPUT * own.settings.step
            self._largest[near] = np.maximum(self._largest, seen.size)[near]
            outputs = self._outputs_about(float(seen.time[k]))
            steps = np.arange(outputs[0], outputs[-1] + _ROWS_REPORTED)
            self._repeated += steps[-1] - round(self._begin.t[0] / own.settings.step)
            if self._repeated > own.chunk + _MAX_REPEATED_SHARE * own.state.count[0]["steps"]:
                break
            times = own.settings.start + own.settings.step * steps
            state = State(*(array.copy() for array in self._begin))
            settings = own.settings._replace(end=times[-1])
            run = Integration(own.compiled, own.method, settings, state, times)
            run.count_outputs()
            run.integrate(own.chunk)
            block = run.rows.read()
            for at in outputs - outputs[0]:
                yield block.part(at, at + _ROWS_REPORTED)
        seen.size[:] = 0.0

    def _outputs_about(self, time: float) -> np.ndarray:
        """Numbers (n,) of the steps that end at outputs near a time of alternation."""
        settings, times = self._own.settings, self._own.times
        first, last = np.searchsorted(
            times, time + settings.step * np.array([0.5 - _STEPS_NEAR_OUTPUT, 0.5])
        )
        outputs = times[min(first, len(times) - 1) : max(last, first + 1)] - settings.start
        return np.ceil(outputs / settings.step - _SAME_TIME).astype(int)


def _endless(t: float, step: float, left: float, limited: bool, cause: str) -> str:
    where = (
        f"at t = {t:.6g} s steps of {step:.2g} s leave {left:.2g} of them for the rest of the run"
    )
    if cause:
        return f"{where}: {cause}"
    if limited:
        return (
            f"{where}: stability of an explicit method limits them, not accuracy; "
            'method = "radau" has no such limit'
        )
    return (
        f"{where}: look for a singular pose, or forces that jump again and again; ask for less "
        "accuracy, or try another method or a fixed step"
    )


def static_modes_sentence(
    compiled: Compiled, integrator: method.Method, beside_dynamic: bool = False
) -> str:
    """The sentence on bodies whose quasi-static modes a method cannot solve for, or "".

    For explicit methods, `beside_dynamic` restricts it to joined bodies that also have dynamic
    modes.
    """
    static = compiled.system.kinds.get(STATIC_MODES.name)
    if static is None:
        return ""
    if integrator.stages == 0:
        return _unsettled(compiled, static.rows[static.kinetostatic == 1])
    rows = static.rows
    if beside_dynamic:
        markers, system = compiled.system.parts.markers, compiled.system
        ends = np.concatenate([system.rows["I"], system.rows["J"]])
        joined = np.isin(rows, markers["body"][ends[ends >= 0]])
        rows = rows[(static.kinetostatic == 0) & joined]
    if not len(rows):
        return ""
    names = ", bodies.".join(compiled.layout.bodies[row].name for row in rows)
    return (
        f"modes of bodies.{names} are quasi-static, which explicit methods cannot do where joints "
        f'need their compliance: use method = "{STIFF_METHOD}"'
    )


def stiff_force_sentence(run: Integration) -> str:
    """The sentence on a body with quasi-static modes if Newton's method fails there, or "".

    Such modes have no inertia, so a shorter step does not make a stiff force that begins to act on
    them smoother.
    """
    static = run.compiled.system.kinds.get(STATIC_MODES.name)
    names = [run.compiled.layout.bodies[row].name for row in static.rows] if static else []
    body = worst_place(run.compiled, run.work).removeprefix("body ")
    if run.method.collocation > 0 or body not in names:
        return ""
    return (
        f"bodies.{body}: a force that sets in with the deformation, such as a stiff stop's, is too "
        f'stiff for its quasi-static modes; use method = "{STIFF_METHOD}", or deformation '
        '= "dynamic"'
    )


def _unsettled(compiled: Compiled, rows: np.ndarray) -> str:
    """The sentence on kinetostatic bodies: the iteration of their loads does not converge."""
    if not len(rows):
        return ""
    names = ", bodies.".join(compiled.layout.bodies[row].name for row in rows)
    return (
        f"bodies.{names}: loads that depend on the deformation, such as those of a stiff stop, of "
        "friction, of compression that buckles, or of rotation near a critical speed, do not "
        "settle with quasi-static modes; "
        'deformation = "automatic" has them'
    )
