"""The file below a result file: one writer, no torn writes, no crash when the disk fails.

HDF5 2.0 crashes the process if a write fails inside it (disk full, quota, file-size limit), or if
it does not read back what it wrote. So `DiskFile` remembers its first failure instead of raising
it, and keeps the pages that the disk did not take in memory; HDF5 never learns of the failure. The
caller asks for the failure after every flush; what was flushed before stays intact. `WriteLock`
admits one writer; `uninterrupted` delays Ctrl-C until a write is complete.

A finished file is sealed as a whole (`flexmb.untrusted`). Until then it contains three checksums:

- `/checks`: two rows, each a number of output rows and the CRC-32 of every table up to there. They
  are written alternately, before `/progress` counts the rows, so that one of them always matches;
- the attribute `content`: SHA-256 of everything that is fixed before the run;
- `/state/checks`: CRC-32 of each slot of the integrator's state.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Self
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.results.channels import TABLES
from flexmb.untrusted import begin_writing, end_writing, seal

_PAGE = 1 << 16  # bytes of a page in memory
# Suffixes of the name of a new file, and of a file that replaces one that is still being written.
_PART, _NEXT = ".part", ".next"
# what disks without locks (network disks) answer
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)
_LOCK_TIMEOUT = 0.05  # s to wait for a lock file that its last owner is removing at this moment


class WriteLock:
    """Exclusive permission to write `path`, until it is released or the process ends, also by a
    kill.

    The lock is a separate file, named like `path` with ``.lock`` at the end, so that every program
    may read `path` itself while it is written. A lock file left by a killed process has no effect.
    On a disk without locks every process gets the permission.

    Raises
    ------
    BlockingIOError
        Another run has it.
    OSError
        The folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        from filelock import FileLock, Timeout

        self._file = path.with_name(path.name + ".lock")
        self._lock = FileLock(self._file, thread_local=False)
        try:
            self._lock.acquire(timeout=_LOCK_TIMEOUT, poll_interval=_LOCK_TIMEOUT / 5)
        except Timeout:
            raise BlockingIOError(errno.EAGAIN, "another run is writing it") from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the permission; calling it again does nothing."""
        if self._lock.is_locked:
            # Windows removes no open file; there filelock removes it
            with contextlib.suppress(OSError):
                # while it is locked, so that nobody removes the file of the next owner
                self._file.unlink()
            self._lock.release()


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay an interruption (Ctrl-C) until the end of the ``with`` block.

    HDF5 calls back into Python for every write. An exception raised there would leave the file half
    written, or end the process. Only the main thread is ever interrupted.
    """
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT) if main else None
    if before is None:  # another thread, or a handler that was not set by Python
        yield
        return
    waiting = []
    signal.signal(signal.SIGINT, lambda *_: waiting.append(True))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if waiting:
            signal.raise_signal(signal.SIGINT)


class DiskFile(io.RawIOBase):
    """An unbuffered binary file for reading and writing.

    Parameters
    ----------
    path : Path
        Its path.
    new : bool
        Whether to write a new file. It gets its name by `complete`; an older file of this name
        stays until then.
    claimed : bool
        Whether this process already has the `WriteLock` of `path`, and will call `take_place_of`.

    Raises
    ------
    BlockingIOError
        Another run is writing the file; it is left untouched.
    OSError
        The file cannot be opened.
    """

    def __init__(self, path: Path, *, new: bool = False, claimed: bool = False) -> None:
        super().__init__()
        self._lock = None if claimed else WriteLock(path)
        self._path = path
        self._part = path.with_name(path.name + (_NEXT if claimed else _PART)) if new else None
        try:
            if self._part is not None:
                self._part.touch()
            self._file = open(self._part or path, "r+b", buffering=0)  # noqa: SIM115
            if new:
                self._file.truncate(0)
            if not claimed:  # remains of a run that was killed
                path.with_name(path.name + _NEXT).unlink(missing_ok=True)
            begin_writing(self._part or path)
        except OSError:
            self._release()
            raise
        self.failure: OSError | None = None
        self._pages: dict[int, bytearray] = {}  # what the disk did not take, by page number
        self._position = 0

    def complete(self) -> None:
        """Give a new file its name, replacing an older one; a failure is remembered."""
        if self._part is not None:
            self._unless_failed(self._move)

    def take_place_of(self, before: DiskFile) -> None:
        """Continue in place of another file, which is closed: take over its lock, and its name if
        any."""
        self._lock, before._lock = before._lock, None
        has_name = before._part is None
        before.close()
        if has_name:
            self.complete()

    def seal(self) -> None:
        """Write the checksum of the whole file into its user block; a failure is remembered."""
        self._unless_failed(lambda: self._write_all(0, memoryview(seal(self._file))))

    def _move(self) -> None:
        assert self._part is not None  # `complete` calls this only for a new file
        self._file.close()  # Windows renames no open file
        os.replace(self._part, self._path)
        self._part = None
        self._file = open(self._path, "r+b", buffering=0)  # noqa: SIM115

    def readinto(self, buffer: Any) -> int | None:
        """Fill `buffer` from the current position."""
        view = memoryview(buffer).cast("B")
        if self.failure is not None:
            for start, stop, page, inside in self._parts(len(view)):
                view[start:stop] = self._page(page)[inside : inside + stop - start]
            self._position += len(view)
            return len(view)
        self._file.seek(self._position)
        n = self._file.readinto(view)
        self._position += n or 0
        return n

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position."""
        if whence == io.SEEK_END:
            offset += self._end()
        self._position = offset + (self._position if whence == io.SEEK_CUR else 0)
        return self._position

    def tell(self) -> int:
        """The current position."""
        return self._position

    def write(self, data: Any) -> int:
        """Write all of `data`; reports success also if it fails, and remembers the failure."""
        view = memoryview(data).cast("B")
        self._unless_failed(lambda: self._write_all(self._position, view))
        if self.failure is not None:
            for start, stop, page, inside in self._parts(len(view)):
                self._page(page)[inside : inside + stop - start] = view[start:stop]
        self._position += len(view)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file; a failure is remembered."""
        length = self.tell() if size is None else size
        self._unless_failed(lambda: self._file.truncate(length))
        return length

    def close(self) -> None:
        """Close the file on the disk."""
        if not self.closed:
            end_writing(self._part or self._path)
            self._unless_failed(self._file.close)
            if self._part is not None:
                self._part.unlink(missing_ok=True)
            self._release()
        super().close()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.release()

    def _end(self) -> int:
        last = max(self._pages, default=-1)
        return max(self._file.seek(0, io.SEEK_END), (last + 1) * _PAGE)

    def _parts(self, n: int) -> Iterator[tuple[int, int, int, int]]:
        """The next `n` bytes by pages: start and end among them, page number, offset in the
        page."""
        start = 0
        while start < n:
            page, inside = divmod(self._position + start, _PAGE)
            stop = min(n, start + _PAGE - inside)
            yield start, stop, page, inside
            start = stop

    def _page(self, number: int) -> bytearray:
        """A page in memory; initially as on the disk."""
        if number not in self._pages:
            self._file.seek(number * _PAGE)
            self._pages[number] = bytearray((self._file.read(_PAGE) or b"").ljust(_PAGE, b"\0"))
        return self._pages[number]

    def _write_all(self, position: int, view: memoryview) -> None:
        self._file.seek(position)
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


_CHANGING: Final = (*TABLES, "progress", "report", "checks", "state")
_BLOCK_BYTES = 1 << 24  # bytes of a table read at once
# number of attempts, and seconds between: a run may count new rows while they are read
_ATTEMPTS, _PAUSE = 5, 0.02


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise what a ``with`` block cannot read as `ResultFileError`, since flexmb writes no such
    file."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, OSError, RuntimeError) as error:
        raise ResultFileError(f"{path}: is a damaged result file ({error})") from error


def no_rows() -> NDArray[np.int64]:
    """The checksums of zero rows."""
    return np.zeros(1 + len(TABLES), dtype=np.int64)


def add_rows(sums: NDArray[np.int64], tables: Mapping[str, Any], rows: int) -> NDArray[np.int64]:
    """The checksums after further rows, whose stored columns are in `tables`."""
    crcs = [
        crc32(np.ascontiguousarray(tables[name], "<f8").data, int(crc))
        for name, crc in zip(TABLES, sums[1:], strict=True)
    ]
    return np.array([sums[0] + rows, *crcs], dtype=np.int64)


def sum_rows(
    file: h5py.File, rows: int, sums: NDArray[np.int64] | None = None
) -> NDArray[np.int64]:
    """The checksums of the first `rows` rows; `sums` are those of fewer rows, if known."""
    done = no_rows() if sums is None or sums[0] > rows else sums
    step = max(1, _BLOCK_BYTES // sum(8 * math.prod(file[name].shape[1:]) for name in TABLES))
    for start in range(int(done[0]), rows, step):
        stop = min(rows, start + step)
        done = add_rows(done, {name: file[name][start:stop] for name in TABLES}, stop - start)
    return done


def content_digest(file: h5py.File) -> str:
    """SHA-256 of everything in a file that a run does not change."""
    digest = hashlib.sha256()

    def add(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if name.partition("/")[0] in _CHANGING:
            return
        marks = sorted((key, str(mark)) for key, mark in item.attrs.items() if key != "content")
        digest.update(f"{name} {marks}".encode())
        if isinstance(item, h5py.Dataset):
            value = np.asarray(item[()])
            words = str(value.tolist()).encode() if value.dtype.hasobject else value.tobytes()
            digest.update(f"{value.shape} ".encode() + words)

    add("", file)
    file.visititems(add)
    return digest.hexdigest()


def state_sum(saves: int, rows: int, data: NDArray[np.uint8]) -> int:
    """CRC-32 of a slot of the integrator's state, including its save number and number of rows."""
    return crc32(data.data, crc32(f"{saves} {rows}".encode()))


def verify(path: Path, verified: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
    """Compare an unsealed file with its checksums.

    Parameters
    ----------
    path : Path
        The file; a run may be writing it.
    verified : (10,) int or None
        The result of an earlier call: these rows are not read again.

    Returns
    -------
    (10,) int or None
        Checksums of the rows that were read; None for a file of an earlier version without any.

    Raises
    ------
    ValueError
        Says what does not match.
    """
    for _ in range(_ATTEMPTS):
        with h5py.File(path, "r", locking=False) as file:
            if "checks" not in file:
                return None
            if file.attrs.get("content") != content_digest(file):
                raise ValueError("what was written before the run does not match its checksum")
            rows, checks = int(file["progress"][0]), file["checks"][:]
            fitting = checks[checks[:, 0] == rows]
            if len(fitting):
                sums = sum_rows(file, rows, verified)
                wrong = np.flatnonzero(sums != fitting[0])
                if len(wrong):
                    raise ValueError(
                        f"its table {TABLES[wrong[0] - 1]} does not match its checksum"
                    )
                return sums
        time.sleep(_PAUSE)
    raise ValueError("the number of its rows does not match its checksums")
