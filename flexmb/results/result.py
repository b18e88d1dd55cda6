"""A result, as its file holds it: times, channels, reactions, energies, poses, statistics.

In: the path of a ``result.h5``, also of one that is still being written or was cut off by a kill.
Out: arrays over time by name, read when asked for. Times, channels, reactions and energies are in
the unit system of the scene, ``result.units``; the tables q, v, vd, lam and drift are SI, as in the
file. The file is not held open.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, ResultFileError, nearest
from flexmb.model.values.orientation import rotation_matrix
from flexmb.results.channels import Channel, all_channels, channels
from flexmb.results.copying import copy_result
from flexmb.results.export import write_csv
from flexmb.results.notebook import html
from flexmb.results.pose import locate, slerp
from flexmb.results.reactions import NOT_UNIQUE, Reaction, find_side, sides
from flexmb.results.recovered import Recovered
from flexmb.results.recovered_channels import asked, largest_stress_names, values_of

__all__ = ["Pose", "Result", "load_result"]

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Where a body is, in SI: p = r + A (s + Phi eta) for a point s of its undeformed frame."""

    r: Array  # (3,) origin of the body frame, global axes [m]
    A: Array  # (3, 3) direction cosines, body to global
    eta: Array  # (m,) modal coordinates


class Result(Recovered):
    """The result of one run.

    Parameters
    ----------
    path : path
        A result file, or the folder that holds ``result.h5``.

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
    texts : dict
        Further texts, such as the scene file's own.
    units : UnitSystem
        The unit system of times, channels, reactions and energies: that of the scene.
    layout : Columns
        Names and offsets of bodies, rows, channels and energies.
    flexbodies : dict of str to Path
        The file of each flexible body.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """

    _channels: dict[str, Channel] | None = None

    @property
    def reactions(self) -> tuple[str, ...]:
        """Names of the joints and drivers that have reactions."""
        return tuple(pair.name for pair in sides(self.layout, self.model))

    @property
    def reactions_not_unique(self) -> tuple[str, ...]:
        """Names of those that redundant equations share: their least values are reported."""
        paths = str(self.statistics.get(NOT_UNIQUE, "")).split(", ")
        return tuple(pair.name for pair in sides(self.layout, self.model) if pair.path in paths)

    def reaction(self, name: str, on: str = "J") -> Reaction:
        """What a joint or driver does to one of its two bodies, over time.

        Action and reaction: ``on="I"`` and ``on="J"`` give opposite forces, each in the axes of its
        own marker (z: the joint's axis, on J the second one of a joint with two; of what slides in
        a planar scene x is the axis, z the normal), and moments about its own marker. A driver's
        are beside those of its joint, not in them.

        Parameters
        ----------
        name : str
            A joint or driver, such as ``"crank_pin"``.
        on : str
            The body it acts on, such as ``"rod"``, or its marker there, such as ``"rod.big_end"``;
            ``"I"`` or ``"J"``: the first or second of the joint's ``between``.

        Returns
        -------
        Reaction
            ``force`` and ``moment``, (n, 3) in the scene's units, on marker ``on``, by ``by``;
            ``unique`` is False where redundant equations leave it undetermined.

        Raises
        ------
        ResultFileError
            No such joint or driver, or it does not act there.
        """
        number, side, pair = find_side(sides(self.layout, self.model), name, on)
        at = 12 * number + (0 if side == "J" else 6)
        table = self.part("reactions", slice(at, at + 6))
        there = (pair.J, pair.I) if side == "J" else (pair.I, pair.J)
        force, moment = self.told(table[:, :3], "N"), self.told(table[:, 3:], "N m")
        return Reaction(force, moment, *there, pair.name not in self.reactions_not_unique)

    def channels(self, what: str = "sensors") -> tuple[str, ...]:
        """Names that ``result[name]`` knows.

        Parameters
        ----------
        what : str
            ``"sensors"`` (such as slider.x), ``"reactions"`` (crank_pin.rod.force.x: what the joint
            does to that body, as `reaction` gives it), ``"energy"`` (energy.kinetic), ``"drift"``,
            ``"coordinates"`` (rod.r.x, rod.eta.0), ``"accelerations"`` (rod.r_ddot.x) or
            ``"stress"`` (rod.von_mises: the largest of the body; also known: rod.von_mises.17 of
            mesh node 17, rod.stress.17.top.xx, and rod.section_force.3.1.Mz of beam element 3 at
            its first end). What the run did not keep is not among them.

        Raises
        ------
        ResultFileError
            No such kind.
        """
        if what == "stress":
            return largest_stress_names(self)
        found = channels(self.layout, self.model, what)
        return tuple(c.name for c in found if self.is_kept(c.table, [c.column]))

    def __getitem__(self, channel: str) -> Array:
        """A channel over time (n,) in the scene's units: ``result["slider.x"]``; see `channels`.

        Raises
        ------
        ResultFileError
            No such channel; lists those there are, nearest first.
        """
        recovered = asked(self, channel)
        if recovered is not None and channel not in self._known():
            return values_of(self, recovered)
        found = self._channel(channel)
        if found.table == "balance":
            return self.balance
        return self.told(self.part(found.table, [found.column])[:, 0], found.unit)

    def __contains__(self, channel: object) -> bool:
        """Whether there is a channel of that name."""
        if channel in self._known():
            found = self._known()[str(channel)]
            return self.is_kept(found.table, [found.column])
        return asked(self, str(channel)) is not None

    def unit(self, channel: str) -> str:
        """The unit of a channel in the scene's system, such as m/s², mm or N; empty for none.

        Raises
        ------
        ResultFileError
            No such channel.
        """
        recovered = asked(self, channel)
        if recovered is not None and channel not in self._known():
            return self.units.label(recovered.unit, raised=True)
        return self.units.label(self._channel(channel).unit, raised=True)

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
        i, s = locate(self.time, time, self.path, self.units.label("s"))
        wanted = slice(columns.iq, columns.iq + 7 + columns.m)
        rows = self.part("q", wanted)[[i, min(i + 1, len(self.time) - 1)]]
        mixed = (1.0 - s) * rows[0] + s * rows[1]
        A = rotation_matrix(slerp(rows[0, 3:7], rows[1, 3:7], s))
        return Pose(r=mixed[:3], A=A, eta=mixed[7 : 7 + columns.m])

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

    def to_csv(
        self, path: str | Path, channels: Sequence[str] = (), *, what: str = "sensors"
    ) -> Path:
        """Write channels over time to a CSV file, with their units in the header.

        Parameters
        ----------
        path : path
            The file.
        channels : sequence of str
            Names of channels; none: all of the kind `what`.
        what : str
            A kind of channels, as for `channels`.

        Raises
        ------
        ResultFileError
            No such channels, or the result has no rows.
        OutputError
            The file cannot be written.
        """
        return write_csv(self, path, channels, what)

    def save(self, path: str | Path) -> Result:
        """Copy the result and the files of its flexible bodies; the copy needs nothing else.

        Parameters
        ----------
        path : path
            A folder, made if it is missing, which gets ``result.h5`` and the bodies' files beside
            it; or a file that ends in ``.h5``, with the bodies' files beside that.

        Returns
        -------
        Result
            The copy, which can be drawn and resumed like the original.

        Raises
        ------
        OutputError
            The run still goes on, another flexible body of the same name is there, or the place
            cannot be written.
        """
        return Result(copy_result(self, Path(path)))

    def __repr__(self) -> str:
        t = self.time
        span = f"{t[0]:g}..{t[-1]:g} {self.units.label('s')}" if len(t) else "no rows"
        return f'<Result "{self.title}" {self.status}: {self._contents.rows} rows, {span}>'

    def _repr_html_(self) -> str:
        """What notebooks show: how the run went, and its history."""
        return html(self)

    def _known(self) -> dict[str, Channel]:
        if self._channels is None:
            self._channels = all_channels(self.layout, self.model)
        return self._channels

    def _channel(self, name: str) -> Channel:
        known = self._known()
        if name not in known:
            likely = nearest(name, known)
            allowed = self.layout.channels or ("energy.kinetic", "drift.position")
            what = f'the result has no channel "{name}"'
            raise ResultFileError.from_problems([Problem("", what, allowed, likely)])
        return known[name]


def load_result(path: str | Path) -> Result:
    """Open a result file.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """
    return Result(path)
