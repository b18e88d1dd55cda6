"""A result, as its file holds it: times, channels, coordinates, energies, poses, statistics.

In: the path of a ``result.h5``, also of one that is still being written or was cut off by a kill.
Out: arrays over time by name, read when asked for. Times, channels and energies are in the unit
system of the scene, ``result.units``; the tables q, v, vd, lam and drift are SI, as in the file.
The file is not held open.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ResultFileError
from flexmb.model.orientation import rotation_matrix
from flexmb.model.sensors import channel_unit
from flexmb.results.layout import Columns
from flexmb.results.pose import slerp
from flexmb.results.read import read_contents, read_state, read_table
from flexmb.units import UnitSystem, unit_system

__all__ = ["Pose", "Result", "load_result"]

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Where a body is, in SI: p = r + A (s + Phi eta) for a point s of its undeformed frame."""

    r: Array  # (3,) origin of the body frame, global axes [m]
    A: Array  # (3, 3) direction cosines, body to global
    eta: Array  # (m,) modal coordinates


class Result:
    """The result of one run.

    Parameters
    ----------
    path : path
        A result file.

    Attributes
    ----------
    path : Path
        Where the file is.
    status : str
        ``"finished"``, ``"stopped"``, ``"failed"``; ``"running"`` while a run writes it and after
        a kill.
    message : str
        One sentence on the end of a run that stopped or failed.
    statistics : dict
        Steps, iterations, seconds by phase and so on.
    model : dict
        The scene that was run.
    units : UnitSystem
        The unit system of times, channels and energies: that of the scene.
    texts : dict
        Further texts, such as the scene file's own.
    layout : Columns
        Names and offsets of bodies, rows, channels and energies.
    flexbodies : dict of str to Path
        The file of each flexible body.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._contents = read_contents(self.path)
        self._tables: dict[str, Array] = {}

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
        return self._told(self._table("time"), "s")

    @property
    def q(self) -> Array:
        """Positions (n, nq), SI: per body r, p, eta."""
        return self._table("q")

    @property
    def v(self) -> Array:
        """Velocities (n, nv), SI: per body r_dot (global axes), w (body axes), eta_dot."""
        return self._table("v")

    @property
    def vd(self) -> Array:
        """Accelerations (n, nv), SI: the time derivative of `v`."""
        return self._table("vd")

    @property
    def lam(self) -> Array:
        """Constraint multipliers (n, nc) [N or N m], columns named by ``layout.rows``."""
        return self._table("lam")

    @property
    def energy(self) -> dict[str, Array]:
        """Energies and works by name, each (n,) in the scene's units."""
        table = self._told(self._table("energy"), "J")
        return {name: table[:, i] for i, name in enumerate(self.layout.energies)}

    @property
    def drift(self) -> Array:
        """Largest violation of the constraints (n, 2): at position level, at velocity level."""
        return self._table("drift")

    def __getitem__(self, channel: str) -> Array:
        """A sensor channel over time (n,) in the scene's units: ``result["slider.x"]``.

        Raises
        ------
        ResultFileError
            No such channel; lists those there are, nearest first.
        """
        values = self._table("sensors")[:, self.layout.channel(channel)]
        return self._told(values, self._unit(channel))

    def unit(self, channel: str) -> str:
        """The unit of a channel in the scene's system, such as m/s² or mm.

        Raises
        ------
        ResultFileError
            No such channel.
        """
        self.layout.channel(channel)
        return self.units.label(self._unit(channel), raised=True)

    def pose(self, body: str, time: float) -> Pose:
        """Where a body is at a time, interpolated between the rows.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float
            Between the first and the last output time, in the scene's units.

        Returns
        -------
        Pose
            Origin r (3,) [m], direction cosines A (3, 3), modal coordinates eta (m,).

        Raises
        ------
        ResultFileError
            No such body, or a time outside the run.
        """
        columns = self.layout.body(body)
        i, s = self._locate(time)
        rows = self.q[[i, min(i + 1, len(self.time) - 1)], columns.iq :]
        mixed = (1.0 - s) * rows[0] + s * rows[1]
        A = rotation_matrix(slerp(rows[0, 3:7], rows[1, 3:7], s))
        return Pose(r=mixed[:3], A=A, eta=mixed[7 : 7 + columns.m])

    def last_state(self) -> tuple[int, dict[str, NDArray[Any]]] | None:
        """The newest whole state of the integrator, and how many rows were written before it.

        None where the run was cut off before the first state was kept.
        """
        return read_state(self.path, self._contents.run)

    def plot(self, *channels: str, output: str | Path | None = None) -> Any:
        """Draw channels over time: a matplotlib ``Figure``, also written to `output` if given.

        Parameters
        ----------
        *channels : str
            Names such as ``"slider.x"``; none: those the scene's ``[view]`` names, else all.
        output : path, optional
            A file that ends in .png, .pdf or .svg.

        Raises
        ------
        ResultFileError
            No such channel.
        ViewError
            The result has nothing to draw, or the file cannot be written.
        """
        import flexmb

        figure = flexmb.history_figure(self, channels)
        if output is not None:
            flexmb.save_figure(figure, output)
        return figure

    def close(self) -> None:
        """Let go of the arrays read so far; the file itself is never held open."""
        self._tables.clear()

    def __repr__(self) -> str:
        span = f"0..{self.time[-1]:g} {self.units.label('s')}" if len(self.time) else "no rows"
        return f'<Result "{self.title}" {self.status}: {self._contents.rows} rows, {span}>'

    def _table(self, name: str) -> Array:
        if name not in self._tables:
            contents = self._contents
            table = read_table(self.path, contents.run, name, contents.rows)
            table.flags.writeable = False  # shared by all who ask
            self._tables[name] = table
        return self._tables[name]

    def _told(self, values: Array, unit: str) -> Array:
        """SI values in the scene's units, read-only like the table they are from."""
        told: Array = self.units.outward(values, unit)
        told.flags.writeable = False
        return told

    def _unit(self, channel: str) -> str:
        """SI unit of a channel."""
        sensors = self.model.get("sensors", {})
        types = {name: str(sensor.get("type", "")) for name, sensor in sensors.items()}
        return channel_unit(types, channel) or ""

    def _locate(self, time: float) -> tuple[int, float]:
        """Row before `time` and the share of the way to the next one."""
        times = self.time
        if not len(times):
            raise ResultFileError(f"{self.path}: holds no output rows")
        slack = 1e-9 * max(abs(times[0]), abs(times[-1]))  # a time the user typed in decimals
        if not times[0] - slack <= time <= times[-1] + slack:
            unit = self.units.label("s")
            span = f"{times[0]:g} to {times[-1]:g} {unit}"
            raise ResultFileError(f"t = {time:g} {unit} lies outside the run, which covers {span}")
        i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
        if i == len(times) - 1:
            return i, 0.0
        s = (time - times[i]) / (times[i + 1] - times[i])
        return i, float(np.clip(s, 0.0, 1.0))


def load_result(path: str | Path) -> Result:
    """Open a result file.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """
    return Result(path)
