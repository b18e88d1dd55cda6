"""Reading a result file strictly: ours, of this version, whole; or one sentence on what it is.

In: a path. Out: the metadata of the file (:class:`Contents`) and, one at a time, its tables. The
file is opened for each reading and closed again: a run may write it at the same time, and a new run
may replace it; then the next reading says so.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.results.keep import Kept
from flexmb.results.layout import BodyColumns, Columns
from flexmb.results.schema import FORMAT, STATUS, TABLES, VERSION, widths

__all__ = ["Contents", "file_format", "read_contents", "read_state", "read_table"]

_REQUIRED = (
    *TABLES,
    "progress",
    "span",
    "report",
    "scene",
    "texts",
    "flexbodies",
    "state",
    "layout",
)
_LAYOUT = ("bodies", "iq", "iv", "m", "rows", "channels", "energies", "kept")


@dataclass(frozen=True)
class Contents:
    """What a result file says about itself; `rows` of each table are valid."""

    run: str
    created: str
    rows: int
    status: str
    message: str
    statistics: dict[str, float | int | str]
    columns: Columns
    kept: Kept  # numbers of the stored columns by table
    scene: dict[str, Any]
    extended: bool  # whether duration and outputs are no longer those of the scene as begun
    texts: dict[str, str]
    flexbodies: dict[str, str]


def file_format(path: str | Path) -> str | None:
    """The format an HDF5 file says it has, such as ``"flexmb-result"``; None for other files."""
    try:
        with h5py.File(path, "r", locking=False) as file:
            found = file.attrs.get("format")
            return found if isinstance(found, str) else None
    except OSError:
        return None


def read_contents(path: Path) -> Contents:
    """Read and check everything but the tables.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """
    with _open(path) as file:
        _check_identity(path, file)
        try:
            return _contents(path, file)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ResultFileError(f"{path}: is a damaged result file ({error})") from error


def read_table(path: Path, run: str, name: str, rows: int) -> NDArray[np.float64]:
    """The first `rows` rows of one table of the run that was opened first.

    Raises
    ------
    ResultFileError
        The file is gone, or holds another run by now.
    """
    with _open(path) as file:
        _check_run(path, file, run)
        return np.asarray(file[name][:rows], dtype=np.float64)


def read_state(path: Path, run: str) -> tuple[int, dict[str, NDArray[Any]]] | None:
    """The newest whole state of the integrator and the number of rows written before it.

    Raises
    ------
    ResultFileError
        The file is gone, or holds another run by now.
    """
    with _open(path) as file:
        _check_run(path, file, run)
        group = file["state"]
        saves = group["saves"][:] if "saves" in group else np.zeros(2, dtype=np.int64)
        slot = int(np.argmax(saves))
        if saves[slot] == 0:
            return None
        return int(group["rows"][slot]), _arrays(group, str(slot))


def _arrays(group: h5py.Group, slot: str) -> dict[str, NDArray[Any]]:
    """The arrays of a state, from its bytes."""
    data, at, arrays = group[slot][:].tobytes(), 0, dict[str, NDArray[Any]]()
    for name, kind, shape in json.loads(group["arrays"].asstr()[()]):
        dtype, n = np.dtype(kind), math.prod(shape)
        arrays[name] = np.frombuffer(data, dtype, n, at).reshape(shape).copy()
        at += n * dtype.itemsize
    return arrays


def _open(path: Path) -> h5py.File:
    if path.is_dir():
        raise ResultFileError(f"{path}: is a folder without a result.h5")
    if not path.exists():
        raise ResultFileError(f"{path}: there is no such file")
    try:
        return h5py.File(path, "r", locking=False)
    except OSError as error:
        if "locking flag" in str(error):
            what = "is held open in this program by other means than flexmb; close it there first"
            raise ResultFileError(f"{path}: {what}") from error
        what = "a damaged HDF5 file" if h5py.is_hdf5(path) else "not an HDF5 file"
        raise ResultFileError(f"{path}: is {what}, so not a result of flexmb") from error


def _check_identity(path: Path, file: h5py.File) -> None:
    found = file.attrs.get("format")
    if found != FORMAT:
        kind = f'a "{found}" file' if isinstance(found, str) else "an HDF5 file of another program"
        raise ResultFileError(f"{path}: is {kind}, not a result of flexmb")
    version = file.attrs.get("version")
    if version != VERSION:
        raise ResultFileError(
            f"{path}: is a result of format version {version}; this flexmb reads version "
            f"{VERSION}; run the scene again, or use the flexmb that wrote it"
        )
    missing = [name for name in _REQUIRED if name not in file]
    missing += [f"layout/{name}" for name in _LAYOUT if f"layout/{name}" not in file]
    if missing:
        raise ResultFileError(f"{path}: is a damaged result file ({missing[0]} is missing)")


def _check_run(path: Path, file: h5py.File, run: str) -> None:
    if file.attrs.get("run") != run:
        raise ResultFileError(f"{path}: has been written anew since it was opened; open it again")


def _contents(path: Path, file: h5py.File) -> Contents:
    columns = _columns(file["layout"])
    rows, code = (int(number) for number in file["progress"][:])
    kept = {name: np.asarray(file["layout/kept"][name][:]) for name in TABLES}
    _check_tables(file, columns, kept, rows)
    report = json.loads(file["report"][()])
    scene = json.loads(file["scene"].asstr()[()])
    begun_with = scene.get("dynamics", {})
    duration, outputs = (float(number) for number in file["span"][:])
    if math.isfinite(duration) and math.isfinite(outputs):
        scene["dynamics"] = {**begun_with, "duration": duration, "outputs": int(outputs)}
    return Contents(
        run=str(file.attrs["run"]),
        created=str(file.attrs["created"]),
        rows=rows,
        status=STATUS[code],
        message=report["message"],
        statistics=report["statistics"],
        columns=columns,
        kept=kept,
        scene=scene,
        extended=scene.get("dynamics", {}) != begun_with,
        texts={name: data.asstr()[()] for name, data in file["texts"].items()},
        flexbodies={name: data.asstr()[()] for name, data in file["flexbodies"].items()},
    )


def _columns(group: h5py.Group) -> Columns:
    names = {
        key: tuple(group[key].asstr()[:])
        for key in ("bodies", "coordinates", "rows", "reactions", "channels", "energies")
    }
    offsets = zip(group["iq"][:], group["iv"][:], group["m"][:], strict=True)
    bodies = tuple(
        BodyColumns(name, int(iq), int(iv), int(m))
        for name, (iq, iv, m) in zip(names.pop("bodies"), offsets, strict=True)
    )
    return Columns(
        bodies=bodies,
        nq=sum(7 + body.m for body in bodies) + len(names["coordinates"]),
        nv=sum(6 + body.m for body in bodies) + len(names["coordinates"]),
        nc=len(names["rows"]),
        fingerprint=str(group.attrs["fingerprint"]),
        **names,
    )


def _check_tables(file: h5py.File, columns: Columns, kept: Kept, rows: int) -> None:
    for name, width in widths(columns).items():
        shape, stored = file[name].shape, len(kept[name])
        wanted = () if name == "time" else (stored,)
        if stored > width or shape[1:] != wanted or shape[0] < rows:
            raise ValueError(f"{name} has shape {shape}, {rows} rows and {stored} columns expected")
