"""A study from end to end: settings, reduction of bodies, runs, reference, errors.

In: a scene or a model, and knobs with values. Out: a :class:`Study`. Runs that an earlier call left
in the same folder are used again.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.folders import writable_folder
from flexmb.model.scenes.study import StudySpec, sweep_values
from flexmb.progress import Progress, silent
from flexmb.studies.channel_errors import check_sensors
from flexmb.studies.report import Study
from flexmb.studies.runner import StudyRunner
from flexmb.studies.settings import StudySource, make_settings
from flexmb.studies.workers import open_workers

if TYPE_CHECKING:
    from flexmb.model import Model


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
        what ``[study]`` of the scene says.
    output : path, optional
        Folder of the study; ``out/<scene>/study`` by default. Runs that are there already are used
        again.
    overrides : mapping, optional
        Values of a scene file to change for all runs.
    workers : int
        Runs at the same time, each in a process; 1: one after the other in this process, which
        disturbs the timings least.
    fresh : bool
        Run anew what is there already.
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
    source = _source(scene, overrides, output)
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


def _source(
    scene: str | Path | Model, overrides: Mapping[str, Any] | None, output: str | Path | None
) -> StudySource:
    if isinstance(scene, str | Path):
        return StudySource.of_scene(scene, overrides, output)
    if overrides:
        raise SceneError("overrides are for scene files; change the model itself")
    return StudySource.of_model(scene, output)


def _spec(model: Model, vary: Mapping[str, Any] | None, criteria: Mapping[str, Any]) -> StudySpec:
    """What the scene says of its study, with what is given here in place of it."""
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
