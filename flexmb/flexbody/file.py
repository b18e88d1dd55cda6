"""Reading and writing flexible-body files (HDF5, no code objects inside).

In: a body and a path, or a path. Out: a file, or the body with exactly the same numbers. Reading
is strict: what is not ours, of another version, incomplete or not finite is refused by a sentence.
The layout is the table in :mod:`flexmb.flexbody.schema`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flexmb.errors import BodyFileError, OutputError, ReductionError
from flexmb.flexbody import schema
from flexmb.flexbody.body import FlexBody

__all__ = ["load", "save"]


def save(body: FlexBody, path: str | os.PathLike[str]) -> Path:
    """Write a body; the file appears under its name only when it is complete.

    Parameters
    ----------
    body : FlexBody
        What to write.
    path : path
        Where; customarily ``<name>.flexbody.h5``.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    target = Path(path)
    partial = target.with_name(f"{target.name}.{os.getpid()}.part")  # two runs do not meet
    try:
        with h5py.File(partial, "w", locking=False) as file:
            _write(file, body)
        os.replace(partial, target)
    except OSError as error:
        if target.parent.is_dir():
            partial.unlink(missing_ok=True)
        why = os.strerror(error.errno) if error.errno else error
        raise OutputError(f"{target}: cannot write the flexible body: {why}") from error
    return target


def load(path: str | os.PathLike[str]) -> FlexBody:
    """Read a body.

    Raises
    ------
    BodyFileError
        No such file, not HDF5, not a flexible body, of another version, incomplete, or with
        numbers that cannot be.
    """
    source = Path(path)
    if not source.is_file():
        raise BodyFileError(f"{source}: there is no such file")
    try:
        with h5py.File(source, "r", locking=False) as file:
            _check_header(file, source)
            datasets = {row.path: _read(file, row, source) for row in schema.TABLE}
            name, mass = str(file.attrs["name"]), float(file.attrs["mass"])
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        what = "is damaged" if h5py.is_hdf5(source) else "is not an HDF5 file, or is cut short"
        raise BodyFileError(f"{source}: {what}; write the body again ({error})") from error
    found = {key: value for key, value in datasets.items() if value is not None}
    _check_lengths(found, source)
    try:
        return schema.from_datasets(name, mass, found)
    except (ReductionError, TypeError) as error:
        raise BodyFileError(f"{source}: the body inside is not valid\n{error}") from error


def _write(file: h5py.File, body: FlexBody) -> None:
    file.attrs.update(
        {"format": schema.FORMAT, "version": schema.VERSION, "name": body.name, "mass": body.mass}
    )
    for row in schema.TABLE:
        file.require_group(row.path.partition("/")[0])
    for path, value in schema.to_datasets(body).items():
        if isinstance(value, list):
            file.create_dataset(path, data=np.array(value, dtype=object), dtype=h5py.string_dtype())
        else:
            file.create_dataset(path, data=value)
    for name in schema.RESERVED:
        file.create_group(name).attrs["content"] = "none"
    file.create_group("frame").attrs["choice"] = schema.FRAME


def _check_header(file: h5py.File, source: Path) -> None:
    if file.attrs.get("format") != schema.FORMAT:
        raise BodyFileError(f"{source}: is an HDF5 file, but not a flexible body of flexmb")
    version = file.attrs.get("version")
    if version != schema.VERSION:
        what = f"is a flexible body of file version {version}; this flexmb reads {schema.VERSION}"
        raise BodyFileError(f"{source}: {what}: reduce the mesh again")
    frame = file["frame"].attrs.get("choice") if "frame" in file else None
    filled = [name for name in schema.RESERVED if _content(file, name) != "none"]
    if frame != schema.FRAME or filled:
        what = ", ".join(filled) or f"frame {frame}"
        raise BodyFileError(f"{source}: holds what this flexmb does not know ({what})")


def _content(file: h5py.File, group: str) -> Any:
    return file[group].attrs.get("content") if group in file else None


def _read(file: h5py.File, row: schema.Dataset, source: Path) -> Any:
    item = file.get(row.path)
    if item is None:
        if row.optional:
            return None
        raise BodyFileError(f"{source}: the dataset {row.path} is missing; write the body again")
    values = item.asstr()[()].tolist() if row.kind == "text" else item[()]
    if row.kind != "text":
        values = np.asarray(values, dtype=row.kind)
        may_be_unknown = row.kind[0] != "f" or schema.may_hold_nan(row.path)
        if not (may_be_unknown or np.isfinite(values).all()):
            raise BodyFileError(f"{source}: the dataset {row.path} has entries that are not finite")
    return values


def _check_lengths(found: dict[str, Any], source: Path) -> None:
    lengths: dict[str, int] = {}
    for row in schema.TABLE:
        if row.path not in found:
            continue
        shape = np.shape(found[row.path])
        if len(shape) != len(row.shape) or any(
            lengths.setdefault(want, have) != have if isinstance(want, str) else want != have
            for want, have in zip(row.shape, shape, strict=True)
        ):
            raise BodyFileError(
                f"{source}: the dataset {row.path} has shape {shape}, not {row.shape}"
            )
