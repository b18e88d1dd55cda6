"""The pages on several runs compared and on a study; and functions that all pages share."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import Any

from flexmb.errors import FlexmbError, ResultFileError
from flexmb.folders import read_json, read_regular, scratch_folder
from flexmb.progress import Progress
from flexmb.results import Result
from flexmb.view.history import run_labels
from flexmb.view.html_page import Charts, Html, image, section, table, tag
from flexmb.view.picture import render
from flexmb.view.work_precision import ORDINATES, Curve
from flexmb.workflow.comparison import STILL, compare
from flexmb.workflow.installation import machine

PHASES = ("integrate", "kinematics", "statics", "inverse_dynamics")
"""Phases of a run that are the analysis itself, without reading, compiling and reduction."""
_PICTURE = (1000, 620)


_TABLE, _TEXT, _BUDGET, _SWEEP = "study.csv", "study.md", "budget.json", "sweep.json"
_TIME = "cpu_seconds_integrate"
_ERROR = "error_"


def comparison_parts(
    results: Sequence[Result], charts: Charts, progress: Progress, view: Mapping[str, Any]
) -> tuple[str, list[Html]]:
    """The body of a page that compares several runs."""
    names = run_labels(results)
    titles = list(dict.fromkeys(run.title for run in results if run.title))
    title = titles[0] if len(titles) == 1 else " / ".join(titles) or "Comparison"
    left_out, parts = list[str](), list[Html]()
    head = tag("p", f"{len(results)} runs beside each other: {', '.join(names)}", class_="lead")
    rows: list[Sequence[str]] = []
    for name, run in zip(names, results, strict=True):
        statistics = run.statistics
        keys = ("measured_error_of_positions", "energy_balance_error")
        errors = [f"{statistics[key]:.2g}" if key in statistics else "" for key in keys]
        steps = statistics.get("steps", statistics.get("points", ""))
        seconds = sum(run.seconds.get(phase, 0.0) for phase in PHASES)
        label = f"{name}: {run.title}" if len(titles) > 1 else name
        rows.append((
            label, run.status, str(len(run.layout.bodies)), str(run.layout.nv),
            str(run.layout.nc), str(steps), f"{seconds:.3g}", *errors,
        ))  # fmt: skip
    columns: tuple[str, ...] = (
        "run", "", "bodies", "coordinates", "equations", "steps", "wall time [s]",
        "measured error", "energy balance error",
    )  # fmt: skip
    parts.append(section("The runs", table(columns, rows, right=range(2, 9))))
    try:
        made = compare(*results, progress=progress)
        moving = [d for d in made.differences if d.moves or d.relative > STILL]
        labels = dict(zip((one.name for one in made.models), names, strict=True))
        cells: list[Sequence[str]] = [
            (d.channel, labels.get(d.model, d.model), f"{d.largest:.3g} {d.unit}".rstrip(),
             f"{d.relative:.2g}", f"{d.time:.5g}")
            for d in moving
        ]  # fmt: skip
        second = made.models[0].result.units.label("s")
        columns = ("sensor", "run", f"largest difference from {names[0]}", "over the peak-to-peak",
                   f"at t [{second}]")  # fmt: skip
        notes = [tag("li", note) for note in made.notes]
        listed = tag("ul", *notes, class_="notes") if notes else ""
        parts.append(section("Differences", table(columns, cells, right=(2, 3, 4)), listed))
    except FlexmbError as error:
        left_out.append(str(error))
    try:
        parts.append(section("Plots", *charts.histories(list(results), ())))
    except FlexmbError as error:
        left_out.append(str(error))
    figures = list[Html]()
    for name, run in zip(names, results, strict=True):
        progress("pictures", len(figures) / len(results))
        try:
            figures.append(picture_of(run, "displacement", None, name, view))
        except FlexmbError as error:
            left_out.append(str(error))
    progress("pictures", 1.0)
    parts.append(section("Pictures", tag("div", *figures, class_="pair") if figures else ""))
    return title, [tag("h1", title), head, *parts, foot(left_out)]


def picture_of(
    run: Result,
    color: str | None,
    time: float | None,
    words: str,
    view: Mapping[str, Any] = MappingProxyType({}),
) -> Html:
    """A picture of a run at a time with a caption; `view`: options of ``[view]``."""
    own = {"size": _PICTURE, **({} if color is None else {"color": color}), **view}
    with scratch_folder() as folder:
        path = render(run, time, output=Path(folder) / "picture.png", **own)
        picture = image(path.read_bytes(), words or run.title or "the machine")
    return tag("div", picture, tag("figcaption", words)) if words else picture


def foot(left_out: Sequence[str]) -> Html:
    """The end of a page: what is missing in it, and the version that made it."""

    lines = [tag("p", "Left out of this page: ", text) for text in left_out]
    return tag("footer", *lines, tag("p", f"Written by {machine()}."))


def is_study(folder: Path) -> bool:
    """Whether a folder contains a study, a sweep or a budget."""
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
    """A positive number from a text; else 0."""
    try:
        return max(float(text or 0), 0.0)
    except ValueError:
        return 0.0


def _cell(text: str) -> str:
    try:
        return f"{float(text):.3g}"
    except ValueError:
        return text
