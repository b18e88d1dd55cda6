"""Compiled units: which there are, where they are cached, how they are compiled, loaded and called.

A unit is compiled once a machine: its file in the cache is named by the hash of the sources that it
reaches, in a folder for this processor and these versions of Numba and LLVM. Missing units are
compiled by processes of `engine.compiler`, one a core; a lock for each unit keeps two runs from
doing the same work. Machine code is loaded by LLVM alone, so a run whose units are there never
imports Numba. With NUMBA_DISABLE_JIT=1 all units run as plain Python.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import os
import platform
import re
import selectors
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any, get_type_hints

from filelock import FileLock, Timeout

from flexmb.cache import cache_root, writable
from flexmb.engine.jit import UNITS, Unit
from flexmb.engine.object_files import read_object
from flexmb.engine.records import Packed, is_record, pack, units_in
from flexmb.errors import CompilationError
from flexmb.progress import Progress, silent

__all__ = ["call", "interpreted", "missing_units", "prepare_units", "sources_of", "unit_file"]

_ENGINE = Path(__file__).parent
_IMPORT = re.compile(
    r"^\s*(?:from\s+(flexmb\.engine[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+(flexmb\.engine[\w.]*))",
    re.MULTILINE,
)


def interpreted() -> bool:
    """Whether units run as plain Python (NUMBA_DISABLE_JIT=1)."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


# --- sources and keys -----------------------------------------------------------------------------


def _file_of(module: str) -> Path | None:
    """Source file of a module of the engine."""
    parts = module.split(".")[2:]
    path = _ENGINE.joinpath(*parts)
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


@functools.cache
def _source(file: Path) -> tuple[str, tuple[str, ...]]:
    """Hash of a source file, and the modules of the engine that it imports."""
    data = file.read_bytes()
    modules: set[str] = set()
    for package, names, plain in _IMPORT.findall(data.decode()):
        modules.add(package or plain)
        for name in re.findall(r"\w+", names):
            if package and _file_of(f"{package}.{name}") is not None:
                modules.add(f"{package}.{name}")
    return hashlib.sha256(data).hexdigest(), tuple(sorted(modules))


@functools.cache
def sources_of(module: str) -> tuple[Path, ...]:
    """Source files of the engine that a module reaches, its own among them."""
    reached: set[Path] = set()
    waiting = [module, "flexmb.engine.jit", "flexmb.engine.records", "flexmb.engine.compiler"]
    while waiting:
        file = _file_of(waiting.pop())
        if file is not None and file not in reached:
            reached.add(file)
            waiting.extend(_source(file)[1])
    return tuple(sorted(reached))


@functools.cache
def _key(module: str) -> str:
    """Hash of all that a module reaches."""
    digest = hashlib.sha256()
    for file in sources_of(module):
        digest.update(f"{file.relative_to(_ENGINE).as_posix()}={_source(file)[0]};".encode())
    return digest.hexdigest()[:16]


@functools.cache
def _machine() -> str:
    """What machine code depends on beside its source: processor, and versions of the compilers."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    cpu = hashlib.sha256(f"{llvm.get_host_cpu_name()} {features}".encode()).hexdigest()[:8]
    return f"{platform.machine()}-{cpu}-numba{version('numba')}-llvmlite{version('llvmlite')}"


# --- the cache --------------------------------------------------------------------------------------


def _private(folder: Path) -> bool:
    """Whether no other user may write into a folder; always so where there are no such rights."""
    if not hasattr(os, "getuid"):
        return True
    state = folder.stat()
    return state.st_uid in (os.getuid(), 0) and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


@functools.cache
def cache_folders() -> tuple[Path, ...]:
    """Folders that hold compiled units; the first is where new ones are written.

    A cache that other users may write to is not used. Where it cannot be written, new units go to a
    folder of this process.
    """
    folder = cache_root() / "units" / _machine()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if _private(folder):
            return (folder,) if writable(folder) else (_scratch_folder(), folder)
    return (_scratch_folder(),)


@functools.cache
def _scratch_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="flexmb-units-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def unit_file(name: str) -> str:
    """Name of the file of a unit in the cache."""
    return f"{name.removeprefix('flexmb.engine.')}-{_key(name.rpartition('.')[0])}.unit"


Stored = tuple[bytes, tuple[str, ...]]
"""Machine code of a unit, and the names of the units that it calls."""


def _stored(name: str) -> Stored | None:
    """Machine code of a unit, and the names of the units that it calls; None where it is missing."""
    for folder in cache_folders():
        stored = read_object(folder / unit_file(name))
        if stored is not None:
            return stored
    return None


# --- machine code in this process -----------------------------------------------------------------


class _Loader:
    """The units that this process has loaded."""

    def __init__(self) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        target = llvm.Target.from_triple(llvm.get_process_triple())
        machine = target.create_target_machine(reloc="pic", codemodel="default", jit=True)
        self._llvm = llvm
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        self.addresses: dict[str, int] = {}

    def add(self, codes: dict[str, bytes]) -> None:
        """Load machine code; what it calls is among it or was loaded before."""
        for code in codes.values():
            self._engine.add_object_file(self._llvm.object_file.ObjectFileRef.from_data(code))
        self._engine.finalize_object()
        for name in codes:
            symbol = name.replace(".", "_")
            self.addresses[name] = self._engine.get_function_address(symbol)


_lock = RLock()


@functools.cache
def _loader() -> _Loader:
    return _Loader()


def _collect(
    names: Iterable[str], stored: dict[str, Stored], known: Callable[[str], bool]
) -> list[str]:
    """Add units and all they call to `stored`; returns the names of those that are missing."""
    missing, seen = [], set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in seen or known(name):
            continue
        seen.add(name)
        if name not in stored and (file := _stored(name)) is not None:
            stored[name] = file
        if name in stored:
            waiting.extend(stored[name][1])
        else:
            missing.append(name)
            waiting.extend(_calls_in_source(name))
    return missing


def _calls_in_source(name: str) -> list[str]:
    """Units that a unit may call, by the names in its module: a guess, to count the missing."""
    module = sys.modules.get(name.rpartition(".")[0])
    members = () if module is None else vars(module).values()
    return [other.name for other in members if isinstance(other, Unit)]


def missing_units(units: Iterable[Unit]) -> list[str]:
    """Names of the units that would have to be compiled."""
    return _collect([unit.name for unit in units], {}, lambda name: False)


def prepare_units(units: Iterable[Unit], progress: Progress = silent) -> int:
    """Load units and all they call; compile what is missing. Returns how many were compiled.

    Parameters
    ----------
    units : iterable of Unit
        What will be called.
    progress : Progress
        Told the phase `compile` where anything is compiled, else `load`.

    Raises
    ------
    CompilationError
        A unit does not compile, or its compiler cannot be started.
    """
    if interpreted():
        return 0
    with _lock:
        names = [unit.name for unit in units]
        loaded = _loader().addresses
        if all(name in loaded for name in names):
            return 0
        compiled = 0
        stored: dict[str, Stored] = {}
        progress("load", 0.0)
        while missing := _collect(names, stored, loaded.__contains__):
            compiled += compile_units(missing, progress)
        _loader().add({name: code for name, (code, _) in stored.items()})
        progress("compile" if compiled else "load", 1.0)
        return compiled


def _address(unit: Unit) -> int:
    addresses = _loader().addresses
    if unit.name not in addresses:
        prepare_units([unit])
    return addresses[unit.name]


# --- calls ------------------------------------------------------------------------------------------

_C_TYPES: dict[Any, Any] = {int: ctypes.c_int64, float: ctypes.c_double}


@functools.cache
def _c_function(name: str, address: int) -> Any:
    hints = get_type_hints(UNITS[name].function, include_extras=True)
    result = _C_TYPES[hints.pop("return")]
    types = [ctypes.c_int64 if is_record(hint) else _C_TYPES[hint] for hint in hints.values()]
    return ctypes.CFUNCTYPE(result, *types)(address)


def call(unit: Unit, *arguments: Any) -> Any:
    """Run a unit on records and numbers, as machine code unless `interpreted`.

    Parameters
    ----------
    unit : Unit
        What to run; it is compiled if need be.
    arguments : records and numbers
        As its annotations say; the arrays of records are changed in place.
    """
    if interpreted():
        return unit.function(*arguments)
    records = [value for value in arguments if isinstance(value, tuple)]
    prepare_units([unit, *(other for record in records for other in units_in(record))])
    packed = [pack(value, _address) if isinstance(value, tuple) else value for value in arguments]
    values = [value.address if isinstance(value, Packed) else value for value in packed]
    return _c_function(unit.name, _address(unit))(*values)


# --- compilation --------------------------------------------------------------------------------------


def compile_units(names: Sequence[str], progress: Progress = silent) -> int:
    """Compile units on all cores into the cache; returns how many this process compiled.

    A unit that another process is compiling is waited for.

    Raises
    ------
    CompilationError
        A unit does not compile, or a compiler cannot be started or dies.
    """
    work = _Work(names, progress)
    try:
        work.run()
    finally:
        work.stop()
    return work.compiled


class _Work:
    """Units to compile, and the processes that compile them."""

    def __init__(self, names: Sequence[str], progress: Progress) -> None:
        self.waiting = sorted(set(names), key=lambda name: (-_cost(name), name))
        self.count, self.progress = len(self.waiting), progress
        self.folder = cache_folders()[0]
        self.workers: list[_Worker] = []
        self.elsewhere: list[str] = []  # in the hands of another process
        self.compiled = 0
        self.done_cost, self.cost = 0.0, sum(map(_cost, names)) or 1.0
        self.start = time.perf_counter()

    def run(self) -> None:
        """Until all are there."""
        self._tell("")
        while self.waiting or self.elsewhere or any(worker.name for worker in self.workers):
            self._give()
            busy = [worker for worker in self.workers if worker.name]
            if busy:
                for worker in _ready(busy):
                    self._take(worker)
            else:
                time.sleep(0.02)
            if not self.waiting and self.elsewhere:
                self.waiting, self.elsewhere = self.elsewhere, []

    def _give(self) -> None:
        """A unit to every free worker."""
        while self.waiting:
            free = next((worker for worker in self.workers if not worker.name), None)
            if free is None and len(self.workers) >= min(_cores(), self.count):
                return
            name = self.waiting.pop(0)
            lock = _claim(self.folder, name)
            if lock is None:
                self.elsewhere.append(name)
                return
            if read_object(self.folder / unit_file(name)) is not None:
                lock.release()
                self._finish(name)
                continue
            if free is None:
                free = _Worker(self.folder)
                self.workers.append(free)
            free.begin(name, lock)

    def _take(self, worker: _Worker) -> None:
        """The answer of a worker."""
        name = worker.name
        worker.end()
        self.compiled += 1
        self._finish(name)

    def _finish(self, name: str) -> None:
        self.count -= 0
        self.done_cost += _cost(name)
        self._tell(name)

    def _tell(self, name: str) -> None:
        share = min(self.done_cost / self.cost, 0.99)
        spent = time.perf_counter() - self.start
        left = f", {spent * (1.0 / share - 1.0):.0f} s left" if share > 0.1 else ""
        done = self.count - len(self.waiting) - len(self.elsewhere)
        done -= sum(1 for worker in self.workers if worker.name)
        what = name.rpartition(".")[0].rpartition(".")[2].replace("_", " ")
        detail = f"{done} of {self.count} units, once a machine: {what}{left}" if what else (
            f"{self.count} units, once a machine"
        )
        self.progress("compile", share, detail)

    def stop(self) -> None:
        """End all workers."""
        for worker in self.workers:
            worker.kill()


class _Worker:
    """A process that compiles one unit after the other."""

    def __init__(self, folder: Path) -> None:
        package = str(Path(__file__).parents[2])
        paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        for word in [word for word in environment if word.startswith("NUMBA_")]:
            del environment[word]  # settings of the user's own code
        self.errors = tempfile.TemporaryFile(mode="w+")  # noqa: SIM115  closed with the worker
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "flexmb.engine.compiler", str(folder)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors, text=True,
                env=environment, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise CompilationError(f"the compiler of units cannot be started: {error}") from None
        self.name = ""
        self.lock: Any = None

    def begin(self, name: str, lock: Any) -> None:
        self.name, self.lock = name, lock
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{name}\t{unit_file(name)}\n")
            self.process.stdin.flush()
        except OSError:
            raise CompilationError(self._death()) from None

    def end(self) -> None:
        """Take the answer to the present unit."""
        assert self.process.stdout is not None
        word, _, rest = self.process.stdout.readline().rstrip("\n").partition("\t")
        name, self.name = self.name, ""
        self.lock.release()
        if word == "failed":
            raise CompilationError(f"{name} does not compile: {rest.partition(chr(9))[2]}")
        if word != "done":
            raise CompilationError(self._death())

    def _death(self) -> str:
        self.process.wait()
        self.errors.seek(0)
        text = self.errors.read().strip().splitlines()
        return "the compiler of units ended early" + (f": {text[-1]}" if text else "")

    def kill(self) -> None:
        with suppress(OSError):
            self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.errors):
            with suppress(OSError):
                stream.close()  # type: ignore[union-attr]
        if self.name:
            self.lock.release()


def _ready(workers: Sequence[_Worker]) -> list[_Worker]:
    """Those with an answer; waits a little for the first."""
    with selectors.DefaultSelector() as selector:
        for worker in workers:
            assert worker.process.stdout is not None
            selector.register(worker.process.stdout, selectors.EVENT_READ, worker)
        return [key.data for key, _ in selector.select(0.2)]


def _claim(folder: Path, name: str) -> Any:
    """The lock of a unit, or None if another process has it; it ends with the process."""
    lock = FileLock(folder / f"{unit_file(name)}.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return None
    return lock


def _cost(name: str) -> float:
    """Seconds that a unit takes to compile, about: its module's length."""
    file = _file_of(name.rpartition(".")[0])
    return 0.2 if file is None else 0.2 + file.stat().st_size * 5e-5


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
