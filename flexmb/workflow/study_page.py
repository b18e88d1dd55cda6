"""The page on a study, a sweep or an error budget, from the files that it left in its folder."""

from __future__ import annotations

import csv
from collections.abc import Callable
from functools import partial
from io import StringIO
from pathlib import Path

from flexmb.errors import ResultFileError
from flexmb.folders import read_json, read_regular
from flexmb.view.html_page import Html, image, section, table, tag
from flexmb.view.page_charts import Charts
from flexmb.view.work_precision import ORDINATES, Curve

_TABLE, _TEXT, _BUDGET, _SWEEP = "study.csv", "study.md", "budget.json", "sweep.json"
_TIME = "cpu_seconds_integrate"
_ERROR = "error_"


def is_study(folder: Path) -> bool:
    """Whether a folder is that of a study, a sweep or a budget."""
    return any((folder / name).is_file() for name in (_TABLE, _SWEEP, _BUDGET))


def _budget_parts(folder: Path) -> tuple[str, list[Html]]:
    data = read_json(read_regular(folder / _BUDGET))
    columns, rows = data["table"]
    line, *sentences = data["sentences"]
    picture, numbers = folder / "budget.png", range(1, len(columns))
    words = tag("ul", *(tag("li", one) for one in [*sentences, *data["notes"]]), class_="notes")
    title = f"{data['title']}: error budget"
    return title, [
        tag("h1", title),
        section("What the error consists of", tag("p", line)),
        section("Shares over the peak-to-peak", table(columns, rows, right=numbers),
                image(read_regular(picture), line) if picture.is_file() else ""),
        section("Each share, and the cheapest setting", words),
    ]  # fmt: skip


def study_parts(folder: Path, charts: Charts) -> tuple[str, list[Html]]:
    """Title and body of the page.

    Raises
    ------
    ResultFileError
        The files of the study cannot be read.
    """
    parts: dict[str, Callable[[Path], tuple[str, list[Html]]]] = {
        _SWEEP: _sweep_parts,
        _TABLE: partial(_study_parts, charts=charts),
    }
    name = next((name for name in parts if (folder / name).is_file()), _BUDGET)
    try:
        return parts.get(name, _budget_parts)(folder)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, csv.Error) as error:
        raise ResultFileError(f"{folder / name}: cannot be read ({error})") from error


def _study_parts(folder: Path, charts: Charts) -> tuple[str, list[Html]]:
    rows = list(csv.DictReader(StringIO(read_regular(folder / _TABLE).decode(), "")))
    text = read_regular(folder / _TEXT).decode() if (folder / _TEXT).is_file() else ""
    if not rows or "status" not in rows[0]:
        raise ResultFileError(f"{folder / _TABLE}: is not the table of a study")
    lines = text.splitlines()
    title = next((line.lstrip("# ") for line in lines if line.startswith("#")), folder.name)
    sentences = [line[2:] for line in lines if line.startswith("- ")]
    knobs = list(rows[0])[: list(rows[0]).index("status")]
    errors = [name for name in rows[0] if name.startswith(_ERROR)]
    figures = []
    for name in errors:
        along = max(knobs, key=lambda knob: len({row[knob] for row in rows}))
        series: dict[str, list[dict[str, str]]] = {}
        for row in rows:
            if _number(row.get(name)) and _number(row.get(_TIME)):
                others = ", ".join(f"{k} = {row[k]}" for k in knobs if k != along)
                series.setdefault(others, []).append(row)
        curves = []
        for label, members in series.items():
            seconds, values = ([float(row[key]) for row in members] for key in (_TIME, name))
            words = [f"{along} = {row[along]}" for row in members]
            curves.append(Curve(label, seconds, values, words))
        quantity = name.removeprefix(_ERROR)
        if curves:
            figures += [
                tag("h3", quantity),
                charts.costs(curves, ORDINATES.get(quantity, "error / peak-to-peak")),
            ]
    columns = [*knobs, "status", _TIME, *errors]
    shown = [[_cell(row.get(name) or "") for name in columns] for row in rows]
    names = [name.replace("_", " ") for name in columns]
    numbers = range(len(knobs) + 1, len(columns))
    failures = [tag("li", f"{row['reason']}") for row in rows if row.get("reason")]
    return title, [
        tag("h1", title),
        section("What the study says", tag("ul", *(tag("li", s) for s in sentences), class_="notes")
                if sentences else ""),
        section("Error against time", *figures),
        section("All settings", table(names, shown, right=numbers)),
        section("Why settings failed", tag("ul", *failures, class_="notes") if failures else ""),
    ]  # fmt: skip


def _sweep_parts(folder: Path) -> tuple[str, list[Html]]:
    """Title and body of the page on a sweep."""
    data = read_json(read_regular(folder / _SWEEP))
    title, sentences = str(data["title"]), [tag("li", line) for line in data["sentences"]]
    tables = [(t["title"], table(t["columns"], t["rows"], t["right"])) for t in data["tables"]]
    names = [Path(name).name for name in data["pictures"]]
    pictures = [image(read_regular(folder / name), Path(name).stem) for name in names]
    return title, [
        tag("h1", title),
        section("What the sweep says", tag("ul", *sentences, class_="notes")),
        section("Pictures", *pictures),
        *(section(name, cells) for name, cells in tables),
    ]


def _number(text: str | None) -> float:
    """A positive number, else 0."""
    try:
        return max(float(text or 0), 0.0)
    except ValueError:
        return 0.0


def _cell(text: str) -> str:
    try:
        return f"{float(text):.3g}"
    except ValueError:
        return text
