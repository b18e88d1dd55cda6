"""One run of a study, in a process of its own: integrate, time, leave a result and a record.

In: a :class:`Job`, plain data that can be sent to another process. Out: its record. A run that
fails is a record too; one that was interrupted leaves none.
"""

from __future__ import annotations

import os
import shutil
import signal
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexmb.errors import FlexmbError

__all__ = ["GIVEN_UP", "Job", "be_a_worker", "do"]

GIVEN_UP = "given up"
"""How the reason begins of a run that took longer than its limit."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Job:
    """A run, or with no repeats the reduction of the flexible bodies of its model.

    Attributes
    ----------
    label : str
        Its values, for people.
    scene : dict
        The scene; its paths are relative to `source`.
    source, folder, bodies : str
        Folders: of the scene, of the result and record, of the reduced bodies (empty: none).
    repeats : int
        How often to integrate.
    workers : int
        How many runs go on at the same time.
    limit : float
        Seconds after which one integration is given up; 0 for none.
    """

    label: str
    scene: dict[str, Any]
    source: str
    folder: str
    bodies: str = ""
    repeats: int = 1
    workers: int = 1
    limit: float = 0.0


def be_a_worker() -> None:
    """Prepare a process: Ctrl-C is the parent's business, and one run uses one core."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in _THREADS:  # before NumPy is loaded
        os.environ.setdefault(name, "1")


def do(job: Job) -> dict[str, Any]:
    """Do a job and write its record; a failure is recorded with its reason."""
    from flexmb.studies.store import result_of, write_record

    folder = Path(job.folder)
    folder.mkdir(parents=True, exist_ok=True)
    result_of(folder).unlink(missing_ok=True)  # of a run that was interrupted
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run of the scene itself tells them
        try:
            record = _run(job, folder) if job.repeats else _reduce(job, folder)
            record |= {"status": "finished", "reason": ""}
        except FlexmbError as error:
            record = {"status": "failed", "reason": _reason(folder, error)}
        except Exception as error:  # noqa: BLE001  one bad run must not end the study
            what = f"failed unexpectedly ({type(error).__name__}: {error})"
            record = {"status": "failed", "reason": what}
    record |= {"label": job.label, "repeats": job.repeats, "workers": job.workers}
    write_record(folder, record)
    return record


def _reduce(job: Job, folder: Path) -> dict[str, Any]:
    from flexmb.model import Model
    from flexmb.workflow import flexible_bodies

    model = Model.from_scene_dict(job.scene, Path(job.source))
    started = time.perf_counter()
    flexible_bodies(model, folder, fresh=True)  # else its time would be that of reading
    return {"seconds": time.perf_counter() - started}


def _run(job: Job, folder: Path) -> dict[str, Any]:
    """Integrate `repeats` times; the wall times of all, the statistics of the first run."""
    from flexmb.model import Model
    from flexmb.results import Result
    from flexmb.workflow import run_model

    model = Model.from_scene_dict(job.scene, Path(job.source))
    held = sorted(Path(job.bodies).glob("*.flexbody.h5")) if job.bodies else []
    for file in held:
        shutil.copy2(file, folder / file.name)
    statistics: list[dict[str, Any]] = []
    cpu: list[float] = []
    for _ in range(job.repeats):
        clock = _Clock(job.limit)
        report = run_model(model, folder, pictures=False, progress=clock)
        if Result(report.result).status == "stopped":
            raise KeyboardInterrupt
        statistics.append(report.statistics)
        cpu.append(clock.cpu)
    for file in held:  # kept once for all runs of the model
        (folder / file.name).unlink()
    seconds = [float(one["seconds_integrate"]) for one in statistics]
    return {"seconds": seconds, "cpu_seconds": cpu, "statistics": statistics[0]}


class _Clock:
    """A progress that takes the processor time of the integration, and gives up a long one.

    The integration begins where the assembly ends.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.cpu = 0.0
        self._wall_start, self._cpu_start = time.perf_counter(), time.process_time()

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if phase != "integrate":
            self._wall_start, self._cpu_start = time.perf_counter(), time.process_time()
            return
        self.cpu = time.process_time() - self._cpu_start
        if self.limit and time.perf_counter() - self._wall_start > self.limit:
            raise FlexmbError(f"{GIVEN_UP} after {self.limit:.3g} s, at {detail}")


def _reason(folder: Path, error: FlexmbError) -> str:
    """Why a run failed: the sentence of its result, else that of the error."""
    from flexmb.results import Result
    from flexmb.studies.store import result_of

    try:
        run = Result(result_of(folder))
    except FlexmbError:
        return str(error)
    return run.message if run.status == "failed" and run.message else str(error)
