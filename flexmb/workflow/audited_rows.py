"""The rows of a run that an audit looks at, or those of a run with more of them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import FlexmbError

if TYPE_CHECKING:
    from flexmb.analysis.effects.stored_motion import Motion
    from flexmb.engine.compile import Compiled
    from flexmb.model import Model
    from flexmb.results import Result

_ROUGH = 0.2  # of velocities against accelerations between rows, relative
_RINGS = 0.003  # of what a sensor shows: so much may ring faster than the rows
_ENOUGH = 1.1  # times as many rows for turns and what rings would be better: these do
_MORE_ROWS = 4  # times as many where these do not
_MOST_NUMBERS = 1.2e7  # of a matrix of the coordinates in all rows: 100 MB


def resolved_motion(
    motion: Motion, compiled: Compiled, model: Model, most_rows: int,
    run: Callable[[Model], Result] | None,
) -> tuple[Motion, list[str]]:  # fmt: skip
    """At most so many rows of a motion that resolve it, and what to say of them.

    Parameters
    ----------
    motion, compiled, model
        The rows of a run, and its model.
    most_rows : int
        More of them, four times at most, are taken only of another run, of a model that is not too
        large for it, where so many do not resolve accelerations, turns, and what rings at sensors.
    run : callable, optional
        Runs a model; None: it cannot be run again.
    """
    from flexmb.analysis.effects.stored_motion import read_motion
    from flexmb.model.excitation import driving_frequencies

    rows, thinned, notes = motion, motion.thinned(most_rows), []
    fastest = max((hertz for _, hertz in driving_frequencies(model)), default=0.0)
    limits = list(_limits(compiled, most_rows))
    for most in limits:
        thinned = rows.thinned(most)
        better = max(thinned.turns(compiled, fastest), _rings(model, compiled, thinned))
        if most > most_rows and better <= _ENOUGH and thinned.gap(compiled) <= _ROUGH:
            break
        finer = max(thinned.finer(compiled, fastest), better)
        wanted = int(np.ceil((len(thinned.t) - 1) * finer))
        if most < limits[-1] <= wanted and better > _ENOUGH * (most / len(thinned.t)) ** 2:
            continue  # what rings falls with the fourth power of the rows at best: more are needed
        n = min(wanted, most - 1)
        if finer > 1.0 and n > len(rows.t) and model.dynamics is not None and run is not None:
            other = copy.copy(model)
            other.dynamics = model.dynamics.model_copy(update={"outputs": n})
            try:
                rows = read_motion(run(other))
            except FlexmbError as error:  # one with other steps may fail
                why = str(error).splitlines()[0]
                notes.append(
                    f"a run with {n + 1} rows, which would resolve the motion, fails: {why}"
                )
                break
            thinned = rows.thinned(most)
            notes = [f"{len(motion.t)} rows do not resolve the motion: audited with {n + 1}"]
    if fastest * np.diff(thinned.t).max() > 0.5:
        loads = f"{model.units.say(fastest, 'Hz', 2)} that drive the scene"
        notes.append(f"the {len(thinned.t)} rows do not see the {loads}")
    if (gap := thinned.gap(compiled)) > _ROUGH:
        notes.append(
            f"the {len(thinned.t)} rows resolve the accelerations of the bodies to "
            f"{100 * gap:.2g} % only: the estimates are rough"
        )
    return thinned, notes


def _rings(model: Model, compiled: Compiled, motion: Motion) -> float:
    """How many times as many rows resolve what rings at the sensors."""
    from flexmb.analysis.effects.contribution import fast_shares

    rings = fast_shares(model, motion.channels, compiled.layout.channels).values()
    return float(np.sqrt(max(rings, default=0.0) / _RINGS))


def _limits(compiled: Compiled, most_rows: int) -> Iterator[int]:
    """How many rows there may be, at first and then."""
    yield most_rows
    affordable = int(_MOST_NUMBERS / compiled.layout.nv**2)
    if affordable > most_rows:
        yield from 2 * [min(affordable, _MORE_ROWS * most_rows)]
