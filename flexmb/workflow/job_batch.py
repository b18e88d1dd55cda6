"""Jobs of a run each, done one after the other: what a worker does, and the records of failures.

In: a function and some jobs. Out: a record of each. A process does one job at a time on one core.
"""

from __future__ import annotations

import faulthandler
import functools
import hashlib
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, OutputError

Record = dict[str, Any]
Function = Callable[[Any], Record]

TOO_LONG = "given up"
"""How the reason begins of a run that took longer than its limit."""

DIED = "its process ended abruptly each time"
"""How the reason begins of a run whose workers died."""

_GRACE = 5.0  # s after its limit, when a run that does not end by itself is ended with its worker
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def attempt(function: Function, job: Any) -> Record:
    """The record of a job; that of a failure says why."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run of the scene itself shows them
        try:
            return {"status": "finished", "reason": "", **function(job)}
        except OutputError:
            raise
        except FlexmbError as error:
            return failure(str(error))
        except Exception as error:  # noqa: BLE001  one bad run must not end the others
            return failure(f"failed unexpectedly ({type(error).__name__}: {error})")


def failure(reason: str) -> Record:
    """The record of a run that failed."""
    return {"status": "failed", "reason": reason}


class RunTimer:
    """A progress that takes the processor time of the integration, and gives up a long run.

    The integration begins where the assembly ends.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.cpu = 0.0
        self._wall_start, self._cpu_start = time.perf_counter(), time.process_time()

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if phase != "integrate":
            self._wall_start, self._cpu_start = time.perf_counter(), time.process_time()
            return
        self.cpu = time.process_time() - self._cpu_start
        if self.limit and time.perf_counter() - self._wall_start > self.limit:
            raise FlexmbError(f"{TOO_LONG} after {self.limit:.3g} s, at {detail}")


_ONE_RUN = threading.Lock()  # a process does one at a time, whatever number of threads it has


def do_batch(
    function: Function, jobs: Sequence[Any], limit: float, required: tuple[str, ...]
) -> tuple[list[Record], float, OutputError | None]:
    """On a worker: the records of jobs, their wall time [s], and what keeps it from writing.

    Raises
    ------
    FlexmbError
        The worker has other software than the process that sends the jobs.
    """
    if software() != required:
        here, there = " ".join(software()), " ".join(required)
        raise FlexmbError(f"a worker has other software ({here}) than this process ({there})")
    _use_one_thread()
    records: list[Record] = []
    with _ONE_RUN, open(os.devnull, "wb") as nowhere:
        start = time.perf_counter()
        try:
            for job in jobs:
                if limit:
                    faulthandler.dump_traceback_later(limit + _GRACE, exit=True, file=nowhere)
                records.append(attempt(function, job))
        except OutputError as error:
            return records, time.perf_counter() - start, error
        finally:
            faulthandler.cancel_dump_traceback_later()
        return records, time.perf_counter() - start, None


@functools.cache
def _use_one_thread() -> None:
    """One run uses one core."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    for name in _THREADS:  # for libraries that are loaded later
        os.environ.setdefault(name, "1")


@functools.cache
def software() -> tuple[str, str]:
    """Python, and flexmb with a hash of its sources: what must be equal on all workers."""
    import flexmb

    python = ".".join(map(str, sys.version_info[:2]))
    return f"Python {python},", f"flexmb {flexmb.__version__} {source_key()}"


@functools.cache
def source_key() -> str:
    """Hash of the sources that a run goes through."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for folder in ("analysis", "engine", "fe", "flexbody", "model", "results", "workflow"):
        for path in sorted((root / folder).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
