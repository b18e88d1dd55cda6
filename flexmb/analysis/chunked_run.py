"""The procedure of every analysis: load units, assemble, run in chunks with progress, finish.

A chunk is a fixed amount of work, never of time, so that a run is reproducible to the last bit.
Rows are stored after each chunk, so a failure or an interruption loses at most one chunk. Errors of
a small model are reported before anything is compiled for it: the first state is computed in plain
Python, in a second instead of a minute of compiling. It is then discarded, so that results never
depend on the content of the cache.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, fields
from typing import Any, Protocol, TypeVar

import numpy as np

from flexmb.analysis.assembly.jacobian import one_blas_thread
from flexmb.engine.allocation import new_output
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_units import interpretation, load_units, prepare_units
from flexmb.engine.jit import CompiledUnit
from flexmb.engine.state import Output
from flexmb.engine.tables import ENERGIES
from flexmb.errors import FlexmbError
from flexmb.progress import Progress, silent
from flexmb.results.output_block import OutputBlock

T = TypeVar("T")

_in_one_thread = ContextVar("_in_one_thread", default=False)

# Sizes up to which plain Python takes about two seconds, as measured: 600 coordinates of rigid
# bodies 0.5 to 1.4 s, a body of 86 modes with a quasi-static start 2.1 s.
_MAX_COORDINATES = 600
_MAX_MODES_SQUARED = 6000  # summed over the bodies
# Exchange of energy over the stored energy, below which a model is at rest.
_REST_SHARE = 1e-6
# Round-off of energies: this share of the larger one of two energies of all bodies: weight times
# the size of the model; mass times _NO_SPEED [1/s²] times the square of the larger one of that size
# and the distance from the origin.
_ROUND_OFF, _NO_SPEED = 1e-12, 1e-7


class Sink(Protocol):
    """A receiver of rows, such as `flexmb.results.writer.ResultWriter`."""

    def append(self, block: OutputBlock) -> None: ...
    def save_state(self, state: dict[str, np.ndarray]) -> None: ...
    def restart(self) -> None: ...


@dataclass(frozen=True)
class Outcome:
    """How an analysis ended: status, sentence, statistics, and notes for the user."""

    status: str
    message: str
    statistics: dict[str, float | int | str]
    notes: tuple[str, ...]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let runs compute in this thread only, so that its processor time is theirs."""
    before = _in_one_thread.set(True)
    try:
        with one_blas_thread():
            yield
    finally:
        _in_one_thread.reset(before)


@contextmanager
def meanwhile(function: Callable[..., T], *arguments: Any) -> Iterator[Future[T]]:
    """Call a function in a thread of its own during the context; within `one_thread` before it.

    Machine code runs beside that of this thread. An error is raised when the result is asked for.
    """
    if not _in_one_thread.get():
        with ThreadPoolExecutor(max_workers=1) as thread:
            yield thread.submit(copy_context().run, function, *arguments)
        return
    done = Future[T]()
    try:
        done.set_result(function(*arguments))
    except FlexmbError as error:
        done.set_exception(error)
    yield done


class Halt:
    """A progress that ends what calls it in another thread, once its context ends by an error."""

    def __init__(self) -> None:
        self._ended = False

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if self._ended:
            raise FlexmbError("its result is not needed any more")

    def __enter__(self) -> None: ...

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._ended = kind is not None


class PhaseTimer:
    """Wall time by phase."""

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self.seconds: dict[str, float] = {}

    def lap(self, phase: str) -> None:
        """Assign the time since the last call to a phase."""
        now = time.perf_counter()
        self.seconds[f"seconds_{phase}"] = now - self._last
        self._last = now


@dataclass(frozen=True)
class Ending:
    """How a run ended: "finished", "stopped" or "failed", and why."""

    status: str
    message: str = ""


class ChunkedRun(Protocol):
    """An analysis that computes one chunk between two calls of the progress."""

    phase: str

    @property
    def time(self) -> float:
        """Time of the state [s]."""

    @property
    def share_done(self) -> float:
        """Completed share of the run; 1 at its end."""

    def next_chunk(self) -> Ending | None:
        """Compute and store one chunk; returns an ending if the run ends early."""

    def store_unread(self) -> None:
        """Store rows of a chunk that was interrupted."""


def assemble_first_state(
    compiled: Compiled,
    units: Iterable[CompiledUnit],
    first_state: Callable[[], T],
    progress: Progress = silent,
) -> tuple[T, PhaseTimer]:
    """Load or compile units and compute the first state; returns it and the time of both.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    units : iterable of Unit
        The units that the analysis calls.
    first_state : callable
        Computes the first state.
    progress : Progress
        Receives the phases `load` or `compile`, and `assemble`.

    Raises
    ------
    FlexmbError
        What is wrong with the model.
    """
    timer, needed = PhaseTimer(), list(units)
    precheck(compiled, needed, first_state, progress)
    timer.lap("compile" if prepare_units(needed, progress) else "load")
    progress("assemble", 0.0)
    first = first_state()
    progress("assemble", 1.0)
    timer.lap("assemble")
    return first, timer


def precheck(
    compiled: Compiled,
    units: Iterable[CompiledUnit],
    first_state: Callable[[], object],
    progress: Progress = silent,
) -> None:
    """Compute the first state in plain Python, if units are missing and the model is small.

    Raises
    ------
    FlexmbError
        What is wrong with the model.
    """
    modes = (compiled.system.parts.bodies["m"] ** 2).sum()
    small = compiled.layout.nv <= _MAX_COORDINATES and modes <= _MAX_MODES_SQUARED
    if load_units(units, progress) or not small:
        return
    # an argument outside a function's domain raises in Python, but not in machine code
    with interpretation(), suppress(ArithmeticError, ValueError):
        first_state()


def run_chunks(run: ChunkedRun, progress: Progress) -> Ending:
    """The loop over chunks until the end of a run, a failure, or an interruption by the user."""
    try:
        while run.share_done < 1.0:
            ending = run.next_chunk()
            progress(run.phase, run.share_done, f"t = {run.time:.4g} s")
            if ending is not None:
                return ending
    except KeyboardInterrupt:
        run.store_unread()
        return Ending("stopped", f"stopped by the user at t = {run.time:.6g} s")
    except FlexmbError as error:
        return Ending("failed", str(error))
    return Ending("finished")


class ChunkRows:
    """Memory for the rows of a chunk; energy balance and drift of all rows so far.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    n : int
        Number of rows at most.
    """

    def __init__(self, compiled: Compiled, n: int) -> None:
        self.output: Output = new_output(compiled.system, n, len(compiled.layout.channels))
        self.unread = False
        parts, length = compiled.system.parts, compiled.length
        places = parts.bodies["iq"][:, None] + np.arange(3)
        away = max(length, np.abs(compiled.initial_q[places]).max(initial=0.0))
        square = max(float(np.linalg.norm(parts.gravity)) * length, _NO_SPEED * float(away) ** 2)
        self.balance = EnergyBalance(_ROUND_OFF * float(parts.bodies["mass"].sum()) * square)
        self.largest_drift = np.zeros(3)  # constraint drift of q and of v; largest velocity
        self._speeds = (parts.bodies["iv"][:, None] + np.arange(6)).ravel()

    def clear(self) -> None:
        """Delete the rows before a chunk, so that an interruption never stores old ones again."""
        self.output.rows[0] = 0
        self.unread = True

    def read(self) -> OutputBlock:
        """The rows of the last chunk."""
        self.unread = False
        n = int(self.output.rows[0])
        rows = OutputBlock(
            *(np.array(table[:n]) for table in self.output[: len(fields(OutputBlock))])
        )
        self.balance.update_range(self.output.extent)
        if n:
            self.balance.add(rows.energy)
            speed = np.abs(rows.v[:, self._speeds]).max(initial=0.0)
            largest = [*rows.drift.max(axis=0), speed]
            np.maximum(self.largest_drift, largest, out=self.largest_drift)
        return rows


class EnergyBalance:
    """Largest error of the energy balance, and the energy that it is compared with.

    Parameters
    ----------
    round_off : float
        Energy that is round-off [J].

    Attributes
    ----------
    tally : (17,) array
        Least and greatest value of every energy so far (7, 7); then the first difference of energy
        and work, the largest change of it, and the exchange of a model at rest. NaN: no row yet.
    """

    def __init__(self, round_off: float = 0.0) -> None:
        n = len(ENERGIES)
        self._round_off = round_off
        self.tally = np.full(2 * n + 3, np.nan)
        self._least, self._most = self.tally[:n], self.tally[n : 2 * n]
        self._rest = self.tally[2 * n :]

    def add(self, energy: np.ndarray) -> None:
        """Add energies (n, 7) of the next rows."""
        stored = energy[:, :4].sum(axis=1) - energy[:, 4:].sum(axis=1)
        if np.isnan(self._rest[0]):
            self._rest[0] = stored[0]
        off = float(np.abs(stored - self._rest[0]).max())
        # in a model at rest only round-off of the stored energy changes
        at_rest = max(_REST_SHARE * float(np.abs(energy).max()), self._round_off)
        self._rest[1:] = np.fmax(self._rest[1:], (off, at_rest))
        self.update_range(np.array([energy.min(axis=0), energy.max(axis=0)]))

    def update_range(self, extent: np.ndarray) -> None:
        """Include least and greatest energies (2 or more, 7) of steps between rows; NaN: none."""
        np.fmin(self._least, extent[0], out=self._least)
        np.fmax(self._most, extent[1], out=self._most)

    @property
    def moved(self) -> float:
        """The largest energy that moved [J]."""
        return max(float((self._most - self._least).max()), float(self._most[0]))

    @property
    def relative(self) -> float:
        """Error of the energy balance over the largest exchange of energy."""
        if np.isnan(self._rest[0]):
            return 0.0
        scale = max(self.moved, float(self._rest[2]))
        return float(self._rest[1]) / scale if scale > 0.0 else 0.0
