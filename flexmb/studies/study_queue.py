"""The jobs of a study as they are done: each once, and none that an earlier study has done.

In: jobs, each with what is to be done with its record. Out: records in the table of the study, and
results in its folder. Jobs may be added while others are done. A worker of another machine that
does not see the folder is sent what it lacks.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from flexmb.folders import output_errors, read_json, whole_file, writable_folder
from flexmb.progress import Progress
from flexmb.studies.channel_errors import read_statistics
from flexmb.studies.record_table import KEY, RecordTable
from flexmb.studies.study_jobs import SENT, WANTED, FileCopies, Job, do_job, files_key, result_file
from flexmb.workflow.cluster import Cluster
from flexmb.workflow.job_batch import DIED, TOO_LONG, Record

Owner = Callable[[Record], None]


class StudyQueue:
    """Jobs that wait, are under way or have ended; for a ``with`` statement.

    Attributes
    ----------
    workers : int
        Runs at the same time.
    reused : int
        Jobs that an earlier study had done.
    """

    def __init__(self, cluster: Cluster, table: RecordTable, progress: Progress) -> None:
        self.workers, self.reused = cluster.count, 0
        self._cluster, self._table, self._progress = cluster, table, progress
        self._earlier = {row[KEY]: row for row in table.rows().to_pylist()}
        self._records: dict[str, Record] = {}  # of this study, by key
        self._owners: dict[str, list[Owner]] = {}  # of jobs that have not ended
        self._values: dict[str, Mapping[str, Any]] = {}  # of the same
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
        """Do a job, before those that wait if it is to be first.

        Parameters
        ----------
        job : Job
            What to do; equal ones are done once.
        values : mapping
            Of the knobs, for the table.
        owner : callable
            Called with the record, at once if there is one already.
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
        """Do all jobs, and those that owners add meanwhile, each within a wall time [s] if any."""
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
        """The record of a job that was done in this study, or in an earlier one."""
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
    """A row of the table as the record that it was; a damaged one is a missing one."""
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
        return record if len(record["seconds"]) >= max(1, record["repeats"]) * ended else None
    except (LookupError, TypeError, ValueError, OverflowError):
        return None
