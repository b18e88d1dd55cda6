"""The runs of an error budget: a scene with some values changed, each done once and kept.

In: changes of a scene. Out: histories, processor time and statistics by changes; of what fails the
reason. Bodies that the run of the scene itself has reduced are not reduced again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flexmb.errors import FlexmbError
from flexmb.folders import read_json, read_regular, whole_file, writable_folder
from flexmb.model import Model
from flexmb.progress import Progress
from flexmb.studies.channel_errors import Reading, read_run, read_statistics
from flexmb.studies.error_shares import Shares
from flexmb.studies.study_jobs import content_key, result_file, run_key
from flexmb.studies.study_settings import StudySource, change_model
from flexmb.workflow.cluster import Cluster
from flexmb.workflow.job_batch import Record, RunTimer

_RECORD = "budget_run.json"
_AUDIT = "audit"


class Run(NamedTuple):
    """A run that has ended: its histories, or why there are none."""

    reading: Reading | None
    reason: str = ""
    cpu: float = 0.0
    statistics: Mapping[str, Any] = {}
    folder: str = ""


class ChangedRuns:
    """Runs of the scene with changes, each done once."""

    def __init__(
        self, source: StudySource, folder: Path, cluster: Cluster, sensors: Sequence[str],
        fresh: bool, progress: Progress,
    ) -> None:  # fmt: skip
        self.source, self.folder, self.cluster = source, folder, cluster
        self.sensors, self.fresh, self.progress = sensors, fresh, progress
        self.ended: dict[str, Run] = {}
        self.audit: Record = {}
        self.names: list[tuple[str, str]] = []  # quantities and names of histories
        self.bodies = ""  # folder of a run whose reduced bodies others may use

    def __getitem__(self, changes: Mapping[str, Any]) -> Run:
        return self.ended[content_key(changes)]

    def do(self, phase: str, several: Sequence[Mapping[str, Any]], audit: str = "") -> None:
        """Do those of the runs that have not been done, and the audit of the run in a folder."""
        jobs: dict[str, dict[str, Any]] = {}
        models: dict[str, Model] = {}
        for changes in several:
            key = content_key(changes)
            if key in self.ended or key in jobs:
                continue
            try:
                models[key], scene = change_model(self.source, changes)
            except FlexmbError as error:
                self.ended[key] = Run(None, str(error).replace("\n", "; "))
                continue
            resolved = models[key].to_scene_dict(self.source.folder)
            folder = self.folder / "runs" / run_key(resolved, self.source.folder)
            jobs[key] = {
                "key": key, "scene": scene, "source": str(self.source.folder),
                "folder": str(folder.resolve()), "bodies": self.bodies, "fresh": self.fresh,
                "limit": self.cluster.limit,
            }  # fmt: skip
        todo = [*jobs.values()]
        if audit:
            todo.append({"key": _AUDIT, "audit": True, "folder": audit, "fresh": True})
        for job, record in self.cluster.run(run_changed, todo, progress=self.progress, phase=phase):
            if job["key"] == _AUDIT:
                self.audit = record
                continue
            self.ended[job["key"]] = self._read(models[job["key"]], job["folder"], record)

    def _read(self, model: Model, folder: str, record: Record) -> Run:
        if record["status"] != "finished":
            return Run(None, str(record["reason"]).replace("\n", "; "))
        try:
            reading = read_run(model, result_file(folder), self.sensors)
        except FlexmbError as error:
            return Run(None, str(error))
        names = [one[:2] for one in reading.histories]
        self.names = self.names or names
        if names != self.names:
            return Run(None, "it has other sensors or reactions than the scene as it is")
        return Run(reading, "", float(record["cpu"]), record["statistics"], folder)


def run_changed(job: Mapping[str, Any]) -> Record:
    """Run a scene that is plain data into its folder; its processor time and statistics."""
    from flexmb.results import Result
    from flexmb.workflow import run_model

    folder = Path(job["folder"])
    if job["key"] == _AUDIT:
        return {"shares": _audit_shares(folder)}
    file = folder / _RECORD
    if result_file(folder).is_file() and not job["fresh"] and (record := _stored(file)):
        return record
    writable_folder(folder)
    for body in Path(job["bodies"]).glob("*.flexbody.h5") if job["bodies"] else ():
        if not (folder / body.name).exists():
            shutil.copy2(body, folder / body.name)
    timer = RunTimer(float(job["limit"]))
    model = Model.from_scene_dict(job["scene"], Path(job["source"]))
    report = run_model(model, folder, pictures=False, analysis="dynamics", progress=timer)
    if Result(report.result).status == "stopped":  # by Ctrl-C: its record would say finished
        raise KeyboardInterrupt
    record = {"cpu": timer.cpu, "statistics": report.statistics}
    with whole_file(file) as partial:
        partial.write_text(json.dumps(record, default=float), encoding="utf-8")
    return record


def _stored(file: Path) -> Record | None:
    """The record of a run that has ended; a damaged one is a missing one."""
    try:
        record = read_json(read_regular(file))
        return {"cpu": float(record["cpu"]), "statistics": read_statistics(record["statistics"])}
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _audit_shares(folder: Path) -> Shares:
    """By sensor the sum over bodies of the largest effect that is left out."""
    from flexmb.workflow.audit import audit

    bodies: dict[str, Shares] = {}
    for one in audit(folder).effects:
        if not one.on and one.effect != "further modes":
            own = bodies.setdefault(one.body, {})
            for channel, value in one.shares.items():
                name = channel.split(".")[0]
                own[name] = max(own.get(name, 0.0), value)
    names = {name for own in bodies.values() for name in own}
    return {name: sum(own.get(name, 0.0) for own in bodies.values()) for name in names}
