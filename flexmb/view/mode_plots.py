"""Campbell diagrams, root loci, frequency responses, equilibria over a parameter.

In: a `ModeSweep`, a response, or a `StaticSweep`. Out: a matplotlib ``Figure``. Units: the
parameter's own, Hz, 1/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.view.plot import INK, LINES, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.analysis.linear.mode_sweep import ModeSweep
    from flexmb.analysis.static_sweep import StaticSweep

_ORDERS = (1, 2, 3)  # multiples of the speed that are drawn
_SHOWN = 12  # modes


def campbell_figure(sweep: ModeSweep, modes: int = _SHOWN) -> Figure:
    """Frequencies over the parameter, with the multiples of the fastest rotation."""
    figure = new_figure(9.6, 6.0, f"frequencies over {sweep.parameter}")
    axes = figure.subplots()
    frequencies = sweep.frequencies[:, :modes]
    for k in range(frequencies.shape[1]):
        color = LINES[k % len(LINES)]
        axes.plot(sweep.values, frequencies[:, k], color=color, lw=1.6, marker="o", ms=3)
    top = 1.1 * float(np.nanmax(frequencies, initial=0.0)) or 1.0
    if sweep.speeds.any():
        for n in _ORDERS:
            line = n * sweep.speeds / (2.0 * np.pi)
            axes.plot(sweep.values, line, color=INK, lw=0.8, ls=":")
            inside = np.flatnonzero(line <= 0.97 * top)
            if len(inside) and line[inside[-1]] > 0.0:
                at = sweep.values[inside[-1]], line[inside[-1]]
                axes.annotate(f"{n}x", at, color=INK, ha="right", va="bottom")
    axes.set_ylim(0.0, top)
    axes.set_xlabel(sweep.parameter, color=INK)
    axes.set_ylabel("frequency [Hz]", color=INK)
    style_axes(axes)
    return figure


def root_locus_figure(sweep: ModeSweep, modes: int = _SHOWN) -> Figure:
    """Eigenvalues in the complex plane: a circle at the first value, a dot at the last."""
    figure = new_figure(9.6, 6.0, f"eigenvalues over {sweep.parameter}")
    axes = figure.subplots()
    for k in range(min(modes, sweep.eigenvalues.shape[1])):
        color, line = LINES[k % len(LINES)], sweep.eigenvalues[:, k]
        axes.plot(line.real, line.imag, color=color, lw=1.4, marker=".", ms=4)
        axes.plot(line.real[:1], line.imag[:1], color=color, marker="o", ms=8, mfc="none", ls="")
        axes.plot(line.real[-1:], line.imag[-1:], color=color, marker="o", ms=7, ls="")
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set_xlabel("Re λ [1/s]", color=INK)
    axes.set_ylabel("Im λ [1/s]", color=INK)
    style_axes(axes)
    return figure


def response_figure(frequencies: Sequence[float], response: Any, title: str) -> Figure:
    """Amplitude and phase over frequencies [Hz], in logarithmic scales."""
    figure = new_figure(9.6, 6.0, title)
    top, bottom = figure.subplots(2, 1, sharex=True)
    top.loglog(frequencies, np.abs(response), color=LINES[0], lw=1.6)
    phase = np.degrees(np.unwrap(np.angle(response)))
    bottom.semilogx(frequencies, phase, color=LINES[0], lw=1.6)
    top.set_ylabel("amplitude, SI", color=INK)
    bottom.set_ylabel("phase [deg]", color=INK)
    bottom.set_xlabel("frequency [Hz]", color=INK)
    for axes in (top, bottom):
        style_axes(axes)
    return figure


def equilibria_figure(sweep: StaticSweep, names: Sequence[str] = ()) -> Figure:
    """Channels of a static sweep over its parameter, one pair of axes for each unit.

    Unstable equilibria are drawn with open circles, events as dotted lines.
    """
    names = names or [n for n in sweep.names if np.ptp(sweep[n]) > 0.0] or sweep.names
    panels: dict[str, list[str]] = {}
    for name in names:
        panels.setdefault(sweep.units[sweep.names.index(name)], []).append(name)
    figure = new_figure(9.6, 1.2 + 2.5 * len(panels), f"equilibria over {sweep.parameter}")
    grid = figure.subplots(max(1, len(panels)), 1, sharex=True, squeeze=False)[:, 0]
    values, unstable = sweep.values, ~sweep.stable
    ends = [event.place for event in sweep.events if event.kind == "limit point"]  # of branches
    for axes, (unit, members) in zip(grid, panels.items(), strict=False):
        for k, name in enumerate(members):
            color, line = LINES[k % len(LINES)], sweep[name]
            for i, (part, rest) in enumerate(
                zip(np.split(values, ends), np.split(line, ends), strict=True)
            ):
                label = None if i else name
                axes.plot(part, rest, color=color, lw=1.6, marker="o", ms=3, label=label)
            axes.plot(values[unstable], line[unstable], color=color, ls="", marker="o", ms=7,
                      mfc="white")  # fmt: skip
        for event in sweep.events:
            axes.axvline(event.low, color=INK, lw=0.8, ls=":")
            at = event.low, 1.0
            axes.annotate(event.kind, at, xycoords=("data", "axes fraction"), color=INK,
                          fontsize=8, rotation=90, ha="right", va="top")  # fmt: skip
        axes.set_ylabel(f"[{unit}]" if unit else "", color=INK)
        style_axes(axes)
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.02), frameon=False, labelcolor=INK)
    grid[-1].set_xlabel(sweep.parameter, color=INK)
    return figure
