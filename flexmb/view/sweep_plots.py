"""Pictures of a sweep: histograms, scatter, response surfaces, sensitivities, parallel coordinates.

In: columns of numbers with their labels. Out: figures; failed runs are red marks, never left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.flexbody.arrays import Array
from flexmb.view.plot import COLORMAP, GHOST, INK, JOINT, LINES, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FAILED = "#c0392b"
_MAX_LINES = 500  # largest number of lines in parallel coordinates
_MAX_POINTS = 5000  # largest number of points in a scatter plot
_CELLS = 60  # cells of a response surface in each direction
_MAX_LEVEL_TICKS = 7  # largest number of choices of a knob with horizontal tick labels


class Axis(NamedTuple):
    """A knob or a scalar: its label, its numbers (n,), and for choices their texts."""

    label: str
    values: Array
    words: tuple[str, ...] = ()


class Bar(NamedTuple):
    """A sensitivity with its confidence interval."""

    label: str
    value: float
    low: float
    high: float


def histogram_figure(
    scalars: Sequence[Axis], marks: Sequence[Sequence[float]], title: str, note: str
) -> Figure:
    """Histograms of each scalar; `marks` are quantiles, drawn as lines."""
    figure, grid = _panels(len(scalars), title)
    for axes, one, lines in zip(grid, scalars, marks, strict=False):
        x = one.values[np.isfinite(one.values)]
        axes.hist(x, bins=_bins(x), color=LINES[0], alpha=0.75, edgecolor="white", lw=0.4)
        for value in lines:
            axes.axvline(value, color=JOINT, lw=1.2, ls="--")
        _finish(axes, one.label, "runs")
    figure.supxlabel(note, color=GHOST, fontsize=7, x=0.02, ha="left")
    return figure


def _bins(x: Array) -> int:
    """Number of bars by the rule of Freedman and Diaconis, from 5 to 60."""
    width = 2.0 * float(np.subtract(*np.percentile(x, (75, 25)))) / len(x) ** (1.0 / 3.0)
    return int(np.clip(np.ptp(x) / width, 5, 60)) if width > 0.0 else 10


def scatter_figure(
    knobs: Sequence[Axis], scalars: Sequence[Axis], title: str, joined: bool = False
) -> Figure:
    """Every scalar over every knob; a run without a value is a red mark at the bottom."""
    figure = new_figure(1.2 + 2.7 * len(knobs), 0.8 + 2.2 * len(scalars), title)
    grid = figure.subplots(len(scalars), len(knobs), squeeze=False, sharex="col", sharey="row")
    for i, scalar in enumerate(scalars):
        for j, knob in enumerate(knobs):
            axes, failed = grid[i][j], ~np.isfinite(scalar.values)
            x, y = knob.values[~failed][:_MAX_POINTS], scalar.values[~failed][:_MAX_POINTS]
            style: dict[str, Any] = (
                {"marker": "o", "lw": 1.2} if joined else {"marker": ".", "lw": 0.0}
            )
            order = np.argsort(x) if joined else slice(None)
            axes.plot(x[order], y[order], ms=3, color=LINES[0], alpha=0.8, **style)
            if failed.any():
                low = np.full(int(failed.sum()), y.min() if len(y) else 0.0)
                axes.plot(knob.values[failed], low, "x", color=_FAILED, ms=5, label="failed")
                axes.legend(fontsize=7, frameon=False)
            last = i == len(scalars) - 1
            _finish(axes, knob.label if last else "", scalar.label if j == 0 else "")
            axes.locator_params(axis="x", nbins=4)  # so that long numbers do not overlap
            _word_ticks(axes.xaxis, knob)
    return figure


class SurfacePicture(NamedTuple):
    """A scalar over two knobs: its fit, the runs it was fitted to, and a note on its quality."""

    x: Axis
    y: Axis
    scalar: Axis
    fit: Callable[[Array, Array], Array]
    note: str


def surface_figure(surfaces: Sequence[SurfacePicture], title: str) -> Figure:
    """Response surfaces as contours, with the runs as points in the same colours."""
    figure, grid = _panels(len(surfaces), title)
    for axes, one in zip(grid, surfaces, strict=False):
        ends = [(float(a.values.min()), float(a.values.max())) for a in (one.x, one.y)]
        X, Y = np.meshgrid(*(np.linspace(*end, _CELLS) for end in ends))
        Z = one.fit(X.ravel(), Y.ravel()).reshape(X.shape)
        values = one.scalar.values
        both = np.concatenate([Z.ravel(), values[np.isfinite(values)]])
        limits = {"vmin": float(both.min()), "vmax": float(both.max())}
        filled = axes.contourf(X, Y, Z, 14, cmap=COLORMAP, **limits)
        axes.scatter(
            one.x.values[:_MAX_POINTS], one.y.values[:_MAX_POINTS], c=values[:_MAX_POINTS],
            cmap=COLORMAP, s=9, edgecolors="white", linewidths=0.3, **limits,
        )  # fmt: skip
        bar = figure.colorbar(filled, ax=axes)
        bar.set_label(one.scalar.label, color=INK, fontsize=8)
        bar.ax.tick_params(labelsize=7, colors=INK)
        axes.set_title(one.note, color=GHOST, fontsize=7, loc="left")
        _finish(axes, one.x.label, one.y.label)
        axes.grid(False)
    return figure


def sensitivity_figure(
    panels: Sequence[tuple[str, Sequence[tuple[str, Sequence[Bar]]]]], title: str, ordinate: str
) -> Figure:
    """Bars with intervals: for each scalar its series (name, bars by knob), the largest knob on
    top."""
    figure, grid = _panels(len(panels), title, height=3.0)
    for axes, (label, series) in zip(grid, panels, strict=False):
        order = np.argsort([abs(bar.value) for bar in series[-1][1]])
        thickness = 0.8 / len(series)
        for k, (name, bars) in enumerate(series):
            sorted_bars = [bars[i] for i in order]
            y = np.arange(len(sorted_bars)) + (0.5 * (len(series) - 1) - k) * thickness
            values = np.array([bar.value for bar in sorted_bars])
            axes.barh(y, values, thickness * 0.9, color=LINES[k], label=name)
            ends = np.array([(bar.value - bar.low, bar.high - bar.value) for bar in sorted_bars]).T
            axes.errorbar(values, y, xerr=np.clip(ends, 0, None), fmt="none", ecolor=INK, lw=0.9)
        axes.set_yticks(range(len(order)), [series[0][1][i].label for i in order])
        axes.axvline(0.0, color=GHOST, lw=0.8)
        axes.set_title(label, color=INK, fontsize=9, loc="left")
        _finish(axes, ordinate, "")
        if len(series) > 1:
            axes.legend(fontsize=7, frameon=False, loc="lower right")
    return figure


def parallel_figure(axes_of: Sequence[Axis], color: Axis, title: str) -> Figure:
    """Every run as a line through its values on parallel axes, coloured by one scalar.

    For many runs only some are drawn, with the extremes of that scalar; failed runs are red.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure = new_figure(1.6 + 1.5 * len(axes_of), 4.4, title)
    axes = figure.subplots()
    order = np.argsort(color.values)  # NaN come last
    if len(order) > _MAX_LINES:
        order = order[np.unique(np.linspace(0, len(order) - 1, _MAX_LINES).astype(int))]
    finite = color.values[np.isfinite(color.values)]
    norm = Normalize(*((float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)))
    shown = ScalarMappable(norm, COLORMAP)
    scaled = []
    for one in axes_of:
        inside = one.values[np.isfinite(one.values)]
        low, width = (inside.min(), np.ptp(inside)) if len(inside) else (0.0, 0.0)
        scaled.append((one.values - low) / width if width > 0.0 else one.values * 0.0 + 0.5)
    lines = np.stack(scaled, axis=1)[order]
    for line, value in zip(lines, color.values[order], strict=True):
        style: dict[str, Any] = {"color": shown.to_rgba(value), "lw": 0.7, "alpha": 0.7}
        if not np.isfinite(value):
            style = {"color": _FAILED, "lw": 1.0, "marker": "x", "ms": 4}
        axes.plot(range(len(axes_of)), line, **style)
    for i, one in enumerate(axes_of):
        axes.plot((i, i), (0.0, 1.0), color=INK, lw=0.9)
        inside = one.values[np.isfinite(one.values)]
        ends = one.words[:: max(len(one.words) - 1, 1)] or tuple(
            f"{end:.4g}" for end in (inside.min(), inside.max())
        ) if len(inside) else ("", "")  # fmt: skip
        for text, y, va in ((ends[0], -0.02, "top"), (ends[-1], 1.02, "bottom")):
            axes.text(i, y, text, ha="center", va=va, fontsize=7, color=INK)
    axes.set_xticks(range(len(axes_of)), [one.label for one in axes_of], fontsize=8, color=INK)
    axes.tick_params(axis="x", pad=12, length=0)
    axes.set_yticks([])
    axes.set_ylim(-0.06, 1.06)
    for side in axes.spines.values():
        side.set_visible(False)
    bar = figure.colorbar(shown, ax=axes, pad=0.02)
    bar.set_label(color.label, color=INK, fontsize=8)
    bar.ax.tick_params(labelsize=7, colors=INK)
    failed = int((~np.isfinite(color.values)).sum())
    note = f"{len(order)} of {len(color.values)} runs" + f", red: {failed} failed" * bool(failed)
    figure.supxlabel(note, color=GHOST, fontsize=7, x=0.02, ha="left")
    return figure


def _panels(count: int, title: str, height: float = 2.8) -> tuple[Figure, list[Any]]:
    columns = min(count, 3) if count != 4 else 2
    rows = -(-count // columns)
    figure = new_figure(1.0 + 3.6 * columns, 0.8 + height * rows, title)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for empty in grid[count:]:
        empty.remove()
    return figure, grid[:count]


def _finish(axes: Any, x: str, y: str) -> None:
    axes.set_xlabel(x, color=INK, fontsize=8)
    axes.set_ylabel(y, color=INK, fontsize=8)
    style_axes(axes, labelsize=7)
    axes.set_axisbelow(True)


def _word_ticks(axis: Any, knob: Axis) -> None:
    if knob.words:
        axis.set_ticks(range(len(knob.words)), knob.words)
        if len(knob.words) > _MAX_LEVEL_TICKS:
            axis.set_tick_params(rotation=90)
