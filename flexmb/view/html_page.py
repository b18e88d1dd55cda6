"""Single-file web pages: escaped text, packed numbers, charts drawn by plotly in the page.

In: texts, tables, pictures, charts and a moving scene. Out: the text of a self-contained page; a
policy in it forbids network access. The library plotly provides the JavaScript that draws;
``page.js`` in this folder calls it.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ViewError, printable
from flexmb.results import Result
from flexmb.view.history import Line, envelope, open_results, quantity_label, select_series
from flexmb.view.plot import LINES, prefixed
from flexmb.view.work_precision import Curve

_FACTS = 3  # tables with at most so many columns are as narrow as a telephone
_POLICY = (
    "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline' 'unsafe-eval'; worker-src blob:; font-src data:"
)


_POINTS = 1200  # points of a line
_DASHES = ("solid", "dash", "dot", "dashdot")
_LETTERS = 60  # characters per row of a legend, on a telephone


class Html(str):
    """Markup, which is not escaped again."""

    __slots__ = ()


def tag(name: str, *children: object, **attributes: object) -> Html:
    """An element; its text and the values of attributes are escaped.

    A trailing underscore of an attribute is dropped: ``class_="card"``.

    >>> tag("p", "a < b", class_="note")
    '<p class="note">a &lt; b</p>'
    """
    words = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(printable(str(value)))}"'
        for key, value in attributes.items()
    )
    inner = "".join(markup(child) for child in children)
    return Html(f"<{name}{words}>{inner}</{name}>" if name != "img" else f"<img{words}>")


def markup(child: object) -> str:
    """Markup unchanged, anything else as escaped text."""
    return child if isinstance(child, Html) else escape(printable(str(child)))


def table(
    columns: Sequence[str], rows: Iterable[Sequence[object]], right: Sequence[int] = ()
) -> Html:
    """A table; the columns numbered in `right` are aligned to the right. Empty without rows."""
    body = [
        tag("tr", *(_cell("td", cell, i in right) for i, cell in enumerate(row))) for row in rows
    ]
    if not body:
        return Html("")
    head = [tag("tr", *(_cell("th", name, i in right) for i, name in enumerate(columns)))]
    inner = [tag("thead", *head)] if any(columns) else []
    kind = "columns" if len(columns) > _FACTS else "facts"
    return tag("div", tag("table", *inner, tag("tbody", *body), class_=kind), class_="wide")


def _cell(name: str, cell: object, right: bool) -> Html:
    return tag(name, cell, class_="number") if right else tag(name, cell)


def section(title: str, *children: object, class_: str = "") -> Html:
    """A section of the page with its heading; empty without content."""
    content = [child for child in children if markup(child)]
    return tag("section", tag("h2", title), *content, class_=class_) if content else Html("")


def image(png: bytes, words: str) -> Html:
    """A picture embedded in the page."""
    if not png.startswith(b"\x89PNG"):  # another file under its name
        raise ValueError(f"the picture {words} is no PNG")
    source = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    return tag("figure", tag("img", src=source, alt=words, loading="lazy"))


def packed(values: Any, kind: str = "f4") -> dict[str, str]:
    """Numbers as base64 text of little-endian `kind`, which ``page.js`` unpacks."""
    data: NDArray[Any] = np.ascontiguousarray(values, dtype="<" + kind)
    return {"kind": kind, "data": base64.b64encode(data.tobytes()).decode("ascii")}


def check_plotly() -> None:
    """Refuse to make a page without the library plotly.

    Raises
    ------
    ViewError
        The library plotly is not installed; says how to get it.
    """
    if find_spec("plotly") is None:
        raise ViewError("a report needs the library plotly: pip install 'flexmb[report]'")


def write_page(title: str, parts: Iterable[Html], data: Mapping[str, Any]) -> str:
    """The text of a page.

    Parameters
    ----------
    title : str
        Of the page.
    parts : iterable of Html
        Its body.
    data : mapping
        ``charts`` and ``motion``, as made by `flexmb.view.html_page` and `flexmb.view.page_motion`;
        each belongs to the element with the id that it names.
    """
    from plotly.offline import get_plotlyjs

    here = Path(__file__).parent
    style, script = ((here / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return "\n".join([
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        tag("title", title),
        f"<style>{style}</style></head><body><main>",
        *parts,
        "</main>",
        f'<script type="application/json" id="data">{text}</script>',
        f"<script>{get_plotlyjs()}</script>",
        f"<script>{script}</script>",
        "</body></html>\n",
    ])  # fmt: skip


class Charts:
    """The charts of a page, in the order in which they are made."""

    def __init__(self) -> None:
        self.data: list[dict[str, Any]] = []

    def histories(self, results: Result | Sequence[Result], names: Sequence[str]) -> list[Html]:
        """Channels over time, one chart per unit.

        Raises
        ------
        FlexmbError
            As of :func:`flexmb.history_figure`.
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
        """Error against processor time, on logarithmic scales."""
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
