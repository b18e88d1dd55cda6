"""The course of a study: bodies reduced, settings run, the truth of each group found, errors taken.

In: the settings. Out: a :class:`Study`. The first tight run of every group goes along with the
settings, so that no process waits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, SceneError
from flexmb.model import Model
from flexmb.model.bodies.body import BodySpec
from flexmb.model.bodies.mesh_body import MeshBodySpec
from flexmb.model.tasks.study import StudySpec
from flexmb.progress import Progress
from flexmb.studies.base import Base
from flexmb.studies.measure import Reading, difference, own_errors, read_run
from flexmb.studies.plan import Setting, changed_model, is_numerical
from flexmb.studies.pool import Workers
from flexmb.studies.reference import Search, Tight, Truth
from flexmb.studies.report import Error, Row, Study
from flexmb.studies.store import Store, run_key
from flexmb.studies.words import label
from flexmb.studies.worker import Job

__all__ = ["Course"]

Record = dict[str, Any]
_REDUCED = tuple(key for key in MeshBodySpec.model_fields if key not in BodySpec.model_fields)
_FAILED: Record = {"status": "failed", "reason": "its result cannot be read", "seconds": []}


class Course:
    """One study under way."""

    def __init__(
        self, base: Base, spec: StudySpec, store: Store, pool: Workers, progress: Progress
    ) -> None:
        self.base, self.spec, self.store, self.pool = base, spec, store, pool
        self.progress = progress
        self.reductions: dict[str, Record] = {}  # by folder
        self.records: dict[Setting, Record] = {}
        self.readings: dict[Setting, Reading] = {}

    def study(self, settings: Sequence[Setting]) -> Study:
        """Do everything that the settings ask for."""
        groups: dict[str, list[Setting]] = {}
        for setting in settings:
            if setting.model is not None:
                groups.setdefault(setting.group, []).append(setting)
        good = [setting for members in groups.values() for setting in members]
        searches = {key: Search(members) for key, members in groups.items()}
        self._reduce(good)
        first = {key: search.next_runs([], 0.0) for key, search in searches.items()}
        self._run(good, searches, first)
        while True:
            tighter = {key: self._wanted(groups[key], one) for key, one in searches.items()}
            if not any(tighter.values()):
                break
            self._run([], searches, tighter)
        truths = {key: search.truth(self._read(groups[key])) for key, search in searches.items()}
        return self._report(settings, truths)

    def _reduce(self, settings: Sequence[Setting]) -> None:
        """Reduce the flexible bodies of every model once."""
        jobs: dict[str, Job] = {}
        for setting in settings:
            folder = self._bodies(setting.model, setting.scene)
            if folder and folder not in jobs:
                jobs[folder] = Job(
                    label=label({k: v for k, v in setting.values.items() if not is_numerical(k)}),
                    scene=setting.scene,
                    source=str(self.base.folder),
                    folder=folder,
                    repeats=0,
                )
        self.reductions = dict(zip(jobs, self._do("reduce", [*jobs.values()]), strict=True))

    def _bodies(self, model: Model | None, scene: Mapping[str, Any]) -> str:
        """Where the reduced bodies of a model are; empty if it has none."""
        assert model is not None
        tables = model.to_scene_dict(self.base.folder)["bodies"]
        found = {
            name: {key: tables[name][key] for key in _REDUCED if key in tables[name]}
            for name, spec in model.bodies.items()
            if isinstance(spec, MeshBodySpec)
        }
        return str(self.store.bodies_folder(run_key(model, found))) if found else ""

    def _run(
        self,
        settings: Sequence[Setting],
        searches: Mapping[str, Search],
        wanted: Mapping[str, Sequence[Tight]],
    ) -> None:
        """Do tight runs, which take longest, and settings; hand on what they gave."""
        tight = [(searches[key], one) for key, runs in wanted.items() for one in runs]
        made = [run for search, one in tight for run in self._tight(search, one)]
        jobs = [job for *_, job in made] + [self._job(setting) for setting in settings]
        records = self._do("study" if settings else "reference", jobs)
        for (search, one, model, job), record in zip(made, records, strict=False):
            search.take(one, *self._reading(model, job, record))
        timed = zip(settings, jobs[len(made) :], records[len(made) :], strict=True)
        for setting, job, record in timed:
            reading, self.records[setting] = self._reading(setting.model, job, record)
            self.records[setting]["folder"] = job.folder
            if reading is not None:
                self.readings[setting] = reading

    def _wanted(self, members: Sequence[Setting], search: Search) -> list[Tight]:
        seconds = sum(sum(self.records[one].get("seconds", ())) for one in members)
        return search.next_runs(self._read(members), seconds)

    def _read(self, members: Sequence[Setting]) -> list[Reading]:
        return [self.readings[one] for one in members if one in self.readings]

    def _tight(self, search: Search, tight: Tight) -> Iterator[tuple[Search, Tight, Model, Job]]:
        """The job of a tight run; none if the model refuses its values, such as below round-off."""
        try:
            values = {**search.finest.values, **tight.changes}
            model, scene = changed_model(self.base, values)
        except SceneError as error:
            search.take(tight, None, {"reason": str(error)})
            return
        yield search, tight, model, self._new_job(model, scene, tight.label, 1, tight.limit)

    def _job(self, setting: Setting) -> Job:
        assert setting.model is not None
        return self._new_job(
            setting.model, setting.scene, label(setting.values), self.spec.repeats, 0.0
        )

    def _new_job(
        self, model: Model, scene: dict[str, Any], name: str, repeats: int, limit: float
    ) -> Job:
        resolved = model.to_scene_dict(self.base.folder)
        return Job(
            label=name,
            scene=scene,
            source=str(self.base.folder),
            folder=str(self.store.run_folder(run_key(model, resolved))),
            bodies=self._bodies(model, scene),
            repeats=repeats,
            workers=self.pool.count,
            limit=limit,
        )

    def _do(self, phase: str, jobs: Sequence[Job]) -> list[Record]:
        if not jobs:
            return []
        self.progress(phase, 0.0, f"{len(jobs)} runs")

        def told(done: int, of: int, last: str) -> None:
            self.progress(phase, done / (of + 1), f"{done} of {of} runs, last: {last}")

        records = self.pool.run(jobs, told)
        self.progress(phase, 1.0)
        return records

    def _reading(
        self, model: Model | None, job: Job, record: Record
    ) -> tuple[Reading | None, Record]:
        assert model is not None
        if record["status"] != "finished":
            return None, dict(record)
        try:
            return read_run(model, Path(job.folder), self.spec.sensors), dict(record)
        except FlexmbError:
            return None, {**record, **_FAILED}

    def _report(self, settings: Sequence[Setting], truths: Mapping[str, Truth]) -> Study:
        rows = [self._row(setting, truths.get(setting.group)) for setting in settings]
        reductions = [
            (record["label"], float(record["seconds"]))
            for record in self.reductions.values()
            if record["status"] == "finished"
        ]
        sentences: dict[str, str] = {}
        for setting in settings:
            if setting.group in truths:
                sentences.setdefault(setting.group, truths[setting.group].sentence)
        return Study(
            title=self.base.model.title or self.base.source,
            source=self.base.source,
            folder=self.base.output,
            rows=rows,
            target=self.spec.target,
            repeats=self.spec.repeats,
            workers=self.pool.count,
            reused=self.pool.reused,
            references=sentences,
            reductions=reductions,
        )

    def _row(self, setting: Setting, truth: Truth | None) -> Row:
        if setting.model is None or truth is None:
            return Row(setting.values, "refused", setting.refusal, group=setting.group)
        record = self.records[setting]
        if record["status"] != "finished":
            return Row(setting.values, "failed", record["reason"], group=setting.group)
        errors = self._errors(setting, truth)
        own = own_errors(record["statistics"])
        errors |= {name: Error(value, value, "", True) for name, value in own.items()}
        assert setting.model.dynamics is not None
        return Row(
            values=setting.values,
            status="finished",
            reason="",
            group=setting.group,
            physics=setting.physics,
            finest=setting.physics == truth.physics,
            errors=errors,
            seconds=tuple(record["seconds"]),
            cpu_seconds=tuple(record["cpu_seconds"]),
            duration=setting.model.dynamics.duration,
            statistics=record["statistics"],
            folder=record["folder"],
            reduction=self._reduction(setting),
        )

    def _errors(self, setting: Setting, truth: Truth) -> dict[str, Error]:
        if truth.reading is None:
            return {}
        found = difference(self.readings[setting], truth.reading)
        return {
            name: Error(one.value, truth.floors[name], one.where, truth.shown(name))
            for name, one in found.items()
        }

    def _reduction(self, setting: Setting) -> float:
        record = self.reductions.get(self._bodies(setting.model, setting.scene), {})
        return float(record.get("seconds", 0.0))
