"""Plots of errors: against processor time, with the front of the best settings, and by causes.

Work-precision plots are log-log, one pair of axes per quantity, with the target as a line; errors
below that of the reference itself are shaded. An error budget shows the shares of each sensor as
points.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from flexmb.errors import ViewError
from flexmb.view.plot import GHOST, INK, LINES, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_COLUMNS = 3
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_SMALLEST = 1e-17  # an error of exactly zero is drawn here, far below round-off
_DECIMAL = 0.009  # smaller numbers are written as powers of ten
_DECADE_TICKS = 30.0  # last over first time above which only powers of ten have ticks
_PLACES = (("left", 5, 8), ("right", -5, -8), ("right", -6, 0), ("left", 6, 0), ("right", -5, 8),
           ("left", 5, -8))  # fmt: skip
_LETTER, _LINE = 0.021, 0.035  # width and height of a character, over those of the axes
ORDINATES = {"energy": "mismatch / energy moved", "drift": "largest violation [m or rad]"}


Point = tuple[float, float, str, str]  # seconds, error, text, colour
Marks = Mapping[str, tuple[float, float]]
_VISIBLE = 1e-7  # smaller shares are not drawn


class Curve(NamedTuple):
    """A series: name, processor times [s], errors over the peak-to-peak, a text for each point."""

    name: str
    seconds: Sequence[float]
    errors: Sequence[float]
    words: Sequence[str] = ()


Panels = Mapping[str, Sequence[Curve]]


def work_precision_figure(
    panels: Panels, floors: Mapping[str, float], best: Marks | None = None, *, target: float,
    title: str, note: str = "",
) -> Figure:  # fmt: skip
    """Error against processor time, one line per series, its points joined in their order.

    Parameters
    ----------
    panels : mapping
        Quantity to its series.
    floors : mapping
        Smallest error that can be shown, by quantity; the range below is shaded.
    best : mapping, optional
        Time and error of the cheapest setting that meets the target, by quantity; it is ringed.
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
        points = _draw(axes, curves, joined=True)
        _finish(axes, name, floors.get(name), target)
        _mark(axes, (best or {}).get(name))
        _label(axes, points, points)
    _legend(figure, grid)
    return figure


def pareto_figure(
    panels: Panels, floors: Mapping[str, float], best: Marks | None = None, *, target: float,
    title: str, note: str = "",
) -> Figure:  # fmt: skip
    """Error against processor time as points, a colour per series, and the front through the best.

    Parameters and errors as of :func:`work_precision_figure`.
    """
    figure, grid = _figure(panels, title, note)
    for axes, (name, curves) in zip(grid, panels.items(), strict=False):
        points = _draw(axes, curves, joined=False)
        front: list[Point] = []  # the points that no other point beats in both time and error
        for point in sorted(points):
            if not front or point[1] < front[-1][1]:
                front.append(point)
        axes.step(
            [point[0] for point in front], [point[1] for point in front],
            where="post", color=GHOST, lw=1.2, zorder=1, label="front",
        )  # fmt: skip
        _finish(axes, name, floors.get(name), target)
        _mark(axes, (best or {}).get(name))
        _label(axes, front, points)
    _legend(figure, grid)
    return figure


def _draw(axes: Any, curves: Sequence[Curve], *, joined: bool) -> list[Point]:
    """Draw the points of all curves in their colours, joined by lines or not; returns the
    points."""
    points = list[Point]()
    for i, curve in enumerate(curves):
        errors = [max(error, _SMALLEST) for error in curve.errors]
        marker = _MARKERS[(i // len(LINES) if joined else i) % len(_MARKERS)]
        axes.loglog(
            curve.seconds, errors, color=LINES[i % len(LINES)], label=curve.name or None,
            marker=marker, ms=5 if joined else 7, ls="-" if joined else "", lw=1.4,
        )  # fmt: skip
        words = curve.words or [""] * len(errors)
        colours = [LINES[i % len(LINES)]] * len(errors)
        points += zip(curve.seconds, errors, words, colours, strict=True)
    return points


def _mark(axes: Any, best: tuple[float, float] | None) -> None:
    """Draw a ring around the recommended setting."""
    if best is not None:
        axes.plot(
            *([value] for value in best), marker="o", ms=15, mfc="none", mec=INK, mew=1.6, ls="",
            label="cheapest that meets it", zorder=5,
        )  # fmt: skip


def _label(axes: Any, front: Sequence[Point], points: Sequence[Point]) -> None:
    """Write texts next to points where they overlap neither each other nor a point."""

    def place(point: Point) -> tuple[float, float]:
        x, y = axes.transAxes.inverted().transform(axes.transData.transform(point[:2]))
        return float(x), float(y)

    taken = [(x - 0.015, x + 0.015, y) for x, y in map(place, points)]
    for point in front:
        x, y = place(point)
        width = _LETTER * len(point[2])
        for ha, dx, dy in _PLACES if point[2] else ():
            low = x + 0.02 if ha == "left" else x - 0.02 - width
            box = (low, low + width, y + dy / 220)
            inside = box[0] >= 0 and box[1] <= 1
            if inside and not any(
                box[0] < right and left < box[1] and abs(box[2] - height) < _LINE
                for left, right, height in taken
            ):
                axes.annotate(
                    point[2], point[:2], xytext=(dx, dy), textcoords="offset points",
                    fontsize=7, color=point[3], ha=ha, va="center",
                ).set_in_layout(False)  # fmt: skip
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
    axes.set_xlabel("processor time [s]", color=INK, fontsize=9)
    axes.set_ylabel(ORDINATES.get(name, "error / peak-to-peak"), color=INK, fontsize=9)
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
    """Ticks at 1, 2, 5 of each decade, or at powers of ten if these would be many."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    subs = (1.0,) if limits[1] > _DECADE_TICKS * limits[0] else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(10.0, subs))
    axis.set_major_formatter(
        FuncFormatter(lambda x, _: f"{x:g}" if x >= _DECIMAL else f"{x:.0e}".replace("e-0", "e-"))
    )
    axis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure, grid: Sequence[Any]) -> None:
    """One legend for all axes, on the right of the plots."""
    named: dict[str, Any] = {}
    for axes in grid:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    if named:
        figure.legend(
            list(named.values()), list(named), loc="outside right upper",
            frameon=False, labelcolor=INK, fontsize=8,
        )  # fmt: skip


def budget_figure(
    sensors: Sequence[str],
    shares: Mapping[str, Mapping[str, float]],
    open_shares: Collection[str],
    *,
    target: float,
    title: str,
) -> Figure:
    """A line for each sensor, a mark for each share, a bar for the sum.

    Parameters
    ----------
    sensors : sequence of str
        From top to bottom.
    shares : mapping
        Name of a share to its value over the peak-to-peak, by sensor.
    open_shares : collection of str
        Shares that are lower bounds; drawn as hollow marks.
    target : float
        Error to be met by each share, drawn as a line.
    title : str
        Above the picture.

    Raises
    ------
    ViewError
        There is nothing to draw.
    """
    if not sensors or not shares:
        raise ViewError("no share of the error is known: there is nothing to draw")
    figure = new_figure(8.6, 1.9 + 0.42 * len(sensors) + 0.1 * len(shares), title)
    axes = figure.subplots()
    values = [100 * v for s in shares.values() for v in s.values() if 100 * v > _VISIBLE]
    left = 0.4 * min([*values, 100 * target])
    for k, sensor in enumerate(sensors):
        total = 100 * sum(s.get(sensor, 0.0) for s in shares.values())
        axes.barh(k, max(total, left) - left, left=left, height=0.62, color=GHOST, alpha=0.22,
                  lw=0, label="sum" if k == 0 else None)  # fmt: skip
    for i, (name, share) in enumerate(shares.items()):
        places = [k for k, sensor in enumerate(sensors) if 100 * share.get(sensor, 0.0) > _VISIBLE]
        numbers = [100 * share[sensors[k]] for k in places]
        colour = LINES[i % len(LINES)]
        least = name in open_shares
        axes.plot(
            numbers, [k + 0.22 * (i / max(len(shares) - 1, 1) - 0.5) * 2 for k in places],
            ls="", marker=_MARKERS[i % len(_MARKERS)], ms=7, mec=colour,
            mfc="none" if least else colour,
            label=name + (" (at least)" if least else "" if places else " (round-off)"),
        )  # fmt: skip
    axes.axvline(100 * target, color=INK, lw=0.9, ls="--", label=f"target {100 * target:.2g} %")
    axes.set_xscale("log")
    axes.set_xlim(left=left)
    axes.set_ylim(len(sensors) - 0.4, -0.6)
    axes.set_yticks(range(len(sensors)), list(sensors))
    axes.set_xlabel("share of the error, % of the sensor's peak-to-peak", color=INK, fontsize=9)
    style_axes(axes, labelsize=8)
    figure.legend(loc="outside right upper", frameon=False, labelcolor=INK, fontsize=8)
    return figure
