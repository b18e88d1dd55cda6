"""The runs of a study: jobs done in processes of this machine, their records on disk.

In: jobs, plain data that can be sent to another process. Out: their records, those on disk first.
With one worker the jobs are done in this process, one after the other, which disturbs timings
least. A run that fails is a record too. A record is written last and in one piece: a run without
one was interrupted. Ctrl-C ends the workers; every run that has ended stays on disk.

The folder of a job has a key of all that the run depends on: the scene, the files that it reads,
the sources of flexmb.
"""

from __future__ import annotations

import functools
import hashlib
import json
import multiprocessing
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import FlexmbError
from flexmb.workflow.check_all import process_pool

if TYPE_CHECKING:
    from flexmb.model import Model

Record = dict[str, Any]
Report = Callable[[int, int, str], None]

_FORMAT = 1
_RECORD = "run.json"
_SOURCES = ("analysis", "engine", "fe", "flexbody", "model", "results", "workflow")
_DIGITS = 16
_GIVEN_UP = "given up"  # how the reason begins of a run that took longer than its limit
_DIED = "its process ended abruptly: it was killed, or memory ran out"
_GUARD = (
    "the processes of the study ended before any run did. In a script the call of flexmb.study "
    'belongs under  if __name__ == "__main__":  ; else memory may have run out (try workers=1)'
)


@dataclass(frozen=True)
class Job:
    """A run, or with no repeats the reduction of the flexible bodies of its model."""

    label: str  # its values, for people
    scene: dict[str, Any]  # its paths are relative to `source`
    source: str  # folder of the scene
    folder: str  # of the result and record
    bodies: str = ""  # folder of the reduced bodies; empty: none
    repeats: int = 1  # how often to integrate
    workers: int = 1  # how many runs are done at the same time
    limit: float = 0.0  # s, after which one integration is given up; 0: none


def content_key(data: Any) -> str:
    """Hash of plain data; the order of tables' keys does not matter."""
    text = json.dumps(data, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def run_key(model: Model, scene: Mapping[str, Any]) -> str:
    """Key of a run: its scene as resolved, the files that it reads, the code that runs it."""
    contents = {}
    for name, spec in model.bodies.items():
        for source in ("mesh", "flexbody", "modes"):
            path = getattr(spec, source, None)
            if isinstance(path, str):
                contents[f"{name}.{source}"] = _file_key(model.path(path))
    return content_key([_FORMAT, _source_key(), scene, contents])


@functools.cache
def _source_key() -> str:
    """Hash of the sources that a run goes through."""
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for folder in _SOURCES:
        for path in sorted((root / folder).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def _file_key(path: Path) -> str:
    """Hash of a file; empty if it cannot be read, which the run itself reports."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:_DIGITS]
    except OSError:
        return ""


def result_file(folder: str | Path) -> Path:
    """The result file of a run in its folder."""
    return Path(folder) / "result.h5"


def _read_record(folder: Path) -> Record | None:
    try:
        record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and record.get("format") == _FORMAT else None


def _write_record(folder: Path, record: Record) -> None:
    draft = folder / f"{_RECORD}.new"
    draft.write_text(json.dumps({"format": _FORMAT, **record}, indent=1), encoding="utf-8")
    os.replace(draft, folder / _RECORD)


class Workers:
    """Processes that do jobs; made by :func:`open_workers`."""

    def __init__(self, count: int, fresh: bool) -> None:
        self.count, self.fresh = count, fresh
        self.reused = 0
        self._records: dict[str, Record] = {}  # by folder
        self._pool: ProcessPoolExecutor | None = None

    def run(self, jobs: Sequence[Job], report: Report) -> list[Record]:
        """Records of the jobs, in their order.

        Parameters
        ----------
        jobs : sequence of Job
            What to do; equal folders are done once.
        report : callable
            Called after each job: how many are done, of how many, the label of the last.
        """
        todo = {job.folder: job for job in jobs if not self._reuse(job)}
        for i, (job, record) in enumerate(self._results(list(todo.values()))):
            self._records[job.folder] = record
            report(i + 1, len(todo), job.label)
        return [self._records[job.folder] for job in jobs]

    def _reuse(self, job: Job) -> bool:
        """Whether the job was done in this study, or in an earlier one that may be used."""
        if job.folder in self._records:
            return True
        record = None if self.fresh else _read_record(Path(job.folder))
        if record is None or record["repeats"] < job.repeats:
            return False
        if record["reason"].startswith(_GIVEN_UP):
            return False  # it may have been the machine that was busy
        lost = not result_file(job.folder).is_file()
        if job.repeats and record["status"] == "finished" and lost:
            return False
        if job.repeats > 1 and record["workers"] != job.workers:
            return False  # times of parallel runs and of single runs are not compared
        self._records[job.folder] = record
        self.reused += 1
        return True

    def _results(self, jobs: list[Job]) -> Iterator[tuple[Job, Record]]:
        if self.count == 1:
            for job in jobs:
                yield job, do_job(job)
            return
        left = {job.folder: job for job in jobs}
        try:
            for job, record in self._run_parallel(jobs):
                del left[job.folder]
                yield job, record
        except BrokenProcessPool:
            if not self._records and len(left) == len(jobs):
                raise FlexmbError(_GUARD) from None
            self._pool = None
            for job in left.values():  # one at a time, to find which one it was
                yield job, self._run_alone(job)

    def _run_parallel(self, jobs: list[Job]) -> Iterator[tuple[Job, Record]]:
        if not jobs:
            return
        if self._pool is None:
            self._pool = process_pool(self.count)
        futures: dict[Future[Record], Job] = {self._pool.submit(do_job, job): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()

    def _run_alone(self, job: Job) -> Record:
        with process_pool(1) as pool:
            try:
                return pool.submit(do_job, job).result()
            except BrokenProcessPool:
                return {"status": "failed", "reason": _DIED, "repeats": 0, "workers": 1}

    def close(self) -> None:
        """End the processes once they have nothing left to do."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


@contextmanager
def open_workers(count: int, fresh: bool) -> Iterator[Workers]:
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


def do_job(job: Job) -> Record:
    """Do a job and write its record; a failure is recorded with its reason."""
    folder = Path(job.folder)
    folder.mkdir(parents=True, exist_ok=True)
    result_file(folder).unlink(missing_ok=True)  # of a run that was interrupted
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run of the scene itself shows them
        try:
            record = _run(job, folder) if job.repeats else _reduce(job, folder)
            record |= {"status": "finished", "reason": ""}
        except FlexmbError as error:
            record = {"status": "failed", "reason": _reason(folder, error)}
        except Exception as error:  # noqa: BLE001  one bad run must not end the study
            what = f"failed unexpectedly ({type(error).__name__}: {error})"
            record = {"status": "failed", "reason": what}
    record |= {"label": job.label, "repeats": job.repeats, "workers": job.workers}
    _write_record(folder, record)
    return record


def _reduce(job: Job, folder: Path) -> Record:
    from flexmb.model import Model
    from flexmb.workflow import flexible_bodies

    model = Model.from_scene_dict(job.scene, Path(job.source))
    started = time.perf_counter()
    flexible_bodies(model, folder, fresh=True)  # else its time would be that of reading
    return {"seconds": time.perf_counter() - started}


def _run(job: Job, folder: Path) -> Record:
    """Integrate `repeats` times; the times of all, the statistics of the first run."""
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.workflow import run_model

    model = Model.from_scene_dict(job.scene, Path(job.source))
    files = sorted(Path(job.bodies).glob("*.flexbody.h5")) if job.bodies else []
    for file in files:
        shutil.copy2(file, folder / file.name)
    statistics: list[dict[str, Any]] = []
    cpu: list[float] = []
    for _ in range(job.repeats):
        timer = _RunTimer(job.limit)
        report = run_model(model, folder, pictures=False, progress=timer)
        if Result(report.result).status == "stopped":
            raise KeyboardInterrupt
        statistics.append(report.statistics)
        cpu.append(timer.cpu)
    for file in files:  # one copy serves all runs of the model
        (folder / file.name).unlink()
    seconds = [float(one["seconds_integrate"]) for one in statistics]
    return {"seconds": seconds, "cpu_seconds": cpu, "statistics": statistics[0]}


class _RunTimer:
    """A progress that takes the processor time of the integration, and gives up a long one.

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
            raise FlexmbError(f"{_GIVEN_UP} after {self.limit:.3g} s, at {detail}")


def _reason(folder: Path, error: FlexmbError) -> str:
    """Why a run failed: the sentence of its result, else that of the error."""
    from flexmb.results import Result

    try:
        run = Result(result_file(folder))
    except FlexmbError:
        return str(error)
    return run.message if run.status == "failed" and run.message else str(error)
