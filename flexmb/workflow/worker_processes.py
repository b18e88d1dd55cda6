"""Worker processes of this machine, or the workers of a Dask scheduler, for many runs.

In: a number of workers, or an address. Out: a Dask client with these workers. Worker processes are
started new: they never execute the script that started them. Each runs its jobs one after the other
on one core and returns a record of each, also of failures.
"""

from __future__ import annotations

import faulthandler
import functools
import gc
import hashlib
import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

from flexmb.errors import FlexmbError, OutputError
from flexmb.folders import scratch_folder

REACH = 5.0
"""Seconds within which a scheduler must answer."""

_CONFIG = {
    # the client repeats jobs itself, since it distinguishes their failures
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.work-stealing": False,
}
_MAX_STARTS = 3  # attempts to start processes that end before they become workers


Record = dict[str, Any]
Function = Callable[[Any], Record]
TOO_LONG = "given up"
DIED = "its process ended abruptly each time"
_GRACE = 5.0  # s after its limit, when a run that has not stopped itself is ended with its worker
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_ONE_RUN = threading.Lock()  # a process runs one job at a time, whatever its number of threads


def connect(address: str) -> Any:
    """A client of the scheduler at an address.

    Raises
    ------
    FlexmbError
        There is none, or it has another version of Dask.
    """
    from distributed import Client

    client, why = None, ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # versions are compared below
            client = Client(address, timeout=REACH, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError, AssertionError) as error:
        cause = str(error.__cause__ or error).strip().splitlines()
        why = f" ({cause[-1]})" if cause and isinstance(error, ValueError) else ""
    if client is None:
        # otherwise its remains would be closed while the next one starts, and block forever
        gc.collect()
        raise FlexmbError(
            f"no Dask scheduler answers at {address} within {REACH:.0f} s{why}: give the address "
            "that it prints when it starts, such as tcp://host:8786"
        )
    try:
        compare_versions(client.get_versions())
    except BaseException:
        client.close()
        raise
    return client


def compare_versions(versions: dict[str, Any]) -> None:
    """Refuse another version of Dask, whose messages may not be understood."""
    here = versions["client"]["packages"]
    others = {"the scheduler": versions["scheduler"], **versions["workers"]}
    for where, other in others.items():
        for package in ("python", "distributed"):
            there = (other or {}).get("packages", {}).get(package)
            mine = here[package]
            if package == "python":  # only the minor version must be equal
                mine, there = (".".join(str(one).split(".")[:2]) for one in (mine, there))
            if there != mine:
                what = f"{where} has {package} {there}, and this process {mine}"
                raise FlexmbError(f"{what}: install equal versions on all machines")


class LocalWorkers:
    """Worker processes of this machine and their scheduler, as a context manager."""

    def __init__(self, count: int, dashboard: bool) -> None:
        self.count, self.dashboard = count, dashboard
        self.processes: list[subprocess.Popen[bytes]] = []
        self.starts = 0
        self.arrivals: list[str] = []  # addresses of all workers so far

    def __enter__(self) -> Self:
        import dask
        from distributed import Client, LocalCluster, SchedulerPlugin

        class Arrivals(SchedulerPlugin):  # type: ignore[misc]
            def add_worker(_, scheduler: Any, worker: str) -> None:  # noqa: N805
                self.arrivals.append(worker)

        self.folder = scratch_folder()
        self.log = Path(self.folder.name) / "workers.log"
        with (
            dask.config.set({**_CONFIG, "temporary-directory": self.folder.name}),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")  # a warning about another port than the requested one
            self.cluster = LocalCluster(
                n_workers=0, processes=False, protocol="tcp://", host="127.0.0.1",
                dashboard_address="127.0.0.1:8787" if self.dashboard else None, silence_logs=False,
            )  # fmt: skip
        try:
            self.cluster.scheduler.add_plugin(Arrivals(), name="arrivals")
            self.client: Any = Client(self.cluster, set_as_default=False)
            for _ in range(self.count):
                self._start()
            self._await_first()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _start(self) -> None:
        package = str(Path(__file__).parents[2])
        paths = [package, *filter(None, sys.path)]  # includes the modules of the caller's functions
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths))}
        environment |= {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
        with self.log.open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "distributed.cli.dask_worker",
                 self.cluster.scheduler_address, "--no-nanny", "--nthreads", "1",
                 "--no-dashboard", "--memory-limit", "0", "--death-timeout", "60",
                 "--local-directory", self.folder.name],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment,
                start_new_session=True,  # Ctrl-C reaches this process, which then ends them
            )  # fmt: skip
        self.processes.append(process)
        self.starts += 1

    def _await_first(self) -> None:
        while not self.arrivals:
            time.sleep(0.02)
            self.restart()

    def restart(self) -> None:
        """Start a new process for each that has ended.

        Raises
        ------
        FlexmbError
            They end before they become workers.
        """
        for process in [one for one in self.processes if one.poll() is not None]:
            self.processes.remove(process)
            if self.starts - len(self.arrivals) - len(self.processes) >= _MAX_STARTS:
                text = self.log.read_text(encoding="utf-8", errors="replace")
                printed = text.strip().splitlines()
                why = f": {printed[-1]}" if printed else ""
                raise FlexmbError(f"worker processes end as soon as they start{why}")
            self._start()

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
        for process in self.processes:
            process.wait()
        for one in (getattr(self, "client", None), self.cluster):
            if one is not None:
                with suppress(Exception):
                    one.close()
        with suppress(OSError):
            self.folder.cleanup()


@contextmanager
def silent_dask() -> Iterator[None]:
    """Keep Dask from writing to the screen."""
    import logging

    import distributed  # noqa: F401  sets the levels of its own loggers

    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


"""Start of the reason of a run that took longer than its limit."""

"""Start of the reason of a run whose workers died."""


def attempt(function: Function, job: Any) -> Record:
    """The record of a job; if it fails, with the reason."""
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
    """A progress that measures the processor time of the integration, and gives up a long run.

    The integration starts when the assembly ends. The time is that of the thread, since idle
    threads of dense algebra wait actively. Use `one_thread`, so that no other thread computes.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.cpu = 0.0
        self._wall_start, self._cpu_start = time.perf_counter(), time.thread_time()

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if phase != "integrate":
            self._wall_start, self._cpu_start = time.perf_counter(), time.thread_time()
            return
        self.cpu = time.thread_time() - self._cpu_start
        if self.limit and time.perf_counter() - self._wall_start > self.limit:
            raise FlexmbError(f"{TOO_LONG} after {self.limit:.3g} s, at {detail}")


def do_batch(
    function: Function, jobs: Sequence[Any], limit: float, required: tuple[str, ...]
) -> tuple[list[Record], float, OutputError | None]:
    """On a worker: the records of jobs, their wall time [s], and the error that keeps it from
    writing.

    Raises
    ------
    FlexmbError
        The worker has other software than the process that sent the jobs.
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
    """Let a run use one core only."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    for name in _THREADS:  # for libraries that are loaded later
        os.environ.setdefault(name, "1")


@functools.cache
def software() -> tuple[str, str]:
    """Python, and flexmb with a hash of its sources: these must be equal on all workers."""
    import flexmb

    python = ".".join(map(str, sys.version_info[:2]))
    return f"Python {python},", f"flexmb {flexmb.__version__} {source_key()}"


@functools.cache
def source_key() -> str:
    """Hash of the sources that a run uses."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for folder in ("analysis", "engine", "fe", "flexbody", "model", "results", "workflow"):
        for path in sorted((root / folder).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
