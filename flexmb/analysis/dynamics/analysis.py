"""Motion in time: chunks of compiled steps, their rows to the writer, progress to the caller.

Chunks are counted in steps, never in seconds, so a run repeats itself to the last bit. The step is
shortened so that outputs at equal intervals fall on steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flexmb.analysis.assembly.initial_state import Assembled, StartValues, assemble
from flexmb.analysis.assembly.jacobian import constraint_rank, n_free
from flexmb.analysis.dynamics.failure import gaps_at, n_kept, open_joint, reason
from flexmb.analysis.dynamics.linear_elasticity import LinearElasticityMonitor
from flexmb.analysis.dynamics.passes import (
    error_statistics,
    limited_by_stability,
    may_change_method,
    missed_accuracy,
    stricter_tolerance,
    unstable_step,
)
from flexmb.analysis.dynamics.prepared import Prepared, prepared_run
from flexmb.analysis.dynamics.run import Clock, Run
from flexmb.analysis.dynamics.settings import loop_settings, time_grid
from flexmb.analysis.dynamics.survey import needs_survey, survey
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.analysis.mobility.driver_conflicts import driver_problems
from flexmb.analysis.monitors import (
    ContactLossMonitor,
    GrowthMonitor,
    SingularOrientationMonitor,
    algebraic_loop_notes,
)
from flexmb.analysis.procedure import precheck
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import integration_units, prepare_integration
from flexmb.engine.integrators import (
    STIFF_METHOD,
    chosen_method,
    method_name,
    reason_of_method,
)
from flexmb.engine.units import prepare_units
from flexmb.errors import AssemblyError, FlexmbError, SceneError
from flexmb.model.forces.friction import BaseFriction
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results import NOT_UNIQUE, OutputBlock

_STIFF = "stiff"  # how a run ends that another method begins anew
_UNABLE = (method.NO_CONVERGENCE, method.NOT_FINITE, method.TOO_SMALL)


class Sink(Protocol):
    """What takes the rows, such as `flexmb.results.ResultWriter`."""

    def append(self, block: OutputBlock) -> None: ...
    def save_state(self, state: dict[str, np.ndarray]) -> None: ...
    def restart(self) -> None: ...


@dataclass(frozen=True)
class _Watched:
    """A sink that shows its rows to the monitors."""

    sink: Sink
    poses: SingularOrientationMonitor
    growth: GrowthMonitor
    elasticity: LinearElasticityMonitor

    def append(self, block: OutputBlock) -> None:
        self.poses.add(block)
        self.growth.add(block)
        self.elasticity.add(block)
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


def prepare(
    compiled: Compiled,
    model: Model,
    *,
    begin: StartValues | None = None,
    progress: Progress = silent,
) -> Prepared:
    """Load the compiled units and find the first state of a run.

    What is wrong with a small model is reported before anything is compiled (`procedure.precheck`).

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.dynamics` must be given.
    begin : StartValues, optional
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
    notes = [*first.assembled.notes, *_frictions(model), *first.notes, *algebraic_loop_notes(model)]
    if spec.step is not None and grid.step < spec.step * (1.0 - 1e-9):
        shortened = f"from {spec.step:g} s to {grid.step:.6g} s"
        met = "the end" if isinstance(spec.outputs, tuple) else "the outputs"
        notes.append(f"step shortened {shortened} to meet {met}")
    return prepared_run(
        compiled, model, name, first.assembled.state, settings, clock, notes=tuple(notes),
        doubtful=first.doubtful,
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


def _first_state(compiled: Compiled, model: Model, start: str, begin: StartValues | None) -> _First:
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
    finished: Prepared | None = None  # the run before, if it came to its end
    while True:
        run = prepared.run
        lifts = ContactLossMonitor(run.compiled)
        poses = SingularOrientationMonitor(run.compiled.layout, prepared.model)
        growth = GrowthMonitor(run.compiled, prepared.model)
        elasticity = LinearElasticityMonitor(run.compiled, prepared.model, prepared.first.q)
        watched = _Watched(sink, poses, growth, elasticity)
        status, message = _integrate(prepared, watched, progress, lifts)
        if status == _STIFF:
            # what the explicit method can't do is said by the other one
            units = integration_units(run.compiled.system, chosen_method(spec, STIFF_METHOD))
            prepare_units(units, progress)
            again = prepared.by(STIFF_METHOD)
        elif status == "failed" and finished is not None and not growth.sentence:
            notes.append(f"steps for more accuracy failed ({message}); those before are kept")
            again, finished = finished.last(), None
        else:
            tolerance = stricter_tolerance(prepared) if status == "finished" else None
            if tolerance is None:
                break
            finished, again = prepared, prepared.stricter(tolerance)
        sink.restart()
        prepared = again
    notes += [*lifts.notes(), *poses.notes(), *elasticity.notes()]
    if growth.sentence and growth.sentence != message:
        notes.append(growth.sentence)
    clock.lap("integrate")
    replaced = int(run.state.count[0]["regularised_pivots"])
    if replaced:
        notes.append(
            f"{replaced} pivots without digits were replaced: the steps are long, a body has no "
            "inertia in some direction that it can move in, or the pose is singular"
        )
    statistics = {"method": prepared.method, **_statistics(run, clock)}
    reason = reason_of_method(spec, prepared.method, _is_flexible(run.compiled))
    if reason:
        statistics["reason_of_method"] = reason
    statistics |= error_statistics(prepared)
    if status == "finished":
        notes += missed_accuracy(prepared)
        notes += [note for note in [unstable_step(run, prepared.method, failed=False)] if note]
    if prepared.doubtful:
        statistics[NOT_UNIQUE] = ", ".join(prepared.doubtful)
    return Outcome(status, message, statistics, tuple(notes))


def dynamics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Prepare and integrate a compiled model; see :func:`prepare` and :func:`integrate`."""
    return integrate(prepare(compiled, model, progress=progress), sink, progress=progress)


def _integrate(
    prepared: Prepared, sink: _Watched, progress: Progress, lifts: ContactLossMonitor
) -> tuple[str, str]:
    """The loop over chunks; a failure or an interruption keeps everything until then."""
    run, verified = prepared.run, prepared.verified
    state = run.state
    status = method.FINE
    try:
        if prepared.rows_before == 0:
            if needs_survey(prepared):
                sink.save_state(prepared.saved())  # so that a kill meanwhile loses nothing
                survey(prepared, progress)
            sink.save_state(prepared.saved())
            status, rows = run.advance(first=True) if verified is None else verified.march(True)
            for block in rows:
                lifts.add(block)
                sink.append(block)
        while status == method.FINE and not run.finished:
            status, rows = run.advance() if verified is None else verified.march()
            apart = _store(prepared, rows, sink, lifts)
            if apart or (sink.growth.ends_run and sink.growth.sentence):
                return "failed", sink.growth.sentence or apart
            progress("integrate", run.share_done, f"t = {state.t[0]:.4g} s")
            if status == method.FINE and not run.finished and limited_by_stability(prepared):
                return _STIFF, ""
    except KeyboardInterrupt:
        if verified is None and run.unread:
            _store(prepared, [run.block()], sink, lifts)
        return "stopped", f"stopped by the user at t = {state.t[0]:.6g} s"
    except FlexmbError as error:
        return "failed", sink.growth.sentence or str(error)
    if status != method.FINE and sink.growth.sentence:
        return "failed", sink.growth.sentence
    if status in _UNABLE and may_change_method(prepared):
        return _STIFF, ""
    if status != method.FINE:
        if verified is not None and run.state.t[0] >= verified.scout.state.t[0]:
            run = verified.scout
        at, step = float(run.state.t[0]), float(run.state.memory[0]["next_step"])
        unstable = unstable_step(run, prepared.method, failed=True)
        if unstable:
            return "failed", f"at t = {at:.6g} s {unstable}"
        return "failed", reason(status, run.compiled, prepared.model, run.work, at, step)
    return "finished", ""


def _store(
    prepared: Prepared, blocks: list[OutputBlock], sink: Sink, lifts: ContactLossMonitor
) -> str:
    """Rows and state of the last chunk; the sentence of a mechanism that has come apart, or ""."""
    compiled = prepared.run.compiled
    for rows in blocks:
        whole = n_kept(compiled, rows)
        kept = rows.part(0, whole)
        lifts.add(kept)
        sink.append(kept)
        if whole < len(rows.t):
            return open_joint(compiled, gaps_at(compiled, rows, whole), float(rows.t[whole]))
    sink.save_state(prepared.saved())
    return ""


def _ten_times(run: Run) -> float:
    """How much more time ten times the accuracy takes: that many more steps."""
    return float(10.0 ** (1.0 / run.method.order))


def _statistics(run: Run, clock: Clock) -> dict[str, float | int | str]:
    count, memory = run.state.count[0], run.state.memory[0]
    fixed = run.settings.step > 0.0
    steps = (
        {"step_s": run.settings.step}
        if fixed
        else {
            "rejected_steps": int(count["rejected"]),
            "smallest_step_s": float(memory["smallest_step"]),
            "largest_step_s": float(memory["largest_step"]),
            "ten_times_more_accuracy_costs": _ten_times(run),
        }
    )
    estimate = {"estimated_error": float(memory["error_sum"])}
    return {
        "steps": int(count["steps"]),
        **steps,
        **({} if fixed or run.settings.refinement else estimate),
        "failed_steps": int(count["failed"]),
        "newton_iterations": int(count["residuals"]),
        "factorisations": int(count["factorisations"]),
        "replaced_pivots": int(count["regularised_pivots"]),
        **({"events": int(count["events"])} if count["events"] else {}),
        **({"partitions": 1 + int(count["partitions"])} if run.method.partitions else {}),
        "largest_position_drift": float(run.largest_drift[0]),
        "largest_velocity_drift": float(run.largest_drift[1]),
        "energy_balance_error": run.balance.relative,
        **clock.seconds,
    }
