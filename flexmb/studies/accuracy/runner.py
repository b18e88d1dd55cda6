"""A study from end to end: settings, reduction of bodies, runs, references, errors.

In: a scene or a model, and knobs with values. Out: a :class:`Study`. Runs of an earlier call in the
same folder are reused. The reference runs of a group are done at the same time as its settings, as
far as they do not depend on them, so that no worker waits.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.folders import writable_folder
from flexmb.model import Model
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.effects import active_model
from flexmb.model.scenes.study import StudySpec, sweep_values
from flexmb.progress import Progress, silent
from flexmb.studies.accuracy.reference import Reference, ReferenceRun, ReferenceSearch
from flexmb.studies.accuracy.report import Study
from flexmb.studies.accuracy.rows import Error, Row
from flexmb.studies.channel_errors import (
    RunHistories,
    check_sensors,
    difference,
    own_errors,
    read_run,
)
from flexmb.studies.record_table import RecordTable
from flexmb.studies.study_jobs import Job, StudyQueue, content_key, result_file, run_key
from flexmb.studies.study_settings import (
    Setting,
    StudySource,
    change_model,
    check_units,
    is_numerical,
    label,
    make_settings,
    refused_values,
)
from flexmb.workflow.cluster import open_cluster
from flexmb.workflow.flexible_bodies import survey_bodies
from flexmb.workflow.worker_processes import Record

REDUCTION_FIELDS = tuple(
    key for key in MeshBodySpec.model_fields if key not in FlexibleBodySpec.model_fields
)
_FAILED: Record = {"status": "failed", "reason": "its result cannot be read", "seconds": []}


def study(
    scene: str | Path | Model,
    vary: Mapping[str, Any] | None = None,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    workers: int = 2,
    scheduler: str = "",
    limit: float = 0.0,
    dashboard: Callable[[str], object] | None = None,
    fresh: bool = False,
    progress: Progress = silent,
    **criteria: Any,
) -> Study:
    """Run all combinations of some knobs and report what accuracy costs.

    Parameters
    ----------
    scene : path or Model
        A scene file, or a model made in Python.
    vary : mapping, optional
        Knob to values: a path such as ``"bodies.rod.modes"``, a parameter, or a field of
        ``[dynamics]``; a list, or a text such as ``"1e-2..1e-6"`` or ``"1e-3..1e-5:5"``. By default
        those of ``[study]`` in the scene.
    output : path, optional
        Folder of the study; ``out/<scene>/study`` by default. Runs that are there already are used
        again.
    overrides : mapping, optional
        Values of a scene file to change for all runs.
    workers : int
        Number of runs at the same time, each in a process; 1: one after the other in this process,
        which disturbs the timings least.
    scheduler : str
        Address of a Dask scheduler, such as ``"tcp://host:8786"``, whose workers are used instead.
    limit : float
        Wall time of an integration [s], after which it is given up; 0: none.
    dashboard : callable, optional
        Serve Dask's dashboard, and report its address by this function, such as ``print``.
    fresh : bool
        Repeat runs that exist already.
    progress : Progress
        Told the phases `reduce` and `study`.
    **criteria
        ``repeats`` of each run (3), ``target`` error (0.01), ``sensors`` (all), in place of those
        of ``[study]``.

    Returns
    -------
    Study
        Errors and times of all settings.

    Raises
    ------
    SceneError
        Unknown knobs, or values of which the model takes none; everything wrong with the scene.
    OutputError
        The folder cannot be written.
    FlexmbError
        The folder holds a study of another scene, or no scheduler answers.
    """
    source = StudySource.of(scene, overrides, output, "study")
    spec = _spec(source.model, vary, criteria)
    problems = check_units(source, spec.vary)
    settings = _surveyed(source, make_settings(source, spec.vary))
    if problems := [*problems, *refused_values(settings)]:
        raise SceneError.from_problems(problems)
    good = [setting for setting in settings if setting.model is not None]
    assert good[0].model is not None  # a study without any model is refused before
    check_sensors(good[0].model, spec.sensors)
    writable_folder(source.output)
    about = {"scene": f"{source.model.title} ({Path(source.file).name})"}
    with (
        RecordTable(source.output / "runs.parquet", about, fresh=fresh) as table,
        open_cluster(workers, scheduler, dashboard=dashboard) as cluster,
        StudyQueue(cluster, table, progress) as queue,
    ):
        return StudyRunner(source, spec, queue, limit).run(settings)


def _surveyed(source: StudySource, settings: Sequence[Setting]) -> list[Setting]:
    """The settings; those whose meshes or body files have mistakes are marked as refused."""
    reasons: dict[str, str] = {}
    surveyed = []
    for setting in settings:
        reason = ""
        if setting.model is not None:
            model = active_model(setting.model)
            key = content_key([model.to_scene_dict(source.folder)["bodies"]])
            if key not in reasons:
                problems = survey_bodies(model)[1]
                reasons[key] = "\n".join(map(str, problems))
            reason = reasons[key]
        surveyed.append(Setting(setting.values, refusal=reason) if reason else setting)
    return surveyed


def _spec(model: Model, vary: Mapping[str, Any] | None, criteria: Mapping[str, Any]) -> StudySpec:
    """`[study]` of the scene, updated by the values given here."""
    allowed = tuple(name for name in StudySpec.model_fields if name != "vary")
    unknown = [name for name in criteria if name not in allowed]
    problems = [Problem(name, "unknown", allowed, nearest(name, allowed)) for name in unknown]
    if vary is not None and not isinstance(vary, Mapping):
        problems.append(Problem("vary", "knobs with their values are expected"))
    fields: dict[str, Any] = {} if model.study is None else model.study.model_dump()
    fields |= {name: value for name, value in criteria.items() if value is not None}
    if vary:
        fields["vary"] = {}
        for knob, values in vary.items():
            try:
                fields["vary"][knob] = sweep_values(values)
            except SceneError as error:
                problems += [Problem(f"vary {knob}", problem.what) for problem in error.problems]
    if problems:
        raise SceneError.from_problems(problems)
    if "vary" not in fields:
        what = 'no knob to vary: give some, or [study] with vary = { accuracy = "1e-2..1e-6" }'
        raise SceneError(what)
    changed = copy.copy(model)
    spec = changed.set_study(**fields)
    problems = [problem for problem in changed.problems() if problem.where.startswith("study")]
    if problems:
        raise SceneError.from_problems(problems)
    return spec


@dataclass
class _Group:
    """The settings of a machine and the search for their reference, during the study."""

    members: list[Setting]
    search: ReferenceSearch
    settings_left: int
    reference_runs_left: int = 0
    complete: bool = False


class StudyRunner:
    """A study during its runs."""

    def __init__(
        self, source: StudySource, spec: StudySpec, queue: StudyQueue, limit: float
    ) -> None:
        self.source, self.spec, self.queue, self.limit = source, spec, queue, limit
        self.reductions: dict[str, Record] = {}  # by folder
        self.records: dict[Setting, Record] = {}
        self.readings: dict[Setting, RunHistories] = {}

    def run(self, settings: Sequence[Setting]) -> Study:
        """Do all runs that the settings need."""
        members: dict[str, list[Setting]] = {}
        for setting in settings:
            if setting.model is not None:
                members.setdefault(setting.group, []).append(setting)
        groups = {
            key: _Group(some, ReferenceSearch(some), len(some)) for key, some in members.items()
        }
        self._reduce([setting for group in groups.values() for setting in group.members])
        for group in groups.values():
            for setting in group.members:
                self._add_setting(group, setting)
            self._search_on(group)
        self.queue.run("study", self.limit * self.spec.repeats)
        references = {
            key: group.search.reference(self._readings(group)) for key, group in groups.items()
        }
        return self._study(settings, references)

    def _reduce(self, settings: Sequence[Setting]) -> None:
        """Reduce the flexible bodies of every model once."""
        for setting in settings:
            folder = self._bodies_folder(setting.model)
            if folder and folder not in self.reductions:
                self.reductions[folder] = {}
                values = {k: v for k, v in setting.values.items() if not is_numerical(k)}
                job = Job(label(values), setting.scene, str(self.source.folder), folder, repeats=0)

                def store(record: Record, folder: str = folder) -> None:
                    self.reductions[folder] = record

                self.queue.add(job, values, store)
        self.queue.run("reduce", 0.0)

    def _bodies_folder(self, model: Model | None) -> str:
        """Folder of the reduced bodies of a model; empty if it has none."""
        assert model is not None
        tables = model.to_scene_dict(self.source.folder)["bodies"]
        reductions = {
            name: {key: tables[name][key] for key in REDUCTION_FIELDS if key in tables[name]}
            | {"stiffened": "geometric_stiffening" in spec.words()}
            for name, spec in model.bodies.items()
            if isinstance(spec, MeshBodySpec)
        }
        if not reductions:
            return ""
        key = run_key(reductions, self.source.folder)
        return str(self.source.output.resolve() / "bodies" / key)

    def _add_setting(self, group: _Group, setting: Setting) -> None:
        """Queue a setting; its history and record are stored when it ends."""
        assert setting.model is not None
        model = setting.model
        job = self._new_job(
            model, setting.scene, label(setting.values), self.spec.repeats, self.limit
        )

        def store(record: Record) -> None:
            reading, self.records[setting] = self._reading(model, job, record)
            self.records[setting]["folder"] = str(self.source.output / "runs" / job.key)
            if reading is not None:
                self.readings[setting] = reading
            group.settings_left -= 1
            self._search_on(group)

        self.queue.add(job, setting.values, store)

    def _search_on(self, group: _Group) -> None:
        """Queue the next reference runs; from the third stage on they depend on all settings."""
        while not group.complete and not group.reference_runs_left:
            if group.search.stage > 1 and group.settings_left:
                return
            records = (self.records.get(one, {}) for one in group.members)
            seconds = sum(sum(record.get("cpu_seconds", ())) for record in records)
            runs = group.search.next_runs(self._readings(group), seconds)
            group.complete = not runs
            group.reference_runs_left = len(runs)
            for run in runs:
                self._add_tight(group, run)

    def _add_tight(self, group: _Group, run: ReferenceRun) -> None:
        """Queue a reference run before all settings, since it takes longest."""
        try:
            values = {**group.search.finest.complete, **run.changes}
            model, scene = change_model(self.source, values)
        # its values are refused, for example because they are below round-off
        except SceneError as error:
            group.search.add(run, None, {"reason": str(error)})
            group.reference_runs_left -= 1
            return
        limit = min(filter(None, (run.limit, self.limit)), default=0.0)
        job = self._new_job(model, scene, run.label, 1, limit)

        def store(record: Record) -> None:
            group.search.add(run, *self._reading(model, job, record))
            group.reference_runs_left -= 1
            self._search_on(group)

        self.queue.add(job, values, store, first=True)

    def _readings(self, group: _Group) -> list[RunHistories]:
        return [self.readings[one] for one in group.members if one in self.readings]

    def _new_job(
        self, model: Model, scene: dict[str, Any], name: str, repeats: int, limit: float
    ) -> Job:
        key = run_key(model.to_scene_dict(self.source.folder), self.source.folder)
        return Job(
            label=name,
            scene=scene,
            source=str(self.source.folder),
            folder=str(self.source.output.resolve() / "runs" / key),
            bodies=self._bodies_folder(model),
            repeats=repeats,
            limit=limit,
        )

    def _reading(
        self, model: Model | None, job: Job, record: Record
    ) -> tuple[RunHistories | None, Record]:
        assert model is not None
        if record["status"] != "finished":
            return None, dict(record)
        try:
            return read_run(model, result_file(job.folder), self.spec.sensors), dict(record)
        except FlexmbError:
            return None, {**record, **_FAILED}

    def _study(self, settings: Sequence[Setting], references: Mapping[str, Reference]) -> Study:
        rows = [self._row(setting, references.get(setting.group)) for setting in settings]
        reductions = [
            (record["label"], record["seconds"][0])
            for record in self.reductions.values()
            if record["status"] == "finished"
        ]
        sentences: dict[str, str] = {}
        for setting in settings:
            if setting.group in references:
                sentences.setdefault(setting.group, references[setting.group].sentence)
        return Study(
            title=self.source.model.title or self.source.file,
            source=self.source.file,
            folder=self.source.output,
            rows=rows,
            target=self.spec.target,
            repeats=self.spec.repeats,
            workers=self.queue.workers,
            reused=self.queue.reused,
            references=sentences,
            reductions=reductions,
        )

    def _row(self, setting: Setting, reference: Reference | None) -> Row:
        if setting.model is None or reference is None:
            return Row(setting.values, "refused", setting.refusal, group=setting.group)
        record = self.records[setting]
        if record["status"] != "finished":
            return Row(setting.values, "failed", record["reason"], group=setting.group)
        errors = self._errors(setting, reference)
        own = own_errors(record["statistics"])
        errors |= {name: Error(value, value, "", True) for name, value in own.items()}
        bodies = self.reductions.get(self._bodies_folder(setting.model), {})
        assert setting.model.dynamics is not None
        return Row(
            values=setting.values,
            status="finished",
            reason="",
            group=setting.group,
            physics=setting.physics,
            finest=setting.physics == reference.physics,
            errors=errors,
            seconds=tuple(record["seconds"]),
            cpu_seconds=tuple(record["cpu_seconds"]),
            duration=setting.model.dynamics.duration,
            statistics=record["statistics"],
            folder=record["folder"],
            reduction=bodies.get("seconds", [0.0])[0],
        )

    def _errors(self, setting: Setting, reference: Reference) -> dict[str, Error]:
        if reference.reading is None:
            return {}
        return {
            name: Error(one.value, reference.floors[name], one.where, reference.shown(name))
            for name, one in difference(self.readings[setting], reference.reading).items()
        }
