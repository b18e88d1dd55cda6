"""The records of many runs as one Parquet table, safe against being killed while it grows.

In: one record after the other. Out: a file that pandas, polars and DuckDB can read, with one row
per run. While the table is open its rows are in a folder next to the file: the latest in a journal,
one per line, the others in parts. At the end they are merged into one file. If the process is
killed, the rows in the folder are read the next time.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.folders import output_errors, read_json, read_regular, whole_file, writable_folder
from flexmb.results.crash_safe_file import WriteLock
from flexmb.untrusted import check_reading, column_kind, note_reading

KEY = "key"
"""The column that identifies a run; a later row with the same key replaces an earlier one."""

_ABOUT = b"flexmb"
_PART_ROWS = 2000
_JOURNAL = "journal.jsonl"


class RecordTable:
    """A table to which records are appended, as a context manager.

    Parameters
    ----------
    file : Path
        The table, such as ``out/slider_crank/sweep/runs.parquet``.
    about : mapping of str to str
        What its runs depend on, by name, such as ``{"scene": content_key(scene)}``; stored with it.
    fresh : bool
        Start a new table, even if one exists.

    Raises
    ------
    FlexmbError
        The existing table depends on something else, or cannot be read.
    OutputError
        It cannot be written, for example because the disk is full.

    Example
    -------
    >>> with RecordTable(folder / "runs.parquet", {"scene": key}) as table:  # doctest: +SKIP
    ...     ended = table.reasons()
    ...     jobs = (job for job in jobs if job.key not in ended)
    ...     for job, record in cluster.run(function, jobs):
    ...         table.append({"key": job.key, **job.values, **record})
    """

    def __init__(self, file: Path, about: Mapping[str, str], *, fresh: bool = False) -> None:
        self.file, self.about = file, dict(about)
        self._folder = _folder_of_parts(file)
        with output_errors(file):
            writable_folder(file.parent)
            self._lock = lock_runs(file)
            if fresh:
                file.unlink(missing_ok=True)
            if fresh or file.exists():
                shutil.rmtree(self._folder, ignore_errors=True)
            try:
                self._check()
            except FlexmbError:
                self._lock.release()
                raise
            self._folder.mkdir(exist_ok=True)
            self._rows = _journal_rows(file)[1]
            if file.exists():
                file.replace(self._folder / f"{0:06d}.parquet")
            if self._rows:
                self._write_part()
            self._begin_journal()

    def _check(self) -> None:
        """Refuse a table that depends on something else."""
        stored = _stored_about(self.file)
        if stored is None or stored == self.about:
            return
        words = [word for word in self.about if stored.get(word) != self.about[word]]
        what = f"{self.file} holds runs of another {' and another '.join(words) or 'kind'}"
        raise FlexmbError(f"{what}: give another folder, or --fresh, which begins anew")

    def append(self, record: Mapping[str, Any]) -> None:
        """Add the record of a run; it is safe on disk when this returns.

        Parameters
        ----------
        record : mapping
            Column to number, text, bool, None, or list or array of numbers; anything else is stored
            as JSON text. Rows may have different columns. One column is `KEY`.
        """
        row = {name: _plain(value) for name, value in record.items()}
        with output_errors(self.file):
            self._add_line(row)
            self._rows.append(row)
            if len(self._rows) >= _PART_ROWS:
                self._journal.close()
                self._write_part()
                self._begin_journal()

    def reasons(self) -> dict[Any, str]:
        """The reason of failure of each run in the table, by key; empty for runs that did not
        fail."""
        rows = self.rows([KEY, "reason"]).to_pylist()
        return {row[KEY]: str(row.get("reason") or "") for row in rows}

    def rows(self, columns: list[str] | None = None) -> Any:
        """All rows so far as a :class:`pyarrow.Table`; by default with all columns."""
        return read_rows(self.file, columns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Merge all parts into one file."""
        with output_errors(self.file):
            self._journal.close()
            rows = self.rows()
            if rows.num_columns:
                self._write(rows, self.file)
            shutil.rmtree(self._folder, ignore_errors=True)
            self._lock.release()

    def _write_part(self) -> None:
        """Move the rows of the journal to a new part."""
        number = len(_part_files(self.file)) + 1
        self._write(_table(self._rows), self._folder / f"{number:06d}.parquet")
        self._rows = []

    def _write(self, rows: Any, file: Path) -> None:
        import pyarrow.parquet as pq

        with whole_file(file) as partial:
            about = {_ABOUT: json.dumps(self.about).encode()}
            pq.write_table(rows.replace_schema_metadata(about), partial)
        note_reading(file)

    def _begin_journal(self) -> None:
        self._journal = (self._folder / _JOURNAL).open("wb", buffering=0)
        self._add_line(self.about)

    def _add_line(self, row: Mapping[str, Any]) -> None:
        line = (json.dumps(row) + "\n").encode()
        if self._journal.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def lock_runs(file: Path) -> WriteLock:
    """The lock for writing a file about many runs, and the files next to it.

    Raises
    ------
    FlexmbError
        Another command has the lock.
    """
    try:
        return WriteLock(file)
    except BlockingIOError:
        what = f"{file}: another command is writing it"
        raise FlexmbError(f"{what}: wait until it ends, or give another folder") from None


def read_rows(file: Path, columns: list[str] | None = None) -> Any:
    """The rows of a table, also of one that is open or was left by a killed process.

    Parameters
    ----------
    file : Path
        The table.
    columns : list of str, optional
        Columns to read, if the table has them; all by default.

    Returns
    -------
    pyarrow.Table
        Its ``column(name).to_numpy()`` is an array; missing numbers are NaN.

    Raises
    ------
    FlexmbError
        The table cannot be read.
    """
    import pyarrow as pa

    tables = [_read_part(path, columns) for path in _part_files(file)]
    rows = _journal_rows(file)[1]
    if rows:
        table = _table(rows)
        names = [one for one in columns or table.column_names if one in table.column_names]
        tables.append(table.select(names))
    if not tables:
        return pa.table({})
    kinds: dict[str, set[str]] = {}
    for table in tables:
        for field in table.schema:
            if not pa.types.is_null(field.type):
                kinds.setdefault(field.name, set()).add(column_kind(field.type))
    for name in [name for name, kind in kinds.items() if len(kind) > 1]:
        tables = [_as_texts(table, name) for table in tables]
    whole = pa.concat_tables(tables, promote_options="permissive")
    if KEY not in whole.column_names:
        return whole
    last = {key: i for i, key in enumerate(whole.column(KEY).to_pylist())}
    return whole if len(last) == len(whole) else whole.take(sorted(last.values()))


def _as_texts(table: Any, name: str) -> Any:
    if name not in table.column_names:
        return table
    texts = _texts(table.column(name).to_pylist())
    return table.set_column(table.column_names.index(name), name, texts)


def _texts(values: list[Any]) -> Any:
    import pyarrow as pa

    return pa.array([one if isinstance(one, str | None) else json.dumps(one) for one in values])


def _folder_of_parts(file: Path) -> Path:
    return file.with_suffix(".parts")


def _part_files(file: Path) -> list[Path]:
    """The files that contain the rows, except the journal."""
    if file.exists():  # parts beside a whole table are what it was made of
        return [file]
    return sorted(_folder_of_parts(file).glob("[0-9]*.parquet"))


def _journal_rows(file: Path) -> tuple[dict[str, str] | None, list[dict[str, Any]]]:
    """The dependencies of the table, and the rows of its journal; the last line may be
    incomplete."""
    path = _folder_of_parts(file) / _JOURNAL
    if file.exists() or not path.exists():
        return None, []
    lines: list[dict[str, Any]] = []
    try:
        text = read_regular(path)
    except OSError as error:
        raise FlexmbError(f"{path}: {error.strerror}: remove it to lose its runs") from None
    for line in text.splitlines():
        with suppress(ValueError, OverflowError):
            row = read_json(line)
            if isinstance(row, dict) and (KEY in row or not lines):
                lines.append({name: _plain(value) for name, value in row.items()})
    return (lines[0], lines[1:]) if lines else (None, [])


def _stored_about(file: Path) -> dict[str, str] | None:
    for path in _part_files(file):
        metadata = _checked(path).metadata.metadata or {}
        with suppress(ValueError):
            about = read_json(metadata.get(_ABOUT, b""))
            if isinstance(about, dict):
                return about
        raise FlexmbError(f"{path} is no table of runs of flexmb: remove it, or give --fresh")
    return _journal_rows(file)[0]


def _checked(path: Path) -> Any:
    """An opened Parquet file that can be read within limits of time and memory."""
    import pyarrow.parquet as pq

    problem = None if path.is_file() else "is no regular file"
    try:
        problem = problem or check_reading(path)
        if problem is None:
            return pq.ParquetFile(path)
    except (OSError, ValueError) as error:
        problem = f"cannot be read ({error})"
    raise FlexmbError(f"{path} {problem}: remove it to lose its runs, or give --fresh")


def _read_part(path: Path, columns: list[str] | None) -> Any:
    with _checked(path) as file:
        if columns is not None:
            columns = [name for name in columns if name in file.schema_arrow.names]
        return file.read(columns).replace_schema_metadata()


def _table(rows: list[dict[str, Any]]) -> Any:
    """Rows as a table; a column of values of different types becomes one of texts."""
    import pyarrow as pa

    columns = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name) for row in rows]
        try:
            columns[name] = pa.array(values)
        except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
            columns[name] = _texts(values)
    return pa.table(columns)


def _plain(value: Any) -> Any:
    """A value that JSON and a column can store."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, str):
        return value.encode(errors="replace").decode()  # what is no Unicode cannot be written
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, list | tuple) and all(isinstance(one, int | float) for one in value):
        return [float(one) for one in value]
    return json.dumps(value, default=str)
