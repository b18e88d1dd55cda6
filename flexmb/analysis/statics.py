"""Statics: the equilibria of a model at a series of times, as rows of a result.

The search for each equilibrium begins at the one before. Reactions belong to each row; stability is
reported for the first and the last one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.initial_state import StartValues, assemble
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, constraint_rank, one_blas_thread
from flexmb.analysis.assembly.positions import take_turns_of_drivers
from flexmb.analysis.chunked_run import (
    ChunkRows,
    Ending,
    Outcome,
    PhaseTimer,
    Sink,
    assemble_first_state,
    run_chunks,
)
from flexmb.analysis.equilibrium_search import Equilibrium, separation
from flexmb.analysis.equilibrium_solver import solve_equilibrium, spin_of
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.analysis.mobility.driver_conflicts import driver_reasons
from flexmb.analysis.monitors import ContactLossMonitor, algebraic_loop_notes
from flexmb.analysis.validity.validity_monitor import ValidityMonitor
from flexmb.engine import method
from flexmb.engine.allocation import new_run, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import statics_units
from flexmb.engine.compiled_units import call
from flexmb.engine.state import State
from flexmb.engine.state_rows import write_equilibrium
from flexmb.errors import AssemblyError, FlexmbError
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import StaticsSpec
from flexmb.progress import Progress, silent
from flexmb.results.result import NOT_UNIQUE

# Two equilibria are on different branches if their distance exceeds that of the two before by the
# first factor, and is larger than the second number, over the model size or in radians.
_DISTANCE_RATIO, _MIN_WAY = 10.0, 0.02


@dataclass(frozen=True)
class PreparedStatics:
    """A model that is ready for the search for its equilibria."""

    compiled: Compiled
    model: Model
    times: tuple[float, ...]
    state: State
    timer: PhaseTimer
    notes: tuple[str, ...]
    not_unique: tuple[str, ...]


@one_blas_thread()
def prepare_statics(
    compiled: Compiled, model: Model, *, progress: Progress = silent
) -> PreparedStatics:
    """Load the compiled units and assemble the first pose.

    Raises
    ------
    AssemblyError
        Positions cannot be closed, or drivers contradict each other or the joints.
    """
    spec = model.statics if model.statics is not None else StaticsSpec()
    first = StartValues(compiled.initial_q, np.zeros(compiled.layout.nv), spec.times[0])

    def first_state() -> tuple[State, tuple[str, ...], list[str]]:
        with driver_reasons(compiled, model):
            assembled = assemble(compiled, model, begin=first if spec.times[0] else None)
        rank = constraint_rank(compiled, assembled.work)
        redundancy: tuple[tuple[str, ...], list[str]] = (), []
        if rank is not None and rank < compiled.layout.nc:
            redundancy = redundant_reactions(compiled, model, assembled.state.q)
        not_unique, notes = redundancy
        return assembled.state, not_unique, [*assembled.notes, *notes]

    units = statics_units(compiled.system)
    (state, not_unique, more), timer = assemble_first_state(compiled, units, first_state, progress)
    notes = (*more, *algebraic_loop_notes(model))
    return PreparedStatics(compiled, model, spec.times, state, timer, notes, not_unique)


@one_blas_thread()
def run_statics(prepared: PreparedStatics, sink: Sink, *, progress: Progress = silent) -> Outcome:
    """Find the equilibria at all times, each from the one before.

    Parameters
    ----------
    prepared : PreparedStatics
        From `prepare_statics`; it can be used once.
    sink : Sink
        Receives the output rows.
    progress : Progress
        Receives the phase `statics`.
    """
    run = _Run(prepared, sink)
    ending = run_chunks(run, progress)
    prepared.timer.lap("statics")
    statistics: dict[str, float | int | str] = {
        "points": run.done,
        "newton_iterations": run.steps,
        "largest_position_drift": float(run.rows.largest_drift[0]),
    }
    statistics |= prepared.timer.seconds
    if prepared.not_unique:
        statistics[NOT_UNIQUE] = ", ".join(prepared.not_unique)
    watched = [note for monitor in run.monitors for note in monitor.notes()]
    notes = (*prepared.notes, *run.stability, *watched)
    return Outcome(ending.status, ending.message, statistics, notes)


class _Run:
    """A run of `run_statics`: one equilibrium per chunk."""

    phase = "statics"

    def __init__(self, prepared: PreparedStatics, sink: Sink) -> None:
        self._prepared, self._sink = prepared, sink
        self.rows = ChunkRows(prepared.compiled, 1)
        self.done, self.steps = 0, 0
        self.stability: list[str] = []
        self._q, self._way = prepared.state.q.copy(), 0.0
        self.monitors = (
            ContactLossMonitor(prepared.compiled),
            ValidityMonitor(prepared.compiled, prepared.model, prepared.state.q, is_motion=False),
        )
        work = new_work(prepared.compiled.system, len(prepared.state.angles))
        system = prepared.compiled.system
        self._writer = new_run(system, prepared.state, work, output=self.rows.output)

    @property
    def time(self) -> float:
        return float(self._prepared.state.t[0])

    @property
    def share_done(self) -> float:
        return self.done / len(self._prepared.times)

    def next_chunk(self) -> Ending | None:
        prepared = self._prepared
        compiled, model, state = prepared.compiled, prepared.model, prepared.state
        state.t[0] = time = prepared.times[self.done]
        take_turns_of_drivers(compiled, model, state)
        self.rows.clear()
        try:
            self.steps += solve_equilibrium(compiled, model, state, spin=spin_of(model))
        except AssemblyError as error:
            return Ending("failed", f"at t = {model.units.say(time, 's')} {error}")
        if call(write_equilibrium, self._writer) != method.SUCCESS:
            return Ending("failed", f"at t = {model.units.say(time, 's')} reactions are not finite")
        self.store_unread()
        self._note_jump(time)
        if self.done == 0 or self.done == len(prepared.times) - 1:
            self._note_stability(time)
        self.done += 1
        return Ending("finished") if self.done == len(prepared.times) else None

    def store_unread(self) -> None:
        if self.rows.unread:
            rows = self.rows.read()
            for monitor in self.monitors:
                monitor.add(rows)
            self._sink.append(rows.in_global_frame(self._prepared.compiled.layout))

    def _note_jump(self, time: float) -> None:
        """Add a note if the equilibrium is on another branch than the one before."""
        prepared, say = self._prepared, self._prepared.model.units.say
        way, body = separation(prepared.compiled, self._q, prepared.state.q)
        if self.done > 1 and way > max(_DISTANCE_RATIO * self._way, _MIN_WAY):
            before = prepared.times[self.done - 1]
            self.stability.append(
                f"between t = {say(before, 's')} and {say(time, 's')} the equilibrium jumps, most "
                f"of bodies.{body}: the branch that it was on ends there; flexmb statics --vary "
                "time=... finds where"
            )
            way = 0.0
        self._q, self._way = prepared.state.q.copy(), way

    def _note_stability(self, time: float) -> None:
        prepared = self._prepared
        if prepared.compiled.layout.nv > MAX_COORDINATES:
            return
        try:
            one = Equilibrium(prepared.compiled, prepared.model, prepared.state, self.steps)
            made = one.linearize()
            values = made.eigenvalues
        except FlexmbError:  # a motion without inertia has no modes
            return
        at = f"the equilibrium at t = {prepared.model.units.say(time, 's')}"
        if not made.stable:
            rate = float(values.real.max())
            name = max(made.energy_shares.items(), key=lambda pair: pair[1][values.real.argmax()])
            self.stability.append(
                f"{at} is unstable: a disturbance grows by a factor of e in {1.0 / rate:.3g} s, "
                f"mostly of bodies.{name[0]}; flexmb modes --about static shows the modes"
            )
        else:
            count = one.neutral_motions
            if count:
                self.stability.append(
                    f"{at} is neutral in {count} motion{'s' * (count > 1)}: nothing holds the "
                    "bodies where they are"
                )
