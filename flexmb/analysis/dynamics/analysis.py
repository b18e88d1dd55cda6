"""Motion in time: chunks of compiled steps, their rows to the writer, progress to the caller.

Chunks are counted in steps, never in seconds, so a run repeats itself to the last bit. The step is
shortened so that the outputs fall on steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from flexmb.analysis.assembly.analysis import Assembled, Begin, assemble
from flexmb.analysis.assembly.precheck import precheck
from flexmb.analysis.dynamics.contacts import Lifts
from flexmb.analysis.dynamics.failure import gaps_at, n_kept, open_joint, reason
from flexmb.analysis.dynamics.run import Clock, Run
from flexmb.analysis.dynamics.settings import (
    Steps,
    local_tolerance,
    loop_settings,
    time_grid,
)
from flexmb.analysis.dynamics.signal_notes import SingularPoses, loop_notes
from flexmb.analysis.dynamics.verified import PACE, VerifiedRun
from flexmb.analysis.mobility.conflicts import driver_problems
from flexmb.analysis.mobility.rank import constraint_rank, n_free
from flexmb.analysis.mobility.report import redundant_reactions
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import integration_units, prepare_integration
from flexmb.engine.integrators import AUTO, STIFF_METHOD, chosen_method, method_name
from flexmb.engine.state import State
from flexmb.engine.units import prepare_units
from flexmb.errors import AssemblyError, FlexmbError, SceneError
from flexmb.model.forces.friction import BaseFriction
from flexmb.model.model import Model
from flexmb.model.tasks.methods import METHODS
from flexmb.progress import Progress, silent
from flexmb.results import NOT_UNIQUE, OutputBlock

_STIFF = "stiff"  # how a run ends that another method begins anew
_UNABLE = (method.NO_CONVERGENCE, method.NOT_FINITE, method.TOO_SMALL)
# Steps from which on, and their share at the limit of stability from which on a run is stiff.
_MANY, _OFTEN = 200, 0.15
_FIRST = "first_"
# Passes of a run at most, each with a stricter tolerance by the error measured.
_MOST_PASSES = 3
# Measured error over what was asked for: that is good enough; that the next pass aims at; from
# which a sentence tells it.
_ENOUGH, _AIM, _TOLD = 1.2, 0.4, 2.0
# Smallest factor of the tolerance from pass to pass.
_LEAST_SHARE = 1e-4


class Sink(Protocol):
    """What takes the rows, such as `flexmb.results.ResultWriter`."""

    def append(self, block: OutputBlock) -> None: ...
    def save_state(self, state: dict[str, np.ndarray]) -> None: ...
    def restart(self) -> None: ...


@dataclass(frozen=True)
class _Watched:
    """A sink that shows its rows to those who look for singular poses."""

    sink: Sink
    poses: SingularPoses

    def append(self, block: OutputBlock) -> None:
        self.poses.add(block)
        self.sink.append(block)

    def save_state(self, state: dict[str, np.ndarray]) -> None:
        self.sink.save_state(state)

    def restart(self) -> None:
        self.sink.restart()


@dataclass(frozen=True)
class Outcome:
    """How a run ended: status, sentence, statistics, and notes for the user."""

    status: str
    message: str
    statistics: dict[str, float | int | str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Prepared:
    """A run that is ready to march: nothing can fail any more but the motion itself."""

    run: Run
    grid: Steps
    model: Model
    clock: Clock
    notes: tuple[str, ...]
    settings: method.Settings  # of the run, were it alone
    first: State  # where it begins
    pace: np.ndarray  # local tolerance, passes so far, number of the method
    rows_before: int = 0  # rows that are in the file already
    doubtful: tuple[str, ...] = ()  # joints and drivers whose reactions are not unique
    verified: VerifiedRun | None = None  # with the scout of `run`

    @property
    def method(self) -> str:
        """Name of the integrator."""
        return tuple(METHODS)[int(self.pace[2])]

    def saved(self) -> dict[str, np.ndarray]:
        """All that a resumed run needs."""
        own = {
            **self.run.state._asdict(),
            **{_FIRST + name: value for name, value in self.first._asdict().items()},
            PACE: self.pace,
        }
        return own if self.verified is None else {**own, **self.verified.saved()}

    def stricter(self, tolerance: float) -> Prepared:
        """The same run from its start with another local tolerance."""
        again = self._again(self.method, self.settings._replace(tolerance=tolerance))
        again.pace[1] = self.pace[1] + 1.0
        return again

    def by(self, name: str) -> Prepared:
        """The same run from its start by another integrator."""
        spec = self.model.dynamics
        assert spec is not None
        chosen = chosen_method(spec, name)
        tolerance = local_tolerance(spec, chosen)
        return self._again(name, self.settings._replace(tolerance=tolerance))

    def _again(self, name: str, settings: method.Settings) -> Prepared:
        return prepared_run(
            self.run.compiled, self.model, name, self.first, settings, self.clock,
            notes=self.notes, doubtful=self.doubtful,
        )  # fmt: skip


def prepare(
    compiled: Compiled,
    model: Model,
    *,
    begin: Begin | None = None,
    progress: Progress = silent,
) -> Prepared:
    """Load the compiled units and find the first state of a run.

    What is wrong with a small model is told before anything is compiled (`assembly.precheck`).

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.dynamics` must be given.
    begin : Begin, optional
        Where to begin instead of the placed pose.
    progress : Progress
        Told the phases `load` or `compile`, and `assemble`.

    Raises
    ------
    SceneError
        The model says nothing about dynamics.
    AssemblyError
        No consistent first state, or drivers that contradict each other or the joints.
    """
    spec = model.dynamics
    if spec is None:
        raise SceneError("the scene has no [dynamics]: give its duration")
    name = method_name(spec, _is_flexible(compiled))
    chosen = chosen_method(spec, name)

    def find_first_state() -> _First:
        return _first_state(compiled, model, spec.start, begin)

    clock = Clock()
    precheck(compiled, integration_units(compiled.system, chosen), find_first_state, progress)
    units = prepare_integration(compiled.system, chosen, progress)
    clock.lap("compile" if units else "load")
    progress("assemble", 0.0)
    first = find_first_state()
    grid = time_grid(spec)
    settings = loop_settings(compiled, spec, chosen, first.rank == n_free(compiled))
    progress("assemble", 1.0)
    clock.lap("assemble")
    notes = [*first.assembled.notes, *_frictions(model), *first.notes, *loop_notes(model)]
    if spec.step is not None and grid.step < spec.step * (1.0 - 1e-9):
        shortened = f"from {spec.step:g} s to {grid.step:.6g} s"
        notes.append(f"step shortened {shortened} to meet the outputs")
    return prepared_run(
        compiled, model, name, first.assembled.state, settings, clock, notes=tuple(notes),
        doubtful=first.doubtful,
    )  # fmt: skip


def prepared_run(
    compiled: Compiled, model: Model, name: str, state: State, settings: method.Settings,
    clock: Clock, **known: Any,
) -> Prepared:  # fmt: skip
    """A run from a state by an integrator of this name, with a scout where it controls its error."""
    spec = model.dynamics
    assert spec is not None
    chosen, verified = chosen_method(spec, name), None
    if spec.verify and settings.step == 0.0:
        verified = VerifiedRun.of(compiled, model, chosen, settings, state)
        run = verified.kept
    else:
        run = Run(compiled, chosen, settings, State(*(array.copy() for array in state)))
    pace = np.array([settings.tolerance, 1.0, tuple(METHODS).index(name)])
    return Prepared(
        run, time_grid(spec), model, clock, first=state, settings=settings, verified=verified,
        pace=pace, **known,
    )  # fmt: skip


def _is_flexible(compiled: Compiled) -> bool:
    return bool(compiled.system.parts.bodies["m"].any())


@dataclass(frozen=True)
class _First:
    """The first state, rank of its rows, elements with reactions in doubt, and notes on these."""

    assembled: Assembled
    rank: int | None
    doubtful: tuple[str, ...]
    notes: list[str]


def _first_state(compiled: Compiled, model: Model, start: str, begin: Begin | None) -> _First:
    """Assemble, and look at equations that repeat others.

    Raises
    ------
    AssemblyError
        No consistent first state, or drivers that contradict each other or the joints.
    """
    try:
        assembled = assemble(compiled, model, start=start, begin=begin)
    except AssemblyError as error:
        reasons = driver_problems(compiled, model, error.problems)
        raise AssemblyError.from_problems(reasons) from None
    rank = constraint_rank(compiled, assembled.work)
    if rank is None or rank == compiled.layout.nc:
        return _First(assembled, rank, (), [])
    return _First(assembled, rank, *redundant_reactions(compiled, model, assembled.state.q))


def _frictions(model: Model) -> Iterator[str]:
    """What to know of friction that does not stick."""
    for name, spec in model.forces.items():
        friction = getattr(spec, "friction", spec)
        if isinstance(friction, BaseFriction) and friction.creep_speed is not None:
            speed = model.units.say(friction.creep_speed, "m/s")
            yield (
                f"forces.{name}: smooth friction does not stick but creeps, with {speed} under "
                '71 % of the load that makes it slide; model = "bristle" sticks'
            )


def integrate(prepared: Prepared, sink: Sink, *, progress: Progress = silent) -> Outcome:
    """March a prepared run to its end.

    Parameters
    ----------
    prepared : Prepared
        From `prepare`; used once.
    sink : Sink
        Takes output rows and, after each chunk, the complete state.
    progress : Progress
        Told the phase `integrate`.
    """
    clock, notes, spec = prepared.clock, list(prepared.notes), prepared.model.dynamics
    assert spec is not None
    while True:
        run = prepared.run
        lifts = Lifts(run.compiled)
        poses = SingularPoses(run.compiled.layout, prepared.model)
        status, message = _integrate(prepared, _Watched(sink, poses), progress, lifts)
        if status == _STIFF:
            # what the explicit method can't do is said by the other one
            units = integration_units(run.compiled.system, chosen_method(spec, STIFF_METHOD))
            prepare_units(units, progress)
            again = prepared.by(STIFF_METHOD)
        else:
            tolerance = _stricter(prepared) if status == "finished" else None
            if tolerance is None:
                break
            again = prepared.stricter(tolerance)
        sink.restart()
        prepared = again
    notes += [*lifts.notes(), *poses.notes]
    clock.lap("integrate")
    replaced = int(run.state.count[method.FIXED_PIVOTS])
    if replaced:
        notes.append(
            f"{replaced} pivots without digits were replaced: the steps are long, a body has no "
            "inertia in some direction that it can move in, or the pose is singular"
        )
    statistics = {"method": prepared.method, **_statistics(run, clock)}
    if prepared.verified is not None:
        statistics |= _errors(prepared.verified, int(prepared.pace[1]))
        if status == "finished":
            notes += _missed(prepared)
    if prepared.doubtful:
        statistics[NOT_UNIQUE] = ", ".join(prepared.doubtful)
    return Outcome(status, message, statistics, tuple(notes))


def _stricter(prepared: Prepared) -> float | None:
    """The local tolerance that leaves the accuracy asked for, where the measured error is larger."""
    verified, settings = prepared.verified, prepared.settings
    if verified is None or prepared.pace[1] >= _MOST_PASSES:
        return None
    measured = verified.errors()["positions"].error
    if measured <= _ENOUGH * settings.accuracy:
        return None
    power = verified.kept.method.error_order / verified.kept.method.order
    share = max(_AIM * settings.accuracy / measured, _LEAST_SHARE)
    return float(settings.tolerance * share**power)


def _errors(verified: VerifiedRun, passes: int) -> dict[str, float | int | str]:
    """Measured errors, each with what it is the error of."""
    statistics: dict[str, float | int | str] = {
        "accuracy_asked": verified.kept.settings.accuracy,
        "passes": passes, "scout_steps": int(verified.scout.state.count[method.STEPS]),
    }  # fmt: skip
    for quantity, found in verified.errors().items():
        if quantity in ("positions", "velocities", "reactions"):
            statistics[f"measured_error_of_{quantity}"] = found.error
            statistics[f"worst_of_{quantity}"] = f"{found.name} at t = {found.time:.4g} s"
    return statistics


def _missed(prepared: Prepared) -> Iterator[str]:
    """A sentence where the accuracy asked for was not reached."""
    verified, accuracy = prepared.verified, prepared.settings.accuracy
    assert verified is not None
    worst = verified.errors()["positions"]
    if worst.error <= _TOLD * accuracy:
        return
    until = verified.error.reached_until(verified.ratio, accuracy)
    unit = prepared.model.units
    yield (
        f"accuracy {accuracy:g} was asked for and {worst.error:.2g} reached (sensor {worst.name}, "
        f"t = {unit.say(worst.time, 's', 4)}); it holds until t = {unit.say(until, 's', 4)}: the "
        "motion multiplies small errors; ask for a shorter run, or take the rest as one motion of "
        "many"
    )


def dynamics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Prepare and integrate a compiled model; see :func:`prepare` and :func:`integrate`."""
    return integrate(prepare(compiled, model, progress=progress), sink, progress=progress)


def _integrate(prepared: Prepared, sink: Sink, progress: Progress, lifts: Lifts) -> tuple[str, str]:
    """The loop over chunks; a failure or an interruption keeps everything until then."""
    run, verified = prepared.run, prepared.verified
    state = run.state
    status = method.FINE
    try:
        if prepared.rows_before == 0:
            sink.save_state(prepared.saved())
            status, rows = run.advance(first=True) if verified is None else verified.march(True)
            for block in rows:
                lifts.see(block)
                sink.append(block)
        while status == method.FINE and not run.finished:
            status, rows = run.advance() if verified is None else verified.march()
            apart = _store(prepared, rows, sink, lifts)
            if apart:
                return "failed", apart
            progress("integrate", run.share_done, f"t = {state.t[0]:.4g} s")
            if status == method.FINE and not run.finished and _limited(prepared):
                return _STIFF, ""
    except KeyboardInterrupt:
        if verified is None and run.unread:
            _store(prepared, [run.block()], sink, lifts)
        return "stopped", f"stopped by the user at t = {state.t[0]:.6g} s"
    except FlexmbError as error:
        return "failed", str(error)
    if status in _UNABLE and _may_change(prepared):
        return _STIFF, ""
    if status != method.FINE:
        if verified is not None and run.state.t[0] >= verified.scout.state.t[0]:
            run = verified.scout
        at, step = float(run.state.t[0]), float(run.state.memory[method.STEP])
        return "failed", reason(status, run.compiled, prepared.model, run.work, at, step)
    return "finished", ""


def _may_change(prepared: Prepared) -> bool:
    """Whether the run may go over to the method for stiff motions."""
    spec = prepared.model.dynamics
    automatic = spec is not None and spec.method == AUTO and prepared.settings.step == 0.0
    return automatic and prepared.method != STIFF_METHOD


def _limited(prepared: Prepared) -> bool:
    """Whether stability, not accuracy, limits the steps of an explicit method."""
    run = prepared.run if prepared.verified is None else prepared.verified.scout
    count, stiff = run.state.count, run.state.memory[method.STIFF_STEPS]
    tried = count[method.STEPS] + count[method.REJECTED]
    return _may_change(prepared) and tried > _MANY and bool(stiff > _OFTEN * tried)


def _store(prepared: Prepared, blocks: list[OutputBlock], sink: Sink, lifts: Lifts) -> str:
    """Rows and state of the last chunk; the sentence of a mechanism that has come apart, or ""."""
    compiled = prepared.run.compiled
    for rows in blocks:
        whole = n_kept(compiled, rows)
        kept = rows.part(0, whole)
        lifts.see(kept)
        sink.append(kept)
        if whole < len(rows.t):
            return open_joint(compiled, gaps_at(compiled, rows, whole), float(rows.t[whole]))
    sink.save_state(prepared.saved())
    return ""


def _ten_times(run: Run) -> float:
    """How much more time ten times the accuracy takes: that many more steps."""
    return float(10.0 ** (1.0 / run.method.order))


def _statistics(run: Run, clock: Clock) -> dict[str, float | int | str]:
    count, memory = run.state.count, run.state.memory
    fixed = run.settings.step > 0.0
    steps = (
        {"step_s": run.settings.step}
        if fixed
        else {
            "rejected_steps": int(count[method.REJECTED]),
            "smallest_step_s": float(memory[method.LEAST_STEP]),
            "largest_step_s": float(memory[method.GREATEST_STEP]),
            "ten_times_more_accuracy_costs": _ten_times(run),
            **({} if run.settings.refinement else {"estimated_error": float(memory[method.ERROR_SUM])}),
        }
    )
    return {
        "steps": int(count[method.STEPS]),
        **steps,
        "failed_steps": int(count[method.FAILED]),
        "newton_iterations": int(count[method.RESIDUALS]),
        "factorisations": int(count[method.FACTORISATIONS]),
        "replaced_pivots": int(count[method.FIXED_PIVOTS]),
        **({"events": int(count[method.EVENTS])} if count[method.EVENTS] else {}),
        "largest_position_drift": float(run.largest_drift[0]),
        "largest_velocity_drift": float(run.largest_drift[1]),
        "energy_balance_error": run.balance.relative,
        **clock.seconds,
    }
