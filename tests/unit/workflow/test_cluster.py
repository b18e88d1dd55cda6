"""Runs on workers: the same records as in this process, whatever happens to a worker."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import pytest
from clusterjobs import do

from flexmb.errors import FlexmbError
from flexmb.workflow import worker_processes
from flexmb.workflow.cluster import Cluster, open_cluster


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    with open_cluster(2) as opened:
        yield opened


@pytest.mark.parametrize("here", [True, False])
def test_records_of_good_and_bad_jobs(cluster: Cluster, here: bool) -> None:
    """A job more is given while the records come in."""
    jobs = deque({"number": i} for i in range(40))
    jobs[3]["what"], jobs[5]["what"] = "refuse", "fault"
    told: list[tuple[float, str]] = []
    records = {}
    with open_cluster(1) as single:
        used = single if here else cluster
        progress = lambda phase, fraction, detail="": told.append((fraction, detail))  # noqa: E731
        for job, record in used.run(do, jobs, progress=progress):
            records[job["number"]] = record
            if job["number"] == 0:
                jobs.append({"number": 40})
    assert sorted(records) == list(range(41))
    assert records.pop(3) == {"status": "failed", "reason": "the crank is stuck"}
    assert records.pop(5)["reason"] == "failed unexpectedly (ValueError: a mistake)"
    assert all(record["number"] == i for i, record in records.items())
    assert (os.getpid() in {record["process"] for record in records.values()}) is here
    assert told[-1][0] == 1.0 and "a second" in told[-2][1]


def test_few_jobs_are_taken_before_their_turn(cluster: Cluster) -> None:
    taken = 0

    def jobs() -> Iterator[dict[str, float]]:
        nonlocal taken
        for taken in range(5000):
            yield {"number": taken}

    for i, _ in enumerate(cluster.run(do, jobs())):
        if i == 20:
            break
    assert taken < 2500  # four batches
    assert [job["number"] for job, _ in cluster.run(do, (j for j in [{"number": 9}]))] == [9]
    assert len(list(cluster.run(do, [{"number": 0}]))) == 1  # those under way are forgotten


@pytest.mark.slow
def test_a_job_that_kills_its_workers_takes_no_other_with_it(
    cluster: Cluster, tmp_path: Path
) -> None:
    jobs = [{"number": i, "seconds": 0.01, "file": str(tmp_path / "mark")} for i in range(60)]
    jobs[7]["what"], jobs[50]["what"] = "die", "die once"
    records = {job["number"]: record for job, record in cluster.run(do, jobs)}
    assert len(records) == 60
    assert [i for i, record in records.items() if record["status"] != "finished"] == [7]
    assert "ended abruptly each time" in records[7]["reason"]


@pytest.mark.slow
def test_a_job_that_hangs_is_ended_with_its_worker(cluster: Cluster) -> None:
    cluster.limit = 0.5
    jobs = [{"number": i, "seconds": 1e4 if i == 4 else 0.0} for i in range(8)]
    records = {job["number"]: record for job, record in cluster.run(do, jobs)}
    cluster.limit = 0.0
    assert [i for i, record in records.items() if record["status"] != "finished"] == [4]
    assert records[4]["reason"].startswith("given up after 0.5 s")
    assert len(records) == 8


def clients() -> set[int]:
    """Those that there are, by their places in memory."""
    return {id(one) for one in gc.get_objects() if type(one).__name__ == "Client"}


@pytest.mark.seconds
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "tcp://no-such-host:8786"])
def test_a_scheduler_that_is_not_there_is_told_soon(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And nothing of a client is left, which would close while the next one starts: they waited
    for each other for ever."""
    monkeypatch.setattr(worker_processes, "REACH", 0.5)
    start = time.monotonic()
    before = clients()
    gc.disable()
    try:
        with (
            pytest.raises(FlexmbError, match=f"no Dask scheduler answers at {address}"),
            open_cluster(scheduler=address),
        ):
            pass
        assert clients() == before
    finally:
        gc.enable()
    assert time.monotonic() - start < 20.0  # of half a second


def test_no_worker_is_a_mistake() -> None:
    with pytest.raises(FlexmbError, match="at least one is needed, given 0"), open_cluster(0):
        pass


@pytest.mark.slow
def test_no_module_of_dask_is_loaded_without_need() -> None:
    code = (
        "import sys, flexmb.cli.app, flexmb.workflow.cluster, flexmb.studies.accuracy.runner\n"
        "import flexmb.studies.budgets.error_budget, flexmb.studies.sweeps.parameter_sweep\n"
        "print([name for name in ('dask', 'distributed', 'pyarrow') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_other_software_of_a_worker_is_refused(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexmb.workflow.cluster.software", lambda: ("Python 3.9,", "flexmb 0.0"))
    with pytest.raises(FlexmbError, match=r"a worker has other software \(Python 3\.\d+, flexmb"):
        list(cluster.run(do, [{"number": 0}]))


def test_another_version_of_dask_is_refused() -> None:
    mine = {"packages": {"python": "3.12.1.final.0", "distributed": "2026.1.0"}}
    other = {"packages": {"python": "3.12.7.final.0", "distributed": "2025.1.0"}}
    versions = {"client": mine, "scheduler": mine, "workers": {"tcp://a:1": other}}
    with pytest.raises(FlexmbError, match=r"tcp://a:1 has distributed 2025\.1\.0, and this proc"):
        worker_processes.compare_versions(versions)


@pytest.mark.slow
def test_workers_that_cannot_start_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DASK_DISTRIBUTED__WORKER__PRELOAD", "['no_such_module_at_all']")
    with (
        pytest.raises(FlexmbError, match="worker processes end as soon as they start: .*no_such"),
        open_cluster(2),
    ):
        pass
