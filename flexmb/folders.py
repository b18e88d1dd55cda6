"""Folders: of caches and of output.

The cache folder is `FLEXMB_CACHE_DIR` where that is set, else the user's cache folder of this
operating system. It holds compiled units and the result of the test of the renderer; to delete it
costs time only.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from zlib import crc32

from flexmb.errors import OutputError, Problem, nearest


def cache_root() -> Path:
    """Folder of all flexmb caches; it may not exist yet."""
    variable = os.environ.get("FLEXMB_CACHE_DIR")
    if variable:
        return Path(variable)
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("flexmb", appauthor=False))


def is_private(path: Path) -> bool:
    """Whether no other user may write to a path; always so where there are no such rights."""
    user = getattr(os, "getuid", None)
    if user is None:
        return True
    state = path.stat()
    return state.st_uid in (user(), 0) and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def output_folder(scene: str | Path) -> Path:
    """``out/<name>``, the name being that of the scene's folder for a file ``scene.toml``."""
    path = Path(scene)
    return Path("out") / (
        Path(os.path.abspath(path)).parent.name if path.stem == "scene" else path.stem
    )


def missing_file(path: Path, what: str = "no such file") -> Problem:
    """The problem of a file that is not there, with the nearest names in its folder."""
    try:
        names = sorted(entry.name for entry in path.parent.iterdir())
    except OSError:
        folder = path.parent
        what += "" if folder.is_dir() else f": the folder {folder} does not exist"
        return Problem(str(path), what)
    return Problem(str(path), what, (), nearest(path.name, names))


def writable_folder(folder: Path) -> Path:
    """The folder, made if it is missing.

    Raises
    ------
    OutputError
        It cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        files = [path for path in (folder, *folder.parents) if path.is_file()]
        why = f"{files[0]} is a file" if files else error.strerror
        raise OutputError(f"cannot write to the output folder {folder}: {why}") from None


def partial_path(path: Path) -> Path:
    """A name beside `path` to write to; what killed processes left of it is removed."""
    return path.with_name(_sweep(path.parent, path.name) + path.suffix)


def temporary_folder() -> Path:
    """A new folder among the temporary files; those of killed processes are removed."""
    return Path(tempfile.mkdtemp(prefix=_temporary_prefix())).resolve()


def scratch_folder() -> tempfile.TemporaryDirectory[str]:
    """The same for a ``with`` statement, or until it is cleaned up."""
    return tempfile.TemporaryDirectory(prefix=_temporary_prefix())


def _temporary_prefix() -> str:
    return f"{_sweep(Path(tempfile.gettempdir()), 'flexmb', 'flexmb-')}-"


def _sweep(folder: Path, name: str, begin: str = ".") -> str:
    """Begin of a name that tells this machine and process; leftovers of ended ones are removed."""
    mark = f"{begin}{crc32(f'{platform.node()} {name}'.encode(errors='replace')):08x}-"
    for old in folder.glob(f"{mark}*"):
        process = old.name[len(mark) :].partition(".")[0].partition("-")[0]
        if process.isdigit() and int(process) != os.getpid():
            import psutil  # 10 ms that few need

            if not psutil.pid_exists(int(process)):
                with suppress(OSError):
                    shutil.rmtree(old) if old.is_dir() else old.unlink()
    return f"{mark}{os.getpid()}"


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write to, in the folder of `path`: at the end of the ``with`` block it becomes it.

    An older file stays until then, also if the disk is full or the program is killed.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    partial = partial_path(path)
    try:
        yield partial
        os.replace(partial, path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_text_file(path: Path, text: str) -> None:
    """Write a text file as a whole.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    try:
        with whole_file(path) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_regular(path: Path) -> bytes:
    """The content of a file that is no pipe, no device and no folder.

    Raises
    ------
    OSError
        It is one, or cannot be read.
    """
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, "is no regular file", str(path))
    return path.read_bytes()


def read_json(text: str | bytes) -> Any:
    """Data of a JSON text.

    Raises
    ------
    ValueError
        It is none, or has lists inside each other more deeply than anything of flexmb.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("lists inside each other, too many") from None


@contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Raise an :class:`OutputError` where a file that takes many runs cannot be written."""
    try:
        yield
    except OSError as error:
        what = f"{path} cannot be written ({error.strerror or error})"
        raise OutputError(f"{what}: make room, and the same command continues") from None


def is_writable(folder: Path) -> bool:
    """Whether files can be made in `folder`, which is created if it is missing."""
    try:
        writable_folder(folder)
    except OutputError:
        return False
    return True


def relative_path(path: Path, folder: Path) -> str:
    """The path as seen from a folder, with forward slashes; as it is on another drive."""
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()
