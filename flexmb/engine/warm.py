"""Compile, or load from the cache, all that a run needs, with progress.

Compilation happens once per machine, version of flexmb and combination of features in a scene; it
would otherwise hide in the first call.
"""

from __future__ import annotations

from typing import Any

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher

from flexmb.engine import march, sweep
from flexmb.engine.consistent import RESIDUAL, solve_level
from flexmb.engine.jit import kernel_names, light_compilation
from flexmb.engine.method import Method, Settings, n_stages
from flexmb.engine.tables import System
from flexmb.engine.work import new_state, new_work
from flexmb.progress import Progress, silent

__all__ = ["compile_kernels"]


class _Count(event.Listener):
    """Tells the progress of every finished kernel."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.done = 0

    def on_start(self, event: event.Event) -> None:
        """Nothing: only finished kernels count."""

    def on_end(self, event: event.Event) -> None:
        """Count one kernel."""
        self.done += 1
        share = min(self.done / max(len(kernel_names), 1), 0.99)
        self.progress("compile", share, f"{self.done} kernels, once per machine")


def compile_kernels(
    system: System, method: Method, channels: int, progress: Progress = silent
) -> int:
    """Make the time loop and the single solves ready for a system; returns kernels compiled.

    Parameters
    ----------
    system : System
        The compiled system; only the types of its tables matter.
    method : Method
        The integrator.
    channels : int
        Number of sensor channels.
    progress : Progress
        Told the phase `compile`.
    """
    state, work = new_state(system, channels), new_work(system, channels, n_stages(method))
    settings = Settings(0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 2, 1.0, 1, 0, 0, 0)
    output = march.new_output(system, 1, channels)
    count = _Count(progress)
    progress("compile", 0.0)
    with event.install_listener("numba:compile", count):
        with light_compilation():
            _compile(solve_level, system, state, work, RESIDUAL)
        _compile(march.march, system, method, settings, state, work, output, 1)
    progress("compile", 1.0)
    return count.done


def compile_sweep(system: System, channels: int, progress: Progress = silent) -> int:
    """Make the kinematic analysis ready for a system, and nothing else; returns kernels compiled.

    Parameters are those of :func:`compile_kernels`.
    """
    state, work = new_state(system, channels), new_work(system, channels)
    settings, path = sweep.Sweep(0.0, 1.0, 1, 0.0, 0), sweep.new_path(system)
    output = march.new_output(system, 1, channels)
    count = _Count(progress)
    progress("compile", 0.0)
    with event.install_listener("numba:compile", count), light_compilation():
        # full optimisation takes a fifth longer and gains nothing here
        _compile(sweep.sweep, system, settings, state, work, path, output, sweep.POINTS, 1)
    progress("compile", 1.0)
    return count.done


def _compile(entry: Any, *arguments: Any) -> None:
    """Compile an entry for the types of the arguments, or load it (nothing to do without JIT)."""
    if isinstance(entry, Dispatcher):
        entry.compile(tuple(numba.typeof(argument) for argument in arguments))
