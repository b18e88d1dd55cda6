"""The file below a result file: one that remembers its first failure instead of raising it.

In: what HDF5 wants written. Out: bytes on the disk, until the disk fails; from then on nothing is
written and `failure` holds the reason. HDF5 2.0 crashes the process when a write fails inside it
(disk full, quota, file-size limit); with this file it never learns of the failure, the caller asks
for it after every flush, and what was flushed before stays whole.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexmb.results.lock import WriteLock

__all__ = ["DiskFile"]


class DiskFile(io.RawIOBase):
    """An unbuffered binary file for reading and writing.

    Parameters
    ----------
    path : Path
        Where it is.
    anew : bool
        Whether an empty file is made there, or the one that is there is kept.

    Raises
    ------
    BlockingIOError
        Another run is writing the file; it is left untouched.
    OSError
        The file cannot be opened.
    """

    def __init__(self, path: Path, *, anew: bool = True) -> None:
        super().__init__()
        self._lock = WriteLock(path)
        try:
            self._file = (  # closed by close()
                open(path, "w+b", buffering=0) if anew else open(path, "r+b", buffering=0)  # noqa: SIM115
            )
        except OSError:
            self._lock.release()
            raise
        self.failure: OSError | None = None

    def readable(self) -> bool:
        """Yes: HDF5 reads back what it evicted from its cache."""
        return True

    def writable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def readinto(self, buffer: Any) -> int | None:
        """Fill `buffer` from the current position."""
        return self._file.readinto(buffer)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """The current position."""
        return self._file.tell()

    def write(self, data: Any) -> int:
        """Write all of `data`, or note why not; says that all was written in either case."""
        view = memoryview(data).cast("B")
        self._unless_failed(lambda: self._write_all(view))
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, or note why not."""
        length = self.tell() if size is None else size
        self._unless_failed(lambda: self._file.truncate(length))
        return length

    def close(self) -> None:
        """Close the file on the disk."""
        if not self.closed:
            self._unless_failed(self._file.close)
            self._lock.release()
        super().close()

    def _write_all(self, view: memoryview) -> None:
        done = 0
        while done < len(view):
            done += self._file.write(view[done:])

    def _unless_failed(self, action: Callable[[], Any]) -> None:
        if self.failure is not None:
            return
        try:
            action()
        except OSError as error:
            self.failure = error
