"""A result as notebooks show it: a compact table and its history, without any plotting library.

In: a result. Out: HTML with an inline SVG. What is not known of a run is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from flexmb.results.result import Result

__all__ = ["html"]

_WIDTH, _HEIGHT = 520, 120  # of the history, pixels
_POINTS = 400  # per line
_LINES = 3
_COLORS = ("#2f6db5", "#c8552b", "#3c8d4f")
_NAMES = 12  # channels listed


def html(result: Result) -> str:
    """The HTML of a result."""
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in _facts(result)
    )
    title = escape(result.title or str(result.path))
    return f"<div><strong>{title}</strong><table>{rows}</table>{_history(result)}</div>"


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    known, t = result.statistics, result.time
    yield "status", result.status + (f": {result.message}" if result.message else "")
    if len(t):
        yield "time", f"{t[0]:g} to {t[-1]:g} {result.units.label('s')}, {len(t)} rows"
    if "steps" in known:
        whole = "integrate" in result.seconds and "resumed_at_s" not in known
        spent = f" in {result.seconds['integrate']:.3g} s" if whole else ""
        yield "steps", f"{known['steps']}{spent}"
    for key, name, unit in (
        (
            "measured_error_of_positions",
            "measured error",
            " of the peak-to-peak of the worst sensor",
        ),
        ("estimated_error", "estimated error", " of the motion"),
        ("energy_balance_error", "energy balance error", " of the energy moved"),
        ("largest_position_drift", "largest position drift", " m or rad"),
    ):
        if key in known:
            yield name, f"{known[key]:.2g}{unit}"
    names = result.channels()
    more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
    if names:
        yield "channels", ", ".join(names[:_NAMES]) + more
    if result.reactions:
        yield "reactions", ", ".join(result.reactions[:_NAMES])
    yield "file", str(result.path)


def _history(result: Result) -> str:
    """Lines of the channels that the scene's `[view]` names, else of the first that move."""
    t = result.time
    if len(t) < 2:
        return ""
    asked = tuple(result.model.get("view", {}).get("history", ())) or result.channels()
    names = [n for n in asked if n in result and np.ptp(result[n]) > 0.0][:_LINES]
    every = max(1, len(t) // _POINTS)
    lines, legend = [], []
    for name, color in zip(names, _COLORS, strict=False):
        values = result[name]
        low, high = float(values.min()), float(values.max())
        points = _points(t[::every], values[::every], low, high)
        lines.append(f'<polyline points="{points}" fill="none" stroke="{color}"/>')
        unit = result.unit(name)
        legend.append(
            f'<span style="color:{color}">{escape(name)}: {low:.4g} to {high:.4g} '
            f"{escape(unit)}</span>"
        )
    if not lines:
        return ""
    box = f'width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
    frame = f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white" stroke="#d9dbe0"/>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{frame}{"".join(lines)}</svg>'
    return f"{svg}<br>{' &nbsp; '.join(legend)}"


def _points(t: NDArray[np.float64], values: NDArray[np.float64], low: float, high: float) -> str:
    """Points of one line; its least and greatest value touch the frame but for a margin."""
    x = _WIDTH * (t - t[0]) / (t[-1] - t[0])
    y = 0.05 * _HEIGHT + 0.9 * _HEIGHT * (high - values) / (high - low)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
