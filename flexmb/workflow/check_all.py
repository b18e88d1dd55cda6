"""The known answers of all scenes in a folder, several scenes at the same time.

The processes of this machine do runs at the same time, each on one core.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from flexmb.errors import FlexmbError, Problem, SceneError
from flexmb.folders import writable_folder
from flexmb.progress import Progress, silent
from flexmb.workflow.part_analysis import run_part
from flexmb.workflow.run import ANALYSES
from flexmb.workflow.run_report import CheckOutcome
from flexmb.workflow.simulate import run_scene


@dataclass(frozen=True)
class SceneChecks:
    """Known answers of one scene; `failure` says why it has none although it should."""

    scene: Path
    outcomes: tuple[CheckOutcome, ...] = ()
    time_unit: str = "s"
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Whether the scene ran and all its answers are right."""
        return not self.failure and all(outcome.passed for outcome in self.outcomes)


def check_all(
    folder: str | Path,
    *,
    output: str | Path = "out/check-all",
    workers: int = 2,
    progress: Progress = silent,
) -> list[SceneChecks]:
    """Run every scene in a folder and compare it with its known answers, without pictures.

    A scene without an analysis has its flexible bodies reduced, one with a part by itself has that
    solved.

    Parameters
    ----------
    folder : path
        Scenes are its files `*.toml`, in subfolders too; or one scene.
    output : path
        Folder of the results, with the same subfolders.
    workers : int
        Scenes that are run at the same time.
    progress : Progress
        Called after each scene.

    Returns
    -------
    list of SceneChecks
        In the order of the paths. A run that fails is one of them.

    Raises
    ------
    SceneError
        No scene there, or all mistakes of all scenes, before any is run.
    """
    root = Path(folder)
    scenes = [root] if root.is_file() else sorted(root.rglob("*.toml"))
    if not scenes:
        what = "holds no scene (*.toml)" if root.is_dir() else "there is no such folder"
        raise SceneError(f"{folder}: {what}")
    if workers < 1:
        raise SceneError(f"workers: at least one is needed, given {workers}")
    analyses = _read_scenes(scenes)
    base = root if root.is_dir() else root.parent
    out = writable_folder(Path(output))
    results: dict[Path, SceneChecks] = {}
    with process_pool(min(workers, len(scenes))) as pool:
        jobs = {}
        for scene in scenes:
            place = out / scene.relative_to(base).with_suffix("")
            jobs[pool.submit(_check, scene, analyses[scene], place)] = scene
        try:
            for job in as_completed(jobs):
                scene = jobs[job]
                try:
                    results[scene] = job.result()
                except BrokenProcessPool:
                    why = "a process ended abruptly: it was killed, or memory ran out"
                    results[scene] = SceneChecks(scene, failure=why)
                progress("scenes", len(results) / len(scenes), str(scene.relative_to(base)))
        except KeyboardInterrupt:
            for process in multiprocessing.active_children():
                process.terminate()
            raise
    return [results[scene] for scene in scenes]


def _read_scenes(scenes: list[Path]) -> dict[Path, tuple[str, ...]]:
    """The analyses of each scene; raises the mistakes of all."""
    from flexmb.model import load_scene

    analyses: dict[Path, tuple[str, ...]] = {}
    problems: list[Problem] = []
    for scene in scenes:
        try:
            model = load_scene(scene)
        except FlexmbError as error:
            problems += [replace(p, where=f"{scene}: {p.where}") for p in error.problems]
        else:
            analyses[scene] = tuple(a for a in ANALYSES if getattr(model, a) is not None)
    if problems:
        raise SceneError.from_problems(problems)
    return analyses


def _check(scene: Path, analyses: tuple[str, ...], output: Path) -> SceneChecks:
    """Run a scene by each of its analyses."""
    from flexmb.model import load_scene
    from flexmb.workflow.flexible_bodies import reduce_scene

    outcomes: list[CheckOutcome] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run of the scene itself shows them
        try:
            for analysis in analyses:
                report = run_scene(scene, output=output, analysis=analysis, pictures=False)
                outcomes += report.checks
            if load_scene(scene).part is not None:
                outcomes += run_part(scene, output=output, pictures=False).checks
            elif not analyses:
                outcomes += reduce_scene(scene, output=output).checks
            return SceneChecks(scene, tuple(outcomes), load_scene(scene).units.label("s"))
        except FlexmbError as error:
            return SceneChecks(scene, tuple(outcomes), failure=str(error))
        except Exception as error:  # noqa: BLE001  one bad run must not end the others
            what = f"failed unexpectedly ({type(error).__name__}: {error})"
            return SceneChecks(scene, tuple(outcomes), failure=what)


_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def process_pool(count: int) -> ProcessPoolExecutor:
    """Processes that begin empty, on every operating system alike."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, mp_context=context, initializer=_prepare_process)


def _prepare_process() -> None:
    """Ctrl-C is handled by the parent, and one run uses one core."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    for name in _THREADS:  # for libraries that are loaded later
        os.environ.setdefault(name, "1")
