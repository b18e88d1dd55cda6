"""The page on several runs beside each other; and what all pages share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from flexmb.errors import FlexmbError
from flexmb.folders import scratch_folder
from flexmb.progress import Progress
from flexmb.results import Result
from flexmb.view import render
from flexmb.view.history import run_labels
from flexmb.view.html_page import Charts, Html, image, section, table, tag
from flexmb.workflow.comparison import STILL, compare
from flexmb.workflow.installation import machine

PHASES = ("integrate", "kinematics", "statics", "inverse_dynamics")
"""Phases of a run that are the analysis itself, without reading, compiling and meshes."""
_PICTURE = (1000, 620)


def comparison_parts(
    results: Sequence[Result], charts: Charts, progress: Progress, view: Mapping[str, Any]
) -> tuple[str, list[Html]]:
    """The body of a page on several runs."""
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
    """A picture of a run at a time, with a line below; `view`: words of ``[view]``."""
    own = {"size": _PICTURE, **({} if color is None else {"color": color}), **view}
    with scratch_folder() as folder:
        path = render(run, time, output=Path(folder) / "picture.png", **own)
        picture = image(path.read_bytes(), words or run.title or "the machine")
    return tag("div", picture, tag("figcaption", words)) if words else picture


def foot(left_out: Sequence[str]) -> Html:
    """What is missing in a page, and who made it."""

    lines = [tag("p", "Left out of this page: ", text) for text in left_out]
    return tag("footer", *lines, tag("p", f"Written by {machine()}."))
