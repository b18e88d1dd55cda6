"""One writer for each file: a lock that a process holds until it closes the file or dies.

In: the path of a file. Out: the claim to it, kept in a file of its own beside it (named like it,
with ``.lock`` at the end), so that every program may read the file itself while it is written. The
operating system ends the claim of a killed process; its empty lock file does no harm.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from pathlib import Path

__all__ = ["WriteLock"]


class WriteLock:
    """The claim to write `path`.

    Raises
    ------
    BlockingIOError
        Another run has it.
    OSError
        The folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(path.name + ".lock")
        self._descriptor = _claimed(self._path)
        while not _is_at(self._descriptor, self._path):  # removed by its last owner meanwhile
            os.close(self._descriptor)
            self._descriptor = _claimed(self._path)

    def release(self) -> None:
        """Give the claim back; calling it again does nothing."""
        if self._descriptor < 0:
            return
        # Removed while it is ours, so that nobody removes the next owner's; Windows removes no
        # open file, and there none of a next owner either.
        _remove(self._path)
        os.close(self._descriptor)
        self._descriptor = -1
        if sys.platform == "win32":
            _remove(self._path)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def _claimed(path: Path) -> int:
    """A descriptor of the lock file, which is locked."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        _claim(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        raise
    return descriptor


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether the file behind a descriptor is still the one at the path."""
    if sys.platform == "win32":
        return True  # no open file is ever removed there
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except OSError:
        return False


def _claim(descriptor: int) -> None:
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            raise BlockingIOError(errno.EAGAIN, "another run is writing it") from error
        # else a network disk without locks: there is nothing to claim
