"""Dynamic analysis: the first state, the integration chunk by chunk, and its passes.

Chunks are counted in steps, never in seconds, so that a run is reproducible to the last bit. A
fixed step is shortened so that outputs at equal intervals are at ends of steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexmb.analysis.assembly.initial_state import Assembled, StartValues, assemble
from flexmb.analysis.assembly.jacobian import constraint_rank, n_free, with_driven_coordinates
from flexmb.analysis.assembly.static_mode_selection import is_determinate
from flexmb.analysis.chunked_run import Ending, Outcome, Sink, assemble_first_state, run_chunks
from flexmb.analysis.dynamics.impacts import MissedPeaks, slow_impacts
from flexmb.analysis.dynamics.integration import (
    Integration,
    StepRows,
    static_modes_sentence,
    stiff_force_sentence,
)
from flexmb.analysis.dynamics.passes import (
    PreparedDynamics,
    complete_measured_error,
    is_worse,
    keeps_failing,
    limited_by_stability,
    may_change_method,
    needs_rough_run,
    prepared_run,
    rough_run,
    stricter_tolerance,
    unstable_step,
)
from flexmb.analysis.dynamics.reached_accuracy import (
    damped_vibration,
    energy_error,
    missed_accuracy,
    reason_of_pass,
    steps_at_points,
)
from flexmb.analysis.dynamics.run_settings import loop_settings, time_grid, why_implicit
from flexmb.analysis.failure_messages import failure_sentence, gaps_at, open_joint
from flexmb.analysis.functions_of_time import missed_pulses
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.analysis.mobility.driver_conflicts import driver_reasons
from flexmb.analysis.monitors import (
    MAX_TURN_OF_A_STEP,
    ContactLossMonitor,
    GrowthMonitor,
    RingingMonitor,
    SingularOrientationMonitor,
    TurningMonitor,
    algebraic_loop_notes,
)
from flexmb.analysis.singular_poses import singular_pose_sentence
from flexmb.analysis.validity.validity_monitor import ValidityMonitor
from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import integration_units
from flexmb.engine.compiled_units import prepare_units
from flexmb.engine.method_selection import (
    AUTO,
    STIFF_METHOD,
    make_integrator,
    method_name,
    reason_of_method,
)
from flexmb.errors import SceneError
from flexmb.model.forces.friction import BaseFriction
from flexmb.model.joints.joint import lost_inertias
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results.output_block import OutputBlock
from flexmb.results.result import NOT_UNIQUE

# Largest constraint violation, in radians or over the size of the model; with a larger one the
# mechanism has come apart.
_MAX_GAP = 1e-3
_STIFF = "stiff"  # ending of a run that starts again with the method for stiff motions
_UNABLE = (method.NO_CONVERGENCE, method.NOT_FINITE, method.STEP_TOO_SMALL)


def prepare_dynamics(
    compiled: Compiled,
    model: Model,
    *,
    begin: StartValues | None = None,
    progress: Progress = silent,
) -> PreparedDynamics:
    """Load the compiled units and find the first state of a run.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.dynamics` must be there.
    begin : StartValues, optional
        Start in place of the pose of the scene.
    progress : Progress
        Receives the phases `load` or `compile`, and `assemble`.

    Raises
    ------
    SceneError
        The model has no section `dynamics`, or its explicit method cannot integrate it.
    AssemblyError
        No consistent first state, or drivers that contradict each other or the joints.
    """
    spec = model.dynamics
    if spec is None:
        raise SceneError("the scene has no [dynamics]: give its duration")
    name = method_name(spec, why_implicit(compiled, model))
    integrator = make_integrator(spec, name)

    def first_state() -> tuple[Assembled, int | None, tuple[str, ...], list[str]]:
        with driver_reasons(compiled, model):
            assembled = assemble(compiled, model, start=spec.start, begin=begin)
        rank = constraint_rank(compiled, assembled.work)
        can_move = bool(model.drivers) or rank != n_free(compiled)
        if rank is None or (rank == compiled.layout.nc and can_move):
            return assembled, rank, (), []
        state = assembled.state
        return assembled, rank, *redundant_reactions(compiled, model, state.q, state)

    units = integration_units(compiled.system, integrator)
    first, timer = assemble_first_state(compiled, units, first_state, progress)
    assembled, rank, not_unique, redundancy = first
    compiled = with_driven_coordinates(assembled.compiled, assembled.state.q)
    settings = loop_settings(compiled, spec, integrator, is_determinate(compiled, rank))
    if spec.method != AUTO and integrator.stages and not settings.determinate:
        for lost in lost_inertias(model):
            raise SceneError(f'{lost}; or use method = "{STIFF_METHOD}"')
    notes = [*assembled.notes, *_friction_notes(model), *redundancy, *algebraic_loop_notes(model)]
    grid = time_grid(spec)
    if spec.step is not None and grid.step < spec.step * (1.0 - 1e-9):
        change = f"from {model.units.say(spec.step, 's')} to {model.units.say(grid.step, 's')}"
        end = "the end" if isinstance(spec.outputs, tuple) else "the outputs"
        notes.append(f"step shortened {change} to meet {end}")
    if grid.step:
        halved = bool(spec.verify)
        notes += missed_pulses(compiled, integrator, grid.step, spec.duration, halved, model.units)
    return prepared_run(
        compiled, model, name, assembled.state, settings, timer=timer, notes=tuple(notes),
        not_unique=not_unique, dampings=tuple(assembled.dampings),
    )  # fmt: skip


def _friction_notes(model: Model) -> Iterator[str]:
    """Notes on friction that does not stick."""
    for name, spec in model.forces.items():
        friction = getattr(spec, "friction", spec)
        if isinstance(friction, BaseFriction) and friction.creep_speed is not None:
            speed = model.units.say(friction.creep_speed, "m/s")
            yield (
                f"forces.{name}: smooth friction does not stick but creeps, with {speed} under "
                '71 % of the load that makes it slide; model = "bristle" sticks'
            )


def run_dynamics(
    prepared: PreparedDynamics, sink: Sink, *, progress: Progress = silent, is_judged: bool = True
) -> Outcome:
    """Integrate a prepared run to its end, pass by pass.

    Parameters
    ----------
    prepared : PreparedDynamics
        From `prepare_dynamics`; used once.
    sink : Sink
        Takes output rows and, after each chunk, the complete state.
    progress : Progress
        Receives the phase `integrate`.
    is_judged : bool
        Whether to examine if the equations are valid; without, no bound ends the run.
    """
    notes, spec, compiled = list(prepared.notes), prepared.spec, prepared.run.compiled
    finished: PreparedDynamics | None = None  # the pass before, if it reached the end
    reason = ""  # why there was a second pass
    while True:
        current = _Pass(prepared, sink, progress, is_judged)
        ending = run_chunks(current, progress)
        if ending.status == "failed" and current.growth.sentence:
            ending = Ending("failed", current.growth.sentence)
        if ending.status == _STIFF:
            # whatever the explicit method failed at, the other method reports it
            prepare_units(
                integration_units(compiled.system, make_integrator(spec, STIFF_METHOD)), progress
            )
            again = prepared.by_method(STIFF_METHOD)
        elif ending.status == "failed" and finished is not None and not current.growth.sentence:
            notes.append(
                f"steps for more accuracy failed ({ending.message}); those before are kept"
            )
            again, finished, reason = finished.as_last_pass(), None, ""
        elif ending.status == "finished" and finished is not None and is_worse(prepared):
            notes.append("steps for more accuracy are worse by round-off; those before are kept")
            again, finished, reason = finished.as_last_pass(), None, ""
        else:
            if ending.status == "finished":
                ending = _complete_measurement(prepared, ending, progress)
            tolerance = stricter_tolerance(prepared) if ending.status == "finished" else None
            if tolerance is None:
                break
            reason = reason or reason_of_pass(prepared)
            finished, again = prepared, prepared.with_tolerance(tolerance)
        sink.restart()
        prepared = again
    prepared.timer.lap("integrate")
    notes += [*current.notes(ending), *filter(None, [reason])]
    statistics = {"method": prepared.method, **_statistics(prepared.run)}
    statistics |= prepared.timer.seconds
    stiff = prepared.method == STIFF_METHOD
    implicit = why_implicit(compiled, prepared.model) if stiff else ""
    of_method = reason_of_method(spec, prepared.method, implicit)
    statistics |= {"reason_of_method": of_method} if of_method else {}
    if prepared.comparison is not None:
        statistics |= prepared.comparison.statistics()
    if prepared.not_unique:
        statistics[NOT_UNIQUE] = ", ".join(prepared.not_unique)
    return Outcome(ending.status, ending.message, statistics, tuple(notes))


def _complete_measurement(prepared: PreparedDynamics, ending: Ending, progress: Progress) -> Ending:
    """Complete the measured error; returns the ending, or "stopped" if the user interrupts."""
    try:
        complete_measured_error(prepared, progress)
    except KeyboardInterrupt:
        return Ending("stopped", f"stopped by the user at t = {prepared.run.state.t[0]:.6g} s")
    return ending


def dynamics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Prepare and integrate; see :func:`prepare_dynamics` and :func:`run_dynamics`."""
    prepared = prepare_dynamics(compiled, model, progress=progress)
    return run_dynamics(prepared, sink, progress=progress)


class _Pass:
    """One pass of a run, with its monitors, while it is integrated."""

    phase = "integrate"

    def __init__(
        self, prepared: PreparedDynamics, sink: Sink, progress: Progress, is_judged: bool
    ) -> None:
        self._prepared, self._sink, self._progress = prepared, sink, progress
        compiled, model = prepared.run.compiled, prepared.model
        self._contact_loss = ContactLossMonitor(compiled)
        self._orientations = SingularOrientationMonitor(compiled.layout, model)
        settings = prepared.run.settings
        step = settings.step if settings.determinate == 0 else 0.0
        self._turning = TurningMonitor(compiled, model, step)
        integrator = prepared.run.method
        may_ring = integrator.prefers_constant_step == 1 and not integrator.collocation
        self._ringing = RingingMonitor(compiled, model, step if may_ring else 0.0)
        self._steps = StepRows(prepared.run, self._ringing.looks)
        self._validity = ValidityMonitor(compiled, model, prepared.first.q, is_judged=is_judged)
        self._peaks = MissedPeaks(compiled, model)
        self.growth = GrowthMonitor(compiled, model)
        self._begins = prepared.rows_before == 0

    @property
    def time(self) -> float:
        return float(self._prepared.run.state.t[0])

    @property
    def share_done(self) -> float:
        return self._prepared.run.share_done

    def next_chunk(self) -> Ending | None:
        prepared = self._prepared
        status = method.SUCCESS
        if self._begins:
            status = self._first_row()
        if status == method.SUCCESS:
            self._steps.begin()
            status, blocks = prepared.advance()
            apart = self._store(blocks)
            for rows in self._steps.rows():
                self._ringing.add_apart(rows)
            apart = apart or self._validity.refusal()
            if apart or keeps_failing(prepared.run):
                return Ending("failed", self._unstable(prepared.run) or apart)
            if self.growth.ends_run and self.growth.sentence:
                return Ending("failed", "")
        if status != method.SUCCESS:
            return self._failure(status)
        stiff = not prepared.run.finished and limited_by_stability(prepared)
        return Ending(_STIFF) if stiff else None

    def store_unread(self) -> None:
        if self._prepared.comparison is None and self._prepared.run.rows.unread:
            self._store([self._prepared.run.rows.read()])

    def notes(self, ending: Ending) -> list[str]:
        """Notes for the user on this pass."""
        prepared = self._prepared
        monitors = (
            self._contact_loss, self._orientations, self._validity, self._turning, self._ringing
        )  # fmt: skip
        notes = [note for monitor in monitors for note in monitor.notes()]
        notes += [prepared.halving.note(prepared.model.units)] if prepared.halving else []
        notes = [note for note in notes if note not in ending.message]
        notes += [self.growth.sentence] if self.growth.sentence != ending.message else []
        pivots = int(prepared.run.state.count[0]["regularised_pivots"])
        if pivots and "not finite" not in ending.message:
            notes.append(
                f"{pivots} ill-conditioned pivots were regularised: a body has no inertia in some "
                "direction that it can move in, or the pose is singular"
            )
        if ending.status == "finished":
            notes += [*missed_accuracy(prepared), damped_vibration(prepared)]
            notes += slow_impacts(prepared.run, prepared.model.units)
            notes += steps_at_points(prepared.run, prepared.model)
            if prepared.rows_before == 0:  # rows of a run before it was resumed were not looked at
                notes += self._peaks.sentences(prepared.run, prepared.model)
            unstable = unstable_step(prepared.run, prepared.method, failed=False)
            notes += [unstable or energy_error(prepared, self._validity.making_energy())]
        return [note for note in notes if note]

    def _first_row(self) -> int:
        prepared, self._begins = self._prepared, False
        if needs_rough_run(prepared):
            self._sink.save_state(prepared.arrays())  # a kill during the rough run loses nothing
            rough_run(prepared, self._progress)
        self._sink.save_state(prepared.arrays())
        status, blocks = prepared.advance(first=True)
        for rows in blocks:
            self._append(rows)
        return status

    def _append(self, rows: OutputBlock) -> None:
        rows = rows.part(0, self._validity.add(rows))
        for monitor in (
            self._contact_loss, self._orientations, self._peaks, self.growth, self._turning,
            self._ringing,
        ):  # fmt: skip
            monitor.add(rows)
        self._sink.append(rows.in_global_frame(self._prepared.run.compiled.layout))

    def _store(self, blocks: Sequence[OutputBlock]) -> str:
        """Store rows and state; returns a sentence if the mechanism has come apart, or ""."""
        compiled = self._prepared.run.compiled
        for rows in blocks:
            n = n_closed(compiled, rows)
            self._append(rows.part(0, n))
            if n < len(rows.t):
                return open_joint(compiled, gaps_at(compiled, rows, n), float(rows.t[n]))
        self._sink.save_state(self._prepared.arrays())
        return ""

    def _failure(self, status: int) -> Ending:
        prepared, run, verified = self._prepared, self._prepared.run, self._prepared.verified
        if status in _UNABLE and may_change_method(prepared) and not self.growth.sentence:
            return Ending(_STIFF)
        if verified is not None and run.state.t[0] >= verified.scout.state.t[0]:
            run = verified.scout
        at, step = float(run.state.t[0]), float(run.state.memory[0]["next_step"])
        unstable = self._unstable(run)
        if unstable:
            return Ending("failed", unstable)
        is_static = status == method.NO_LOOP_CONVERGENCE or run.method.stages > 0
        cause = (
            self._validity.diverging(run.state)
            or (static_modes_sentence(run.compiled, run.method) if is_static else "")
            or (stiff_force_sentence(run) if status == method.NO_CONVERGENCE else "")
            or singular_pose_sentence(run.compiled, run.state.q, run.state.q_first, run.method)
        )
        return Ending("failed", failure_sentence(
            status, run.compiled, prepared.model, run.work, at, step, cause))  # fmt: skip

    def _unstable(self, run: Integration) -> str:
        sentence = unstable_step(run, self._prepared.method, failed=True)
        if not sentence:
            return ""
        static = static_modes_sentence(run.compiled, run.method, beside_dynamic=True)
        return f"at t = {float(run.state.t[0]):.6g} s {static or sentence + self._first_turn()}"

    def _first_turn(self) -> str:
        """Text on a body that the first acceleration rotates too far in a fixed step, or ""."""
        first, h = self._prepared.first, self._prepared.settings.step
        turns = {
            body.name: float(np.linalg.norm(first.v[at] + 0.5 * h * first.vd[at])) * h
            for body in self._prepared.run.compiled.layout.bodies
            for at in [slice(body.iv + 3, body.iv + 6)]
        }
        name = max(turns, key=lambda one: turns[one])
        if not turns[name] > MAX_TURN_OF_A_STEP:
            return ""
        return (
            f"; by its first acceleration bodies.{name} turns by {turns[name]:.2g} rad in such a "
            "step: unless a stiff spring holds it, no method resolves that"
        )


def _statistics(run: Integration) -> dict[str, float | int | str]:
    count, memory = run.state.count[0], run.state.memory[0]
    fixed = run.settings.step > 0.0
    steps = (
        {"step_s": run.settings.step}
        if fixed
        else {
            "rejected_steps": int(count["rejected"]),
            "smallest_step_s": float(memory["smallest_step"]),
            "largest_step_s": float(memory["largest_step"]),
            "ten_times_more_accuracy_costs": float(10.0 ** (1.0 / run.method.order)),
        }
    )
    estimate = {"estimated_error": float(memory["error_sum"])}
    return {
        "steps": int(count["steps"]),
        **steps,
        **({} if fixed or run.settings.refinement else estimate),
        "failed_steps": int(count["failed"]),
        "residual_evaluations": int(count["residuals"]),
        "factorisations": int(count["factorisations"]),
        "replaced_pivots": int(count["regularised_pivots"]),
        **({"events": int(count["events"])} if count["events"] else {}),
        **({"partitions": 1 + int(count["partitions"])} if run.method.partitions else {}),
        "largest_position_drift": float(run.rows.largest_drift[0]),
        "largest_velocity_drift": float(run.rows.largest_drift[1]),
        "largest_speed": float(run.rows.largest_drift[2]),
        "energy_balance_error": run.rows.balance.relative,
    }


def n_closed(compiled: Compiled, rows: OutputBlock) -> int:
    """Number of rows before the first one that violates the constraints."""
    for row in map(int, np.flatnonzero(rows.drift[:, 0] > _MAX_GAP * min(compiled.length, 1.0))):
        if not np.abs(gaps_at(compiled, rows, row) * compiled.system.row_weights).max() <= _MAX_GAP:
            return row
    return len(rows.t)
