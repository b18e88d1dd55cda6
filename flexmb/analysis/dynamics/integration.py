"""One integration: its tables, state and rows, and why it cannot go on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from flexmb.analysis.dynamics.run_settings import set_least_motion
from flexmb.analysis.procedure import ChunkRows
from flexmb.analysis.singular_poses import singular_pose_sentence
from flexmb.engine import entries, method
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled
from flexmb.engine.forces.contact_pair import (
    BLOW_SPEED,
    BLOW_WORK,
    FASTEST,
    HARDEST_SPEED,
    HARDEST_WORK,
    REBOUND,
    takes_a_blow,
)
from flexmb.engine.method import time_round_off
from flexmb.engine.state import Plan, State, Work
from flexmb.engine.units import packed_record
from flexmb.engine.work import equal_times, new_plan, new_run, new_work, output_run
from flexmb.errors import FlexmbError
from flexmb.results.output_block import OutputBlock
from flexmb.units import UnitSystem

# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
# Rows reported from such an output on; steps around it in which alternation counts. An alternation
# is reported if its amplitude is this share of the multiplier's range (at least _LEAST_SPAN of the
# largest one) and so many times the amplitude reported before; share of all steps that may be
# repeated.
_ROWS, _NEAR, _SAME_TIME = 6, 4, 1e-6
_ALTERNATES, _LARGER, _LEAST_SPAN, _REPEATED = 0.02, 1.5, 1e-3, 0.1
# Impacts are slow if the fastest has so many times the least speed; a rebound by this share of the
# size of the model, or less, does not matter.
_FASTER, _REBOUND = 10.0, 1e-4
_BLOW = 0.01  # of the energy that moved, above which what a blow loses in a contact matters
_MIN_CHUNK = 4  # steps, after which the state is saved
# Steps between two looks at how long the rest of a run will take, and steps for it that are too
# many, also times velocity coordinates and stages; fewer where stability limits them, which another
# method is free of.
_CHECK_EVERY = 5_000
# Looks in a row by implicit methods: the front of a relaxation oscillation passes.
_LOOKS = 8
_MAX_STEPS, _MAX_STABLE_STEPS = (1e9, 1e11), (1e7, 2e9)
_MAX_STATIC_STEPS = 1e5  # of an explicit method with quasi-static modes beside dynamic ones
# Share of steps at the limit of stability that makes a run one that stability limits.
_STIFF_SHARE = 0.35


class Integration:
    """One integration: tables, state, scratch and room for the rows of one chunk.

    Parameters
    ----------
    compiled, integrator, settings, state : Compiled, Method, Settings, State
        What is integrated, how, and where it begins.
    times : (n,) array, optional
        Times of all outputs [s]; `settings.interval` apart by default.
    plan : Plan, optional
        Of the run to be followed; else this one writes its own.
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
        if settings.step == 0.0 and not state.motion.any():
            set_least_motion(compiled, integrator, settings, state)
        self.times = equal_times(settings) if times is None else times
        channels = len(compiled.layout.channels)
        self.work: Work = new_work(compiled.system, channels, integrator)
        stages = max(integrator.stages, 1)
        self.chunk = max(_MIN_CHUNK, _CHUNK_WORK // (compiled.layout.nv * stages))  # steps
        self.plan = new_plan(self.chunk) if plan is None else plan
        self.rows = ChunkRows(compiled, self._max_rows())
        run = new_run(
            compiled.system, state, self.work, integrator, settings, self.plan, self.rows.output,
            self.times,
        )  # fmt: skip
        self._run, self._output_run = packed_record(run), packed_record(output_run(run))
        self._checkpoint: tuple[int, float, float] | None = None  # steps, time, steps at the limit
        self._endless = 0  # looks in a row at which the rest would take too many steps

    def count_outputs(self) -> None:
        """Count the outputs until the time of the state, which may be of a run with other ones."""
        if not self.state.count[0]["outputs"]:
            return  # it has not begun
        until = self.state.t[0] + method.time_round_off(self.settings)
        self.state.count["outputs"] = np.searchsorted(self.times, until, side="right")

    def tallies(self) -> dict[str, np.ndarray]:
        """What all rows so far tell, to be saved and filled in again."""
        return {"largest_drift": self.rows.largest_drift, "balance": self.rows.balance.tally}

    def _max_rows(self) -> int:
        """Outputs of one chunk at most; room for a few of them at least."""
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
        """States behind events of the last chunk (n, width), as `engine.state.Events` has them."""
        events = self.work.events
        return np.asarray(events.states[: events.taken[1]])

    @property
    def share_done(self) -> float:
        """How much of the time span is done."""
        start, end = self.settings.start, self.settings.end
        return 1.0 if self.finished else float((self.state.t[0] - start) / (end - start))

    @property
    def finished(self) -> bool:
        """Whether the run has reached its end."""
        settings = self.settings
        return bool(self.state.t[0] >= settings.end - time_round_off(settings))

    def integrate(self, steps: int) -> int:
        """Run some steps, or with 0 report the present state; returns the status.

        Raises
        ------
        FlexmbError
            Steps under error control have become so short that the run would not end.
        """
        if self.settings.step == 0.0:
            self._refuse_endless()
        self.rows.clear()
        return entries.integrate(self._run, steps, self._output_run)

    def _refuse_endless(self) -> None:
        """Stop a run whose rest would take far too many steps."""
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
        if endless and (self.method.stages > 0 or self._endless == _LOOKS):
            cause = static
            if not (static or limited):
                cause = singular_pose_sentence(self.compiled, self.state.q, self.state.q_first)
            raise FlexmbError(_endless(t, passed / steps, left, limited, cause))


class StepRows:
    """Rows of consecutive fixed steps at outputs near which multipliers alternate step by step.

    Outputs alone do not show it, and multipliers of the method are not the reported reactions. So
    the chunk up to these outputs is integrated again and each step reported; at most one chunk and
    a tenth of all steps are repeated.

    Parameters
    ----------
    own : Integration
        The run.
    looks : bool
        Whether it is looked at.
    """

    def __init__(self, own: Integration, looks: bool) -> None:
        settings = own.settings
        self._own = own
        self._looks = looks and settings.interval > (1.0 + method.STEP_ROUND_OFF) * settings.step
        self._largest = np.zeros(own.compiled.layout.nc)
        self._repeated = 0  # steps
        self._begin = own.state  # a copy, once there is a chunk

    def begin(self) -> None:
        """Before a chunk."""
        if self._looks:
            self._begin = State(*(array.copy() for array in self._own.state))

    def rows(self) -> Iterator[OutputBlock]:
        """After a chunk: of the multipliers that alternate most, over their range."""
        own, seen = self._own, self._own.work.alternation
        while self._looks and own.state.count[0]["steps"]:
            weights = own.compiled.system.row_weights
            spans = (seen.high - seen.low) / weights
            spans = np.maximum(spans, _LEAST_SPAN * spans.max(initial=0.0)) * weights
            new = (seen.size > _LARGER * self._largest) & (seen.size > _ALTERNATES * spans)
            if not new.any():
                break
            k = int(np.where(new, seen.size / np.where(new, spans, 1.0), 0.0).argmax())
            near = np.abs(seen.time - seen.time[k]) < _NEAR * own.settings.step
            self._largest[near] = np.maximum(self._largest, seen.size)[near]
            outputs = self._outputs_about(float(seen.time[k]))
            steps = np.arange(outputs[0], outputs[-1] + _ROWS)
            self._repeated += steps[-1] - round(self._begin.t[0] / own.settings.step)
            if self._repeated > own.chunk + _REPEATED * own.state.count[0]["steps"]:
                break
            times = own.settings.start + own.settings.step * steps
            state = State(*(array.copy() for array in self._begin))
            settings = own.settings._replace(end=times[-1])
            run = Integration(own.compiled, own.method, settings, state, times)
            run.count_outputs()
            run.integrate(own.chunk)
            block = run.rows.read()
            for at in outputs - outputs[0]:
                yield block.part(at, at + _ROWS)
        seen.size[:] = 0.0

    def _outputs_about(self, time: float) -> np.ndarray:
        """Numbers (n,) of the steps that end at outputs of which a time may tell something."""
        settings, times = self._own.settings, self._own.times
        first, last = np.searchsorted(times, time + settings.step * np.array([0.5 - _NEAR, 0.5]))
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
    """The sentence for bodies with quasi-static modes that a method cannot solve for, or "".

    Of an explicit method, with `beside_dynamic` for those alone that have dynamic modes too, and
    are joined.
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
        f'need their compliance: use method = "{entries.STIFF_METHOD}"'
    )


def stiff_force_sentence(run: Integration) -> str:
    """The sentence for a body whose quasi-static modes Newton's method leaves behind, or "".

    They have no inertia, so that no step is small against a force that sets in with them.
    """
    static = run.compiled.system.kinds.get(STATIC_MODES.name)
    names = [run.compiled.layout.bodies[row].name for row in static.rows] if static else []
    body = entries.worst_place(run.compiled, run.work).removeprefix("body ")
    if run.method.collocation > 0 or body not in names:
        return ""
    return (
        f"bodies.{body}: a force that sets in with the deformation, such as a stiff stop's, is too "
        f'stiff for its quasi-static modes; use method = "{entries.STIFF_METHOD}", or deformation '
        '= "dynamic"'
    )


def slow_impacts(run: Integration, units: UnitSystem) -> Iterator[str]:
    """A sentence for each contact that is damped for speeds which its impacts do not have.

    Where its fastest impacts are about as slow as its least speed and it rebounds from one below:
    what comes to rest after faster ones, what is pressed together for long, what drivers move, and
    what rebounds by next to nothing of the model does not count. Where sides that lie against each
    other, damped as at the least speed, take a blow. Points of one surface have no restitution of
    their own.
    """
    for name, element in run.compiled.elements.items():
        if element.kind != "contacts" or element.n > 1 or run.settings.determinate == 1:
            continue
        row, state = run.compiled.system.kinds["contacts"].rows[element.row], run.state.history
        slow, history = float(row["slow"]), state[row["impacts"] :]
        fastest = float(history[FASTEST])
        least = _REBOUND * run.compiled.length
        say = partial(units.say, unit="m/s", digits=2)
        blow = (
            (BLOW_WORK, BLOW_SPEED) if takes_a_blow(row, state) else (HARDEST_WORK, HARDEST_SPEED)
        )
        if history[blow[0]] > _BLOW * run.rows.balance.moved:
            hit = float(history[blow[1]])
            yield (
                f"{name}: its sides lay against each other when a blow drove them together with "
                f"{say(hit)}; it is damped as an impact of {say(slow)}, its least_speed, and "
                "rebounds by far less than its restitution: a small gap gives the blow its own "
                f"speed, or give least_speed = {units.outward(hit, 'm/s'):.1g}"
            )
        elif row["damping"] > 0.0 and fastest < _FASTER * slow and history[REBOUND] > least:
            yield (
                f"{name}: impacts below its least_speed of {say(slow)} are damped as those of that "
                f"speed, so that they rebound by more than its restitution; the fastest one has "
                f"{say(fastest)}: give least_speed = {units.outward(fastest / 100, 'm/s'):.1g}"
            )


def _unsettled(compiled: Compiled, rows: np.ndarray) -> str:
    """The sentence for kinetostatic bodies whose loads follow their deformation too stiffly."""
    if not len(rows):
        return ""
    names = ", bodies.".join(compiled.layout.bodies[row].name for row in rows)
    return (
        f"bodies.{names}: loads that depend on the deformation, such as those of a stiff stop, of "
        "friction, of compression that buckles, or of rotation near a critical speed, do not "
        "settle with quasi-static modes; "
        'deformation = "automatic" has them'
    )
