"""Writing a result file during a run, and adding to it afterwards.

In: the layout of the compiled system and the scene, then blocks of output rows and the integrator's
state. Out: one HDF5 file as described in `result_file`, readable at any moment, also after a kill.
All space is reserved before the run; an older file of that name stays until the new one has rows. A
block is written and flushed before its rows are counted, so the row counter never exceeds the rows.
The integrator's state is written to two slots alternately, of which one is always complete. Rows
that are not finite are refused; the rows before them are stored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import copyfileobj
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import Layout
from flexmb.errors import OutputError, ResultFileError
from flexmb.flexbody.arrays import Array
from flexmb.results.channels import (
    Columns,
    count_finite_rows,
    describe_bad_row,
    stored_columns,
    widths,
)
from flexmb.results.crash_safe_file import (
    DiskFile,
    add_rows,
    content_digest,
    no_rows,
    reading,
    state_sum,
    sum_rows,
    uninterrupted,
)
from flexmb.results.output_block import OutputBlock
from flexmb.results.result_file import (
    STATUS,
    arrays_text,
    copy_content,
    create_content,
    create_state,
    put_text,
    read_contents,
    read_state,
    report_text,
    state_bytes,
)
from flexmb.untrusted import USER_BLOCK, open_hdf5


class ResultWriter:
    """Writes one result file; use it in a ``with`` statement or call :meth:`close`.

    Parameters
    ----------
    path : path
        The file, usually ``result.h5``; its folder is made, an older file is replaced.
    layout : Layout
        Names and offsets of bodies, rows, channels and energies.
    n_outputs : int
        Number of rows to reserve. More may be appended, at the cost of a copy of the file.
    scene : mapping
        The scene as JSON-able data, as ``Model.to_scene_dict`` gives it.
    flexbodies : mapping of str to str
        For each flexible body its file, relative to the folder of `path`.
    texts : mapping of str to str
        Further texts to store, such as the scene file's own.

    Raises
    ------
    SceneError
        The scene requests output that does not exist.
    OutputError
        The file or its folder cannot be written, or the disk lacks the space.
    """

    def __init__(
        self,
        path: str | Path,
        layout: Layout,
        n_outputs: int,
        *,
        scene: Mapping[str, Any],
        flexbodies: Mapping[str, str] | None = None,
        texts: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        self.columns = Columns.of(layout)
        self.stored = stored_columns(self.columns, scene)
        self._rows = 0
        self._sums = no_rows()
        self._saves = 0
        self._capacity = max(int(n_outputs), 1)
        self._disk = _open_disk(self.path, new=True)
        with uninterrupted():
            self._file = h5py.File(self._disk, "w", userblock_size=USER_BLOCK)
            create_content(
                self._file, self.columns, self._capacity, self.stored, scene, texts or {},
                flexbodies or {},
            )  # fmt: skip
            self._flush()

    @classmethod
    def reopen(cls, path: str | Path) -> Self:
        """The writer of a run that was stopped or killed, to continue from its newest complete
        state.

        Rows after that state are dropped, since the run computes them again.

        Raises
        ------
        ResultFileError
            Not a result of this version, or one that was cut off before its first state was stored.
        OutputError
            Another run is writing the file, or it cannot be written.
        """
        writer = cls.__new__(cls)
        writer.path = Path(path)
        read_contents(writer.path)  # raises if it is not a result
        writer._disk = _open_disk(writer.path)
        try:
            contents = read_contents(writer.path)  # read again under the lock
            newest = read_state(writer.path, contents.run)
            if newest is None:
                what = "was cut off before its first state was kept; run the scene again"
                raise ResultFileError(f"{writer.path}: {what}")
            with uninterrupted(), reading(writer.path), ExitStack() as stack:
                writer._disk.write(bytes(USER_BLOCK))  # remove the seal while rows are added
                writer._file = stack.enter_context(h5py.File(writer._disk, "r+"))
                writer.columns, writer.stored = contents.columns, contents.stored
                writer._rows = newest[0]
                writer._saves = int(writer._file["state/saves"][:].max())
                writer._capacity = len(writer._file["time"])
                writer._sums = sum_rows(writer._file, writer._rows)
                writer._write_sums()
                writer._file["progress"][:] = writer._rows, STATUS.index("running")
                writer._flush()
                stack.pop_all()
        except BaseException:
            writer._disk.close()
            raise
        return writer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(complete=kind is None)

    @property
    def rows_written(self) -> int:
        """Number of rows written to the file and counted."""
        return self._rows

    def append(self, block: OutputBlock) -> None:
        """Append the rows of `block` and make them readable.

        Raises
        ------
        OutputError
            The disk failed, or a row is not finite: the rows before it are stored.
        """
        tables = block.tables()
        self._check_shapes(tables)
        if not len(tables["time"]):
            return
        good = count_finite_rows(tables)
        if good > 0:
            with uninterrupted():
                self._write_rows(tables, good)
        if good < len(tables["time"]):
            what = describe_bad_row(self.columns, tables, good)
            raise OutputError(f"{what}; the {self._rows} rows until then are kept in {self.path}")

    def save_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Store the integrator's complete state; the previous one stays until this one is complete.

        Names and shapes must be the same in all calls. Call it once before the first rows are
        appended, so that the space is reserved before the run.

        Raises
        ------
        OutputError
            The disk failed.
        """
        with uninterrupted():
            arrays, group = {k: np.asarray(v) for k, v in state.items()}, self._file["state"]
            if self._saves == 0:
                create_state(group, arrays)
                self._flush()
            if arrays_text(arrays) != group["arrays"].asstr()[()]:
                raise KeyError("the state's arrays differ from those of the first call")
            slot = self._saves % 2
            group["saves"][slot] = 0  # invalid while it is being written
            self._flush()
            data = state_bytes(arrays)
            group[str(slot)][...] = data
            group["rows"][slot] = self._rows
            if "checks" in group:
                group["checks"][slot] = state_sum(self._saves + 1, self._rows, data)
            self._flush()
            self._saves += 1
            group["saves"][slot] = self._saves
            self._flush()

    def restart(self) -> None:
        """Drop all rows, because the run computes them again more accurately.

        Raises
        ------
        OutputError
            The disk failed.
        """
        with uninterrupted():
            self._rows, self._sums = 0, no_rows()
            self._write_sums()
            self._file["progress"][0] = 0
            self._flush()

    def finish(
        self, statistics: Mapping[str, float | int | str], status: str, message: str = ""
    ) -> None:
        """Write the statistics and how the run ended.

        Parameters
        ----------
        statistics : mapping
            Steps, iterations, seconds by phase and so on.
        status : str
            ``"finished"``, ``"stopped"`` (by the user) or ``"failed"``.
        message : str
            One sentence on why a run stopped or failed.

        Raises
        ------
        OutputError
            The disk failed.
        """
        code = STATUS.index(status)
        if not self._file:  # the disk has failed, which was reported at that time
            return
        with uninterrupted():
            self._file["report"][()] = report_text(statistics, message)
            self._flush()
            self._file["progress"][1] = code
            self._flush()
            self._disk.complete()
            self._flush()

    def close(self, *, complete: bool = True) -> None:
        """Close the file; calling it again does nothing.

        Parameters
        ----------
        complete : bool
            Whether it replaces an older file even if it has no rows.
        """
        if self._file:
            self._file.close()
            if self._disk.failure is None:
                if complete:
                    self._disk.complete()
                self._disk.seal()
        self._disk.close()

    def _flush(self, failure: OSError | None = None) -> None:
        self._file.flush()
        failure = self._disk.failure if failure is None else failure
        if failure is None:
            return
        size = self._file.id.get_filesize() / 1e6
        self.close()
        what, cure = (
            "the disk takes no more of this file",
            f"the {self._rows} rows until then are kept",
        )
        if not self._rows:
            what = "the disk has no room for this file"
            cure = "request fewer outputs or choose another folder"
        text = f"{self.path}: {what} of {size:.3g} MB ({failure.strerror}); {cure}"
        raise OutputError(text) from failure

    def _check_shapes(self, tables: dict[str, Array]) -> None:
        k = len(tables["time"])
        for name, width in widths(self.columns).items():
            values, expected = tables[name], (k,) if name == "time" else (k, width)
            if values.shape != expected:
                raise ValueError(f"block.{name} has shape {values.shape}, not {expected}")

    def _write_rows(self, tables: dict[str, Array], k: int) -> None:
        start, stop = self._rows, self._rows + k
        if stop > self._capacity:
            self._grow(stop)
        stored = {
            name: values[:k] if name == "time" else values[:k, self.stored[name]]
            for name, values in tables.items()
        }
        for name, values in stored.items():
            if values.size:
                self._file[name][start:stop] = values
        self._sums = add_rows(self._sums, stored, k)
        self._write_sums()
        self._file["progress"][0] = stop
        self._flush()
        self._rows = stop
        self._disk.complete()

    def _write_sums(self) -> None:
        """Write the checksums, unless they are those of the rows that `/progress` counts now."""
        if "checks" in self._file:  # missing in files of an earlier version
            checks = self._file["checks"]
            checks[int(checks[0, 0] == self._file["progress"][0])] = self._sums
        self._flush()

    def _grow(self, rows: int) -> None:
        """Continue in a copy with more room: if a file grows in place, a kill may damage it."""
        self._capacity = max(rows, 2 * self._capacity)
        try:
            disk = DiskFile(self.path, new=True, claimed=True)
        except OSError as error:
            self._flush(error)
            raise
        file = h5py.File(disk, "w", userblock_size=USER_BLOCK)
        copy_content(self._file, file, self._capacity)
        file.flush()
        if disk.failure is not None:
            file.close()
            disk.close()
        self._flush(disk.failure)
        self._file.close()
        disk.take_place_of(self._disk)
        self._file, self._disk = file, disk
        self._flush()


def _open_disk(path: Path, *, new: bool = False) -> DiskFile:
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return DiskFile(path, new=new)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); choose another folder") from error


def extend_file(path: Path, duration: float, outputs: int) -> None:
    """Make room for `outputs` intervals and store the new duration of the whole run.

    A copy with more room replaces the file when it is complete.

    Parameters
    ----------
    path : Path
        The result.
    duration, outputs : float, int
        Duration in the scene's units, and number of output intervals, both from the start.

    Raises
    ------
    OutputError
        Another run is writing the file, the disk has no room, or the file cannot be replaced.
    """
    with (
        _successor(path, "extended") as disk,
        open_hdf5(path, ResultFileError, "a result of flexmb") as old,
        h5py.File(disk, "w", userblock_size=USER_BLOCK) as new,
    ):
        copy_content(old, new, outputs + 1)
        new["span"][:] = duration, outputs
        new.attrs["content"] = content_digest(new)


def store_text(path: Path, name: str, text: str) -> None:
    """Store a further text in a result that no run is writing, replacing one of that name.

    Raises
    ------
    OutputError
        A run is writing the file, or it cannot be written.
    """
    open_hdf5(path, ResultFileError, "a result of flexmb").close()
    with _successor(path, "written") as disk, uninterrupted():
        with path.open("rb") as old:
            copyfileobj(old, disk)
        disk.seek(0)
        disk.write(bytes(USER_BLOCK))  # remove the seal until the text is complete
        with h5py.File(disk, "r+") as file:
            if name in file["texts"]:
                del file["texts"][name]
            put_text(file["texts"], name, text)
            file.attrs["content"] = content_digest(file)


@contextmanager
def _successor(path: Path, done: str) -> Iterator[DiskFile]:
    """A file that replaces a result when it is complete: after a kill one of the two is there."""
    try:
        disk = DiskFile(path, new=True)
        try:
            yield disk
            disk.complete()
            disk.seal()
        finally:
            disk.close()
        if disk.failure is not None:
            raise disk.failure
    except BlockingIOError as error:
        raise OutputError(f"{path}: another run is writing it") from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be {done} ({error.strerror or error})") from error
