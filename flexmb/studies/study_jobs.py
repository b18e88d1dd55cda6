"""The runs of a study: jobs for workers on this machine or another one, and their queue.

In: a job, plain data. Out: its record in the table of the study, and its files in the folder of the
study. A worker that cannot see that folder gets the files that its job reads, once, and returns the
files that it writes. Jobs may be added while others run; none is done twice.

The name of a job's folder contains a key of everything that the run depends on: the scene, the
files that it reads, the sources of flexmb.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Self

from flexmb.errors import FlexmbError, OutputError
from flexmb.folders import output_errors, read_json, scratch_folder, whole_file, writable_folder
from flexmb.progress import Progress
from flexmb.studies.channel_errors import read_statistics
from flexmb.studies.record_table import KEY, RecordTable
from flexmb.workflow.cluster import Cluster
from flexmb.workflow.worker_processes import DIED, TOO_LONG, Record, RunTimer, failure, source_key

_FORMAT = 2
_DIGITS = 16
WANTED = "wanted"
"""The status of a job whose worker lacks the files that the job reads."""

SENT = "sent"
"""Key in a record: files by name that a job has written where the study cannot see them."""


# folder and file names of the copies in this process, by key
_COPIES: dict[str, tuple[Any, dict[str, str]]] = {}
Owner = Callable[[Record], None]


@dataclass(frozen=True)
class Job:
    """A run; with zero repeats, the reduction of the flexible bodies of its model."""

    label: str  # its values as text
    scene: dict[str, Any]  # paths in it are relative to `source`
    source: str  # folder of the scene
    folder: str  # folder of the result
    bodies: str = ""  # folder of the reduced bodies; empty: none
    repeats: int = 1  # number of integrations
    limit: float = 0.0  # s, after which one integration is given up; 0: none
    # a file by which workers recognise that they see all folders; empty: all workers do
    mark: str = ""
    copies: str = ""  # key of the files that it reads, for other workers
    files: FileCopies | None = None  # the files themselves, for a worker that lacks them

    @property
    def key(self) -> str:
        """Key of everything that the job depends on."""
        return Path(self.folder).name


@dataclass(frozen=True)
class FileCopies:
    """The files that a job reads, as data."""

    names: dict[str, str]  # path in the scene to name of the copy
    contents: dict[str, bytes]  # by name of the copy

    @classmethod
    def of(cls, job: Job) -> FileCopies:
        """All files that the scene of a job refers to, and its reduced bodies."""
        files = named_files(job.scene, Path(job.source))
        names = {text: f"{i}/{path.name}" for i, (text, path) in enumerate(files.items())}
        contents = {names[text]: path.read_bytes() for text, path in files.items()}
        for path in _body_files(job.bodies):
            contents[f"bodies/{path.name}"] = path.read_bytes()
        return cls(names, contents)


def named_files(scene: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """The files that a scene refers to, by their paths in it."""
    paths = {text: folder / text for text in texts_of(scene)}
    return {text: path for text, path in paths.items() if os.path.isfile(path)}


def files_key(job: Job) -> str:
    """Key of the files that a job reads."""
    files = named_files(job.scene, Path(job.source)) | {p.name: p for p in _body_files(job.bodies)}
    return content_key({text: _file_key(path) for text, path in files.items()})


def texts_of(value: Any) -> Iterator[str]:
    """All texts in nested tables and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for inside in value.values() if isinstance(value, Mapping) else value:
            yield from texts_of(inside)


def content_key(data: Any) -> str:
    """Hash of plain data; independent of the order of keys."""
    text = json.dumps(data, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def run_key(scene: Mapping[str, Any], folder: Path) -> str:
    """Key of a run: its resolved scene, the files that it reads, the code that runs it."""
    contents = {text: _file_key(path) for text, path in named_files(scene, folder).items()}
    return content_key([_FORMAT, source_key(), scene, contents])


def _file_key(path: Path) -> str:
    """Hash of a file; empty if it cannot be read, which the run itself reports."""
    try:
        state = path.stat()
        return _content_hash(path, state.st_mtime_ns, state.st_size)
    except OSError:
        return ""


@cache
def _content_hash(path: Path, *_: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:_DIGITS]


def result_file(folder: str | Path) -> Path:
    """The result file of a run in its folder."""
    return Path(folder) / "result.h5"


def do_job(job: Job) -> Record:
    """On a worker: run a job; a failure is recorded with its reason."""
    if not job.mark or os.path.exists(job.mark):
        return _do(job)
    copies = _place_copies(job)
    if copies is None:
        return {"status": WANTED, "reason": ""}
    folder, names = copies
    bodies = str(folder / "bodies") if job.bodies else ""
    with scratch_folder() as output:
        scene = _rename(job.scene, names)
        record = _do(replace(job, scene=scene, source=str(folder), folder=output, bodies=bodies))
        sent = {path.name: path.read_bytes() for path in Path(output).iterdir()}
    return {**record, SENT: sent}


def _place_copies(job: Job) -> tuple[Path, dict[str, str]] | None:
    """The folder of the copies for a job, and their names; None if this process lacks them."""
    if job.copies not in _COPIES:
        if job.files is None:
            return None
        folder = scratch_folder()
        for place, data in job.files.contents.items():
            path = Path(folder.name) / place
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
        _COPIES[job.copies] = folder, job.files.names
    folder, names = _COPIES[job.copies]
    return Path(folder.name), names


def _rename(value: Any, names: Mapping[str, str]) -> Any:
    """A scene with the names of the copies instead of those of the files."""
    if isinstance(value, Mapping):
        return {key: _rename(inside, names) for key, inside in value.items()}
    if isinstance(value, list | tuple):
        return [_rename(inside, names) for inside in value]
    return names.get(value, value) if isinstance(value, str) else value


def _do(job: Job) -> Record:
    folder = Path(job.folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        result_file(folder).unlink(missing_ok=True)  # left by an interrupted run
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        return _run(job, folder) if job.repeats else _reduce(job, folder)
    except OutputError:
        raise
    except FlexmbError as error:
        return failure(_reason(folder, error))


def _body_files(folder: str) -> list[Path]:
    return sorted(Path(folder).glob("*.flexbody.h5")) if folder else []


def _reduce(job: Job, folder: Path) -> Record:
    from flexmb.model import Model
    from flexmb.workflow.flexible_bodies import flexible_bodies

    model = Model.from_scene_dict(job.scene, Path(job.source))
    started = time.perf_counter()
    # fresh, so that the measured time includes the reduction
    flexible_bodies(model, folder, fresh=True)
    return {"seconds": [time.perf_counter() - started]}


def _run(job: Job, folder: Path) -> Record:
    """Integrate `repeats` times; the times of all integrations, the statistics of the first."""
    from flexmb.analysis.chunked_run import one_thread
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.workflow.simulate import run_model

    model = Model.from_scene_dict(job.scene, Path(job.source))
    files = _body_files(job.bodies)
    for file in files:
        shutil.copy2(file, folder / file.name)
    statistics: list[dict[str, Any]] = []
    cpu: list[float] = []
    for _ in range(job.repeats):
        timer = RunTimer(job.limit)
        with one_thread():
            report = run_model(model, folder, pictures=False, progress=timer)
        if Result(report.result).status == "stopped":
            raise KeyboardInterrupt
        statistics.append(report.statistics)
        cpu.append(timer.cpu)
    for file in files:  # one copy serves all runs of the model
        (folder / file.name).unlink()
    seconds = [float(one["seconds_integrate"]) for one in statistics]
    return {"seconds": seconds, "cpu_seconds": cpu, "statistics": statistics[0]}


def _reason(folder: Path, error: FlexmbError) -> str:
    """The reason of a failed run: the message of its result, else that of the error."""
    from flexmb.results import Result

    try:
        run = Result(result_file(folder))
    except FlexmbError:
        return str(error)
    return run.message if run.status == "failed" and run.message else str(error)


class StudyQueue:
    """Jobs that wait, run or have ended; a context manager.

    Attributes
    ----------
    workers : int
        Runs at the same time.
    reused : int
        Jobs that an earlier study has done.
    """

    def __init__(self, cluster: Cluster, table: RecordTable, progress: Progress) -> None:
        self.workers, self.reused = cluster.count, 0
        self._cluster, self._table, self._progress = cluster, table, progress
        self._earlier = {row[KEY]: row for row in table.rows().to_pylist()}
        self._records: dict[str, Record] = {}  # of this study, by key
        self._owners: dict[str, list[Owner]] = {}  # of jobs that have not ended
        self._values: dict[str, Mapping[str, Any]] = {}  # of the same jobs
        self._jobs: deque[Job] = deque()
        self._mark: Any = None

    def __enter__(self) -> Self:
        if self._cluster.scheduler:
            folder = self._table.file.parent.resolve()
            self._mark = tempfile.NamedTemporaryFile(dir=folder, prefix=".seen-")  # noqa: SIM115
        return self

    def __exit__(self, *_: object) -> None:
        if self._mark is not None:
            self._mark.close()

    def add(
        self, job: Job, values: Mapping[str, Any], owner: Owner, *, first: bool = False
    ) -> None:
        """Queue a job, with `first` before all that wait.

        Parameters
        ----------
        job : Job
            The job; equal jobs are done once.
        values : mapping
            Values of the knobs, for the table.
        owner : callable
            Called with the record; immediately if there is one already.
        """
        if job.key in self._owners:
            self._owners[job.key].append(owner)
        elif (record := self._stored(job)) is not None:
            owner(record)
        else:
            if self._mark is not None:
                job = replace(job, mark=self._mark.name, copies=files_key(job))
            self._owners[job.key], self._values[job.key] = [owner], values
            (self._jobs.appendleft if first else self._jobs.append)(job)

    def run(self, phase: str, limit: float) -> None:
        """Do all jobs, including those added meanwhile, each within a wall time [s] if it is not
        0."""
        self._cluster.limit = limit
        for job, record in self._cluster.run(
            do_job, self._jobs, progress=self._progress, phase=phase
        ):
            if record["status"] == WANTED:
                self._jobs.appendleft(replace(job, files=FileCopies.of(job)))
                continue
            self._store(job, record)
            for owner in self._owners.pop(job.key):
                owner(record)

    def _stored(self, job: Job) -> Record | None:
        """The record of a job that was done in this or an earlier study."""
        if job.key in self._records:
            return self._records[job.key]
        record = _readable(self._earlier.get(job.key))
        if record is None or record["repeats"] < job.repeats:
            return None
        if record["reason"].startswith((TOO_LONG, DIED)):
            return None  # it may have been the machine that was busy
        files = [result_file(job.folder)] if job.repeats else Path(job.folder).glob("*.h5")
        if record["status"] == "finished" and not any(file.is_file() for file in files):
            return None
        if job.repeats > 1 and (record["workers"] == 1) != (self.workers == 1):
            return None  # times of parallel runs and of single runs are not compared
        self.reused += 1
        self._records[job.key] = record
        return record

    def _store(self, job: Job, record: Record) -> None:
        for name, data in record.pop(SENT, {}).items():
            file = writable_folder(Path(job.folder)) / name
            with output_errors(file), whole_file(file) as partial:
                partial.write_bytes(data)
        record |= {"label": job.label, "repeats": job.repeats, "workers": self.workers}
        self._records[job.key] = record
        self._table.append({KEY: job.key, **self._values.pop(job.key), **record})


def _readable(row: Mapping[str, Any] | None) -> Record | None:
    """A row of the table as a record; None if it is damaged."""
    if row is None:
        return None
    try:
        ended, statistics = row["status"] == "finished", row.get("statistics") or "{}"
        record = {
            **row,
            "repeats": int(row["repeats"]),
            "reason": str(row["reason"] or ""),
            "seconds": [float(one) for one in row["seconds"] or ()] if ended else [],
            "statistics": read_statistics(read_json(statistics)),
        }
        if ended and record["repeats"]:
            record["cpu_seconds"] = [float(one) for one in row["cpu_seconds"]]
            if len(record["cpu_seconds"]) < record["repeats"]:
                return None
        return record if len(record["seconds"]) >= max(1, record["repeats"]) * ended else None
    except (LookupError, TypeError, ValueError, OverflowError):
        return None
