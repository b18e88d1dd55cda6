"""Giving a result more room: a copy with space for more rows takes the place of the file.

In: a result file that no run is writing, its new duration and number of outputs. Out: the same
content under the same name. The file is replaced as a whole when the copy is complete, so that a
kill at any moment leaves one of the two.
"""

from __future__ import annotations

import os
from pathlib import Path

import h5py

from flexmb.errors import OutputError
from flexmb.results.create import reserve
from flexmb.results.disk import DiskFile
from flexmb.results.lock import WriteLock
from flexmb.results.schema import TABLES

__all__ = ["extend_file"]


def extend_file(path: Path, duration: float, outputs: int) -> None:
    """Make room for `outputs` intervals and note the new duration of the run as a whole.

    Parameters
    ----------
    path : Path
        The result.
    duration : float
        In the scene's units.
    outputs : int
        Output intervals from the start.

    Raises
    ------
    OutputError
        Another run is writing the file, the disk has no room, or the file cannot be replaced.
    """
    partial = path.with_name(path.name + ".part")
    try:
        lock = WriteLock(path)
    except BlockingIOError as error:
        raise OutputError(f"{path}: another run is writing it") from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be extended ({error.strerror or error})") from error
    try:
        _write_copy(path, partial, duration, outputs)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be extended ({error.strerror or error})") from error
    finally:
        partial.unlink(missing_ok=True)
        lock.release()


def _write_copy(path: Path, partial: Path, duration: float, outputs: int) -> None:
    disk = DiskFile(partial)
    try:
        with h5py.File(path, "r", locking=False) as old, h5py.File(disk, "w") as new:
            new.attrs.update(old.attrs)
            rows = int(old["progress"][0])
            for name in TABLES:
                reserve(new, name, (max(outputs + 1, rows), *old[name].shape[1:]))
                if rows:
                    new[name][:rows] = old[name][:rows]
            for name in old:
                if name not in TABLES:
                    old.copy(name, new)
            new["span"][:] = duration, outputs
    finally:
        disk.close()
    if disk.failure is not None:
        raise disk.failure
