"""Reading a result: facts of the run, and its tables over time.

In: the path of a file. Out: properties, read when they are used; read-only arrays. A result in a
temporary folder (`TemporaryFolder`) removes it when it is no longer used.
"""

from __future__ import annotations

import json
import os
import shutil
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.flexbody import FlexBody, load
from flexmb.flexbody.arrays import Array
from flexmb.folders import temporary_folder
from flexmb.model.scenes.parameters import Time, read_quantity
from flexmb.results.channels import Columns, describe_missing, row_bytes, widths
from flexmb.results.crash_safe_file import reading
from flexmb.results.result_file import read_contents, read_state, read_table
from flexmb.results.run_summary import SECONDS
from flexmb.units import UnitSystem, unit_system

DAMPING = "damping"  # name of the text in a result


@dataclass(frozen=True)
class BodyDamping:
    """The damping that a scene states for a body, and that of its modes as the scene joins it.

    Parameters
    ----------
    body, words : str
        Name of the body, and its damping as a short text. Empty name: all flexible bodies together.
    frequencies, ratios : tuple of float
        Frequency [Hz] and damping ratio of each mode as joined, ascending; empty without damping.
    """

    body: str
    words: str
    frequencies: tuple[float, ...] = ()
    ratios: tuple[float, ...] = ()

    def summary(self) -> str:
        """The ratios as a short text."""
        if not self.ratios:
            return ""
        f, z = (self.frequencies[0], self.frequencies[-1]), [100 * ratio for ratio in self.ratios]
        span = f"{len(z)} modes as joined, {f[0]:.4g} to {f[1]:.4g} Hz"
        if max(z) - min(z) <= 1e-4 * max(z):
            return f"{span}: {z[0]:.4g} %"
        return f"{span}: {z[0]:.4g} % of the first, {min(z):.4g} to {max(z):.4g} % of all"


def damping_text(dampings: Iterable[BodyDamping]) -> str:
    """Dampings as one text for a result file; the inverse of `read_damping_text`."""
    return json.dumps([asdict(one) for one in dampings])


def read_damping_text(text: str) -> tuple[BodyDamping, ...]:
    """Dampings from the text in a result file; the inverse of `damping_text`."""
    return tuple(
        BodyDamping(
            str(row["body"]),
            str(row["words"]),
            tuple(map(float, row["frequencies"])),
            tuple(map(float, row["ratios"])),
        )
        for row in json.loads(text)
    )


Places = list[int] | NDArray[np.int64] | slice

_ALL = slice(None)
_MAX_TABLE = 1.28e8  # bytes above which only the wanted rows of a table are read, and not cached
_BLOCK_BYTES = 1.6e7  # bytes of a larger table read at once
# numbers above which a table is not read whole if only a few rows are wanted
_READ_AT_ONCE = 8_000_000
# suffix of energies that are work done by forces; the others are stored energies
_WORK_SUFFIX = "_work"
_ERRORS = {  # by statistic: its name in texts, and what it is relative to
    "measured_error_of_positions": (
        "measured error", " of the peak-to-peak of the worst sensor",
    ),
    "estimated_error": ("sum of local errors", " of the motion, not verified"),
    "energy_balance_error": ("energy balance error", " of the energy moved"),
    "largest_position_drift": ("largest position drift", " m or rad"),
}  # fmt: skip


class TemporaryFolder:
    """A new folder for results without a folder of their own; removed with the last of them.

    It exists while this object or a `ResultReader` of a file in it exists, at most until Python
    ends. `Result.save` copies what is to be kept.
    """

    living: ClassVar[weakref.WeakValueDictionary[Path, TemporaryFolder]]
    living = weakref.WeakValueDictionary()
    permanent: ClassVar[list[TemporaryFolder]] = []

    def __init__(self) -> None:
        self.path = temporary_folder()
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
        self.living[self.path] = self

    def preserve(self) -> None:
        """Keep the folder until Python ends, because its path was shown to a user."""
        self.permanent.append(self)


class ResultReader:
    """Facts and tables of one run; see `Result`."""

    _bodies: dict[str, tuple[int, FlexBody]] | None = None
    _rows: tuple[str, int, Array] = ("", 0, np.zeros((2, 0)))

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        inside = path / "result.h5"
        self.path = inside if os.path.isfile(inside) else path  # a result file may have any name
        self._contents = read_contents(self.path)
        self._tables: dict[str, Array] = {}
        self._folder = TemporaryFolder.living.get(self.path.parent.resolve())

    @property
    def status(self) -> str:
        """``"finished"``, ``"stopped"``, ``"failed"``; ``"running"`` during a run or after a
        kill."""
        return self._contents.status

    @property
    def message(self) -> str:
        """One sentence on the end of a run that stopped or failed; else empty."""
        return self._contents.message

    @property
    def created(self) -> str:
        """When the run was started, ISO 8601 in UTC."""
        return self._contents.created

    @property
    def statistics(self) -> dict[str, float | int | str]:
        """Steps, iterations, seconds by phase and so on."""
        return self._contents.statistics

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time by phase [s]: compile, assemble, integrate, flexible_bodies."""
        return {
            name.removeprefix(SECONDS): float(value)
            for name, value in self.statistics.items()
            if name.startswith(SECONDS)
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the run that were reported when it ended."""
        return tuple(str(self.statistics.get("notes", "")).splitlines())

    @property
    def extended(self) -> bool:
        """Whether the duration was changed after the start of the run."""
        return self._contents.extended

    @property
    def model(self) -> dict[str, Any]:
        """The scene that was run, as data."""
        return self._contents.scene

    @property
    def units(self) -> UnitSystem:
        """The unit system of the scene, which times, channels and energies are in."""
        return unit_system(str(self.model.get("units", "SI")))

    @property
    def title(self) -> str:
        """The title of the scene."""
        return str(self.model.get("title", ""))

    @property
    def texts(self) -> dict[str, str]:
        """Further texts stored with the result, such as the scene file's own."""
        return self._contents.texts

    @property
    def damping(self) -> dict[str, BodyDamping]:
        """For each flexible body its damping, and the ratio of each mode as the scene joins it.

        If there are several, the entry "" has the ratios of the modes of all of them together.
        """
        with reading(self.path):
            rows = read_damping_text(self.texts.get(DAMPING, "[]"))
        return {one.body: one for one in rows}

    @property
    def layout(self) -> Columns:
        """Names and offsets of bodies, constraint rows, channels and energies."""
        return self._contents.columns

    @property
    def flexbodies(self) -> dict[str, Path]:
        """For each flexible body the path of its file."""
        folder = self.path.parent
        return {name: folder / file for name, file in self._contents.flexbodies.items()}

    def flexbody(self, name: str) -> FlexBody:
        """The flexible body of that name, from its file.

        Raises
        ------
        ResultFileError
            No such flexible body, or its file is not the one of this run.
        BodyFileError
            The file is missing or damaged.
        """
        if name not in self.flexbodies:
            what = f'the result has no flexible body "{name}"'
            raise ResultFileError.unknown(what, name, self.flexbodies)
        path, m = self.flexbodies[name], self.layout.body(name).m
        stamp = path.stat().st_mtime_ns if path.exists() else 0
        self._bodies = self._bodies or {}
        if self._bodies.get(name, (None,))[0] != stamp:
            body = load(path)
            if body.m != m:
                raise ResultFileError(
                    f"{path}: has {body.m} modes, the run was made with {m}; "
                    "run the scene again, or bring back the flexible-body file of the run"
                )
            self._bodies[name] = (stamp, body)
        return self._bodies[name][1]

    @property
    def time(self) -> Array:
        """Output times (n,) in the scene's units."""
        return self.in_scene_units(self.table("time"), "s")

    @property
    def q(self) -> Array:
        """Positions (n, nq), SI: per body r, p, eta."""
        return self.table("q")

    @property
    def v(self) -> Array:
        """Velocities (n, nv), SI: per body r_dot (global axes), w (body axes), eta_dot."""
        return self.table("v")

    @property
    def vd(self) -> Array:
        """Accelerations (n, nv), SI: the time derivative of `v`."""
        return self.table("vd")

    @property
    def lam(self) -> Array:
        """Constraint multipliers (n, nc) [N or N m], columns named by ``layout.rows``."""
        return self.table("lam")

    @property
    def energy(self) -> dict[str, Array]:
        """Energies and works by name, each (n,) in the scene's units, as far as they are stored.

        Stored energies: kinetic, strain, gravity, spring. Work done since the start: driver_work,
        damper_work, applied_work.
        """
        numbers = self._contents.stored["energy"]
        table = self.in_scene_units(self.part("energy", numbers), "J")
        return {self.layout.energies[k]: table[:, i] for i, k in enumerate(numbers)}

    @property
    def balance(self) -> Array:
        """Stored energy minus work done, minus its first value (n,); nonzero by errors only."""
        if "balance" not in self._tables:
            self.table("energy")  # raises if not all of them are stored
            total = np.zeros(len(self.time))
            for name, values in self.energy.items():
                total += -values if name.endswith(_WORK_SUFFIX) else values
            self._tables["balance"] = total - total[:1]
            self._tables["balance"].flags.writeable = False
        return self._tables["balance"]

    @property
    def drift(self) -> Array:
        """Largest violation of the constraints (n, 2): at position level, at velocity level."""
        return self.table("drift")

    @property
    def row_bytes(self) -> tuple[int, int]:
        """Bytes of a row in the file, and bytes of a row if everything were stored."""
        return row_bytes(self._contents.stored), 8 * sum(widths(self.layout).values())

    def last_state(self) -> tuple[int, dict[str, NDArray[Any]]] | None:
        """The newest complete state of the integrator, and the number of rows written before it.

        None if the run was cut off before the first state was stored.
        """
        return read_state(self.path, self._contents.run)

    def refresh(self) -> None:
        """Read the file again, because the run may have continued."""
        old = self._contents
        self._contents = read_contents(self.path, old.sums)
        if self._contents.run != old.run:
            self._contents = read_contents(self.path)
        self._rows = ResultReader._rows
        self.close()

    def close(self) -> None:
        """Release the arrays read so far; the file itself does not stay open."""
        self._tables.clear()

    def in_scene_units(self, values: Array, unit: str) -> Array:
        """SI values in the scene's units, read-only like their table."""
        scaled: Array = self.units.outward(values, unit) if unit else values
        scaled.flags.writeable = False
        return scaled

    def table(self, name: str) -> Array:
        """A whole table, SI; names as in `channels`.

        Raises
        ------
        ResultFileError
            There is no such table, or the run did not store all of it.
        """
        return self._stored(name) if name == "time" else self.part(name)

    def two_rows(self, name: str, i: int, columns: slice) -> Array:
        """Rows i and, if there is one, i + 1 of these columns (2, k), SI.

        Of a long table only these are read, so that memory stays bounded.
        """
        length = len(self.time)
        if name in self._tables or length * widths(self.layout)[name] <= _READ_AT_ONCE:
            return self.part(name, columns)[[i, min(i + 1, length - 1)]]
        places = self._file_columns(name, columns)
        if self._rows[:2] != (name, i):
            contents = self._contents
            rows = read_table(self.path, contents.run, name, min(i + 2, length), i)
            self._rows = name, i, rows[[0, -1]]
        return np.asarray(self._rows[2][:, places])

    def some_rows(self, name: str, rows: slice, columns: slice) -> Array:
        """Rows of these columns (r, k), SI; of a long table only these rows are read."""
        if name in self._tables or len(self.time) * widths(self.layout)[name] <= _READ_AT_ONCE:
            return self.part(name, columns)[rows]
        places = self._file_columns(name, columns)
        stop = min(rows.stop, len(self.time))
        return np.asarray(
            read_table(self.path, self._contents.run, name, stop, rows.start)[:, places]
        )

    def part(self, name: str, columns: Places = _ALL) -> Array:
        """Columns of a table (n, k) by their numbers in the layout, SI.

        Raises
        ------
        ResultFileError
            The run did not store them.
        """
        places = self._file_columns(name, columns)
        contents = self._contents
        row, rows = 8 * len(contents.stored[name]), contents.rows
        if name in self._tables or row * rows <= _MAX_TABLE:
            return np.asarray(self._stored(name)[:, places])
        step = int(_BLOCK_BYTES / row)
        table = np.empty((rows, np.arange(row // 8)[places].size))
        for first in range(0, rows, step):
            last = min(first + step, rows)
            block = read_table(self.path, contents.run, name, last, first)
            table[first:last] = block[:, places]
        return table

    def _file_columns(self, name: str, columns: Places) -> Places:
        """Numbers of the file's columns that hold these columns of a table."""
        if name not in self._contents.stored:
            raise ResultFileError.unknown_name("table", name, ("time", *self._contents.stored))
        stored, width = self._contents.stored[name], widths(self.layout)[name]
        if len(stored) == width:
            return columns
        wanted = np.arange(width)[columns]
        missing = np.setdiff1d(wanted, stored)
        if len(missing):
            what = describe_missing(self.layout, self.model, name, missing.tolist())
            raise ResultFileError(f"{self.path}: {what}")
        return np.searchsorted(stored, wanted)

    def has_columns(self, name: str, columns: Places = _ALL) -> bool:
        """Whether the run stored these columns of a table."""
        if name == "balance":
            name, columns = "energy", _ALL
        wanted = np.arange(widths(self.layout)[name])[columns]
        return bool(np.isin(wanted, self._contents.stored[name]).all())

    def _facts(self) -> Iterator[tuple[str, str]]:
        """How the run ended, its time, steps and errors, as texts; missing ones are left out."""
        statistics, t = self.statistics, self.time
        yield "status", self.status + (f": {self.message}" if self.message else "")
        if len(t):
            yield "time", f"{t[0]:g} to {t[-1]:g} {self.units.label('s')}, {len(t)} rows"
        if "steps" in statistics:
            whole = "integrate" in self.seconds and "resumed_at_s" not in statistics
            spent = f" in {self.seconds['integrate']:.3g} s" if whole else ""
            yield "steps", f"{statistics['steps']}{spent}"
        for key, (name, unit) in _ERRORS.items():
            if key in statistics:
                yield name, f"{statistics[key]:.2g}{unit}"

    def row_at(self, time: Time) -> tuple[int, float]:
        """Row before a time in the scene's units, and the fraction of the way to the next one.

        Raises
        ------
        ResultFileError
            The time lies outside the run, or there are no rows.
        """
        t, unit, time = (
            self.time,
            self.units.label("s"),
            read_quantity(self.model, time, "time", "s"),
        )
        if not len(t):
            raise ResultFileError(f"{self.path}: holds no output rows")
        # tolerance for a time that the user typed in decimals
        slack = 1e-9 * max(abs(t[0]), abs(t[-1]))
        if not t[0] - slack <= time <= t[-1] + slack:
            span = f"{t[0]:g} to {t[-1]:g} {unit}"
            raise ResultFileError(f"t = {time:g} {unit} lies outside the run, which covers {span}")
        i = int(np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 1))
        if i == len(t) - 1:
            return i, 0.0
        return i, float(np.clip((time - t[i]) / (t[i + 1] - t[i]), 0.0, 1.0))

    def _stored(self, name: str) -> Array:
        """A table as the file holds it."""
        if name not in self._tables:
            contents = self._contents
            table = read_table(self.path, contents.run, name, contents.rows)
            table.flags.writeable = False  # the array is shared by all callers
            self._tables[name] = table
        return self._tables[name]
