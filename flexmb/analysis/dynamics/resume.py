"""Going on with a run that was stopped or killed: its newest whole state, ready to march.

In: the compiled model, the result as its file holds it. Out: the run as it was at the end of a
chunk. A chunk begins by forgetting the factor and the state is complete, so the rest of the run is
that of an uninterrupted one to the last bit.
"""

from __future__ import annotations

import numpy as np

from flexmb.analysis.assembly.jacobian import constraint_rank, n_free
from flexmb.analysis.dynamics.prepared import Prepared, prepared_run
from flexmb.analysis.dynamics.run import Clock
from flexmb.analysis.dynamics.settings import loop_settings, with_tolerance
from flexmb.analysis.dynamics.verified import PACE
from flexmb.analysis.mobility.degrees_of_freedom import redundant_reactions
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import prepare_integration, solve_stage
from flexmb.engine.initial_conditions import ACCELERATIONS
from flexmb.engine.integrators import chosen_method, method_name
from flexmb.engine.work import new_state, new_work
from flexmb.errors import ResultFileError
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import METHODS
from flexmb.progress import Progress, silent
from flexmb.results import Result

__all__ = ["prepare_rest"]


def prepare_rest(
    compiled: Compiled, model: Model, result: Result, *, progress: Progress = silent
) -> Prepared:
    """Make the rest of a run ready.

    Parameters
    ----------
    compiled : Compiled
        The model of the result, compiled anew; its fingerprint must be that of the result.
    model : Model
        The model; `model.dynamics.duration` may be longer than it was.
    result : Result
        What there is of the run.
    progress : Progress
        Told the phase `compile`.

    Raises
    ------
    ResultFileError
        No whole state, or one that is not of this system.
    """
    spec = model.dynamics
    newest = result.last_state()
    if spec is None or newest is None:
        raise ResultFileError(f"{result.path}: holds no state to go on from; run the scene again")
    rows, arrays = newest
    clock, name = Clock(), method_name(spec)
    if PACE in arrays and arrays[PACE].shape == (5,):
        name = tuple(METHODS)[int(arrays[PACE][2])]
    chosen = chosen_method(spec, name)
    units = prepare_integration(compiled.system, chosen, progress)
    clock.lap("compile" if units else "load")
    first, rank = _first_pose(compiled, arrays, result, rows)
    settings = loop_settings(compiled, spec, chosen, rank == n_free(compiled))
    if settings.step == 0.0 and PACE in arrays:
        settings = with_tolerance(settings, spec, chosen, compiled, float(arrays[PACE][0]))
    doubtful: tuple[str, ...] = ()
    if rank is not None and rank < compiled.layout.nc:
        doubtful, _ = redundant_reactions(compiled, model, first)
    state = new_state(compiled.system, len(compiled.layout.channels))
    prepared = prepared_run(
        compiled, model, name, state, settings, clock, notes=(), rows_before=rows,
        doubtful=doubtful,
    )  # fmt: skip
    _restore(prepared, arrays, result)
    clock.lap("assemble")
    return prepared


def _restore(prepared: Prepared, arrays: dict[str, np.ndarray], result: Result) -> None:
    """Fill in the saved arrays.

    Raises
    ------
    ResultFileError
        They are not those of this run.
    """
    own = prepared.saved()
    fits = arrays.keys() == own.keys() and all(
        arrays[name].shape == array.shape and arrays[name].dtype == array.dtype
        for name, array in own.items()
    )
    if not fits:
        what = "its saved state is of another version of flexmb; run the scene again"
        raise ResultFileError(f"{result.path}: {what}")
    for name, array in own.items():
        array[...] = arrays[name]
    if result.status == "finished":  # it is to go on for longer
        prepared.pace[1], prepared.pace[3:] = 1.0, 0.0


def _first_pose(
    compiled: Compiled, arrays: dict[str, np.ndarray], result: Result, rows: int
) -> tuple[np.ndarray, int | None]:
    """Positions (nq,) of the first row, and the rank of the constraints there as at the start."""
    first = new_state(compiled.system, len(compiled.layout.channels))
    try:
        first.q[:], first.v[:] = arrays["first_q"], arrays["first_v"]
    except (KeyError, ValueError):
        return first.q, None  # of another version, which is told
    work = new_work(compiled.system)
    solve_stage(compiled.system, first, work, ACCELERATIONS)
    return first.q, constraint_rank(compiled, work)
