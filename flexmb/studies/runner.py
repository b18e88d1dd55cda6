"""A study from end to end: settings, reduction of bodies, runs, references, errors.

In: a scene or a model, and knobs with values. Out: a :class:`Study`. Runs that an earlier call left
in the same folder are used again. The first tight run of every group is done together with the
settings, so that no process waits.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.folders import writable_folder
from flexmb.model import Model
from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.mesh_body import MeshBodySpec
from flexmb.model.scenes.study import StudySpec, sweep_values
from flexmb.progress import Progress, silent
from flexmb.studies.channel_errors import Reading, check_sensors, difference, own_errors, read_run
from flexmb.studies.reference import Reference, ReferenceRun, ReferenceSearch
from flexmb.studies.report import Study
from flexmb.studies.rows import Error, Row
from flexmb.studies.study_settings import (
    Setting,
    StudySource,
    change_model,
    is_numerical,
    label,
    make_settings,
)
from flexmb.studies.workers import Job, Record, Workers, open_workers, result_file, run_key

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
    fresh: bool = False,
    progress: Progress = silent,
    **criteria: Any,
) -> Study:
    """Run all combinations of some knobs and say what accuracy costs.

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
        Runs at the same time, each in a process; 1: one after the other in this process, which
        disturbs the timings least.
    fresh : bool
        Run again what is there already.
    progress : Progress
        Told the phases `reduce`, `study` and `reference`.
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
    """
    if isinstance(scene, str | Path):
        source = StudySource.of_scene(scene, overrides, output)
    elif overrides:
        raise SceneError("overrides are for scene files; change the model itself")
    else:
        source = StudySource.of_model(scene, output)
    spec = _spec(source.model, vary, criteria)
    if workers < 1:
        raise SceneError(f"workers: at least one is needed, given {workers}")
    settings = make_settings(source, spec.vary)
    good = [setting for setting in settings if setting.model is not None]
    assert good[0].model is not None  # `make_settings` refuses a study without any
    check_sensors(good[0].model, spec.sensors)
    writable_folder(source.output)
    with open_workers(workers, fresh) as pool:
        return StudyRunner(source, spec, pool, progress).run(settings)


def _spec(model: Model, vary: Mapping[str, Any] | None, criteria: Mapping[str, Any]) -> StudySpec:
    """`[study]` of the scene, with the values given here in place of its own."""
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


class StudyRunner:
    """One study while it is run."""

    def __init__(
        self, source: StudySource, spec: StudySpec, workers: Workers, progress: Progress
    ) -> None:
        self.source, self.spec, self.workers = source, spec, workers
        self.progress = progress
        self.reductions: dict[str, Record] = {}  # by folder
        self.records: dict[Setting, Record] = {}
        self.readings: dict[Setting, Reading] = {}

    def run(self, settings: Sequence[Setting]) -> Study:
        """Run everything that the settings need."""
        groups: dict[str, list[Setting]] = {}
        for setting in settings:
            if setting.model is not None:
                groups.setdefault(setting.group, []).append(setting)
        good = [setting for members in groups.values() for setting in members]
        searches = {key: ReferenceSearch(members) for key, members in groups.items()}
        self._reduce(good)
        first = {key: search.next_runs([], 0.0) for key, search in searches.items()}
        self._run(good, searches, first)
        while True:
            tighter = {key: self._next_runs(groups[key], one) for key, one in searches.items()}
            if not any(tighter.values()):
                break
            self._run([], searches, tighter)
        references = {
            key: search.reference(self._readings(groups[key])) for key, search in searches.items()
        }
        return self._study(settings, references)

    def _reduce(self, settings: Sequence[Setting]) -> None:
        """Reduce the flexible bodies of every model once."""
        jobs: dict[str, Job] = {}
        for setting in settings:
            folder = self._bodies_folder(setting.model)
            if folder and folder not in jobs:
                jobs[folder] = Job(
                    label=label({k: v for k, v in setting.values.items() if not is_numerical(k)}),
                    scene=setting.scene,
                    source=str(self.source.folder),
                    folder=folder,
                    repeats=0,
                )
        self.reductions = dict(zip(jobs, self._do("reduce", [*jobs.values()]), strict=True))

    def _bodies_folder(self, model: Model | None) -> str:
        """Where the reduced bodies of a model are; empty if it has none."""
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
        return str(self.source.output / "bodies" / run_key(model, reductions))

    def _run(
        self,
        settings: Sequence[Setting],
        searches: Mapping[str, ReferenceSearch],
        reference_runs: Mapping[str, Sequence[ReferenceRun]],
    ) -> None:
        """Do tight runs, which take longest, and settings; store their histories and records."""
        pairs = [(searches[key], one) for key, runs in reference_runs.items() for one in runs]
        tight = [prepared for pair in pairs for prepared in self._reference_job(*pair)]
        jobs = [job for *_, job in tight] + [self._setting_job(setting) for setting in settings]
        records = self._do("study" if settings else "reference", jobs)
        for (search, one, model, job), record in zip(tight, records, strict=False):
            search.add(one, *self._reading(model, job, record))
        timed = zip(settings, jobs[len(tight) :], records[len(tight) :], strict=True)
        for setting, job, record in timed:
            reading, self.records[setting] = self._reading(setting.model, job, record)
            self.records[setting]["folder"] = job.folder
            if reading is not None:
                self.readings[setting] = reading

    def _next_runs(self, members: Sequence[Setting], search: ReferenceSearch) -> list[ReferenceRun]:
        seconds = sum(sum(self.records[one].get("seconds", ())) for one in members)
        return search.next_runs(self._readings(members), seconds)

    def _readings(self, members: Sequence[Setting]) -> list[Reading]:
        return [self.readings[one] for one in members if one in self.readings]

    def _reference_job(
        self, search: ReferenceSearch, run: ReferenceRun
    ) -> Iterator[tuple[ReferenceSearch, ReferenceRun, Model, Job]]:
        """The job of a tight run; none if the model refuses its values, such as below round-off."""
        try:
            values = {**search.finest.complete, **run.changes}
            model, scene = change_model(self.source, values)
        except SceneError as error:
            search.add(run, None, {"reason": str(error)})
            return
        yield search, run, model, self._new_job(model, scene, run.label, 1, run.limit)

    def _setting_job(self, setting: Setting) -> Job:
        assert setting.model is not None
        return self._new_job(
            setting.model, setting.scene, label(setting.values), self.spec.repeats, 0.0
        )

    def _new_job(
        self, model: Model, scene: dict[str, Any], name: str, repeats: int, limit: float
    ) -> Job:
        resolved = model.to_scene_dict(self.source.folder)
        return Job(
            label=name,
            scene=scene,
            source=str(self.source.folder),
            folder=str(self.source.output / "runs" / run_key(model, resolved)),
            bodies=self._bodies_folder(model),
            repeats=repeats,
            workers=self.workers.count,
            limit=limit,
        )

    def _do(self, phase: str, jobs: Sequence[Job]) -> list[Record]:
        if not jobs:
            return []
        self.progress(phase, 0.0, f"{len(jobs)} runs")

        def report(done: int, of: int, last: str) -> None:
            self.progress(phase, done / (of + 1), f"{done} of {of} runs, last: {last}")

        records = self.workers.run(jobs, report)
        self.progress(phase, 1.0)
        return records

    def _reading(
        self, model: Model | None, job: Job, record: Record
    ) -> tuple[Reading | None, Record]:
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
            (record["label"], float(record["seconds"]))
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
            workers=self.workers.count,
            reused=self.workers.reused,
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
            reduction=float(bodies.get("seconds", 0.0)),
        )

    def _errors(self, setting: Setting, reference: Reference) -> dict[str, Error]:
        if reference.reading is None:
            return {}
        return {
            name: Error(one.value, reference.floors[name], one.where, reference.shown(name))
            for name, one in difference(self.readings[setting], reference.reading).items()
        }
