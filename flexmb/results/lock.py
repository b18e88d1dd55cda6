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
        self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _claim(self._descriptor)
        except BlockingIOError:
            os.close(self._descriptor)
            raise

    def release(self) -> None:
        """Give the claim back; calling it again does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
            with contextlib.suppress(OSError):  # another run may have taken it already
                self._path.unlink()


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
