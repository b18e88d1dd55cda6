"""What a result file holds, as it holds it: facts of the run, and tables over time.

In: the path of a file. Out: properties, read when asked for; arrays that cannot be changed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.results.keep import not_kept, row_bytes
from flexmb.results.layout import Columns
from flexmb.results.read import read_contents, read_state, read_table
from flexmb.results.schema import widths
from flexmb.results.scratch import scratch_of
from flexmb.units import UnitSystem, unit_system

__all__ = ["Stored"]

Array = NDArray[np.float64]
Places = list[int] | NDArray[np.int64] | slice

_SECONDS = "seconds_"  # statistics of this prefix are wall times by phase
_ALL = slice(None)
_WORK = "_work"  # energies of this ending were done by something, the others are stored


class Stored:
    """Facts and tables of one run; see `Result`."""

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        inside = path / "result.h5"
        self.path = inside if inside.is_file() else path
        self._contents = read_contents(self.path)
        self._tables: dict[str, Array] = {}
        self._scratch = scratch_of(self.path.parent)  # a temporary folder lives as long as this

    @property
    def status(self) -> str:
        """How the run ended, or ``"running"``."""
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
            name.removeprefix(_SECONDS): float(value)
            for name, value in self.statistics.items()
            if name.startswith(_SECONDS)
        }

    @property
    def extended(self) -> bool:
        """Whether the run was given another duration than its scene began with."""
        return self._contents.extended

    @property
    def model(self) -> dict[str, Any]:
        """The scene that was run, as data."""
        return self._contents.scene

    @property
    def units(self) -> UnitSystem:
        """The unit system of the scene, in which times, channels and energies are."""
        return unit_system(str(self.model.get("units", "SI")))

    @property
    def title(self) -> str:
        """The title of the scene."""
        return str(self.model.get("title", ""))

    @property
    def texts(self) -> dict[str, str]:
        """Further texts kept with the result, such as the scene file's own."""
        return self._contents.texts

    @property
    def layout(self) -> Columns:
        """Names and offsets of bodies, constraint rows, channels and energies."""
        return self._contents.columns

    @property
    def flexbodies(self) -> dict[str, Path]:
        """For each flexible body the path of its file."""
        folder = self.path.parent
        return {name: folder / file for name, file in self._contents.flexbodies.items()}

    @property
    def time(self) -> Array:
        """Output times (n,) in the scene's units."""
        return self.told(self.table("time"), "s")

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
        """Energies and works by name, each (n,) in the scene's units, as far as they were kept.

        Stored: kinetic, strain, gravity, spring. Done since the start: driver_work, damper_work,
        applied_work.
        """
        numbers = self._contents.kept["energy"]
        table = self.told(self.part("energy", numbers), "J")
        return {self.layout.energies[k]: table[:, i] for i, k in enumerate(numbers)}

    @property
    def balance(self) -> Array:
        """Energy stored less work done, less its first value (n,): 0 but for errors."""
        if "balance" not in self._tables:
            self.table("energy")  # all of them
            total = np.zeros(len(self.time))
            for name, values in self.energy.items():
                total += -values if name.endswith(_WORK) else values
            self._tables["balance"] = total - total[:1]
            self._tables["balance"].flags.writeable = False
        return self._tables["balance"]

    @property
    def drift(self) -> Array:
        """Largest violation of the constraints (n, 2): at position level, at velocity level."""
        return self.table("drift")

    @property
    def row_bytes(self) -> tuple[int, int]:
        """Bytes that a row takes in the file, and would take if everything were kept."""
        return row_bytes(self._contents.kept), 8 * sum(widths(self.layout).values())

    def last_state(self) -> tuple[int, dict[str, NDArray[Any]]] | None:
        """The newest whole state of the integrator, and how many rows were written before it.

        None where the run was cut off before the first state was kept.
        """
        return read_state(self.path, self._contents.run)

    def refresh(self) -> None:
        """Look at the file again, for a run that has gone on since."""
        self._contents = read_contents(self.path)
        self.close()

    def close(self) -> None:
        """Let go of the arrays read so far; the file itself is never held open."""
        self._tables.clear()

    def told(self, values: Array, unit: str) -> Array:
        """SI values in the scene's units, read-only like the table they are from."""
        told: Array = self.units.outward(values, unit) if unit else values
        told.flags.writeable = False
        return told

    def table(self, name: str) -> Array:
        """A whole table, SI; names as in `schema`.

        Raises
        ------
        ResultFileError
            The run did not keep all of it.
        """
        return self._stored(name) if name == "time" else self.part(name)

    def part(self, name: str, columns: Places = _ALL) -> Array:
        """Columns of a table (n, k) by their numbers in the layout, SI.

        Raises
        ------
        ResultFileError
            The run did not keep them.
        """
        kept, width = self._contents.kept[name], widths(self.layout)[name]
        if len(kept) == width:
            whole: Array = self._stored(name)[:, columns]
            return whole
        wanted = np.arange(width)[columns]
        missing = np.setdiff1d(wanted, kept)
        if len(missing):
            what = not_kept(self.layout, self.model, name, missing.tolist())
            raise ResultFileError(f"{self.path}: {what}")
        found: Array = self._stored(name)[:, np.searchsorted(kept, wanted)]
        return found

    def is_kept(self, name: str, columns: Places = _ALL) -> bool:
        """Whether the run kept these columns of a table."""
        if name == "balance":
            name, columns = "energy", _ALL
        wanted = np.arange(widths(self.layout)[name])[columns]
        return bool(np.isin(wanted, self._contents.kept[name]).all())

    def _stored(self, name: str) -> Array:
        """A table as the file holds it."""
        if name not in self._tables:
            contents = self._contents
            table = read_table(self.path, contents.run, name, contents.rows)
            table.flags.writeable = False  # shared by all who ask
            self._tables[name] = table
        return self._tables[name]
