"""The cache of compiled units: keys, folders, and the files that hold their machine code.

A unit is compiled once per machine. Its file is named by the hash of all sources of the engine that
it reaches, and is in a folder for this processor and these versions of Numba and LLVM. So after an
edit only the units that reach the edited file are compiled again, and different machines and
versions can share a home folder. A file has a line of JSON (checksum, names of the units that it
calls), then the machine code. It is written whole or not at all; a damaged file counts as missing.
A cache folder that other users may write to is not used.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import json
import os
import platform
import re
import shutil
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from flexmb.errors import FlexmbWarning
from flexmb.folders import cache_root, is_private, is_writable, temporary_folder, whole_file

_ENGINE = Path(__file__).parent
_IMPORT = re.compile(
    r"^\s*(?:from\s+(flexmb\.engine[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)"
    r"|import\s+(flexmb\.engine[\w.]*))",
    re.MULTILINE,
)
_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ ].*\n|\n)+", re.MULTILINE)
_UNUSED_DAYS = 30.0  # caches of other versions or processors are removed after so long without use
_FORMAT = "flexmb unit 1"

Stored = tuple[bytes, tuple[str, ...]]
"""Machine code of a unit, and the names of the units that it calls."""


def file_of(module: str) -> Path | None:
    """Source file of a module of the engine."""
    parts = module.split(".")[2:]
    path = _ENGINE.joinpath(*parts)
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


@functools.cache
def _source(file: Path) -> tuple[str, tuple[str, ...]]:
    """Hash of a source file, and the modules of the engine that it imports to run."""
    data = file.read_bytes()
    modules: set[str] = set()
    for package, names, plain in _IMPORT.findall(_FOR_TYPES.sub("", data.decode())):
        modules.add(package or plain)
        for name in re.findall(r"\w+", names):
            if package and file_of(f"{package}.{name}") is not None:
                modules.add(f"{package}.{name}")
    return hashlib.sha256(data).hexdigest(), tuple(sorted(modules))


@functools.cache
def sources_of(module: str) -> tuple[Path, ...]:
    """Source files of the engine that a module imports, directly or not, and its own."""
    compiler = file_of("flexmb.engine.compiler")
    assert compiler is not None  # it is part of the package
    reached = {compiler}
    waiting = [module, "flexmb.engine.jit"]
    while waiting:
        file = file_of(waiting.pop())
        if file is not None and file not in reached:
            reached.add(file)
            waiting.extend(_source(file)[1])
    return tuple(sorted(reached))


@functools.cache
def _key(module: str) -> str:
    """Hash of all sources that a module reaches (16 hex digits)."""
    digest = hashlib.sha256()
    for file in sources_of(module):
        digest.update(f"{file.relative_to(_ENGINE).as_posix()}={_source(file)[0]};".encode())
    return digest.hexdigest()[:16]


@functools.cache
def engine_hash() -> str:
    """Hash of all sources of the engine, names and contents (16 hex digits)."""
    digest = hashlib.sha256()
    for path in sorted(_ENGINE.rglob("*.py")):
        digest.update(path.relative_to(_ENGINE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def checks_indices() -> bool:
    """Whether kernels check their indices: `FLEXMB_CHECK_INDICES=1`, to find a wrong kernel."""
    return os.environ.get("FLEXMB_CHECK_INDICES", "0") not in ("", "0")


@functools.cache
def _machine() -> str:
    """Name of processor and compiler versions, on which machine code depends beside its source."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    cpu = hashlib.sha256(f"{llvm.get_host_cpu_name()} {features}".encode()).hexdigest()[:8]
    versions = f"numba{version('numba')}-llvmlite{version('llvmlite')}"
    return f"{platform.machine()}-{cpu}-{versions}{'-indices' * checks_indices()}"


def cache_folders() -> tuple[Path, ...]:
    """Folders of compiled units; new ones are written to the first.

    A cache that other users may write to is not used. If the cache cannot be written, new units go
    to a temporary folder of this process.
    """
    return (_scratch_folder(), *_shared_folders()) if _full else _shared_folders()


_full: list[Path] = []  # caches that could not be written


def leave_cache(folder: Path, why: str) -> bool:
    """Stop writing to a cache folder, with a warning; False if it is the temporary folder."""
    if folder == _scratch_folder():
        return False
    _full.append(folder)
    what = "compiled parts of flexmb are kept for this run only; free it or set FLEXMB_CACHE_DIR"
    warnings.warn(f"{folder}: cannot be written ({why}); {what}", FlexmbWarning, stacklevel=2)
    return True


@functools.cache
def _shared_folders() -> tuple[Path, ...]:
    folder, shared = cache_root() / "units" / _machine(), False
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        shared = not is_private(folder)
        if not shared and is_writable(folder):
            _remove_unused(folder)
            return (folder,)
    why = "other users may write to it" if shared else "it is read-only or full"
    what = "compiled parts of flexmb are kept for this run only; set FLEXMB_CACHE_DIR to a folder"
    warnings.warn(
        f"{folder}: not used as cache, for {why}: {what} of your own", FlexmbWarning, stacklevel=2
    )
    readable = not shared and folder.is_dir()
    return (_scratch_folder(), folder) if readable else (_scratch_folder(),)


def _remove_unused(folder: Path) -> None:
    """Remove folders of other versions and processors that were not used for `_UNUSED_DAYS`."""
    limit = time.time() - _UNUSED_DAYS * 86400.0
    with suppress(OSError):  # a network disk may not store times, another process may be faster
        os.utime(folder)
        for other in folder.parent.iterdir():
            if other != folder and other.is_dir() and other.stat().st_mtime < limit:
                shutil.rmtree(other, ignore_errors=True)


@functools.cache
def _scratch_folder() -> Path:
    folder = temporary_folder()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def unit_file(name: str) -> str:
    """Name of the file of a unit in the cache."""
    return f"{name.removeprefix('flexmb.engine.')}-{_key(name.rpartition('.')[0])}.unit"


def read_stored(name: str) -> Stored | None:
    """Machine code of a unit and the names of the units that it calls; None if it is missing."""
    for folder in cache_folders():
        stored = read_unit(folder / unit_file(name))
        if stored is not None:
            return stored
    return None


def write_unit(path: Path, code: bytes, called: Sequence[str]) -> None:
    """Write the machine code of a unit and the names of the units that it calls.

    Raises
    ------
    OSError
        The folder is gone, read-only or full.
    """
    head = {"format": _FORMAT, "sha256": hashlib.sha256(code).hexdigest(), "calls": list(called)}
    with whole_file(path) as partial:
        partial.write_bytes(json.dumps(head).encode() + b"\n" + code)


def read_unit(path: Path) -> Stored | None:
    """Content of a file of the cache; None if there is no such file or it is damaged."""
    try:
        line, _, code = path.read_bytes().partition(b"\n")
        head = json.loads(line)
        whole = head["format"] == _FORMAT and head["sha256"] == hashlib.sha256(code).hexdigest()
        return (code, tuple(map(str, head["calls"]))) if whole else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
