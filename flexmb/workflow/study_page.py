"""The page on a study, a sweep or an error budget, from the files that it left in its folder."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from flexmb.errors import ResultFileError
from flexmb.view.html_page import Charts, Html, image, section, table, tag
from flexmb.view.work_precision import ORDINATES, Curve

_TABLE, _TEXT, _BUDGET, _SWEEP = "study.csv", "study.md", "budget.json", "sweep.json"
_TIME = "cpu_seconds_integrate"
_ERROR = "error_"


def is_study(folder: Path) -> bool:
    """Whether a folder is that of a study, a sweep or a budget."""
    return any((folder / name).is_file() for name in (_TABLE, _SWEEP, _BUDGET))


def _budget_parts(folder: Path) -> tuple[str, list[Html]]:
    try:
        data = json.loads((folder / _BUDGET).read_text(encoding="utf-8"))
        columns, rows = data["table"]
        line, *sentences = data["sentences"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(f"{folder}: the budget cannot be read ({error})") from error
    picture, numbers = folder / "budget.png", range(1, len(columns))
    words = tag("ul", *(tag("li", one) for one in [*sentences, *data["notes"]]), class_="notes")
    title = f"{data['title']}: error budget"
    return title, [
        tag("h1", title),
        section("What the error consists of", tag("p", line)),
        section("Shares over the peak-to-peak", table(columns, rows, right=numbers),
                image(picture.read_bytes(), line) if picture.is_file() else ""),
        section("Each share, and the cheapest setting", words),
    ]  # fmt: skip


def study_parts(folder: Path, charts: Charts) -> tuple[str, list[Html]]:
    """Title and body of the page.

    Raises
    ------
    ResultFileError
        The files of the study cannot be read.
    """
    if (folder / _SWEEP).is_file():
        return _sweep_parts(folder)
    if not (folder / _TABLE).is_file():
        return _budget_parts(folder)
    try:
        with (folder / _TABLE).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        text = (folder / _TEXT).read_text(encoding="utf-8") if (folder / _TEXT).is_file() else ""
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ResultFileError(f"{folder}: the study cannot be read ({error})") from error
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
    try:
        data = json.loads((folder / _SWEEP).read_text(encoding="utf-8"))
        title, sentences = str(data["title"]), [tag("li", line) for line in data["sentences"]]
        tables = [(t["title"], table(t["columns"], t["rows"], t["right"])) for t in data["tables"]]
        names = [Path(name).name for name in data["pictures"]]
        pictures = [image((folder / name).read_bytes(), Path(name).stem) for name in names]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(f"{folder}: the sweep cannot be read ({error})") from error
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
