"""The file below a result file: one that remembers its first failure instead of raising it.

In: what HDF5 wants written. Out: bytes on the disk, until the disk fails; from then on nothing is
written there and `failure` holds the reason. HDF5 2.0 crashes the process when a write fails inside
it (disk full, quota, file-size limit), or when it does not read back what it wrote; with this file
it never learns of the failure: the pages that found no room are kept in memory. The caller asks for
the failure after every flush, and what was flushed before stays whole.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from flexmb.results.lock import WriteLock

__all__ = ["DiskFile"]

_PAGE = 1 << 16  # bytes of a page kept in memory


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
        self._pages: dict[int, bytearray] = {}  # what found no room, by number of the page
        self._at = 0  # the position

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
        view = memoryview(buffer).cast("B")
        if self.failure is not None:
            for start, stop, page, inside in self._parts(len(view)):
                view[start:stop] = self._page(page)[inside : inside + stop - start]
            self._at += len(view)
            return len(view)
        self._file.seek(self._at)
        n = self._file.readinto(view)
        self._at += n or 0
        return n

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position."""
        if whence == io.SEEK_END:
            offset += self._end()
        self._at = offset + (self._at if whence == io.SEEK_CUR else 0)
        return self._at

    def tell(self) -> int:
        """The current position."""
        return self._at

    def write(self, data: Any) -> int:
        """Write all of `data`, or note why not; says that all was written in either case."""
        view = memoryview(data).cast("B")
        self._unless_failed(lambda: self._write_all(view))
        if self.failure is not None:
            for start, stop, page, inside in self._parts(len(view)):
                self._page(page)[inside : inside + stop - start] = view[start:stop]
        self._at += len(view)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, or note why not."""
        length = self.tell() if size is None else size
        self._unless_failed(lambda: self._file.truncate(length))
        return length

    def reserve(self, size: int) -> None:
        """Take room for `size` more bytes at the end, or note why not."""
        end = self._file.seek(0, io.SEEK_END)
        self._at = end
        while size > 0 and self.failure is None:
            size -= self.write(bytes(min(size, _PAGE)))
        if self.failure is not None:
            with contextlib.suppress(OSError):
                self._file.truncate(end)

    def close(self) -> None:
        """Close the file on the disk."""
        if not self.closed:
            self._unless_failed(self._file.close)
            self._lock.release()
        super().close()

    def _end(self) -> int:
        last = max(self._pages, default=-1)
        return max(self._file.seek(0, io.SEEK_END), (last + 1) * _PAGE)

    def _parts(self, n: int) -> Iterator[tuple[int, int, int, int]]:
        """The next `n` bytes by pages: from and to in them, number of the page, place in it."""
        start = 0
        while start < n:
            page, inside = divmod(self._at + start, _PAGE)
            stop = min(n, start + _PAGE - inside)
            yield start, stop, page, inside
            start = stop

    def _page(self, number: int) -> bytearray:
        """A page in memory, begun with what is on the disk."""
        if number not in self._pages:
            self._file.seek(number * _PAGE)
            self._pages[number] = bytearray((self._file.read(_PAGE) or b"").ljust(_PAGE, b"\0"))
        return self._pages[number]

    def _write_all(self, view: memoryview) -> None:
        self._file.seek(self._at)
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
