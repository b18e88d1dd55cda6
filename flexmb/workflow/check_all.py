"""The known answers of all scenes in a folder; several scenes run at the same time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.folders import writable_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.part_analysis import run_part
from flexmb.workflow.run import ANALYSES
from flexmb.workflow.run_report import CheckOutcome
from flexmb.workflow.simulate import run_scene


@dataclass(frozen=True)
class SceneChecks:
    """Known answers of one scene; `failure` says why there are none although it has some."""

    scene: Path
    outcomes: tuple[CheckOutcome, ...] = ()
    time_unit: str = "s"
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Whether the scene ran and all its known answers are met."""
        return not self.failure and all(outcome.passed for outcome in self.outcomes)


def check_all(
    folder: str | Path,
    *,
    output: str | Path = "out/check-all",
    workers: int = 2,
    progress: Progress = silent,
) -> list[SceneChecks]:
    """Run every scene in a folder and compare it with its known answers, without pictures.

    In a scene without an analysis the flexible bodies are reduced; in one with ``[part]`` the part
    is solved.

    Parameters
    ----------
    folder : path
        Scenes are its files `*.toml`, in subfolders too; or one scene.
    output : path
        Folder of the results, with the same subfolders.
    workers : int
        Number of scenes that run at the same time.
    progress : Progress
        Called after each scene.

    Returns
    -------
    list of SceneChecks
        In the order of the paths; failed runs are included.

    Raises
    ------
    SceneError
        No scene found; or all mistakes of all scenes, before any is run.
    """
    root = Path(folder)
    scenes = [root] if root.is_file() else sorted(root.rglob("*.toml"))
    if not scenes:
        what = "holds no scene (*.toml)" if root.is_dir() else "there is no such folder"
        raise SceneError(f"{folder}: {what}")
    from flexmb.workflow.cluster import open_cluster

    analyses = _read_scenes(scenes)
    base = root if root.is_dir() else root.parent
    out = writable_folder(Path(output))
    results: dict[Path, SceneChecks] = {}
    jobs = [
        (scene, analyses[scene], out / scene.relative_to(base).with_suffix("")) for scene in scenes
    ]
    with open_cluster(min(workers, len(scenes))) as cluster:
        for (scene, *_), record in cluster.run(_check, jobs, progress=progress, phase="scenes"):
            results[scene] = record.get("checks") or SceneChecks(scene, failure=record["reason"])
    return [results[scene] for scene in scenes]


def _read_scenes(scenes: list[Path]) -> dict[Path, tuple[str, ...]]:
    """The analyses of each scene; raises the mistakes of all of them."""
    from flexmb.model import load_scene

    analyses: dict[Path, tuple[str, ...]] = {}
    problems: list[Problem] = []
    for scene in scenes:
        try:
            model = load_scene(scene)
        except FlexmbError as error:
            problems += [_in_scene(scene, p) for p in error.problems]
        else:
            analyses[scene] = tuple(a for a in ANALYSES if getattr(model, a) is not None)
    if problems:
        raise SceneError.from_problems(problems)
    return analyses


def _in_scene(scene: Path, problem: Problem) -> Problem:
    where = problem.where
    if where == str(scene) or (not where and problem.what.startswith(f"{scene}: ")):
        return problem
    return replace(problem, where=f"{scene}: {where}")


def _check(job: tuple[Path, tuple[str, ...], Path]) -> dict[str, Any]:
    """Run a scene by each of its analyses."""
    from flexmb.model import load_scene
    from flexmb.workflow.reduction import reduce_scene

    scene, analyses, output = job
    outcomes: list[CheckOutcome] = []
    failure = ""
    try:
        for analysis in analyses:
            report = run_scene(scene, output=output, analysis=analysis, pictures=False)
            outcomes += report.checks
        if load_scene(scene).part is not None:
            outcomes += run_part(scene, output=output, pictures=False).checks
        elif not analyses:
            outcomes += reduce_scene(scene, output=output).checks
    except FlexmbError as error:
        failure = str(error)
    unit = load_scene(scene).units.label("s")
    return {"checks": SceneChecks(scene, tuple(outcomes), unit, failure)}
