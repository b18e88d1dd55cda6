"""Continuation of a run that was stopped or killed, or is to be extended.

It starts from the state at the end of a chunk, which the result file contains. Each chunk begins
with a new factor, and the state is complete, so the continued run is identical to an uninterrupted
one to the last bit.
"""

from __future__ import annotations

import numpy as np

from flexmb.analysis.assembly.body_damping import add_damping
from flexmb.analysis.assembly.jacobian import constraint_rank, with_driven_coordinates
from flexmb.analysis.assembly.static_mode_selection import choose_static_modes, is_determinate
from flexmb.analysis.chunked_run import PhaseTimer
from flexmb.analysis.dynamics.passes import PASSES, PreparedDynamics, prepared_run
from flexmb.analysis.dynamics.run_settings import loop_settings, with_tolerance
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import prepare_integration, solve_stage
from flexmb.engine.initial_conditions import ACCELERATIONS
from flexmb.engine.method_selection import make_integrator, method_name
from flexmb.errors import ResultFileError
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import METHODS
from flexmb.progress import Progress, silent
from flexmb.results import Result


def prepare_resumed(
    compiled: Compiled, model: Model, result: Result, *, progress: Progress = silent
) -> PreparedDynamics:
    """Prepare the continuation of a run.

    Parameters
    ----------
    compiled : Compiled
        The model of the result, compiled anew; its fingerprint must be that of the result.
    model : Model
        The model; `model.dynamics.duration` may be longer than it was.
    result : Result
        The result of the run so far.
    progress : Progress
        Receives the phase `compile`.

    Raises
    ------
    ResultFileError
        No complete state, or the state of another system.
    """
    spec = model.dynamics
    newest = result.last_state()
    if spec is None or newest is None:
        raise ResultFileError(f"{result.path}: has no state to resume from; run the scene again")
    rows, arrays = newest
    timer, name = PhaseTimer(), method_name(spec)
    passes = arrays.get("passes")
    if passes is not None and passes.dtype == PASSES:
        name = tuple(METHODS)[int(passes[0]["method"])]
    integrator = make_integrator(spec, name)
    units = prepare_integration(compiled.system, integrator, progress)
    timer.lap("compile" if units else "load")
    compiled, first, rank = _first_pose(compiled, arrays, result, rows)
    if "first_q" in arrays:
        compiled, _ = add_damping(choose_static_modes(compiled, first), model, first)
    settings = loop_settings(compiled, spec, integrator, is_determinate(compiled, rank))
    if settings.step == 0.0 and passes is not None and passes.dtype == PASSES:
        tolerance = float(passes[0]["tolerance"])
        settings = with_tolerance(settings, spec, integrator, tolerance)
    not_unique: tuple[str, ...] = ()
    if rank is not None and rank < compiled.layout.nc:
        not_unique, _ = redundant_reactions(compiled, model, first)
    state = new_state(compiled.system, len(compiled.layout.channels))
    prepared = prepared_run(
        compiled, model, name, state, settings, timer=timer, notes=(), rows_before=rows,
        not_unique=not_unique,
    )  # fmt: skip
    _restore(prepared, arrays, result)
    timer.lap("assemble")
    return prepared


def _restore(prepared: PreparedDynamics, arrays: dict[str, np.ndarray], result: Result) -> None:
    """Restore the saved arrays.

    Raises
    ------
    ResultFileError
        They are arrays of another run.
    """
    own = prepared.arrays()
    fits = arrays.keys() == own.keys() and all(
        arrays[name].shape == array.shape and arrays[name].dtype == array.dtype
        for name, array in own.items()
    )
    if not fits:
        what = "its saved state is of another version of flexmb; run the scene again"
        raise ResultFileError(f"{result.path}: {what}")
    for name, array in own.items():
        array[...] = arrays[name]
    others = [prepared.verified.scout] if prepared.verified else []
    others += [prepared.halving.halved] if prepared.halving else []
    for run in (prepared.run, *others):
        run.count_outputs()  # an extended run has other outputs and comparison times
    if prepared.verified is not None and prepared.verified.jumps is not None:
        prepared.verified.jumps.add_jumps(prepared.run.compiled, prepared.settings)
    if result.status == "finished":
        tolerance, _, number, _, _ = prepared.passes[0]
        prepared.passes[0] = (tolerance, 1, number, 0.0, 0.0)


def _first_pose(
    compiled: Compiled, arrays: dict[str, np.ndarray], result: Result, rows: int
) -> tuple[Compiled, np.ndarray, int | None]:
    """The model at the first row, positions (nq,), and the rank of the constraints there."""
    first = new_state(compiled.system, len(compiled.layout.channels))
    try:
        first.q[:], first.v[:] = arrays["first_q"], arrays["first_v"]
    except (KeyError, ValueError):
        return compiled, first.q, None  # a file of another version, which `_restore` reports
    work = new_work(compiled.system)
    solve_stage(compiled.system, first, work, ACCELERATIONS)
    rank = constraint_rank(compiled, work)
    return with_driven_coordinates(compiled, first.q), first.q, rank
