"""The one decorator of all compiled code, and the cache folder behind it.

Numba keys its disk cache on the file of the *called* function only: after an edit in one file, a
cached caller in another file goes on running the old code. So the cache folder carries a hash of
every source file of the engine: any edit opens a fresh folder, and a stale one is never read.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import codegen
from numba.core.dispatcher import Dispatcher

from flexmb.cache import cache_root, writable

_ENGINE = Path(__file__).parent
_UNUSED_DAYS = 30.0

# `fastmath=True` would let the compiler assume that no NaN exists and make isfinite(nan) true;
# these four flags keep NaN honest and still allow vectorised sums.
_FASTMATH = {"contract", "reassoc", "arcp", "nsz"}


def source_hash(folder: Path = _ENGINE) -> str:
    """Hash of all Python sources below `folder`, names and contents (16 hex digits)."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _forget_unused(root: Path, keep: Path) -> None:
    limit = time.time() - _UNUSED_DAYS * 86400.0
    for folder in root.iterdir():
        with suppress(OSError):  # another process may be removing it as well
            if folder != keep and folder.is_dir() and folder.stat().st_mtime < limit:
                shutil.rmtree(folder, ignore_errors=True)


def _open_cache() -> Path:
    folder = cache_root() / "kernels" / source_hash()
    if not writable(folder):
        return Path(tempfile.mkdtemp(prefix="flexmb-kernels-"))
    with suppress(OSError):  # a network disk may not keep times of folders
        os.utime(folder)
        _forget_unused(folder.parent, keep=folder)
    return folder


CACHE_DIR = _open_cache()
numba.config.CACHE_DIR = str(CACHE_DIR)

# Without reference counting (`_nrt`) nothing can allocate, calls cost a tenth, and Numba refuses
# at compile time any kernel that would allocate.
_OPTIONS = {
    "cache": True,
    "fastmath": _FASTMATH,
    "error_model": "numpy",
    "nogil": True,
    "_nrt": False,
}

_LIGHT = type(numba.config.OPT)(1)


@contextmanager
def light_compilation() -> Iterator[None]:
    """Compile with few optimisations meanwhile: for code outside the time loop."""
    level, numba.config.OPT = numba.config.OPT, _LIGHT
    try:
        yield
    finally:
        numba.config.OPT = level


class _Emission:
    """Whether compiled code becomes machine code now."""

    wanted = True


def _skip_unless_wanted(cls: type, name: str) -> None:
    """Let a method of the code generator do nothing while no machine code is wanted."""
    method = getattr(cls, name, None)
    if method is None:  # another version of Numba: all kernels become machine code, only slower
        return

    def guarded(*args: Any) -> Any:
        return method(*args) if _Emission.wanted else None

    setattr(cls, name, guarded)


_skip_unless_wanted(codegen.JITCodeLibrary, "_finalize_specific")
_skip_unless_wanted(codegen.JITCPUCodegen, "_add_module")
_skip_unless_wanted(codegen.JITCPUCodegen, "set_env")


@contextmanager
def _without_machine_code() -> Iterator[None]:
    """Stop at optimised intermediate code meanwhile: only entries run, with all they call linked.

    Numba would make machine code of every kernel for its own, a quarter of all compile time, and
    would bind it to an environment that only Python objects need.
    """
    before, _Emission.wanted = _Emission.wanted, False
    try:
        yield
    finally:
        _Emission.wanted = before


entry = numba.njit(**_OPTIONS)
"""Decorator of the few functions that Python calls."""

kernel_names: list[str] = []
"""All kernels that were imported, for the progress of compilation."""


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of all functions that only compiled code calls; they get no Python wrapper.

    Called from Python with compilation on, they raise `TypeError` (tests wrap them in an `entry`).
    """
    return _internal(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of kernels in the time loop that take the whole System and Work.

    A call would copy hundreds of numbers, some 0.3 µs each time.
    """
    return _internal(function, forceinline=True)


def _internal(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    kernel_names.append(f"{function.__module__}.{function.__qualname__}")
    options = {**_OPTIONS, "cache": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled = numba.njit(**options, **more)(function)
    if isinstance(compiled, Dispatcher):

        def refuse(*_: Any, **__: Any) -> None:
            raise TypeError(f"kernel {function.__qualname__} is called by compiled code only")

        def template(args: Any, kws: Any) -> Any:
            plain = tuple(numba.types.unliteral(arg) for arg in args)
            with light_compilation(), _without_machine_code():
                return Dispatcher.get_call_template(compiled, plain, kws)

        compiled._compile_for_args = refuse
        compiled._insert = lambda *_, **__: None
        # One compilation for all integers, not one for every literal that is passed, and a cheap
        # one: the entries optimise everything once more with all kernels in view.
        compiled.get_call_template = template
    return compiled
