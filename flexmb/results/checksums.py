"""Checksums inside a result file, for a run that is under way or was killed.

A finished file is sealed as a whole (`flexmb.untrusted`). Until then three sums stand in it:

- `/checks`: two rows, each a number of output rows and the CRC-32 of every table up to there. They
  are written in turn, before `/progress` counts the rows, so that one of them fits at any moment;
- the attribute `content`: SHA-256 of all that is fixed before the run;
- `/state/checks`: CRC-32 of each slot of the integrator's state.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.results.channels import TABLES

_CHANGING: Final = (*TABLES, "progress", "report", "checks", "state")
_PIECE = 1 << 24  # bytes of a table that are read at once
_ATTEMPTS, _PAUSE = 5, 0.02  # s; a run may count new rows while they are read


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """What a ``with`` block cannot read is a `ResultFileError`: flexmb writes no such file."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, OSError, RuntimeError) as error:
        raise ResultFileError(f"{path}: is a damaged result file ({error})") from error


def no_rows() -> NDArray[np.int64]:
    """The sums of no rows."""
    return np.zeros(1 + len(TABLES), dtype=np.int64)


def add_rows(sums: NDArray[np.int64], tables: Mapping[str, Any], rows: int) -> NDArray[np.int64]:
    """The sums with further rows, whose stored columns are in `tables`."""
    crcs = [
        crc32(np.ascontiguousarray(tables[name], "<f8").data, int(crc))
        for name, crc in zip(TABLES, sums[1:], strict=True)
    ]
    return np.array([sums[0] + rows, *crcs], dtype=np.int64)


def sum_rows(
    file: h5py.File, rows: int, sums: NDArray[np.int64] | None = None
) -> NDArray[np.int64]:
    """The sums of the first rows of a file; `sums` are those of some of them."""
    done = no_rows() if sums is None or sums[0] > rows else sums
    step = max(1, _PIECE // sum(8 * math.prod(file[name].shape[1:]) for name in TABLES))
    for start in range(int(done[0]), rows, step):
        stop = min(rows, start + step)
        done = add_rows(done, {name: file[name][start:stop] for name in TABLES}, stop - start)
    return done


def content_digest(file: h5py.File) -> str:
    """SHA-256 of everything that a run does not change."""
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
    """CRC-32 of a slot of the integrator's state with its numbers."""
    return crc32(data.data, crc32(f"{saves} {rows}".encode()))


def verify(path: Path, verified: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
    """Compare a file without seal with its checksums.

    Parameters
    ----------
    path : Path
        The file; a run may be writing it.
    verified : (10,) int or None
        What an earlier call returned: these rows are not read again.

    Returns
    -------
    (10,) int or None
        Sums of the rows that were read; None of a file of an earlier flexmb, which has none.

    Raises
    ------
    ValueError
        What does not match.
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
