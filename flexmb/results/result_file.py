"""The result file in HDF5: creating and reading it.

Every dataset gets its final shape and its place in the file before the run starts, so that HDF5
changes none of its internal records during the run: only numbers are written, the row counter last.
So a file is readable after a kill at any moment. `/progress` says how many rows are valid; rows
beyond it have no content. `channels` describes the tables over time; the other datasets are:

=============  ==================  ==========================================================
dataset        shape               meaning
=============  ==================  ==========================================================
/progress      (2,)                valid rows; status code (index into `STATUS`)
/span          (2,)                duration and number of output intervals, NaN if not stated;
                                   they replace those of the scene when a run is extended
/report        text of fixed size  JSON: statistics and the message of the end
/layout/*                          names and offsets of all columns
/layout/kept/* (k,)                numbers of the stored columns of each table
/scene         text                the scene as JSON
/texts/*       text                further texts, such as the scene file's own
/flexbodies/*  text                per body the path of its file, relative to this file
/state/0, 1    (bytes,)            two slots of the integrator's complete state
/state/arrays  text                its arrays, JSON: names, types, shapes
/state/saves   (2,)                number of the save in each slot, 0: none; /state/rows: rows then
/checks, /state/checks             sums of rows and states; see `crash_safe_file`
=============  ==================  ==========================================================

A reader opens the file for each reading and closes it again. So a run may write it at the same
time, and a new run may replace it; the next reading reports that.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Final
from uuid import uuid4

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import BodyColumns
from flexmb.errors import ResultFileError
from flexmb.results.channels import TABLES, Columns, StoredColumns, widths
from flexmb.results.crash_safe_file import content_digest, no_rows, reading, state_sum, verify
from flexmb.units import unit_system
from flexmb.untrusted import is_sealed, open_hdf5

STATUS: Final = ("running", "finished", "stopped", "failed")
_FORMAT, _VERSION = "flexmb-result", 3
_REPORT_BYTES = 65536  # bytes for statistics and message, reserved before the run
_CHUNK_BYTES = 1 << 16  # bytes of one chunk of a table; a flush rewrites at most one chunk
# sections whose objects are tables by name
_SECTIONS = ("bodies", "joints", "drivers", "forces", "sensors", "markers")
_COPIED = 1 << 24  # bytes copied at once
_MAX_MODES = 100_000  # largest number of modes of all bodies
_NAMES = ("bodies", "coordinates", "rows", "reactions", "channels", "energies")
_REQUIRED = (
    *TABLES, "progress", "span", "report", "scene", "texts", "flexbodies", "state", "layout",
    *(f"layout/{name}" for name in ("bodies", "iq", "iv", "m", "rows", "channels", "energies")),
    "layout/kept",
)  # fmt: skip


@dataclass(frozen=True)
class Contents:
    """What a result file says about itself; the first `rows` rows of each table are valid."""

    run: str
    created: str
    rows: int
    status: str
    message: str
    statistics: dict[str, float | int | str]
    columns: Columns
    stored: StoredColumns
    scene: dict[str, Any]
    extended: bool  # whether duration and outputs were changed after the start
    texts: dict[str, str]
    flexbodies: dict[str, str]
    sums: NDArray[np.int64] | None = None  # checksums of the rows verified so far


def create_content(
    file: h5py.File,
    columns: Columns,
    rows: int,
    stored: StoredColumns,
    scene: Mapping[str, Any],
    texts: Mapping[str, str],
    flexbodies: Mapping[str, str],
) -> None:
    """Write everything that is fixed before the run, and reserve `rows` rows of every table."""
    file.attrs["format"] = _FORMAT
    file.attrs["version"] = _VERSION
    # identifies the run: a new run that replaces the file has another one
    file.attrs["run"] = uuid4().hex
    file.attrs["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    for name, numbers in stored.items():
        _reserve(file, name, (rows,) if name == "time" else (rows, len(numbers)))
    file.create_dataset("progress", data=np.array([0, STATUS.index("running")], dtype=np.int64))
    dynamics = scene.get("dynamics", {})
    span = [dynamics.get(key, np.nan) for key in ("duration", "outputs")]
    span = [np.nan if isinstance(value, list) else float(value) for value in span]
    file.create_dataset("span", data=np.array(span))
    file.create_dataset("report", data=report_text({}, ""), dtype=f"S{_REPORT_BYTES}")
    _write_layout(file.create_group("layout"), columns)
    for name, numbers in stored.items():
        file["layout"].create_dataset(f"kept/{name}", data=numbers)
    put_text(file, "scene", json.dumps(scene))
    for group, content in (("texts", texts), ("flexbodies", flexbodies)):
        file.create_group(group)
        for name, text in content.items():
            put_text(file[group], name, text)
    file.create_group("state")
    file.create_dataset("checks", data=np.tile(no_rows(), (2, 1)))
    file.attrs["content"] = content_digest(file)


def create_state(group: h5py.Group, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Create both slots of the integrator's state; neither is valid yet."""
    group.create_dataset("saves", data=np.zeros(2, dtype=np.int64))
    group.create_dataset("rows", data=np.zeros(2, dtype=np.int64))
    group.create_dataset("checks", data=np.zeros(2, dtype=np.int64))
    put_text(group, "arrays", arrays_text(arrays))
    for slot in ("0", "1"):
        group.create_dataset(slot, data=state_bytes(arrays))


def arrays_text(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Names, types and shapes of the arrays of a state, as JSON in their order."""
    return json.dumps([[name, _kind(value.dtype), value.shape] for name, value in arrays.items()])


def _kind(dtype: np.dtype[Any]) -> Any:
    """A dtype in JSON form: its name, or the names and forms of its fields."""
    return dtype.descr if dtype.names else dtype.str


def state_bytes(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """The arrays of a state one after the other: one write is much faster than fifty."""
    return np.frombuffer(b"".join(value.tobytes() for value in arrays.values()), np.uint8)


def report_text(statistics: Mapping[str, float | int | str], message: str) -> np.bytes_:
    """Statistics and message as JSON in the fixed size reserved for them."""
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in statistics.items()}
    text = json.dumps({"message": message, "statistics": plain}).encode()
    if len(text) > _REPORT_BYTES:
        message = message[: max(len(message) - (len(text) - _REPORT_BYTES) - 3, 0)] + "..."
        text = json.dumps({"message": message, "statistics": plain}).encode()
    return np.bytes_(text)


def copy_content(old: h5py.File, new: h5py.File, rows: int) -> None:
    """Copy a result into a new file, with room for at least `rows` rows."""
    new.attrs.update(old.attrs)
    done = int(old["progress"][0])
    for name in TABLES:
        shape = max(rows, done), *old[name].shape[1:]
        _reserve(new, name, shape)
        step = max(1, _COPIED // (8 * max(math.prod(shape[1:]), 1)))
        for start in range(0, done if old[name].size else 0, step):
            stop = min(start + step, done)
            new[name][start:stop] = old[name][start:stop]
    for name in old:
        if name not in TABLES:
            old.copy(name, new)


def file_format(path: str | Path) -> str | None:
    """The format that an HDF5 file states, such as ``"flexmb-result"``; None for other files."""
    try:
        with open_hdf5(Path(path), ResultFileError, "a file of flexmb") as file:
            name = file.attrs.get("format")
            return name if isinstance(name, str) else None
    except (ResultFileError, OSError, RuntimeError):
        return None


def read_contents(path: Path, verified: NDArray[np.int64] | None = None) -> Contents:
    """Read and check everything; verify the tables if the file has no seal.

    `verified` (10,) are the `Contents.sums` of an earlier reading.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """
    with reading(path), _open(path) as file:
        _check_identity(path, file)
        contents = _contents(file)
        sums = None if is_sealed(path) else verify(path, verified)
        return replace(contents, sums=sums)


def read_table(path: Path, run: str, name: str, rows: int, first: int = 0) -> NDArray[np.float64]:
    """The rows from `first` to before `rows` of one table of the run that was opened first.

    Raises
    ------
    ResultFileError
        The file is gone, or holds another run by now.
    """
    with reading(path), _open(path, run) as file:
        return np.asarray(file[name][first:rows], dtype=np.float64)


def read_state(path: Path, run: str) -> tuple[int, dict[str, NDArray[Any]]] | None:
    """The newest whole state of the integrator and the number of rows written before it.

    Raises
    ------
    ResultFileError
        The file is gone, or holds another run by now.
    """
    with reading(path), _open(path, run) as file:
        group = file["state"]
        saves = group["saves"][:] if "saves" in group else np.zeros(2, dtype=np.int64)
        slot = int(np.argmax(saves))
        if saves[slot] and not _is_whole(group, slot):
            slot = 1 - slot  # the other, older slot
        if saves[slot] == 0 or not _is_whole(group, slot):
            return None
        data, start, arrays = group[str(slot)][:].tobytes(), 0, dict[str, NDArray[Any]]()
        for name, kind, shape in json.loads(group["arrays"].asstr()[()]):
            fields = kind if isinstance(kind, str) else [tuple(field) for field in kind]
            dtype, n = np.dtype(fields), math.prod(shape)
            arrays[name] = np.frombuffer(data, dtype, n, start).reshape(shape).copy()
            start += n * dtype.itemsize
        return int(group["rows"][slot]), arrays


def _is_whole(group: h5py.Group, slot: int) -> bool:
    """Whether a slot of the state matches its checksum."""
    if "checks" not in group:
        return True  # a file of an earlier version has none
    saves, rows = int(group["saves"][slot]), int(group["rows"][slot])
    return bool(group["checks"][slot] == state_sum(saves, rows, group[str(slot)][:]))


def _open(path: Path, run: str | None = None) -> h5py.File:
    """The open file; with `run`, only if it still contains that run."""
    if path.is_dir():
        raise ResultFileError(f"{path}: is a folder without a result.h5")
    file = open_hdf5(path, ResultFileError, "a result of flexmb")
    if run is not None and file.attrs.get("run") != run:
        file.close()
        raise ResultFileError(f"{path}: was replaced by another run since it was opened; reopen it")
    return file


def _check_identity(path: Path, file: h5py.File) -> None:
    name = file.attrs.get("format")
    if not isinstance(name, str) or name != _FORMAT:
        kind = f'a "{name}" file' if isinstance(name, str) else "an HDF5 file of another program"
        raise ResultFileError(f"{path}: is {kind}, not a result of flexmb")
    version = file.attrs.get("version")
    if not np.array_equal(version, _VERSION):
        raise ResultFileError(
            f"{path}: is a result of format version {version}; this flexmb reads version "
            f"{_VERSION}; run the scene again, or use the flexmb that wrote it"
        )
    missing = next((name for name in _REQUIRED if name not in file), None)
    if missing is not None:
        raise ResultFileError(f"{path}: is a damaged result file ({missing} is missing)")


def _contents(file: h5py.File) -> Contents:
    columns = _read_layout(file["layout"])
    rows, code = (int(number) for number in file["progress"][:])
    stored = {name: np.asarray(file["layout/kept"][name][:]) for name in TABLES}
    for name, width in widths(columns).items():
        shape, k = file[name].shape, len(stored[name])
        if k > width or shape[1:] != (() if name == "time" else (k,)) or shape[0] < rows:
            raise ValueError(f"{name} has shape {shape}, {rows} rows and {k} columns expected")
        numbers, whole = stored[name], stored[name].dtype.kind in "iu"
        if k and not (whole and numbers[-1] < width and (np.diff(numbers, prepend=-1) > 0).all()):
            raise ValueError(f"layout/kept/{name} does not number its columns")
        stored[name] = numbers.astype(np.int64)  # an empty dataset may have any type
    report = json.loads(file["report"][()])
    scene = json.loads(file["scene"].asstr()[()])
    _check_scene(scene)
    original = scene.get("dynamics", {})
    duration, outputs = (float(number) for number in file["span"][:])
    if math.isfinite(duration) and math.isfinite(outputs):
        scene["dynamics"] = {**original, "duration": duration, "outputs": int(outputs)}
    return Contents(
        run=str(file.attrs["run"]),
        created=str(file.attrs["created"]),
        rows=rows,
        status=STATUS[code],
        message=report["message"],
        statistics=report["statistics"],
        columns=columns,
        stored=stored,
        scene=scene,
        extended=scene.get("dynamics", {}) != original,
        texts={name: data.asstr()[()] for name, data in file["texts"].items()},
        flexbodies=_read_file_names(file["flexbodies"]),
    )


def _check_scene(scene: Any) -> None:
    """Raise TypeError or ValueError if a scene has another structure than those of flexmb."""
    for name in _SECTIONS:
        if not all(isinstance(table, dict) for table in scene.get(name, {}).values()):
            raise TypeError(f"its scene has {name} that are no tables")
    for name in ("dynamics", "view", "results"):
        if not isinstance(scene.get(name, {}), dict):
            raise TypeError(f"{name} of its scene is no table")
    unit_system(str(scene.get("units", "SI")))


def _read_file_names(group: h5py.Group) -> dict[str, str]:
    """File names of the flexible bodies, which must be in the folder of the result."""
    files = {str(name): str(data.asstr()[()]) for name, data in group.items()}
    for name, file in files.items():
        if (
            file in ("", "..")
            or PurePosixPath(file).name != file
            or PureWindowsPath(file).name != file
        ):
            raise ValueError(
                f"the file of the flexible body {name} is not in this folder: {file!r}"
            )
    return files


def _read_layout(group: h5py.Group) -> Columns:
    names = {key: tuple(group[key].asstr()[:]) for key in _NAMES}
    offsets = zip(group["iq"][:], group["iv"][:], group["m"][:], strict=True)
    bodies = tuple(
        BodyColumns(name, int(iq), int(iv), int(m))
        for name, (iq, iv, m) in zip(names.pop("bodies"), offsets, strict=True)
    )
    iq, iv = 0, 0
    for body in bodies:
        if (body.iq, body.iv) != (iq, iv) or not 0 <= body.m <= _MAX_MODES - iv:
            raise ValueError(f"the columns of {body.name} are not those of a body")
        iq, iv = iq + 7 + body.m, iv + 6 + body.m
    return Columns(
        bodies=bodies,
        nq=sum(7 + body.m for body in bodies) + len(names["coordinates"]),
        nv=sum(6 + body.m for body in bodies) + len(names["coordinates"]),
        nc=len(names["rows"]),
        fingerprint=str(group.attrs["fingerprint"]),
        **names,
    )


def _write_layout(group: h5py.Group, columns: Columns) -> None:
    group.attrs["fingerprint"] = columns.fingerprint
    for key in _NAMES:
        names = [getattr(item, "name", item) for item in getattr(columns, key)]
        group.create_dataset(key, data=names, shape=(len(names),), dtype=h5py.string_dtype())
    for key in ("iq", "iv", "m"):
        offsets = [getattr(body, key) for body in columns.bodies]
        group.create_dataset(key, data=np.array(offsets, dtype=np.int64))


def put_text(group: h5py.Group, name: str, text: str) -> None:
    group.create_dataset(name, data=text, dtype=h5py.string_dtype())


def _reserve(file: h5py.File, name: str, shape: tuple[int, ...]) -> None:
    """Create a table of doubles; its space is allocated now and not filled."""
    width = max(shape[1], 1) if len(shape) > 1 else 1
    rows = max(1, min(_CHUNK_BYTES // (8 * width), shape[0]))
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((rows, width)[: len(shape)])
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    space = h5py.h5s.create_simple(shape, (shape[0], width)[: len(shape)])
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, space, properties)
