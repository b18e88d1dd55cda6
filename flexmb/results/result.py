"""A result: times, channels, reactions, energies, poses, stress and statistics of one run.

In: the path of a ``result.h5``, also of one that is still being written or was cut off by a kill.
Out: arrays over time by name, read when they are used: times, channels, reactions and energies in
the units of the scene, ``result.units``; q, v, vd, lam and drift in SI. The file is not kept open.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from fnmatch import filter as filter_names
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexmb.errors import FlexmbError, Problem, ResultFileError
from flexmb.flexbody.arrays import Array
from flexmb.model.scenes.parameters import Time
from flexmb.results.channels import (
    CHANNEL_KINDS,
    Channel,
    HistoryTable,
    MarkerPair,
    all_channels,
    list_channels,
    marker_pairs,
)
from flexmb.results.export import copy_result, export_table, notebook_html
from flexmb.results.marker_history import MarkerHistory, MotionChannel
from flexmb.results.recovery import StressChannel
from flexmb.results.stress_envelopes import StressEnvelopes
from flexmb.units import UnitSystem, unit_system

_PLOTTED = 3  # channels plotted in notebooks
_PREVIEW_NAMES = 12  # channel names listed in notebooks

NOT_UNIQUE = "reactions_not_unique"
"""Statistic with the names of joints and drivers whose reactions are not unique."""


class Reaction(NamedTuple):
    """Force and moment of a joint or driver on a body over time, axes of its marker there."""

    force: Array  # (n, 3) on the marker
    moment: Array  # (n, 3) about the marker
    on: str  # the marker, such as "rod.big_end"
    by: str  # the marker on the other side
    unique: bool = True  # False: constraints are redundant, the minimum-norm reaction is reported


class Pose(NamedTuple):
    """Where a body is, in SI: p = r + A (s + Phi eta) for a point s of its undeformed frame."""

    r: Array  # (3,) origin of the body frame, global axes [m]
    A: Array  # (3, 3) direction cosines, body to global
    eta: Array  # (m,) modal coordinates


class Result(StressEnvelopes, MarkerHistory):
    """The result of one run.

    Parameters
    ----------
    path : path
        A result file, or the folder that holds ``result.h5``.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """

    @property
    def reactions(self) -> tuple[str, ...]:
        """Names of the joints and drivers that have reactions."""
        return tuple(pair.name for pair in marker_pairs(self.layout, self.model))

    @property
    def reactions_not_unique(self) -> tuple[str, ...]:
        """Names of those with redundant constraints: their minimum-norm values are reported."""
        paths = str(self.statistics.get(NOT_UNIQUE, "")).split(", ")
        return tuple(
            pair.name for pair in marker_pairs(self.layout, self.model) if pair.path in paths
        )

    def reaction(self, name: str, on: str = "J") -> Reaction:
        """What a joint or driver does to one of its two bodies, over time.

        Action and reaction: ``on="I"`` and ``on="J"`` give opposite forces, each in the axes of its
        own marker (z: the joint's axis, on J the second one of a joint with two; of what slides in
        a planar scene x is the axis, z the normal), and moments about its own marker. Those of a
        joint do not include those of its driver.

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
        number, side, pair = _find_side(marker_pairs(self.layout, self.model), name, on)
        first = 12 * number + (0 if side == "J" else 6)
        table = self.part("reactions", slice(first, first + 6))
        markers = (pair.J, pair.I) if side == "J" else (pair.I, pair.J)
        force, moment = (
            self.in_scene_units(table[:, :3], "N"),
            self.in_scene_units(table[:, 3:], "N m"),
        )
        return Reaction(force, moment, *markers, pair.name not in self.reactions_not_unique)

    def channels(self, what: str = "sensors") -> tuple[str, ...]:
        """Names that ``result[name]`` knows.

        Parameters
        ----------
        what : str
            ``"sensors"`` (such as slider.x), ``"reactions"`` (crank_pin.rod.force.x: what the joint
            does to that body, as `reaction` gives it), ``"energy"`` (energy.kinetic), ``"drift"``,
            ``"coordinates"`` (rod.r.x, rod.eta.0), ``"accelerations"`` (rod.r_ddot.x),
            ``"motion"`` (recovered, of every marker, joint and mode: rod.big_end.velocity.x,
            crank_pin.angle, crank_pin.angle_rate, rod.mode_energy.3) or ``"stress"``
            (rod.von_mises: the largest of the body; also known: rod.von_mises.17 of mesh node 17,
            rod.stress.17.top.xx, and rod.section_force.3.1.Mz of beam element 3 at its first end).
            What the run did not store is not among them.

        Raises
        ------
        ResultFileError
            No such kind.
        """
        if what == "stress":
            bodies = (b for b in self.flexbodies if self.flexbody(b).stress is not None)
            return tuple(f"{name}.von_mises" for name in bodies)
        if what == "motion":
            return tuple(self._motions)
        named = list_channels(self.layout, self.model, what)
        return tuple(c.name for c in named if self.has_columns(c.table, [c.column]))

    def __getitem__(self, channel: str) -> Array:
        """A channel over time (n,) in the scene's units: ``result["slider.x"]``; see `channels`.

        Raises
        ------
        ResultFileError
            No such channel; lists those there are, nearest first.
        """
        stored = self._channel(channel)
        if isinstance(stored, StressChannel):
            return self._stress_values(stored)
        if isinstance(stored, MotionChannel):
            return self.in_scene_units(self._motion_values(stored), stored.unit)
        if stored.table == "balance":
            return self.balance
        return self.in_scene_units(self.part(stored.table, [stored.column])[:, 0], stored.unit)

    def __contains__(self, channel: object) -> bool:
        """Whether there is a channel of that name."""
        if not isinstance(channel, str):
            return False
        if channel in self._by_name:
            stored = self._by_name[channel]
            return self.has_columns(stored.table, [stored.column])
        name = channel
        return self._stress_channel(name) is not None or self._motion_channel(name) is not None

    def match(self, pattern: str) -> tuple[str, ...]:
        """Names of channels that a name, or one with the wildcards ``*``, ``?``, ``[...]``, means.

        Those of sensors go first: of the kinds as `channels` lists them, wildcards mean those of
        the first one that has any.

        Raises
        ------
        ResultFileError
            There is none; lists those there are, nearest first.
        """
        if pattern in self:
            return (pattern,)
        kinds = (*CHANNEL_KINDS, "stress", "motion")
        every: list[str] = []
        for kind in kinds:
            with suppress(FlexmbError):  # without those of bodies whose file is missing
                names = self.channels(kind)
                if matches := tuple(filter_names(names, pattern)):
                    return matches
                every += names
        if pattern in self._by_name:
            _ = self[pattern]  # raises the error that says what stores it
        what = f'the result has no channel "{pattern}"'
        raise ResultFileError.unknown(what, pattern, every)

    def select(self, names: Sequence[str]) -> tuple[str, ...]:
        """Channels that names mean, once each.

        Parameters
        ----------
        names : sequence of str
            Channels, wildcards as of `match`, or a vector's name for its three components.

        Raises
        ------
        ResultFileError
            Names that mean nothing, all of them at once.
        """
        channels, problems = dict[str, None](), list[Problem]()
        for name in names:
            components = [f"{name}.{axis}" for axis in "xyz"]
            vector = name not in self and all(component in self for component in components)
            try:
                channels |= dict.fromkeys(components if vector else self.match(name))
            except ResultFileError as error:
                problems += error.problems
        if problems:
            raise ResultFileError.from_problems(problems)
        return tuple(channels)

    def unit(self, channel: str) -> str:
        """The unit of a channel in the scene's system, such as m/s², mm or N; empty for none.

        Raises
        ------
        ResultFileError
            No such channel.
        """
        return self.units.label(self._channel(channel).unit, raised=True)

    def si_unit(self, channel: str) -> str:
        """The unit of a channel in SI; empty for none. Errors as of `unit`."""
        return self._channel(channel).unit

    def in_units(self, channel: str, units: UnitSystem | str) -> Array:
        """A channel over time (n,) in another unit system, such as ``"mm-t-s"``."""
        unit = self.si_unit(channel)
        factor = self.units.scale(unit) / unit_system(units).scale(unit)
        return self[channel] if factor == 1.0 else factor * self[channel]

    def pose(self, body: str, time: Time) -> Pose:
        """Where a body is at a time, interpolated between the rows.

        Parameters
        ----------
        body : str
            Name of the body.
        time : float or str
            Between the first and the last output time, in the scene's units or with its own.

        Returns
        -------
        Pose
            Origin r (3,) [m], direction cosines A (3, 3), modal coordinates eta (m,).

        Raises
        ------
        ResultFileError
            No such body, or a time outside the run.
        """
        from scipy.spatial.transform import Rotation  # takes 0.2 s

        columns = self.layout.body(body)
        i, s = self.row_at(time)
        own = slice(columns.iq, columns.iq + 7 + columns.m)
        rows = self.two_rows("q", i, own)
        between = (1.0 - s) * rows[0] + s * rows[1]
        ends = Rotation.from_quat(np.roll(rows[:, 3:7], -1, axis=1))  # SciPy's scalar part is last
        turn = (ends[0].inv() * ends[1]).as_rotvec()  # along the shorter arc
        A = (ends[0] * Rotation.from_rotvec(s * turn)).as_matrix()
        return Pose(r=between[:3], A=A, eta=between[7:])

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

    def snapshot(self, time: Time | Sequence[Time] | None = None, **options: Any) -> Any:
        """The mechanism at a time, or at several, as a notebook shows it; see `flexmb.render`."""
        import flexmb

        return flexmb.snapshot(self, time, **options)

    def animation(self, **options: Any) -> Any:
        """The motion, as a notebook shows it; see `flexmb.film`."""
        import flexmb

        return flexmb.animation(self, **options)

    def to_csv(
        self, path: str | Path, channels: Sequence[str] = (), *, what: str = "sensors"
    ) -> Path:
        """Write channels over time to a CSV file, with their units in the header.

        Parameters
        ----------
        path : path
            The file.
        channels : sequence of str
            Names of channels, wildcards and vectors (see `select`); none: all of the kind `what`.
        what : str
            A kind of channels, as for `channels`.

        Raises
        ------
        ResultFileError
            No such channels, or the result has no rows.
        OutputError
            The file cannot be written.
        """
        return export_table(self._table(channels, what), Path(path), ".csv")

    def export(
        self, path: str | Path, channels: Sequence[str] = (), *, what: str = "sensors"
    ) -> Path:
        """Write channels over time in the format that the file's ending names, such as .csv.

        Parameters and errors are those of `to_csv`; an ending without a format is refused.
        """
        return export_table(self._table(channels, what), Path(path))

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
            The run is not complete, another flexible body of the same name is there, or the place
            cannot be written.
        """
        return Result(copy_result(self.path, self.flexbodies.values(), Path(path)))

    def __repr__(self) -> str:
        t = self.time
        span = f"{t[0]:g}..{t[-1]:g} {self.units.label('s')}" if len(t) else "no rows"
        return f'<Result "{self.title}" {self.status}: {self._contents.rows} rows, {span}>'

    def _repr_html_(self) -> str:
        """What notebooks show: facts of the run, and up to three channels that change."""
        facts, names = list(self._facts()), self.channels()
        if names:
            rest = len(names) - _PREVIEW_NAMES
            more = f" and {rest} more" if rest > 0 else ""
            facts.append(("channels", ", ".join(names[:_PREVIEW_NAMES]) + more))
        if self.reactions:
            facts.append(("reactions", ", ".join(self.reactions[:_PREVIEW_NAMES])))
        facts.append(("file", str(self.path)))
        lines = [] if len(self.time) < 2 else self.model.get("view", {}).get("history") or names
        lines = [name for name in lines if name in self and np.ptp(self[name]) > 0.0][:_PLOTTED]
        histories = [(name, self.unit(name), self[name]) for name in lines]
        return notebook_html(self.title or str(self.path), facts, self.time, histories)

    def _table(self, names: Sequence[str], what: str) -> HistoryTable:
        """The channels of these names, else of a kind, as a table for output formats."""
        names = self.select(names) if names else self.channels(what)
        if not names:
            lacks = f"has no channels of the kind {what}"
            if what in CHANNEL_KINDS and list_channels(self.layout, self.model, what):
                cure = f'keep = ["{what}"] in [results] keeps them'
                lacks = f"kept no channels of the kind {what}; {cure}"
            raise ResultFileError(f"{self.path}: {lacks}")
        if not len(self.time):
            raise ResultFileError(f"{self.path}: holds no output rows")
        units = (self.units.label("s"), *(self.unit(name).replace("²", "^2") for name in names))
        values = np.column_stack([self.time, *(self[name] for name in names)])
        return HistoryTable(self.title, ("time", *names), units, values)

    @cached_property
    def _by_name(self) -> dict[str, Channel]:
        return all_channels(self.layout, self.model)

    def _channel(self, name: str) -> Channel | StressChannel | MotionChannel:
        if not isinstance(name, str):
            raise ResultFileError(
                f'a channel is asked for by its name, such as result["tip.x"], given {name!r}; '
                "result.time has the times of the rows, result.channels() all names"
            )
        channel = (
            self._by_name.get(name) or self._stress_channel(name) or self._motion_channel(name)
        )
        if channel is None:
            what = f'the result has no channel "{name}"'
            raise ResultFileError.unknown(what, name, self._by_name)
        return channel


def load_result(path: str | Path) -> Result:
    """Open a result file.

    Raises
    ------
    ResultFileError
        No such file, not HDF5, not a flexmb result, another version, or damaged.
    """
    return Result(path)


def _find_side(pairs: tuple[MarkerPair, ...], name: str, on: str) -> tuple[int, str, MarkerPair]:
    """Number of a joint or driver, side ``"I"`` or ``"J"``, and its markers; see `reaction`."""
    number = next((i for i, pair in enumerate(pairs) if name in (pair.name, pair.path)), None)
    if number is None:
        what = f'the result has no reaction of "{name}" (a sensor records that of a force)'
        raise ResultFileError.unknown(what, name, [pair.name for pair in pairs])
    pair = pairs[number]
    for side, marker, body in (("J", pair.J, pair.body_J), ("I", pair.I, pair.body_I)):
        if on in (side, marker, body):
            return number, side, pair
    allowed = dict.fromkeys((pair.body_I, pair.body_J, pair.I, pair.J, "I", "J"))
    raise ResultFileError.unknown(f'{pair.path} does not act on "{on}"', on, allowed)
