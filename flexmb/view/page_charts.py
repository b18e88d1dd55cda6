"""Charts of a web page: lines of channels with few points, for ``page.js``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.results import Result
from flexmb.view.history import Line, envelope, open_results, quantity_label, select_series
from flexmb.view.html_page import Html, packed, tag
from flexmb.view.plot import LINES, prefixed
from flexmb.view.work_precision import Curve

Array = NDArray[np.float64]

_POINTS = 1200  # of a line
_DASHES = ("solid", "dash", "dot", "dashdot")
_LETTERS = 60  # of a legend in one line, on a telephone


class Charts:
    """The charts of a page, in the order in which they are made."""

    def __init__(self) -> None:
        self.data: list[dict[str, Any]] = []

    def histories(self, results: Result | Sequence[Result], names: Sequence[str]) -> list[Html]:
        """Channels over time, one chart per unit.

        Raises
        ------
        FlexmbError
            As of :func:`flexmb.view.history_figure`.
        """
        runs = open_results(results)
        units = runs[0].units
        panels: dict[tuple[str, bool], list[Line]] = {}
        last = 0.0
        for one in select_series(runs, names):
            t, y = one.time(units), one.values(units)
            last = max(last, float(np.ptp(t)))
            line = Line(one, *envelope(t, y, points=_POINTS), one.unit)
            panels.setdefault((one.unit, one.channel == "energy.balance"), []).append(line)
        factor, shown = prefixed(last, units.label("s"), units)
        return [self._panel(lines, runs, factor, f"time [{shown}]") for lines in panels.values()]

    def _panel(self, lines: Sequence[Line], runs: Sequence[Result], time: float, x: str) -> Html:
        units = runs[0].units
        largest = max(float(np.abs(line.y).max(initial=0.0)) for line in lines)
        factor, label = quantity_label(lines[0].unit, largest, units)
        channels = list(dict.fromkeys(line.series.channel for line in lines))
        labels = list(dict.fromkeys(line.series.run for line in lines))
        traces = []
        for i, line in enumerate(lines):
            channel, run = channels.index(line.series.channel), labels.index(line.series.run)
            color, dash = (
                (channel, run) if len(channels) > 1 < len(labels) else (i, i // len(LINES))
            )
            traces.append({
                "name": line.series.label,
                "x": packed(line.x / time, "f8"),
                "y": packed(line.y / factor, "f4"),
                "color": LINES[color % len(LINES)],
                "dash": _DASHES[dash % len(_DASHES)],
            })  # fmt: skip
        return self._add(traces, x=x, y=label, time=time)

    def costs(self, curves: Sequence[Curve], quantity: str) -> Html:
        """Error against processor time, in logarithmic scales."""
        traces = [
            {
                "name": curve.name or "settings", "x": packed(curve.seconds, "f8"),
                "y": packed(curve.errors, "f8"), "words": list(curve.words),
                "color": LINES[i % len(LINES)], "dash": "solid",
            }
            for i, curve in enumerate(curves)
        ]  # fmt: skip
        return self._add(traces, x="processor time [s]", y=quantity, logs=True, points=True)

    def _add(self, traces: list[dict[str, Any]], **words: Any) -> Html:
        name = f"chart{len(self.data)}"
        letters = sum(len(str(trace["name"])) + 6 for trace in traces)
        self.data.append({"id": name, "lines": traces, "rows": 1 + letters // _LETTERS, **words})
        return tag("div", id=name, class_="chart")
