"""Motion in time: chunks of compiled steps, their rows to the writer, progress to the caller.

Chunks are counted in steps, never in seconds, so a run repeats itself to the last bit. Output times
are exact: the step is shortened so that the outputs fall on steps.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flexmb.analysis.assembly import assemble
from flexmb.analysis.failure import first_rows, n_kept, open_joint, reason
from flexmb.analysis.rank import motion_is_determined
from flexmb.engine import march, method
from flexmb.engine.compile import Compiled
from flexmb.engine.warm import compile_kernels
from flexmb.engine.work import State, Work, new_work
from flexmb.errors import FlexmbError, SceneError
from flexmb.model.dynamics import DynamicsSpec
from flexmb.model.model import Model
from flexmb.progress import Progress, silent
from flexmb.results import OutputBlock

# Steps of a chunk times velocity coordinates: about a tenth of a second on a present machine.
_CHUNK_WORK = 200_000
_MAX_ITERATIONS = 15
_AT_REST = 1e-6


class Sink(Protocol):
    """What takes the rows, such as `flexmb.results.ResultWriter`."""

    def append(self, block: OutputBlock) -> None: ...
    def save_state(self, state: dict[str, np.ndarray]) -> None: ...


@dataclass(frozen=True)
class Outcome:
    """How a run ended: status, sentence, statistics, and notes for the user."""

    status: str
    message: str
    statistics: dict[str, float | int | str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Steps:
    """The grid of a run."""

    step: float
    every: int
    outputs: int

    @property
    def count(self) -> int:
        """Steps in all."""
        return self.every * self.outputs


def time_grid(spec: DynamicsSpec) -> Steps:
    """The largest step not above the one asked for with which all outputs fall on steps."""
    interval = spec.duration / spec.outputs
    every = max(1, math.ceil(interval / spec.step * (1.0 - 1e-12)))
    return Steps(interval / every, every, spec.outputs)


def chosen_method(spec: DynamicsSpec) -> method.Method:
    """The integrator of `dynamics.method`."""
    if spec.method == "explicit-rk":
        return method.bogacki_shampine()
    return method.generalized_alpha(spec.spectral_radius)


def dynamics(
    compiled: Compiled, model: Model, sink: Sink, *, progress: Progress = silent
) -> Outcome:
    """Integrate a compiled model as its `dynamics` say.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    model : Model
        The model; `model.dynamics` must be given.
    sink : Sink
        Takes output rows and, after each chunk, the complete state.
    progress : Progress
        Told the phases `compile`, `assemble` and `integrate`.

    Raises
    ------
    SceneError
        The model says nothing about dynamics.
    AssemblyError
        No consistent first state.
    """
    spec = model.dynamics
    if spec is None:
        raise SceneError("the scene has no [dynamics]: give duration and step")
    chosen = chosen_method(spec)
    clock = _Clock()
    compile_kernels(compiled.system, chosen, len(compiled.layout.channels), progress)
    clock.lap("compile")
    progress("assemble", 0.0)
    first = assemble(compiled, model, start=spec.start)
    settings, grid = _settings(compiled, spec, first.state, first.work)
    progress("assemble", 1.0)
    clock.lap("assemble")
    run = _Run(compiled, chosen, settings, first.state)
    status, message = _integrate(run, grid, model, sink, progress)
    clock.lap("integrate")
    notes = list(first.notes)
    if grid.step < spec.step * (1.0 - 1e-9):
        shortened = f"from {spec.step:g} s to {grid.step:.6g} s"
        notes.append(f"step shortened {shortened} to meet the outputs")
    return Outcome(status, message, _statistics(run, clock), tuple(notes))


class _Clock:
    """Wall time by phase."""

    def __init__(self) -> None:
        self.last = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def lap(self, phase: str) -> None:
        now = time.perf_counter()
        self.seconds[f"seconds_{phase}"] = now - self.last
        self.last = now


class _Run:
    """One integration: tables, state, scratch and room for the rows of one chunk."""

    def __init__(
        self,
        compiled: Compiled,
        chosen: method.Method,
        settings: method.Settings,
        state: State,
    ) -> None:
        self.compiled, self.method, self.settings, self.state = compiled, chosen, settings, state
        self.work: Work = new_work(compiled.system, method.n_stages(chosen))
        per_output = compiled.layout.nv * settings.output_every
        self.outputs_per_chunk = max(1, _CHUNK_WORK // per_output)
        self.output = march.new_output(
            compiled.system, self.outputs_per_chunk, len(compiled.layout.channels)
        )
        self.largest_drift = np.zeros(2)
        self.balance = _Balance()

    def march(self, steps: int) -> int:
        """Run some steps, or with 0 report the present state; returns the status."""
        return int(
            march.march(
                self.compiled.system, self.method, self.settings, self.state, self.work,
                self.output, steps,
            )
        )  # fmt: skip

    def block(self) -> OutputBlock:
        """The rows of the last chunk."""
        n = int(self.output.rows[0])
        rows = OutputBlock(*(np.array(table[:n]) for table in self.output[:-1]))
        if n:
            self.largest_drift = np.maximum(self.largest_drift, rows.drift.max(axis=0))
            self.balance.add(rows.energy)
        return rows


class _Balance:
    """Largest mismatch of energy and work, and what to compare it with."""

    def __init__(self) -> None:
        self.first: float | None = None
        self.error = 0.0
        self.scale = 0.0

    def add(self, energy: np.ndarray) -> None:
        stored = energy[:, :4].sum(axis=1) - energy[:, 4:].sum(axis=1)
        if self.first is None:
            self.first = float(stored[0])
        self.error = max(self.error, float(np.abs(stored - self.first).max()))
        moved = max(float(np.ptp(energy, axis=0).max()), float(energy[:, 0].max()))
        # in a scene at rest nothing but round-off of the stored energy moves
        self.scale = max(self.scale, moved, _AT_REST * float(np.abs(energy).max()))

    @property
    def relative(self) -> float:
        """Mismatch over the largest energy that moved."""
        return self.error / self.scale if self.scale > 0.0 else 0.0


def _settings(
    compiled: Compiled, spec: DynamicsSpec, state: State, work: Work
) -> tuple[method.Settings, Steps]:
    grid = time_grid(spec)
    system = compiled.system
    works = bool(
        system.springs is not None
        or system.loads is not None
        or np.any(system.rows["fun"] >= 0)
        or np.any(system.parts.bodies["damped"])
    )
    settings = method.Settings(
        step=grid.step,
        newton_tolerance=spec.newton_tolerance,
        max_iterations=_MAX_ITERATIONS,
        output_every=grid.every,
        works=int(works),
        determined=int(motion_is_determined(compiled, work)),
    )
    return settings, grid


def _integrate(
    run: _Run, grid: Steps, model: Model, sink: Sink, progress: Progress
) -> tuple[str, str]:
    """The loop over chunks; a failure or an interruption keeps everything until then."""
    state = run.state
    sink.save_state(state._asdict())
    done = 0
    try:
        status = run.march(0)
        sink.append(run.block())
        while status == method.FINE and done < grid.outputs:
            n = min(run.outputs_per_chunk, grid.outputs - done)
            status = run.march(n * grid.every)
            rows = run.block()
            whole = n_kept(run.compiled, rows)
            sink.append(first_rows(rows, whole))
            if whole < len(rows.t):
                return "failed", open_joint(run.compiled, run.work.con.C, float(rows.t[whole]))
            sink.save_state(state._asdict())
            done += whole
            progress("integrate", done / grid.outputs, f"t = {state.t[0]:.4g} s")
    except KeyboardInterrupt:
        return "stopped", f"stopped by the user at t = {state.t[0]:.6g} s"
    except FlexmbError as error:
        return "failed", str(error)
    if status != method.FINE:
        at, step = float(state.t[0]), run.settings.step
        return "failed", reason(status, run.compiled, model, run.work, at, step)
    return "finished", ""


def _statistics(run: _Run, clock: _Clock) -> dict[str, float | int | str]:
    count = run.state.count
    return {
        "steps": int(count[method.STEPS]),
        "step_s": run.settings.step,
        "newton_iterations": int(count[method.RESIDUALS]),
        "factorisations": int(count[method.FACTORISATIONS]),
        "replaced_pivots": int(count[method.FIXED_PIVOTS]),
        "largest_position_drift": float(run.largest_drift[0]),
        "largest_velocity_drift": float(run.largest_drift[1]),
        "energy_balance_error": run.balance.relative,
        **clock.seconds,
    }
