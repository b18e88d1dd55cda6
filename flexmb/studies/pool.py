"""Doing the jobs of a study: in processes of this machine, side by side.

In: jobs. Out: their records, those on disk first. With one worker the jobs are done in this very
process, one after the other, which disturbs timings least. Ctrl-C ends the workers; every run that
has ended is kept.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError
from flexmb.studies.store import has_result, read_record
from flexmb.studies.worker import GIVEN_UP, Job, be_a_worker, do

__all__ = ["Workers", "workers_of"]

Record = dict[str, Any]
Told = Callable[[int, int, str], None]
_DIED = "its process ended abruptly: it was killed, or memory ran out"
_GUARD = (
    "the processes of the study ended before any run did. In a script the call of flexmb.study "
    'belongs under  if __name__ == "__main__":  ; else memory may have run out (try workers=1)'
)


class Workers:
    """Processes that do jobs; made by :func:`workers_of`."""

    def __init__(self, count: int, fresh: bool) -> None:
        self.count, self.fresh = count, fresh
        self.reused = 0
        self._done: dict[str, Record] = {}
        self._pool: ProcessPoolExecutor | None = None

    def run(self, jobs: Sequence[Job], told: Told) -> list[Record]:
        """Records of the jobs, in their order.

        Parameters
        ----------
        jobs : sequence of Job
            What to do; equal folders are done once.
        told : callable
            Told after each job: how many are done, of how many, the label of the last.
        """
        todo = {job.folder: job for job in jobs if not self._kept(job)}
        whole = len(todo)
        for i, (job, record) in enumerate(self._results(list(todo.values()))):
            self._done[job.folder] = record
            told(i + 1, whole, job.label)
        return [self._done[job.folder] for job in jobs]

    def _kept(self, job: Job) -> bool:
        """Whether the job was done in this study, or in an earlier one that may be used."""
        if job.folder in self._done:
            return True
        record = None if self.fresh else read_record(Path(job.folder))
        if record is None or record["repeats"] < job.repeats:
            return False
        if record["reason"].startswith(GIVEN_UP):
            return False  # it may have been the machine that was busy
        if job.repeats and record["status"] == "finished" and not has_result(Path(job.folder)):
            return False
        if job.repeats > 1 and record["workers"] != job.workers:
            return False  # times taken side by side and alone are not compared
        self._done[job.folder] = record
        self.reused += 1
        return True

    def _results(self, jobs: list[Job]) -> Iterator[tuple[Job, Record]]:
        if self.count == 1:
            for job in jobs:
                yield job, do(job)
            return
        left = {job.folder: job for job in jobs}
        try:
            for job, record in self._together(jobs):
                del left[job.folder]
                yield job, record
        except BrokenProcessPool:
            if not self._done and len(left) == len(jobs):
                raise FlexmbError(_GUARD) from None
            self._pool = None
            for job in left.values():  # one at a time, to find which one it was
                yield job, self._alone(job)

    def _together(self, jobs: list[Job]) -> Iterator[tuple[Job, Record]]:
        if not jobs:
            return
        if self._pool is None:
            self._pool = _new_pool(self.count)
        futures: dict[Future[Record], Job] = {self._pool.submit(do, job): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()

    def _alone(self, job: Job) -> Record:
        with _new_pool(1) as pool:
            try:
                return pool.submit(do, job).result()
            except BrokenProcessPool:
                return {"status": "failed", "reason": _DIED, "repeats": 0, "workers": 1}

    def close(self) -> None:
        """End the processes once they have nothing left to do."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


@contextmanager
def workers_of(count: int, fresh: bool) -> Iterator[Workers]:
    """Processes for the jobs of a study; those on disk are used again unless `fresh`."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise FlexmbError(_GUARD)  # a worker has run the script that started it
    before = set(multiprocessing.active_children())
    workers = Workers(count, fresh)
    try:
        yield workers
    except KeyboardInterrupt:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        workers.close()


def _new_pool(count: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, mp_context=context, initializer=be_a_worker)
