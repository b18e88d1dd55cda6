"""A Dask scheduler and its workers in processes of their own, for tests that may kill them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class DaskProcesses:
    """A scheduler and workers; all are killed at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.scheduler = self._start(
            "dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard",
            "--scheduler-file", str(self.file),
        )  # fmt: skip
        while not self.file.is_file():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        text = self.file.read_text(encoding="utf-8")
        self.address = text.partition('"address": "')[2].partition('"')[0]
        self.workers = [self.add_worker(), self.add_worker()]

    def add_worker(self) -> subprocess.Popen[bytes]:
        """A worker with a nanny, which starts it anew when it dies."""
        return self._start("dask_worker", self.address, "--nthreads", "1", "--no-dashboard")

    def _start(self, command: str, *words: str) -> subprocess.Popen[bytes]:
        # with another folder of caches, as on another machine; kernels need not be compiled again
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{command}", *words],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=self.folder,
            start_new_session=True,
        )  # fmt: skip

    def kill(self, process: subprocess.Popen[bytes]) -> None:
        """End a process and those that it has started."""
        import psutil

        for one in (*psutil.Process(process.pid).children(recursive=True), process):
            one.kill()
        process.wait()

    def close(self) -> None:
        """End all."""
        for process in (*self.workers, self.scheduler):
            if process.poll() is None:
                self.kill(process)


@contextmanager
def dask_processes() -> Iterator[DaskProcesses]:
    """A scheduler with two workers, which run in a folder of their own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        processes = DaskProcesses(Path(folder))
        try:
            yield processes
        finally:
            processes.close()
