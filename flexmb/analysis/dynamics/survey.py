"""A rough run before the run: how far and how fast each part of the model will move.

The error of a step is judged by motion and speed of each coordinate so far. A machine that starts
from rest has not moved yet, and its stiff parts would be resolved as if their first tremor were all
that ever happens; with the motion of the whole run known beforehand they are not. Nothing else is
taken from the rough run: a wrong scale costs steps or another pass, no accuracy.
"""

from __future__ import annotations

from flexmb.analysis.dynamics.prepared import Prepared
from flexmb.analysis.dynamics.run import Run
from flexmb.engine import method
from flexmb.engine.integrators import STIFF_METHOD
from flexmb.engine.state import State
from flexmb.errors import FlexmbError
from flexmb.progress import Progress

__all__ = ["needs_survey", "survey"]

_ROUGH = 1e-3  # local error over the motion
_LEAST_MOTION = 1e-3  # that counts, over the size of the model


def needs_survey(prepared: Prepared) -> bool:
    """Whether a run is to know beforehand what it will move: by the method for stiff motions."""
    controlled, first = prepared.settings.step == 0.0, prepared.pace[1] == 1.0
    return prepared.method == STIFF_METHOD and controlled and bool(first)


def survey(prepared: Prepared, progress: Progress) -> None:
    """Let a run know what it will move, from a rough run."""
    own, settings = prepared.run, prepared.settings
    rough = settings._replace(
        interval=settings.end - settings.start, tolerance=_ROUGH, accuracy=_ROUGH,
        least_motion=_LEAST_MOTION,
    )  # fmt: skip
    state = State(*(array.copy() for array in prepared.first))
    state.motion[:] = state.speed[:] = 0.0
    run, status = Run(own.compiled, own.method, rough, state), method.FINE
    try:
        while status == method.FINE and not run.finished:
            status, _ = run.advance()
            progress("integrate", 0.0, f"looks ahead, t = {state.t[0]:.4g} s")
    except FlexmbError:  # too many steps: the run itself says so, if it does as well
        return
    if status != method.FINE:
        return
    states = [prepared.first, own.state]
    if prepared.verified is not None:
        states.append(prepared.verified.scout.state)
    for known in states:
        known.motion[:], known.speed[:] = state.motion, state.speed
