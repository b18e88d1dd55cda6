"""Plots, drawn with matplotlib without its global state: time histories, error against wall time.

Time histories have one pair of axes per unit, stacked over a common time axis, legends outside the
data; units are the scene's, and those of SI get the prefix that suits the values. Work-precision
plots are log-log, one pair of axes per quantity, the target as a line; errors below that of the
reference itself are shaded. Colours are those of all pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flexmb.errors import ViewError
from flexmb.model.sensor import CHANNEL_UNITS
from flexmb.results import Result
from flexmb.units import SI, UnitSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PAPER: Final = "#ffffff"
INK: Final = "#2b2f36"
GHOST: Final = "#6b7280"
GROUND: Final = "#c9c5bb"
JOINT: Final = "#e07b24"
COLORMAP: Final = "viridis"
DIVERGING: Final = "coolwarm"

# Bodies in the order of the scene: muted and far apart in hue and lightness, none close to the
# colour map's ends or to the joints. Lines of plots: the Okabe-Ito palette, safe for colour-blind
# readers (M. Okabe and K. Ito, Color Universal Design, 2008), its yellow left out.
BODIES: Final = ("#7d93b2", "#b59f86", "#93ab8f", "#b08fa3", "#8aa8a8", "#a8a08a")
LINES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")

_DPI = 150


def new_figure(width: float, height: float, title: str = "") -> Figure:
    """An empty matplotlib figure for plots [inch], without matplotlib's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    if title:
        figure.suptitle(title, color=INK, fontsize=12, x=0.02, ha="left")
    return figure


def style_axes(axes: Any, **ticks: Any) -> None:
    """White ground, light grid, no frame above and right; `ticks` go to the tick labels."""
    axes.set_facecolor("white")
    axes.grid(True, which="major", color="#d9dbe0", lw=0.6)
    axes.tick_params(colors=INK, **ticks)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def writable_file(output: str | Path, endings: tuple[str, ...]) -> Path:
    """The path, its folder made, if a file with one of these endings can be written there.

    Raises
    ------
    ViewError
        Another ending, a folder in its place, or the folder cannot be made or written.
    """
    path = Path(output)
    if path.suffix.lower() not in endings:
        raise ViewError(f"{path}: the file must end in {' or '.join(endings)}")
    if path.is_dir():
        raise ViewError(f"{path}: is a folder; give the name of a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with path.open("ab"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


_OTHER_UNITS = {
    "force": "N",
    "moment": "N m",
    "energy": "J",
    "stress": "Pa",
}  # of what sensors do not measure
_PREFIXED = ("m", "m/s", "m/s²", "s", "Pa")
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def plot_history(
    result: Result | str | Path, channels: Sequence[str] = (), output: str | Path = "history.png"
) -> Path:
    """Draw channels over time into a file.

    Parameters
    ----------
    result : Result or path
        The run, or its file.
    channels : sequence of str
        Names such as ``"slider.x"``; none: those the scene's ``[view]`` names, else all that move.
    output : path
        A file that ends in .png, .pdf or .svg.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        The result has nothing to draw, or the file cannot be written.
    """
    return save_figure(history_figure(result, channels), output)


def history_figure(result: Result | str | Path, channels: Sequence[str] = ()) -> Figure:
    """Channels over time as a matplotlib ``Figure``, which notebooks show by themselves.

    Raises
    ------
    ResultFileError
        No such channel.
    ViewError
        The result has no channels or no rows.
    """
    result = result if isinstance(result, Result) else Result(result)
    names = tuple(channels) or _default_channels(result)
    if not names or not len(result.time):
        lacks = "rows" if names else "sensor channels"
        raise ViewError(f"{result.path}: the result has no {lacks} to draw")
    panels: dict[str, list[str]] = {}  # by unit, in the order of the names
    for name in names:
        panels.setdefault(result.unit(name), []).append(name)
    figure = new_figure(9.6, 1.2 + 2.5 * len(panels), result.title)
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (unit, members) in zip(grid, panels.items(), strict=True):
        _draw_panel(axes, result, unit, members)
    factor, unit = _time_scale(result)
    grid[-1].set_xlabel(f"time [{unit}]", color=INK)
    grid[-1].set_xlim(result.time[0] / factor, max(result.time[-1] / factor, 1e-300))
    return figure


def save_figure(figure: Figure, output: str | Path) -> Path:
    """Write a figure to a file that ends in .png, .pdf or .svg.

    Raises
    ------
    ViewError
        Another ending, or the file cannot be written.
    """
    path = writable_file(output, (".png", ".pdf", ".svg"))
    try:
        figure.savefig(path)
    except OSError as error:
        raise ViewError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path


def _default_channels(result: Result) -> tuple[str, ...]:
    """Channels that the scene names, else those that change, else all."""
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
    return moving or names


def _draw_panel(axes: Any, result: Result, unit: str, names: list[str]) -> None:
    time_factor, _ = _time_scale(result)
    largest = max(float(np.abs(result[name]).max()) for name in names)
    factor, shown = _prefixed(largest, unit, result.units)
    for i, name in enumerate(names):
        axes.plot(
            result.time / time_factor,
            result[name] / factor,
            color=LINES[i % len(LINES)],
            lw=1.6,
            ls=("-", "--", ":")[i // len(LINES) % 3],
            label=name,
        )
    words = {**CHANNEL_UNITS, **_OTHER_UNITS}.items()
    labels = {result.units.label(si, raised=True): word for word, si in words}
    quantity = labels.get(unit, "value")
    axes.set_ylabel(f"{quantity} [{shown}]" if shown else quantity, color=INK)
    style_axes(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.02), frameon=False, labelcolor=INK)


def _time_scale(result: Result) -> tuple[float, str]:
    return _prefixed(float(np.ptp(result.time)), result.units.label("s"), result.units)


def _prefixed(largest: float, unit: str, units: UnitSystem) -> tuple[float, str]:
    """Factor and unit that bring `largest` near 1 to 1000; of Pa, m, s, their quotients in SI."""
    if units is not SI or unit not in _PREFIXED:
        return 1.0, unit
    for factor, prefix in _PREFIXES:
        if largest >= factor and (factor <= 1.0 or unit == "Pa"):
            return factor, prefix + unit
    return 1.0, unit


_COLUMNS = 3
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_SMALLEST = 1e-17  # an error of exactly zero is drawn here, far below round-off
_SMALL = 0.009  # smaller numbers are written as powers of ten
_WIDE = 30.0  # last over first time from which powers of ten are marks enough
_LETTER, _LINE = 0.021, 0.035  # width and height of a word's letters, over those of the axes
_ORDINATES = {"energy": "mismatch / energy moved", "drift": "largest violation [m or rad]"}


class Curve(NamedTuple):
    """One series: its name, wall times [s], errors over the peak-to-peak, a word to each point."""

    name: str
    seconds: Sequence[float]
    errors: Sequence[float]
    words: Sequence[str] = ()


Point = tuple[float, float, str]  # seconds, error, word
Panels = Mapping[str, Sequence[Curve]]


def work_precision_figure(
    panels: Panels, floors: Mapping[str, float], *, target: float, title: str, note: str = ""
) -> Figure:
    """Error against wall time, one line per series, its points joined in their order.

    Parameters
    ----------
    panels : mapping
        Quantity to its series.
    floors : mapping
        Smallest error that can be shown, by quantity; less is shaded.
    target : float
        Error to be met, drawn as a line.
    title, note : str
        Above and below the plots.

    Raises
    ------
    ViewError
        There is no point to draw.
    """
    figure, grid = _figure(panels, title, note)
    for axes, (name, curves) in zip(grid, panels.items(), strict=False):
        _draw(axes, curves, joined=True)
        _finish(axes, name, floors.get(name), target)
    _legend(figure, grid)
    return figure


def pareto_figure(
    panels: Panels, floors: Mapping[str, float], *, target: float, title: str, note: str = ""
) -> Figure:
    """Error against wall time as points, one colour per series, and the front through the best.

    Parameters and errors as of :func:`work_precision_figure`.
    """
    figure, grid = _figure(panels, title, note)
    for axes, (name, curves) in zip(grid, panels.items(), strict=False):
        points = _draw(axes, curves, joined=False)
        front: list[Point] = []  # the points that no other one beats in both time and error
        for point in sorted(points):
            if not front or point[1] < front[-1][1]:
                front.append(point)
        axes.step(
            [point[0] for point in front], [point[1] for point in front],
            where="post", color=GHOST, lw=1.2, zorder=1, label="front",
        )  # fmt: skip
        _finish(axes, name, floors.get(name), target)
        _label(axes, front, points)
    _legend(figure, grid)
    return figure


def _draw(axes: Any, curves: Sequence[Curve], *, joined: bool) -> list[Point]:
    """Points of all curves in their colours, joined by lines or not; returns them."""
    points = list[Point]()
    for i, curve in enumerate(curves):
        errors = [max(error, _SMALLEST) for error in curve.errors]
        marker = _MARKERS[(i // len(LINES) if joined else i) % len(_MARKERS)]
        axes.loglog(
            curve.seconds, errors, color=LINES[i % len(LINES)], label=curve.name or None,
            marker=marker, ms=5 if joined else 7, ls="-" if joined else "", lw=1.4,
        )  # fmt: skip
        points += zip(curve.seconds, errors, curve.words or [""] * len(errors), strict=True)
    return points


def _label(axes: Any, front: Sequence[Point], points: Sequence[Point]) -> None:
    """Words next to the points of the front, where they cover neither each other nor a point."""

    def place(point: Point) -> tuple[float, float]:
        x, y = axes.transAxes.inverted().transform(axes.transData.transform(point[:2]))
        return float(x), float(y)

    taken = [(x - 0.015, x + 0.015, y) for x, y in map(place, points)]
    for point in front:
        x, y = place(point)
        width = _LETTER * len(point[2])
        for ha, dx, dy in (("left", 5, 8), ("right", -5, -8), ("right", -6, 0)):
            low = x + 0.02 if ha == "left" else x - 0.02 - width
            box = (low, low + width, y + dy / 220)
            inside = box[0] >= 0 and box[1] <= 1
            if inside and not any(
                box[0] < right and left < box[1] and abs(box[2] - height) < _LINE
                for left, right, height in taken
            ):
                axes.annotate(
                    point[2], point[:2], xytext=(dx, dy), textcoords="offset points",
                    fontsize=7, color=INK, ha=ha, va="center",
                )  # fmt: skip
                taken.append(box)
                break


def _figure(panels: Panels, title: str, note: str) -> tuple[Figure, list[Any]]:
    if not any(len(curve.seconds) for curves in panels.values() for curve in curves):
        raise ViewError("no run has an error to draw")
    columns = 2 if len(panels) == 4 else min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(1.4 + 3.4 * columns + 1.6, 1.5 + 2.9 * rows, title)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for empty in grid[len(panels) :]:
        empty.remove()
    if note:
        figure.supxlabel(note, color=GHOST, fontsize=7, x=0.02, ha="left")
    return figure, grid[: len(panels)]


def _finish(axes: Any, name: str, floor: float | None, target: float) -> None:
    axes.set_title(name, color=INK, fontsize=10, loc="left")
    axes.set_xlabel("wall time [s]", color=INK, fontsize=9)
    axes.set_ylabel(_ORDINATES.get(name, "error / peak-to-peak"), color=INK, fontsize=9)
    _ticks(axes.xaxis, axes.get_xlim())
    _ticks(axes.yaxis, axes.get_ylim())
    style_axes(axes, labelsize=8)
    if floor is None:
        return
    axes.axhline(target, color=GHOST, lw=0.9, ls="--", label=f"target {100 * target:.2g} %")
    low = min(axes.get_ylim()[0], 0.5 * floor)
    axes.axhspan(low, floor, color=GHOST, alpha=0.15, lw=0, label="error of the reference")
    axes.set_ylim(bottom=low)


def _ticks(axis: Any, limits: tuple[float, float]) -> None:
    """Marks at 1, 2, 5 of each decade, or where that would be many at powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    subs = (1.0,) if limits[1] > _WIDE * limits[0] else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(10.0, subs))
    axis.set_major_formatter(
        FuncFormatter(lambda x, _: f"{x:g}" if x >= _SMALL else f"{x:.0e}".replace("e-0", "e-"))
    )
    axis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure, grid: Sequence[Any]) -> None:
    """One legend for all, right of the plots."""
    named: dict[str, Any] = {}
    for axes in grid:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    if named:
        figure.legend(
            list(named.values()), list(named), loc="outside right upper",
            frameon=False, labelcolor=INK, fontsize=8,
        )  # fmt: skip
