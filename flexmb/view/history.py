"""Histories: channels of one or several results over time, and how their lines are drawn.

There is one pair of axes per unit, stacked over a common time axis, with legends above the data;
several results are drawn into the same axes. Units are those of the first scene; SI units get a
suitable prefix. For long runs the extremes of every interval are drawn.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.errors import Problem, ResultFileError, ViewError
from flexmb.flexbody.arrays import Array
from flexmb.model.sensor import CHANNEL_UNITS
from flexmb.results import Result
from flexmb.units import UnitSystem
from flexmb.view.plot import INK, LINES, WIDTH, new_figure, prefixed, save_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_OTHER_UNITS = {
    "force": "N",
    "moment": "N m",
    "energy": "J",
    "stress": "Pa",
}  # units of what sensors do not measure
_APART = ("energy.balance",)  # far smaller than other channels of its unit: on separate axes
_POINTS = 4000  # points of a line, about two per pixel; of more the extremes are drawn
_FLAT = 20.0  # distance of lines over their largest range, above which they need own axes
_MAX_LEVELS = 3  # largest number of axes for one unit
_MAX_LINES = 24  # largest number of lines in one plot
_LETTERS = 84  # characters of the legend above a pair of axes, in one row
_MAX_SHARE = 12  # largest height of a legend, as rows per figure and pair of axes

Results = Result | str | Path | Sequence[Result | str | Path]


class Series(NamedTuple):
    """One channel of one result, or the magnitude of three."""

    result: Result
    channel: str  # for a magnitude without its ".x"
    run: str  # distinguishes the result from others; empty for a single one

    @property
    def unit(self) -> str:
        """In SI."""
        return self.result.si_unit(self.channel if self.is_scalar else f"{self.channel}.x")

    @property
    def is_scalar(self) -> bool:
        """Whether it is a channel, not a magnitude."""
        return self.channel in self.result

    @property
    def label(self) -> str:
        """The text in legends."""
        name = self.channel if self.is_scalar else f"|{self.channel}|"
        return f"{name}, {self.run}" if self.run else name

    def values(self, units: UnitSystem) -> Array:
        """Over all rows (n,), in a unit system."""
        if self.is_scalar:
            return self.result.in_units(self.channel, units)
        parts = (self.result.in_units(f"{self.channel}.{axis}", units) for axis in "xyz")
        return np.sqrt(sum(part**2 for part in parts))

    def time(self, units: UnitSystem) -> Array:
        """Output times (n,) in a unit system."""
        return np.asarray(units.outward(self.result.table("time"), "s"))


class Line(NamedTuple):
    """What a plot draws of a series."""

    series: Series
    x: Array  # as drawn
    y: Array  # in the unit system of the plot
    unit: str  # of y, in SI
    panel: int = 0  # lines with the same unit and panel share their axes


def open_results(results: Results) -> tuple[Result, ...]:
    """Open one or several results, from their files if paths are given.

    Raises
    ------
    ResultFileError
        No such result.
    ViewError
        A result has no rows.
    """
    several = [results] if isinstance(results, Result | str | Path) else list(results)
    runs = tuple(run if isinstance(run, Result) else Result(run) for run in several)
    for run in runs:
        if not len(run.time):
            raise ViewError(f"{run.path}: the result has no rows to draw")
    return runs


def run_labels(results: Sequence[Result]) -> tuple[str, ...]:
    """Texts that distinguish results: the ends of their paths that differ; empty for a single
    one."""
    if len(results) < 2:
        return ("",) * len(results)
    paths = [run.path.resolve() for run in results]
    same_name = len({path.name for path in paths}) == 1
    parts = [path.parts[:-1] if same_name else (*path.parts[:-1], path.stem) for path in paths]
    shared = len(os.path.commonprefix([tuple(reversed(part)) for part in parts]))
    depth = max(len(part) for part in parts)
    for count in range(shared + 1, depth + 1):
        labels = ["/".join(part[max(0, len(part) - count) : len(part) - shared]) for part in parts]
        if len(set(labels)) == len(labels):
            return tuple(labels)
    return tuple(f"{k + 1}" for k in range(len(results)))


def select_series(
    results: Sequence[Result], patterns: Sequence[str], *, vectors: bool = False
) -> list[Series]:
    """The channels that patterns match in any of some results, in the order of the patterns.

    Parameters
    ----------
    results : sequence of Result
        The runs.
    patterns : sequence of str
        Names of channels, or of vectors without their ``.x`` (for the magnitude), with or without
        the wildcards ``*``, ``?`` and ``[...]``; none: the default channels that all results have.
    vectors : bool
        Whether only names of vectors are allowed.

    Raises
    ------
    ResultFileError
        Names that match nothing in any result, all of them at once; channels that were not stored.
    ViewError
        More lines than a plot can show, or no common channels.
    """
    labels, problems, series = run_labels(results), list[Problem](), dict[tuple[str, str], Series]()
    for pattern in patterns or _common_channels(results):
        errors = list[ResultFileError]()
        for run, label in zip(results, labels, strict=True):
            try:
                names = _names_of(run, pattern, vectors)
            except ResultFileError as error:
                errors.append(error)
                continue
            for name in names:
                series.setdefault((name, label), Series(run, name, label))
        if len(errors) == len(results):
            problems += errors[0].problems
    if problems:
        raise ResultFileError.from_problems(problems)
    if len(series) > _MAX_LINES:
        what = f"{len(series)} lines are too many for one plot, which shows up to {_MAX_LINES}"
        raise ViewError(f"{what}: name fewer channels, such as {next(iter(series))[0]}")
    return list(series.values())


def _names_of(run: Result, pattern: str, vectors: bool) -> tuple[str, ...]:
    """Channels that match a pattern; for vectors the name without its component."""
    if not vectors:
        with suppress(ResultFileError):
            return run.match(pattern)
    with suppress(ResultFileError):
        stems = (name.removesuffix(".x") for name in run.match(f"{pattern}.x"))
        return tuple(name for name in stems if all(f"{name}.{axis}" in run for axis in "yz"))
    names = run.match(pattern)
    what = f'"{pattern}" is one component; a hodograph needs the name of a vector'
    vector = tuple(dict.fromkeys(name.rpartition(".")[0] for name in names))
    raise ResultFileError.from_problems([Problem("", what, (), vector[:3])])


def _common_channels(results: Sequence[Result]) -> tuple[str, ...]:
    first, *others = ({name: None for name in _default_channels(run)} for run in results)
    common = tuple(name for name in first if all(name in run for run in results[1:]))
    if not common:
        if not others:
            raise ViewError(f"{results[0].path}: the result has no sensor channels to draw")
        names = "; ".join(f"{run.path}: {', '.join(run.channels()[:6])}" for run in results)
        raise ViewError(f"the results have no channels in common; name some of each ({names})")
    return common


def plot_history(
    results: Results, channels: Sequence[str] = (), output: str | Path = "history.png"
) -> Path:
    """Draw channels over time into a file.

    Parameters
    ----------
    results : Result or path, or several
        The run, or its file; several are drawn into the same axes.
    channels : sequence of str
        Names such as ``"slider.x"``, ``"rod.eta.*"`` or ``"crank_pin.rod.force"`` (a magnitude);
        none: those of the scene's ``[view]``, else all that move.
    output : path
        A file that ends in .png, .pdf or .svg.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        The result has nothing to draw, or the file cannot be written.
    """
    return save_figure(history_figure(results, channels), output)


def history_figure(
    results: Results, channels: Sequence[str] = (), times: tuple[float, float] | None = None
) -> Figure:
    """Channels over time as a matplotlib ``Figure``, which notebooks show by themselves.

    `times` (first and last, in the units of the first scene) limit what is drawn; the others are as
    for :func:`plot_history`.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        The result has no channels or no rows.
    """
    runs = open_results(results)
    series = select_series(runs, channels)
    units = runs[0].units
    spans = [time_span(one, units, times) for one in series]
    first = min(float(one.time(units)[rows.start]) for one, rows in zip(series, spans, strict=True))
    last = max(
        float(one.time(units)[rows.stop - 1]) for one, rows in zip(series, spans, strict=True)
    )
    factor, unit = prefixed(last - first, units.label("s"), units)
    lines = [
        Line(
            one, one.time(units)[rows] / factor, one.values(units)[rows], one.unit,
            int(one.channel in _APART),
        )
        for one, rows in zip(series, spans, strict=True)
    ]  # fmt: skip
    if not channels:
        lines = separate_levels(lines)
    figure, grid = draw_panels(lines, units, figure_title(runs))
    grid[-1].set_xlabel(f"time [{unit}]", color=INK)
    grid[-1].set_xlim(first / factor, max(last / factor, first / factor + 1e-300))
    return figure


def separate_levels(lines: Sequence[Line]) -> list[Line]:
    """Lines that are flat compared with their distance to others of their unit, on separate
    axes."""
    separated: list[Line] = []
    for key in dict.fromkeys((line.unit, line.panel) for line in lines):
        alike = [line for line in lines if (line.unit, line.panel) == key]
        ranges = [float(np.ptp(line.y)) for line in alike]
        levels = [0.5 * float(line.y.max() + line.y.min()) for line in alike]
        groups: list[list[int]] = []
        for k in np.argsort(levels):
            if groups and levels[k] - levels[groups[-1][0]] < _FLAT * max(ranges):
                groups[-1].append(int(k))
            else:
                groups.append([int(k)])
        number = {k: i for i, group in enumerate(groups) for k in group}
        few = len(groups) <= _MAX_LEVELS and max(ranges) > 0.0
        separated += [
            line._replace(panel=line.panel + 2 * number[k] * few) for k, line in enumerate(alike)
        ]
    return separated


def figure_title(runs: Sequence[Result]) -> str:
    """The common title of the scenes; empty if they differ."""
    titles = {run.title for run in runs}
    return titles.pop() if len(titles) == 1 else ""


def time_span(series: Series, units: UnitSystem, times: tuple[float, float] | None) -> slice:
    """Rows of a result between two times.

    Raises
    ------
    ViewError
        Fewer than two rows lie between them.
    """
    t = series.time(units)
    if times is None:
        return slice(0, len(t))
    rows = slice(int(np.searchsorted(t, times[0])), int(np.searchsorted(t, times[1], "right")))
    if rows.stop - rows.start < 2:
        unit = units.label("s")
        what = f"between {times[0]:g} and {times[1]:g} {unit} lie no two outputs of the run"
        covers = f"which covers {t[0]:g} to {t[-1]:g} {unit}"
        raise ViewError(f"{series.result.path}: {what}, {covers}")
    return rows


def draw_panels(
    lines: Sequence[Line],
    units: UnitSystem,
    title: str,
    *,
    what: str = "",
    is_function: bool = True,
) -> tuple[Figure, list[Any]]:
    """One pair of axes per unit, stacked over a common abscissa, with a line for each series.

    Parameters
    ----------
    lines : sequence of Line
        What is drawn.
    units : UnitSystem
        Unit system of the ordinates.
    title : str
        Title above all axes.
    what : str
        Put before the quantity of the ordinates, such as ``"amplitude of "``.
    is_function : bool
        Whether the abscissae are ascending.
    """
    panels: dict[tuple[str, int], list[Line]] = {}
    for line in lines:
        panels.setdefault((line.unit, line.panel), []).append(line)
    rows = [_legend_rows([line.series.label for line in panel]) for panel in panels.values()]
    height = 1.0 + sum(2.4 + 0.2 * min(n, _MAX_SHARE) for n in rows)
    figure = new_figure(WIDTH, height, title)
    grid = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0])
    for axes, panel in zip(grid, panels.values(), strict=True):
        _draw_panel(axes, panel, units, what, is_function)
    return figure, grid


def envelope(
    x: Array, y: Array, is_function: bool = True, points: int = _POINTS
) -> tuple[Array, Array]:
    """A line with far fewer points that looks the same: the extremes of every interval."""
    stretches = points // 2
    size = len(x) // stretches
    if size < 4:
        return x, y
    used = size * stretches
    starts = size * np.arange(stretches)
    places = [np.zeros(1, int), np.arange(used, len(x)), np.array([len(x) - 1])]
    for values in (y,) if is_function else (x, y):
        table = values[:used].reshape(stretches, size)
        places += [starts + table.argmin(axis=1), starts + table.argmax(axis=1)]
    order = np.unique(np.concatenate(places))
    return x[order], y[order]


def _default_channels(result: Result) -> tuple[str, ...]:
    """Channels named in the scene, else those that change, else all."""
    history = tuple(result.model.get("view", {}).get("history", ()))
    if history:
        return history
    names = result.channels()
    largest = {name: float(np.abs(result[name]).max(initial=0.0)) for name in names}
    scale: dict[str, float] = {}
    for name in names:
        unit = result.unit(name)
        scale[unit] = max(scale.get(unit, 0.0), largest[name])
    moving = tuple(n for n in names if np.ptp(result[n]) > 1e-9 * scale[result.unit(n)])
    return (moving or names)[:_MAX_LINES]


def _draw_panel(
    axes: Any, lines: Sequence[Line], units: UnitSystem, what: str, is_function: bool
) -> None:
    largest, si_unit = max(float(np.abs(line.y).max(initial=0.0)) for line in lines), lines[0].unit
    factor, label = quantity_label(si_unit, largest, units)
    channels = list(dict.fromkeys(line.series.channel for line in lines))
    runs = list(dict.fromkeys(line.series.run for line in lines))
    for i, (one, x, y, *_) in enumerate(lines):
        channel, run = channels.index(one.channel), runs.index(one.run)
        color, dash = (channel, run) if len(channels) > 1 < len(runs) else (i, i // len(LINES))
        shown_x, shown_y = envelope(x, y, is_function)
        axes.plot(
            shown_x, shown_y / factor,
            color=LINES[color % len(LINES)],
            # so that lines that coincide are all visible
            lw=4.0 if run == 0 < len(runs) - 1 else 1.5,
            alpha=0.4 if run == 0 < len(runs) - 1 else 1.0,
            ls=("-", "--", ":", "-.")[dash % 4],
            label=one.label,
        )  # fmt: skip
    axes.set_ylabel(what + label, color=INK)
    style_axes(axes)
    axes.yaxis.get_offset_text().set(ha="right", x=-0.025, color=INK)  # beside the legend
    names = [line.series.label for line in lines]
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.01, 1.0), frameon=False, labelcolor=INK,
        fontsize=9, ncols=-(-len(names) // _legend_rows(names)), columnspacing=1.2,
        handlelength=1.8, borderaxespad=0.1,
    )  # fmt: skip


def quantity_label(si_unit: str, largest: float, units: UnitSystem) -> tuple[float, str]:
    """Factor and label of an axis for a quantity with this SI unit, with the unit shown."""
    unit = units.label(si_unit, raised=True)
    factor, shown = prefixed(largest, unit, units)
    words = {**CHANNEL_UNITS, **_OTHER_UNITS}.items()
    quantity = {units.label(si, raised=True): word for word, si in words}.get(unit, "value")
    return factor, f"{quantity} [{shown}]" if shown else quantity


def _legend_rows(names: Sequence[str]) -> int:
    """Number of rows of a legend with these names."""
    widest = max(len(name) for name in names) + 6
    return -(-len(names) // max(1, _LETTERS // widest))


_MAX_CHANNELS = 6
_LINE_STYLES = ("-", "--", ":", "-.")


def overlay_figure(runs: dict[str, Result], channels: Sequence[str]) -> Figure:
    """The first six of these channels of all runs, in the units of the first run.

    The line of the first run is wide and pale, the others are thin, so that lines that coincide are
    all visible.
    """
    first = next(iter(runs.values()))
    shown = channels[:_MAX_CHANNELS]
    figure = new_figure(9.6, 1.2 + 2.2 * len(shown), first.title)
    grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, channel in zip(grid, shown, strict=True):
        for k, (name, run) in enumerate(runs.items()):
            axes.plot(
                first.units.outward(run.table("time"), "s"),
                run.in_units(channel, first.units),
                color=LINES[k % len(LINES)],
                lw=1.4 if k else 5.0,
                alpha=1.0 if k else 0.35,
                ls=_LINE_STYLES[k % len(_LINE_STYLES)],
                label=name,
            )
        unit = first.unit(channel)
        axes.set_ylabel(f"{channel} [{unit}]" if unit else channel, color=INK)
        style_axes(axes)
    grid[0].legend(loc="upper left", bbox_to_anchor=(1.005, 1.02), frameon=False, labelcolor=INK)
    grid[-1].set_xlabel(f"time [{first.units.label('s')}]", color=INK)
    return figure
