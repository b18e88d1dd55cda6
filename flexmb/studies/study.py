"""A study from end to end: plan, reduce bodies, run, find the truth, measure.

In: a scene or a model, and knobs with values. Out: a :class:`Study`. Runs that an earlier call left
in the same folder are used again.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.tasks.study import StudySpec, sweep_values
from flexmb.progress import Progress, silent
from flexmb.studies.base import Base, base_of_model, base_of_scene
from flexmb.studies.course import Course
from flexmb.studies.plan import settings_of
from flexmb.studies.pool import workers_of
from flexmb.studies.report import Study
from flexmb.studies.sensing import check_sensors
from flexmb.studies.store import Store

if TYPE_CHECKING:
    from flexmb.model import Model

__all__ = ["study"]


def study(
    scene: str | Path | Model,
    vary: Mapping[str, Any] | None = None,
    *,
    output: str | Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    workers: int = 2,
    fresh: bool = False,
    progress: Progress = silent,
    **judged: Any,
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
    **judged
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
    base = _base(scene, overrides, output)
    spec = _spec(base, vary, judged)
    if workers < 1:
        raise SceneError(f"workers: at least one is needed, given {workers}")
    settings = settings_of(base, spec.vary)
    good = [setting for setting in settings if setting.model is not None]
    assert good[0].model is not None  # `settings_of` refuses a study without any
    check_sensors(good[0].model, spec.sensors)
    store = Store(base.output)
    store.make()
    with workers_of(workers, fresh) as pool:
        return Course(base, spec, store, pool, progress).study(settings)


def _base(
    scene: str | Path | Model, overrides: Mapping[str, Any] | None, output: str | Path | None
) -> Base:
    if isinstance(scene, str | Path):
        return base_of_scene(scene, overrides, output)
    if overrides:
        raise SceneError("overrides are for scene files; change the model itself")
    return base_of_model(scene, output)


def _spec(base: Base, vary: Mapping[str, Any] | None, judged: Mapping[str, Any]) -> StudySpec:
    """What the scene says of its study, with what is given here in place of it."""
    known = tuple(name for name in StudySpec.model_fields if name != "vary")
    unknown = [name for name in judged if name not in known]
    problems = [Problem(name, "unknown", known, nearest(name, known)) for name in unknown]
    if vary is not None and not isinstance(vary, Mapping):
        problems.append(Problem("vary", "knobs with their values are expected"))
    given: dict[str, Any] = {} if base.model.study is None else base.model.study.model_dump()
    given |= {name: value for name, value in judged.items() if value is not None}
    if vary:
        given["vary"] = {}
        for knob, values in vary.items():
            try:
                given["vary"][knob] = sweep_values(values)
            except SceneError as error:
                problems += [Problem(f"vary {knob}", found.what) for found in error.problems]
    if problems:
        raise SceneError.from_problems(problems)
    if "vary" not in given:
        what = 'no knob to vary: give some, or [study] with vary = { accuracy = "1e-2..1e-6" }'
        raise SceneError(what)
    return _checked(base.model, given)


def _checked(model: Model, given: Mapping[str, Any]) -> StudySpec:
    tried = copy.copy(model)
    spec = tried.set_study(**given)
    problems = [found for found in tried.problems() if found.where.startswith("study")]
    if problems:
        raise SceneError.from_problems(problems)
    return spec
