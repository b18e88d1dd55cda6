"""Channels of several runs drawn over each other, one pair of axes for each channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from flexmb.results import Result
from flexmb.view.plot import INK, LINES, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_CHANNELS = 6
_LINE_STYLES = ("-", "--", ":", "-.")


def overlay_figure(runs: Mapping[str, Result], channels: Sequence[str]) -> Figure:
    """The first six of these channels of all runs, in the units of the first run.

    The line of the first run is wide and pale, those of the others are thin, so that lines that
    agree are all seen.
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
