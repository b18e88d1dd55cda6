"""Compile missing units on all cores.

Processes of `engine.compiler`, one per core, each compile one unit after the other into the cache.
A lock file for each unit prevents two runs from doing the same work. A lock ends with its process.
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FunctionType
from typing import Any

from flexmb.engine.jit import UNITS, reached
from flexmb.engine.unit_cache import cache_folders, leave_cache, read_unit, unit_file
from flexmb.errors import CompilationError
from flexmb.progress import Progress, silent

# A process grows by some 4 MB per unit; after so many units a new process replaces it.
_MAX_UNITS_PER_PROCESS = 60
# The time to compile a unit is in proportion to the code size of its kernels (bytes). Measured:
# this share of it is saved for kernels that the process has translated before.
_TRANSLATION_SHARE = 2 / 3
# Work per process, bytes of code, that justifies one more process. Starting a process takes as long
# as 4500 bytes.
_MIN_PROCESS_WORK = 16_000
_MIN_VERSIONS = {"numba": "0.61", "llvmlite": "0.44"}  # as in pyproject.toml


def compile_units(names: Sequence[str], progress: Progress = silent) -> int:
    """Compile units on all cores into the cache; return how many this run compiled.

    It waits for units that another run is compiling.

    Raises
    ------
    CompilationError
        A unit does not compile, or a compiler cannot be started or dies.
    """
    _check_versions()
    pool = _Pool(names, progress)
    try:
        pool.run()
    finally:
        pool.stop()
    return pool.compiled


def _check_versions() -> None:
    """Refuse compilers that are too old.

    Raises
    ------
    CompilationError
        A compiler is too old; the text names it and the cure.
    """
    for package, least in _MIN_VERSIONS.items():
        try:
            present = version(package)
        except PackageNotFoundError:
            present = "none"
        numbers = [int(word) for word in present.split(".")[:2] if word.isdigit()]
        if numbers < [int(word) for word in least.split(".")]:
            what = f"{package} {present} is too old: flexmb compiles with {least} or newer"
            raise CompilationError(f'{what}; python -m pip install "{package}>={least}"')


class _Pool:
    """Units to compile, and the processes that compile them."""

    def __init__(self, names: Sequence[str], progress: Progress) -> None:
        self.waiting = sorted(set(names))
        self.count, self.progress = len(self.waiting), progress
        self.folder = cache_folders()[0]
        self.workers: list[_Worker] = []
        self.answers: queue.SimpleQueue[tuple[_Worker, str]] = queue.SimpleQueue()
        self.locked: list[str] = []  # units that another run is compiling
        self.compiled = 0
        self.done_cost, self.cost = 0.0, sum(map(_cost, names)) or 1.0
        self.start = time.perf_counter()

    def run(self) -> None:
        """Work until all units are in the cache."""
        self._report("")
        while self.waiting or self.locked or any(worker.name for worker in self.workers):
            self._assign()
            if any(worker.name for worker in self.workers):
                with suppress(queue.Empty):
                    self._receive(*self.answers.get(timeout=0.2))
            else:
                time.sleep(0.02)
            if not self.waiting and self.locked:
                self.waiting, self.locked = self.locked, []

    def _assign(self) -> None:
        """Give a unit to every free worker; start more workers if they are worth it."""
        while self.waiting:
            free = next((worker for worker in self.workers if not worker.name), None)
            if free is None and not self._needs_process():
                return
            name = self._next_unit(free)
            self.waiting.remove(name)
            lock = self._lock_unit(name)
            if lock is None:
                self.locked.append(name)
                continue
            if read_unit(self.folder / unit_file(name)) is not None:
                lock.release()
                self._finish(name)
                continue
            if free is not None and free.done >= _MAX_UNITS_PER_PROCESS:
                free.kill()
                self.workers.remove(free)
                free = None
            if free is None:
                free = _Worker(self.folder, self.answers)
                self.workers.append(free)
            free.begin(name, lock)

    def _needs_process(self) -> bool:
        """Whether one more process is worth its start."""
        if not self.workers:
            return True
        left = min(
            sum(_cost(name, worker.kernels) for name in self.waiting) for worker in self.workers
        )
        return len(self.workers) < _cores() and left > _MIN_PROCESS_WORK * len(self.workers)

    def _next_unit(self, worker: _Worker | None) -> str:
        """The next unit for a worker: one that it compiles faster than the others, or a large one.

        A process translates a kernel only once for all units that it compiles.
        """
        mine = worker.kernels if worker else set()
        theirs = [other.kernels for other in self.workers if other is not worker] or [set()]

        def gain(name: str) -> tuple[float, str]:
            here = _cost(name, mine)
            saved = min(_cost(name, kernels) for kernels in theirs) - here
            return saved + 0.5 * here, name

        return max(self.waiting, key=gain)

    def _lock_unit(self, name: str) -> Any:
        """The lock of a unit, or None if another run has it."""
        from filelock import FileLock, Timeout

        lock = FileLock(self.folder / f"{unit_file(name)}.lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return None
        except OSError as error:
            if not leave_cache(self.folder, error.strerror or str(error)):
                raise CompilationError(f"{self.folder}: cannot be written ({error})") from None
            self.folder = cache_folders()[0]
            return self._lock_unit(name)
        return lock

    def _receive(self, worker: _Worker, answer: str) -> None:
        """Treat the answer of a worker; "" if its process has ended."""
        if worker not in self.workers or not worker.name:  # it ended while it had no unit
            return
        name = worker.name
        unwritable = worker.end(answer)
        if not unwritable:
            self.compiled += 1
            self._finish(name)
        elif leave_cache(self.folder, unwritable):
            self.folder = cache_folders()[0]
            self.waiting.insert(0, name)
            for other in [other for other in self.workers if not other.name]:
                other.kill()
                self.workers.remove(other)
        elif worker.folder == self.folder:
            raise CompilationError(f"{self.folder}: cannot be written ({unwritable})")
        else:
            self.waiting.insert(0, name)

    def _finish(self, name: str) -> None:
        self.done_cost += _cost(name)
        self._report(name)

    def _report(self, name: str) -> None:
        share = min(self.done_cost / self.cost, 0.99)
        spent = time.perf_counter() - self.start
        left = f", {spent * (1.0 / share - 1.0):.0f} s left" if share > 0.1 else ""
        done = self.count - len(self.waiting) - len(self.locked)
        done -= sum(1 for worker in self.workers if worker.name)
        what = name.rpartition(".")[0].rpartition(".")[2].replace("_", " ")
        detail = (
            f"{done} of {self.count} units, once a machine: {what}{left}"
            if what
            else (f"{self.count} units, once a machine")
        )
        self.progress("compile", share, detail)

    def stop(self) -> None:
        """End all workers."""
        for worker in self.workers:
            worker.kill()


class _Worker:
    """A process that compiles one unit after the other."""

    def __init__(self, folder: Path, answers: queue.SimpleQueue[tuple[_Worker, str]]) -> None:
        package = str(Path(__file__).parents[2])
        paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        environment["PYTHONIOENCODING"] = "utf-8"
        for word in [word for word in environment if word.startswith("NUMBA_")]:
            del environment[word]  # settings of the user's own code
        self.folder = folder
        self.errors = tempfile.TemporaryFile()  # noqa: SIM115  closed with the worker
        try:
            self.process = subprocess.Popen(
                # -P: files in the current folder are not imported
                [sys.executable, "-P", "-m", "flexmb.engine.compiler", str(folder)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors,
                encoding="utf-8", env=environment, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise CompilationError(f"the compiler of units cannot be started: {error}") from None
        self.name = ""
        self.lock: Any = None
        self.done = 0
        self.kernels: set[FunctionType] = set()  # kernels that it has translated
        # a thread for each worker: on some systems only sockets can be waited for together
        self.listener = threading.Thread(target=self._listen, args=(answers,), daemon=True)
        self.listener.start()

    def _listen(self, answers: queue.SimpleQueue[tuple[_Worker, str]]) -> None:
        """Pass the answers on, and "" when the process has ended."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            answers.put((self, line))
        answers.put((self, ""))

    def begin(self, name: str, lock: Any) -> None:
        self.name, self.lock = name, lock
        self.kernels |= reached(UNITS[name]).kernels.keys()
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{name}\t{unit_file(name)}\n")
            self.process.stdin.flush()
        except OSError:
            raise CompilationError(self._death_message()) from None

    def end(self, answer: str) -> str:
        """Treat the answer to the present unit; return why it could not be written, or ""."""
        word, _, rest = answer.rstrip("\n").partition("\t")
        name, self.name = self.name, ""
        self.done += 1
        self.lock.release()
        if word == "unwritable":
            return rest.partition("\t")[2]
        if word == "failed":
            raise CompilationError(f"{name} does not compile: {rest.partition(chr(9))[2]}")
        if word != "done":
            raise CompilationError(self._death_message())
        return ""

    def _death_message(self) -> str:
        self.process.wait()
        self.errors.seek(0)
        text = self.errors.read().decode(errors="replace").strip().splitlines()
        return "the compiler of units ended early" + (f": {text[-1]}" if text else "")

    def kill(self) -> None:
        with suppress(OSError):
            self.process.kill()
        self.process.wait()
        self.listener.join()
        for stream in (self.process.stdin, self.process.stdout, self.errors):
            with suppress(OSError):
                stream.close()  # type: ignore[union-attr]
        if self.name:
            self.lock.release()


def _cost(name: str, translated: Collection[FunctionType] = ()) -> float:
    """Work to compile a unit, bytes of code; `translated`: kernels that the process knows."""
    kernels = reached(UNITS[name]).kernels
    again = sum(size for kernel, size in kernels.items() if kernel in translated)
    return sum(kernels.values()) - _TRANSLATION_SHARE * again


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # not on all systems
    return len(affinity(0)) if affinity else os.cpu_count() or 1
