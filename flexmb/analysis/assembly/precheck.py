"""The first state of a model in plain Python, before anything is compiled for it.

In: what finds the first state. Out: what is wrong with the model, told in a second and not after
a minute of compiling. The state itself is thrown away: what a run computes never depends on what is
in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress

from flexmb.engine.compile import Compiled
from flexmb.engine.jit import Unit
from flexmb.engine.units import interpretation, load_units
from flexmb.progress import Progress, silent

__all__ = ["precheck"]

# Sizes up to which plain Python takes about two seconds, as measured: 600 coordinates of rigid
# bodies 0.5 to 1.4 s, a body of 86 modes with a quasi-static start 2.1 s.
_MAX_COORDINATES = 600
_MAX_MODES_SQUARED = 6000  # summed over the bodies


def precheck(
    compiled: Compiled,
    units: Iterable[Unit],
    find_first_state: Callable[[], object],
    progress: Progress = silent,
) -> None:
    """Try to find the first state in plain Python, if units are missing and the model is small.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    units : iterable of Unit
        What its analysis calls; loaded if all are in the cache, and then nothing is tried.
    find_first_state : callable
        What is tried.
    progress : Progress
        Told the phase `load` where all units are there.

    Raises
    ------
    FlexmbError
        What is wrong with the model.
    """
    if load_units(units, progress) or not _is_small(compiled):
        return
    # A number out of a function's domain, which machine code goes on with, may raise in Python.
    with interpretation(), suppress(ArithmeticError, ValueError):
        find_first_state()


def _is_small(compiled: Compiled) -> bool:
    modes = (compiled.system.parts.bodies["m"] ** 2).sum()
    return bool(compiled.layout.nv <= _MAX_COORDINATES and modes <= _MAX_MODES_SQUARED)
