"""Studies on a scheduler and workers in processes of their own, any of which may be killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from clusterkit import DaskProcesses, dask_processes

import flexmb
from flexmb.errors import FlexmbError
from flexmb.results import Result
from flexmb.studies.record_table import read_rows

pytestmark = pytest.mark.slow
CASES = Path(__file__).parents[3] / "cases"
PENDULUM = CASES / "pendulum" / "scene.toml"
STEPS = [8e-3 / i for i in range(1, 13)]


@pytest.fixture
def dask() -> DaskProcesses:
    with dask_processes() as processes:
        yield processes


def when_ended(folder: Path, count: int, action: object) -> threading.Thread:
    """Do something once some runs of a study have ended."""

    def watch() -> None:
        journal = folder / "runs.parts" / "journal.jsonl"
        while not journal.is_file() or len(journal.read_bytes().splitlines()) < count + 1:
            time.sleep(0.05)
        action()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


def test_errors_are_those_of_runs_in_this_process(dask: DaskProcesses, tmp_path: Path) -> None:
    vary = {"step": STEPS[:3]}
    here = flexmb.study(PENDULUM, vary, output=tmp_path / "here", workers=1, repeats=1)
    there = flexmb.study(
        PENDULUM, vary, output=tmp_path / "there", scheduler=dask.address, repeats=1
    )
    assert there.errors("reactions") == pytest.approx(here.errors("reactions"), rel=1e-12)
    assert there.references == here.references


def test_a_killed_worker_costs_no_run(dask: DaskProcesses, tmp_path: Path) -> None:
    nanny = psutil.Process(dask.workers[0].pid)

    def kill() -> None:
        for worker in nanny.children(recursive=True):
            worker.kill()

    thread = when_ended(tmp_path, 3, kill)
    study = flexmb.study(
        PENDULUM, {"step": STEPS}, output=tmp_path, scheduler=dask.address, repeats=1
    )
    assert not thread.is_alive()
    assert all(row.status == "finished" for row in study.rows)


def test_a_killed_scheduler_loses_nothing_that_had_ended(
    dask: DaskProcesses, tmp_path: Path
) -> None:
    when_ended(tmp_path, 3, lambda: dask.kill(dask.scheduler))
    vary = {"step": STEPS}
    with pytest.raises(FlexmbError, match=r"scheduler tcp://\S+ is gone: runs that had ended are"):
        flexmb.study(PENDULUM, vary, output=tmp_path, scheduler=dask.address, repeats=1)
    ended = len(read_rows(tmp_path / "runs.parquet"))
    assert ended >= 3
    study = flexmb.study(PENDULUM, vary, output=tmp_path, workers=2, repeats=1)
    assert study.reused == ended
    assert all(row.status == "finished" for row in study.rows)


@pytest.mark.skipif(os.name == "nt", reason="no such signal")
def test_a_killed_study_goes_on_where_it_was_and_leaves_no_process(tmp_path: Path) -> None:
    """Its script needs no guard: worker processes do not run it."""
    script = tmp_path / "script.py"
    script.write_text(
        f"import flexmb\nflexmb.study({str(PENDULUM)!r}, {{'step': {STEPS}}}, output='out', "
        "repeats=1)\n",
        encoding="utf-8",
    )
    process = subprocess.Popen([sys.executable, script], cwd=tmp_path)
    when_ended(tmp_path / "out", 4, lambda: None).join(120.0)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    process.send_signal(signal.SIGKILL)
    process.wait()
    ended = read_rows(tmp_path / "out" / "runs.parquet").column("key").to_pylist()
    before = {key: (tmp_path / "out/runs" / key / "result.h5").stat().st_mtime_ns for key in ended}
    assert psutil.wait_procs(workers, timeout=60.0)[1] == []
    study = flexmb.study(PENDULUM, {"step": STEPS}, output=tmp_path / "out", repeats=1)
    assert study.reused == len(ended) >= 4
    after = {key: (tmp_path / "out/runs" / key / "result.h5").stat().st_mtime_ns for key in ended}
    assert after == before


def test_workers_that_do_not_see_the_folder_are_sent_what_they_lack(
    dask: DaskProcesses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mesh and reduced body go there, results come back, and no run reduces a body again."""
    vary = {"bodies.rod.modes": [2], "accuracy": [1e-2, 1e-3]}
    scene = CASES / "slider_crank" / "scene.toml"
    seen = flexmb.study(scene, vary, output=tmp_path / "seen", scheduler=dask.address, repeats=1)
    unseen = SimpleNamespace(name=str(tmp_path / "not there"), close=lambda: None)
    monkeypatch.setattr("flexmb.studies.study_jobs.tempfile.NamedTemporaryFile", lambda **_: unseen)
    study = flexmb.study(scene, vary, output=tmp_path / "sent", scheduler=dask.address, repeats=1)
    assert study.errors("positions") == pytest.approx(seen.errors("positions"), rel=1e-9)
    assert len(list((tmp_path / "sent").glob("bodies/*/*.h5"))) == 1
    for row in study.rows:
        assert "rod: reduction reused" in row.statistics["notes"]
        assert Result(Path(row.folder) / "result.h5").status == "finished"
