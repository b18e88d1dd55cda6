"""Time histories of channels, drawn with matplotlib without its global state.

In: a :class:`Result` or its file, and channel names. Out: a matplotlib ``Figure`` or a picture of
it: one pair of axes per unit, stacked over a common time axis, legends outside the data. Units are
the scene's; those of SI get the prefix that suits the values.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import ViewError
from flexmb.model.sensor import CHANNEL_UNITS
from flexmb.results import Result
from flexmb.units import SI, UnitSystem
from flexmb.view.style import INK, LINES, new_figure, style_axes, writable_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OTHER_UNITS = {"force": "N", "moment": "N m", "energy": "J"}  # of what sensors do not measure
_PREFIXED = ("m", "m/s", "m/s²", "s")
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


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
    """Factor and unit that bring `largest` near 1 to 1000; only m, s and their quotients in SI."""
    if units is not SI or unit not in _PREFIXED:
        return 1.0, unit
    for factor, prefix in _PREFIXES:
        if largest >= factor:
            return factor, prefix + unit
    return 1.0, unit
