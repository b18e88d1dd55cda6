"""Many runs at the same time: workers of this machine, or those of any Dask cluster.

In: a function and jobs, plain data that can be sent to another process. Out: each job with its
record when it ends, also if it fails. With one worker and no scheduler the jobs run in this
process. Otherwise Dask distributes them to newly started processes. Only a few jobs are submitted
at a time, short ones several to a task, so that neither this process nor the scheduler grows with
the number of jobs. If a worker dies, its jobs run again, each alone; a job whose worker dies three
times has failed.
"""

from __future__ import annotations

import itertools
import queue
import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sized
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from flexmb.errors import FlexmbError
from flexmb.progress import Progress, silent
from flexmb.workflow.worker_processes import (
    DIED,
    TOO_LONG,
    Function,
    LocalWorkers,
    Record,
    attempt,
    connect,
    do_batch,
    failure,
    silent_dask,
    software,
)

_MAX_DEATHS = 3
_BATCH_SECONDS = 0.5  # wall time [s] of the runs in one task, if their number allows
_MAX_BATCH = 256
_MAX_SUSPECTS = 1000
_WORKER_TIMEOUT = 300.0  # a cluster may be without any worker for this time [s]
_POLL_INTERVAL = 0.25  # s
_RESUME = "runs that had ended are stored, and the same command continues"


@contextmanager
def open_cluster(
    workers: int = 2,
    scheduler: str = "",
    *,
    limit: float = 0.0,
    dashboard: Callable[[str], object] | None = None,
) -> Iterator[Cluster]:
    """Workers for many runs, which end with the ``with`` block.

    Parameters
    ----------
    workers : int
        Number of runs at the same time on this machine, each in a process; 1 without `limit`: in
        this process.
    scheduler : str
        Address of a Dask scheduler, such as ``"tcp://host:8786"``, whose workers are used instead.
    limit : float
        Wall time of a run [s], after which it is given up; 0: none. The function should stop
        itself; five seconds later its process is ended.
    dashboard : callable, optional
        Serve Dask's dashboard, and call this with a sentence that contains its address.

    Raises
    ------
    FlexmbError
        No scheduler answers, its software is another one, or a package is missing.

    Example
    -------
    >>> with open_cluster(workers=4) as cluster:  # doctest: +SKIP
    ...     for job, record in cluster.run(do_job, jobs):
    ...         table.append({**record, "length": job["length"]})
    """
    if workers < 1:
        raise FlexmbError(f"workers: at least one is needed, given {workers}")
    if dashboard and not scheduler and find_spec("bokeh") is None:
        what = 'the dashboard needs the package bokeh: pip install "flexmb[dashboard]"'
        raise FlexmbError(what)
    with ExitStack() as stack:
        alone = workers == 1 and not (scheduler or dashboard or limit)
        if not alone:
            stack.enter_context(silent_dask())
        if scheduler:
            client = connect(scheduler)
            stack.callback(client.close)
            cluster = Cluster(max(len(client.nthreads()), 1), limit, client, scheduler)
        elif alone:
            cluster = Cluster(1, limit)
        else:
            local = stack.enter_context(LocalWorkers(workers, dashboard is not None))
            cluster = Cluster(workers, limit, local.client, watch=local.restart)
        if dashboard is not None:
            link = cluster.client.dashboard_link
            dashboard(f"dashboard: {link}" if link else "the scheduler serves no dashboard")
        yield cluster


class Cluster:
    """Workers that run jobs; made by :func:`open_cluster`.

    Attributes
    ----------
    count : int
        Number of workers, which is the number of runs at the same time.
    limit : float
        Wall time after which a run is given up [s]; 0: none.
    """

    def __init__(
        self,
        count: int,
        limit: float,
        client: Any = None,
        scheduler: str = "",
        watch: Callable[[], None] = lambda: None,
    ) -> None:
        self.count, self.limit = count, limit
        self.client, self.scheduler, self.watch = client, scheduler, watch

    def run(
        self,
        function: Function,
        jobs: Iterable[Any],
        *,
        total: int | None = None,
        progress: Progress = silent,
        phase: str = "runs",
    ) -> Iterator[tuple[Any, Record]]:
        """Run jobs; yields each with its record when it ends, in no particular order.

        Parameters
        ----------
        function : callable
            ``function(job) -> dict``, defined at the top level of a module that workers can import.
            Data common to all jobs goes into a :func:`functools.partial`; it is sent once per task.
            Warnings are silenced.
        jobs : iterable
            Consumed as workers become free, so a generator may yield 100 000 jobs. If it is a
            :class:`collections.deque`, the caller may append jobs while it takes records, such as
            further runs that depend on them.
        total : int, optional
            Number of jobs, for the progress; ``len(jobs)`` by default.
        progress : Progress
            Called with the number of jobs that have ended, the rate, and the remaining time.
        phase : str
            Name of the progress.

        Yields
        ------
        job, record
            The record is what the function returns, with ``status`` ``"finished"`` and an empty
            ``reason`` unless it sets others. If the function raises, its worker dies three times or
            its time is over, the record has only the ``status`` ``"failed"`` and the ``reason``.

        Raises
        ------
        OutputError
            A run cannot write, for example because a disk is full.
        FlexmbError
            The scheduler or all workers are gone, or a worker has other software.
        """
        source = _Source(jobs)
        rate = _Rate(progress, phase, source, total)
        ends: Generator[tuple[Any, Record], None, None]
        if self.client is None:
            ends = ((job, attempt(function, job)) for job in source)
        else:
            ends = _Flight(self, function, source).ends()
        try:
            for job, record in ends:
                yield job, record
                rate.count()
        finally:
            ends.close()
        rate.finish()


class _Source:
    """The jobs that have not been handed out yet, one at a time."""

    def __init__(self, jobs: Iterable[Any]) -> None:
        self._queue = jobs if isinstance(jobs, deque) else None
        self._rest: Iterator[Any] = iter(() if self._queue is not None else jobs)
        self._size = len(jobs) if isinstance(jobs, Sized) else None
        self._taken = 0

    @property
    def size(self) -> int | None:
        """Number of all jobs, if known."""
        return self._size if self._queue is None else self._taken + len(self._queue)

    @property
    def left(self) -> int | None:
        """Number of jobs that are still to come, if known."""
        return None if self.size is None else self.size - self._taken

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> Any:
        if self._queue is None:
            job = next(self._rest)
        elif self._queue:
            job = self._queue.popleft()
        else:
            raise StopIteration
        self._taken += 1
        return job


class _Rate:
    """Reports to a progress how many jobs have ended, the rate, and the remaining time."""

    def __init__(self, progress: Progress, phase: str, source: _Source, total: int | None) -> None:
        self._progress, self._phase, self._source, self._total = progress, phase, source, total
        self._start, self._number, self._reported = time.perf_counter(), 0, 0.0
        if total or source.size is None or source.size:
            progress(phase, 0.0, self._of())

    def _size(self) -> int:
        return max(self._total or self._source.size or 0, self._number)

    def _of(self) -> str:
        total = self._total or self._source.size
        return f"{self._number} of {self._size()} runs" if total else f"{self._number} runs"

    def count(self) -> None:
        """One more job has ended."""
        self._number += 1
        now = time.perf_counter()
        if now - self._reported < 0.1 and self._number != self._size():
            return
        self._reported = now
        rate = self._number / max(now - self._start, 1e-9)
        left = (self._size() - self._number) / rate
        detail = f"{self._of()}, {rate:.3g} a second"
        if left:
            detail += f", {time_text(left)} left"
        size = self._size() if self._total or self._source.size else self._number + 1
        self._progress(self._phase, min(self._number / (size + 1), 0.999), detail)

    def finish(self) -> None:
        if self._number:
            self._progress(self._phase, 1.0)


def time_text(seconds: float) -> str:
    """A remaining time as text, with one or two digits."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


@dataclass
class _Batch:
    """Jobs that form one task of Dask."""

    jobs: list[tuple[Any, int]]  # each with the number of workers that died during it
    worker: str  # address of the worker if its only job runs alone; else empty
    start: float


class _Flight:
    """The jobs that are submitted to a Dask cluster."""

    def __init__(self, cluster: Cluster, function: Function, source: _Source) -> None:
        self.cluster, self.client = cluster, cluster.client
        self.function, self.source = function, source
        self.batches: dict[Any, _Batch] = {}  # by future
        self.answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.suspects: deque[tuple[Any, int]] = deque()
        self.mean = 0.0  # mean time of a run [s]; 0 before the first has ended
        self.alive = self.looked = time.perf_counter()

    def ends(self) -> Generator[tuple[Any, Record], None, None]:
        """All jobs as they end."""
        try:
            self._fill()
            while self.batches or self.suspects:
                with suppress(queue.Empty):
                    future = self.answers.get(timeout=_POLL_INTERVAL)
                    if future in self.batches:
                        yield from self._end(future)
                if time.perf_counter() - self.looked >= _POLL_INTERVAL:
                    self._look()
                self._fill()
        finally:
            with suppress(Exception):
                self.client.cancel(list(self.batches), force=True)

    def _fill(self) -> None:
        """Submit jobs while few are under way."""
        if any(batch.worker for batch in self.batches.values()):
            self._send_suspects()
            return
        while len(self.batches) < 2 * self.cluster.count and len(self.suspects) < _MAX_SUSPECTS:
            jobs = [(job, 0) for job in itertools.islice(self.source, self._size())]
            if not jobs:
                break
            self._send(jobs)
        if not self.batches:
            self._send_suspects()

    def _send_suspects(self) -> None:
        """Submit one suspect to each free worker, so that it is clear which job kills a worker."""
        if not self.suspects:
            return
        busy = {batch.worker for batch in self.batches.values()}
        for worker in self._workers():
            if worker not in busy and self.suspects:
                self._send([self.suspects.popleft()], worker)

    def _size(self) -> int:
        """Number of jobs in the next task: half a second of runs, and fewer near the end."""
        if not self.mean:
            return 1
        size = int(min(max(_BATCH_SECONDS / self.mean, 1), _MAX_BATCH))
        if self.source.left is not None:
            size = max(1, min(size, self.source.left // (4 * self.cluster.count)))
        return size

    def _send(self, jobs: list[tuple[Any, int]], worker: str = "") -> None:
        future = self.client.submit(
            do_batch,
            self.function, [job for job, _ in jobs], self.cluster.limit, software(),
            pure=False, workers=[worker] if worker else None,
        )  # fmt: skip
        self.batches[future] = _Batch(jobs, worker, time.perf_counter())
        future.add_done_callback(self.answers.put)

    def _end(self, future: Any) -> Iterator[tuple[Any, Record]]:
        from distributed import KilledWorker

        batch = self.batches.pop(future)
        if future.status in ("cancelled", "lost"):
            raise self._gone()
        error = future.exception()
        if isinstance(error, KilledWorker):
            yield from self._suspect(batch, error)
            return
        if isinstance(error, ImportError):
            raise FlexmbError(f"a worker of {self.cluster.scheduler} lacks a package: {error}")
        if error is not None:
            raise error
        records, seconds, stop = future.result()
        self.alive = time.perf_counter()
        mean = seconds / max(len(records), 1)
        self.mean = max(0.5 * (self.mean + mean) if self.mean else mean, 1e-6)
        yield from zip((job for job, _ in batch.jobs), records, strict=False)
        if stop is not None:
            raise stop

    def _suspect(self, batch: _Batch, error: Any) -> Iterator[tuple[Any, Record]]:
        """After a worker has died: its jobs run again, each alone; after three deaths a job has
        failed."""
        if not batch.worker:
            self.suspects += batch.jobs
            return
        ((job, deaths),) = batch.jobs
        deaths += 1 + getattr(error, "allowed_failures", 0)
        limit = self.cluster.limit
        if limit and time.perf_counter() - batch.start > limit:
            yield job, failure(f"{TOO_LONG} after {limit:.3g} s: its process did not answer")
        elif deaths < _MAX_DEATHS:
            self.suspects.append((job, deaths))
        else:
            what = f"{DIED} ({deaths} times): it was killed, or memory ran out"
            yield job, failure(what)

    def _look(self) -> None:
        """Check that the scheduler and workers still respond, and count the workers."""
        self.cluster.watch()
        workers = self._workers()
        self.looked = now = time.perf_counter()
        if workers:
            self.alive, self.cluster.count = now, len(workers)
        elif now - self.alive > _WORKER_TIMEOUT:
            what = f"the cluster has had no worker for {_WORKER_TIMEOUT:.0f} s"
            raise FlexmbError(f"{what}: start workers; {_RESUME}")
        for future, batch in list(self.batches.items()):
            if batch.worker and batch.worker not in workers and not future.done():
                # its worker died before the job began
                self.suspects += self.batches.pop(future).jobs
                self.client.cancel([future], force=True)

    def _workers(self) -> Collection[str]:
        """Addresses of all workers."""
        if self.client.status != "running":
            raise self._gone()
        try:
            return self.client.nthreads().keys()  # type: ignore[no-any-return]
        except (OSError, TimeoutError):
            raise self._gone() from None

    def _gone(self) -> FlexmbError:
        where = f" {self.cluster.scheduler}" if self.cluster.scheduler else ""
        return FlexmbError(f"the Dask scheduler{where} is gone: {_RESUME}")
