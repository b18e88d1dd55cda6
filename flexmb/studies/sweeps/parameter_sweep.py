"""A sweep from end to end: settings of the knobs, their runs, the answer to questions.

In: a scene or a model, knobs with distributions, scalars of channels. Out: a :class:`Sweep`. All
mistakes are reported before anything is run. Existing runs in the folder are reused.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, SceneError, nearest
from flexmb.folders import writable_folder
from flexmb.model import Model
from flexmb.model.quantities import read_number
from flexmb.model.reading import under
from flexmb.model.scenes.effects import active_model
from flexmb.model.scenes.study import leaves, override, stated_unit
from flexmb.model.scenes.sweep import (
    Distribution,
    SweepSpec,
    numbers_written,
    read_knobs,
    read_question,
)
from flexmb.progress import Progress, silent
from flexmb.studies.record_table import KEY, RecordTable
from flexmb.studies.study_jobs import content_key, run_key
from flexmb.studies.study_settings import StudySource, check_units, resolve_knobs, value_text
from flexmb.studies.sweeps.design_search import Answer, DesignSearch, Target, rounded_as_stated
from flexmb.studies.sweeps.sampling import Design, make_design, values_at
from flexmb.studies.sweeps.sweep_report import RUNS, Sweep
from flexmb.studies.sweeps.sweep_runs import (
    SECTIONS,
    Job,
    Row,
    Scalar,
    SweepScene,
    find_scalars,
    flexible_bodies_of,
    run_setting,
)
from flexmb.workflow.cluster import Cluster, open_cluster
from flexmb.workflow.flexible_bodies import bodies_of_surveys, survey_bodies
from flexmb.workflow.worker_processes import TOO_LONG

_MAX_REFUSALS = 5


def sweep(
    scene: str | Path | Model,
    vary: Mapping[str, Any] | None = None,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    histories: bool = False,
    workers: int = 2,
    scheduler: str = "",
    limit: float = 0.0,
    dashboard: Callable[[str], object] | None = None,
    fresh: bool = False,
    progress: Progress = silent,
    **settings: Any,
) -> Sweep:
    """Run a scene for many values of some knobs: statistics, sensitivities, worst cases, answers.

    Parameters
    ----------
    scene : path or Model
        A scene file, or a model made in Python.
    vary : mapping, optional
        Knob (a parameter, a path such as ``"bodies.rod.modes"``, a field of ``[dynamics]``) to a
        distribution ``"normal(0.15, 1e-4)"``, ``"uniform(low, high)"``, ``"log-uniform(low,
        high)"``, ``"triangular(low, mode, high)"``, a range ``"low..high"`` (uniform) or
        ``"low..high:5"`` (five values), or a list of values. By default those of ``[sweep]``.
    output : path, optional
        Folder of the sweep; ``out/<scene>/sweep`` by default. Existing runs in it are reused.
    overrides : mapping, optional
        Values of a scene file to change for all runs.
    histories : bool
        Whether each run leaves its result in a folder of its own.
    workers : int
        Number of runs at the same time, each in a process; 1: in this process.
    scheduler : str
        Address of a Dask scheduler, whose workers are used instead.
    limit : float
        Wall time of a run [s], after which it is given up; 0: none.
    dashboard : callable, optional
        Serve Dask's dashboard, and report its address by this function, such as ``print``.
    fresh : bool
        Repeat runs that exist already.
    progress : Progress
        Told the phases `reduce` and `sweep`.
    **settings
        ``method``, ``samples``, ``seed``, ``sensors``, ``quantiles``, ``find`` in place of those of
        ``[sweep]``.

    Returns
    -------
    Sweep
        All runs and their evaluation.

    Raises
    ------
    SceneError
        All that is wrong with the scene, its knobs, scalars and questions, before anything is run.
    OutputError
        The folder cannot be written.
    FlexmbError
        The folder holds runs of another scene, or no scheduler answers.
    """
    source = StudySource.of(scene, overrides, output, "sweep")
    plan = _plan(source, vary, settings, histories)
    names = [one.name for one in plan.base.scalars]
    about = {"scene or version of flexmb": run_key(plan.base.scene, source.folder)}
    file = writable_folder(source.output) / RUNS
    with (
        open_cluster(workers, scheduler, limit=limit, dashboard=dashboard) as cluster,
        RecordTable(file, about, fresh=fresh) as table,
    ):
        runner = _Runner(plan, source, cluster, table, progress)
        answer = runner.sweep()
        columns = columns_of(table.rows(), runner.keys, names, file)
    units = {one.name: source.model.units.label(one.unit) for one in plan.base.scalars}
    if not (plan.spec.sensors or plan.spec.find):
        units = _of_motion(units, columns)
    return Sweep(
        source.model.title or source.file, source.file, source.output, plan.design,
        runner.settings, units, columns, plan.spec.quantiles, plan.spec.seed, source.overrides,
        answer, runner.reused, _stated_units(source, plan),
    )  # fmt: skip


def _stated_units(source: StudySource, plan: _Plan) -> dict[str, tuple[str, float]]:
    return {knob: stated_unit(source.scene, knob) for knob in plan.design.knobs}


def _of_motion(units: Mapping[str, str], columns: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """The scalars of channels that are more than round-off, relative to others of their unit."""
    sizes: dict[str, float] = {}
    scales: dict[str, float] = {}
    for name, unit in units.items():
        values = np.abs(columns[name])
        size = float(values[np.isfinite(values)].max(initial=0.0))
        channel = name.partition(":")[0]
        sizes[channel] = max(sizes.get(channel, 0.0), size)
        scales[unit] = max(scales.get(unit, 0.0), size)
    shown = {k: u for k, u in units.items() if sizes[k.partition(":")[0]] > _REST * scales[u]}
    return shown or dict(units)


_REST = 1e-9  # fraction of the largest value of its unit below which a channel is round-off
_TEXTS = ("status", "reason", "notes")
_NUMBERS = ("seconds", "cpu_seconds", "seconds_run")


def columns_of(
    rows: Any, keys: Sequence[str], scalars: Sequence[str], file: Path
) -> dict[str, NDArray[Any]]:
    """Columns of a table of runs, in the order of the keys; NaN and "" for missing values.

    Raises
    ------
    FlexmbError
        A column contains values that flexmb does not write.
    """
    import pyarrow as pa

    place = {key: i for i, key in enumerate(rows.column(KEY).to_pylist())}
    order = np.array([place[key] for key in keys], np.int64)
    columns: dict[str, NDArray[Any]] = {}
    for name in (*_TEXTS, *scalars, *_NUMBERS):
        missing: Any = "" if name in _TEXTS else float("nan")
        if name in rows.column_names:
            try:
                column = rows.column(name).cast(pa.string() if name in _TEXTS else pa.float64())
            except pa.ArrowException:
                what = f"{file}: the column {name} is not one of a sweep"
                raise FlexmbError(f"{what}: give another folder, or --fresh") from None
            columns[name] = column.fill_null(missing).to_numpy()[order]
        else:
            columns[name] = np.full(len(order), missing, object if name in _TEXTS else float)
    return columns


class _Plan:
    """A sweep after all checks."""

    def __init__(
        self, spec: SweepSpec, base: SweepScene, design: Design, targets: list[Target]
    ) -> None:
        self.spec, self.base, self.design, self.targets = spec, base, design, targets


def _plan(
    source: StudySource, vary: Mapping[str, Any] | None, settings: Mapping[str, Any], keep: bool
) -> _Plan:
    spec = _spec(source, vary, settings)
    problems: list[Problem] = []
    knobs: dict[str, Distribution] = {}
    try:
        resolved = resolve_knobs(source, {knob: (one,) for knob, one in spec.vary.items()})
        knobs = {name: one for name, (one,) in resolved.items()}
        written = vary or leaves("", source.scene.get("sweep", {}).get("vary", {}))
        problems += check_units(source, {k: numbers_written(v) for k, v in dict(written).items()})
    except SceneError as error:
        problems += error.problems
    changed, wrong = override(source.scene, source.overrides)
    scene = {k: v for k, v in changed.items() if k not in SECTIONS}
    base = SweepScene(scene, str(source.folder), str(source.output / "bodies"))
    questions = [read_question(text) for text in spec.find]
    names = [":".join(question.scalar) for question in questions]
    scalars, missing = _scalars(base, (*spec.sensors, *names))
    for problem in missing:  # those of questions come last
        i = int(problem.where[len("sensors[") : -1])
        where = problem.where if i < len(spec.sensors) else f"find[{i - len(spec.sensors)}]"
        problems.append(Problem(where, problem.what, problem.allowed, problem.nearest))
    targets: list[Target] = []
    units = {one.name: one.unit for one in scalars}
    for i, question in enumerate(questions):
        name, unit = names[i], units.get(names[i], "")
        try:
            bound = float("nan")
            if question.bound:
                bound = read_number(question.bound, source.model.context, unit or None)
            targets.append(Target(question, name, bound, source.model.units.label(unit)))
        except SceneError as error:
            problems += under(f"find[{i}]", error.problems)
    design = None
    try:
        if knobs and not questions:
            design = make_design(knobs, spec.method, spec.samples, spec.seed)
    except SceneError as error:
        problems += error.problems
    if not problems:
        problems += _refusals(base, knobs)
    if problems:
        raise SceneError.from_problems(problems)
    histories = str(source.output / "histories") if keep else ""
    base = SweepScene(scene, base.folder, base.bodies, tuple(scalars), histories)
    return _Plan(spec, base, design or Design(knobs, "search", np.zeros((0, len(knobs)))), targets)


def _spec(
    source: StudySource, vary: Mapping[str, Any] | None, settings: Mapping[str, Any]
) -> SweepSpec:
    """`[sweep]` of the scene, updated by the values given here."""
    model = source.model
    allowed = tuple(name for name in SweepSpec.model_fields if name != "vary")
    unknown = [name for name in settings if name not in allowed]
    problems = [Problem(name, "unknown", allowed, nearest(name, allowed)) for name in unknown]
    fields: dict[str, Any] = {} if model.sweep is None else dict(model.sweep)
    fields |= {name: value for name, value in settings.items() if value is not None}
    if vary is not None and not isinstance(vary, Mapping):
        problems.append(Problem("vary", "knobs with their distributions are expected"))
    elif vary:
        fields["vary"], wrong = read_knobs(vary, model.context)
        problems += [Problem(f"vary {p.where}", p.what, p.allowed, p.nearest) for p in wrong]
    if "vary" not in fields:
        what = 'no knob to vary: give some, or [sweep] with vary = { r = "normal(0.15, 1e-4)" }'
        problems.append(Problem("", what))
    changed = copy.copy(model)
    spec = None
    try:
        spec = changed.set_sweep(
            **{"vary": {}, **{k: fields[k] for k in fields if k in (*allowed, "vary")}}
        )
    except SceneError as error:
        problems += [p for p in error.problems]
    if problems or spec is None:
        if isinstance(vary, Mapping) and vary:  # unknown names of knobs come with the rest
            try:
                resolve_knobs(source, dict.fromkeys(vary, (0,)))
            except SceneError as error:
                problems += error.problems
        raise SceneError.from_problems(problems)
    return spec


def _scalars(base: SweepScene, names: Sequence[str]) -> tuple[list[Scalar], list[Problem]]:
    """The scalars of these names, from the channels of a scene whose bodies need not be reduced."""
    from flexmb.engine.compile import compile_system
    from flexmb.results.channels import Columns

    model = active_model(base.model({}))
    surveys, problems = survey_bodies(model)
    if problems:
        raise SceneError.from_problems(problems)
    bodies, _ = bodies_of_surveys(model, surveys)
    columns = Columns.of(compile_system(model, bodies).layout)
    return find_scalars(columns, model, names)


def _refusals(base: SweepScene, knobs: Mapping[str, Distribution]) -> list[Problem]:
    """Problems of values that the model refuses: each choice, and the median of a distribution."""
    problems: list[Problem] = []
    for knob, one in knobs.items():
        for value in one.choices or values_at(one, np.array([0.5])):
            if mistakes := _mistakes(base, knob, value):
                first = mistakes[0]
                where = f"vary {knob} = {value_text(value)}"
                what = (
                    first.what
                    if first.where == knob
                    else str(replace(first, allowed=(), nearest=()))
                )
                problems.append(Problem(where, what, first.allowed, first.nearest))
    return problems[:_MAX_REFUSALS]


def _mistakes(base: SweepScene, knob: str, value: Any) -> Sequence[Problem]:
    """Problems of a value of a knob, including those of the meshes of bodies."""
    try:
        model = active_model(base.model({knob: value}))
    except SceneError as error:
        return error.problems
    return survey_bodies(model)[1] if knob.startswith("bodies.") else ()


class _Runner:
    """A sweep during its runs."""

    def __init__(self, plan: _Plan, source: StudySource, cluster: Cluster, table: RecordTable,
                 progress: Progress) -> None:  # fmt: skip
        self.plan, self.source, self.cluster, self.table = plan, source, cluster, table
        self.progress = progress
        self.settings: list[dict[str, Any]] = []
        self.keys: list[str] = []
        self.rows: dict[str, Row] | None = None  # rows of a search
        self.reused = 0

    def sweep(self) -> Answer | None:
        """Do all runs; returns the answer to questions."""
        plan = self.plan
        flexible_bodies_of(plan.base, plan.base.model({}), self.progress)
        if not plan.targets:
            stated = _stated_units(self.source, plan)
            self.run_all([rounded_as_stated(one, stated) for one in plan.design.values()])
            return None
        present = {knob: self._present(knob, one) for knob, one in plan.design.knobs.items()}
        return DesignSearch(
            dict(plan.design.knobs), plan.targets, self.run, present, plan.spec.samples,
            plan.spec.seed, _stated_units(self.source, plan),
        ).answer()  # fmt: skip

    def _present(self, knob: str, one: Distribution) -> float:
        """The knob's value in the present scene; the middle of the range if it has none."""
        model = self.source.model
        if knob in model.parameters:
            return float(model.parameters[knob])
        value: Any = self.source.scene
        for part in knob.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        try:
            return read_number(value, model.context, None)
        except FlexmbError:
            return 0.5 * sum(one.span)

    def run_all(self, settings: Sequence[dict[str, Any]]) -> None:
        """Run the settings that the table does not contain; their rows are not kept in memory."""
        jobs = [Job(content_key(values), values) for values in settings]
        ended = self._ended()
        left = list({job.key: job for job in jobs if job.key not in ended}.values())
        self.reused = len({job.key for job in jobs}) - len(left)
        for _ in self._ends(left):
            pass
        self.settings, self.keys = list(settings), [job.key for job in jobs]

    def _ended(self) -> dict[str, Row]:
        """Rows of the table by key: failed runs, and runs with all scalars; not those given up.

        On a busy machine a run that was given up may end in another attempt.
        """
        names = [one.name for one in self.plan.base.scalars]
        if self.plan.base.histories:
            names.append("folder")
        rows = self.table.rows([KEY, "status", "reason", *names]).to_pylist()
        return {
            row[KEY]: row
            for row in rows
            if not str(row.get("reason") or "").startswith(TOO_LONG)
            and (row.get("status") == "failed" or all(row.get(one) is not None for one in names))
        }

    def _ends(self, jobs: list[Job]) -> Iterator[tuple[str, Row]]:
        function = partial(run_setting, self.plan.base)
        progress = self.progress if len(jobs) > 1 else silent
        for job, record in self.cluster.run(function, jobs, progress=progress, phase="sweep"):
            self.table.append({KEY: job.key, **job.values, **record})
            yield job.key, record

    def run(self, settings: Sequence[dict[str, Any]]) -> list[Row]:
        """Run settings of a search; their rows in order."""
        if self.rows is None:
            self.rows = self._ended()
        jobs = {content_key(values): values for values in settings}
        self.reused += sum(key in self.rows and key not in self.keys for key in jobs)
        self.rows |= self._ends([Job(*item) for item in jobs.items() if item[0] not in self.rows])
        self.settings += [values for key, values in jobs.items() if key not in self.keys]
        self.keys += [key for key in jobs if key not in self.keys]
        missing = dict.fromkeys((one.name for one in self.plan.base.scalars), float("nan"))
        return [{**missing, **self.rows[content_key(values)]} for values in settings]
