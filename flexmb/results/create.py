"""Laying out a result file before the run: every dataset with its final shape and place.

In: an open, empty HDF5 file, the columns, the number of rows, the scene. Out: the content that
`schema` lists, with space reserved for every row.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any
from uuid import uuid4

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.results.keep import Kept
from flexmb.results.layout import Columns
from flexmb.results.schema import FORMAT, REPORT_BYTES, STATUS, VERSION

__all__ = [
    "arrays_text",
    "create_content",
    "create_state",
    "report_text",
    "reserve",
    "state_bytes",
]

_CHUNK_BYTES = 1 << 16  # one chunk of a table: what a flush writes anew at most


def create_content(
    file: h5py.File,
    columns: Columns,
    rows: int,
    kept: Kept,
    scene: Mapping[str, Any],
    texts: Mapping[str, str],
    flexbodies: Mapping[str, str],
) -> None:
    """Write everything that is known before the run, and reserve `rows` rows of every table."""
    file.attrs["format"] = FORMAT
    file.attrs["version"] = VERSION
    file.attrs["run"] = uuid4().hex  # tells a file that was written anew from the one opened first
    file.attrs["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    for name, numbers in kept.items():
        reserve(file, name, (rows,) if name == "time" else (rows, len(numbers)))
    file.create_dataset("progress", data=np.array([0, STATUS.index("running")], dtype=np.int64))
    file.create_dataset("span", data=_span(scene))
    file.create_dataset("report", data=report_text({}, ""), dtype=f"S{REPORT_BYTES}")
    _write_layout(file.create_group("layout"), columns)
    for name, numbers in kept.items():
        file["layout"].create_dataset(f"kept/{name}", data=numbers)
    _write_text(file, "scene", json.dumps(scene))
    for group, content in (("texts", texts), ("flexbodies", flexbodies)):
        file.create_group(group)
        for name, text in content.items():
            _write_text(file[group], name, text)
    file.create_group("state")


def create_state(group: h5py.Group, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Make both slots of the integrator's state, none of them valid yet."""
    group.create_dataset("saves", data=np.zeros(2, dtype=np.int64))
    group.create_dataset("rows", data=np.zeros(2, dtype=np.int64))
    _write_text(group, "arrays", arrays_text(arrays))
    for slot in ("0", "1"):
        group.create_dataset(slot, data=state_bytes(arrays))


def arrays_text(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Names, types and shapes of the arrays of a state, as JSON in their order."""
    return json.dumps([[name, value.dtype.str, value.shape] for name, value in arrays.items()])


def state_bytes(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """The arrays of a state one behind the other: one write is much cheaper than fifty."""
    return np.frombuffer(b"".join(value.tobytes() for value in arrays.values()), np.uint8)


def report_text(statistics: Mapping[str, float | int | str], message: str) -> np.bytes_:
    """Statistics and message as JSON in the fixed size that was reserved for them."""
    report = {"message": message, "statistics": {k: _plain(v) for k, v in statistics.items()}}
    text = json.dumps(report).encode()
    if len(text) > REPORT_BYTES:
        report["message"] = message[: max(len(message) - (len(text) - REPORT_BYTES) - 3, 0)] + "..."
        text = json.dumps(report).encode()
    return np.bytes_(text)


def _span(scene: Mapping[str, Any]) -> NDArray[np.float64]:
    dynamics = scene.get("dynamics", {})
    told = [dynamics.get(key, np.nan) for key in ("duration", "outputs")]
    return np.array([np.nan if isinstance(value, list) else value for value in told], dtype=float)


def _plain(value: float | int | str) -> float | int | str:
    return value.item() if isinstance(value, np.generic) else value


def reserve(file: h5py.File, name: str, shape: tuple[int, ...]) -> None:
    """A table of doubles that can grow in time, its space taken now and not filled."""
    width = max(shape[1], 1) if len(shape) > 1 else 1
    rows = max(1, min(_CHUNK_BYTES // (8 * width), shape[0]))
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((rows, width)[: len(shape)])
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    space = h5py.h5s.create_simple(shape, (h5py.h5s.UNLIMITED, width)[: len(shape)])
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, space, properties)


def _write_layout(group: h5py.Group, columns: Columns) -> None:
    group.attrs["fingerprint"] = columns.fingerprint
    for name, names in (
        ("bodies", tuple(body.name for body in columns.bodies)),
        ("coordinates", columns.coordinates),
        ("rows", columns.rows),
        ("reactions", columns.reactions),
        ("channels", columns.channels),
        ("energies", columns.energies),
    ):
        group.create_dataset(name, data=list(names), shape=(len(names),), dtype=h5py.string_dtype())
    for name in ("iq", "iv", "m"):
        offsets = [getattr(body, name) for body in columns.bodies]
        group.create_dataset(name, data=np.array(offsets, dtype=np.int64))


def _write_text(group: h5py.Group, name: str, text: str) -> None:
    group.create_dataset(name, data=text, dtype=h5py.string_dtype())
