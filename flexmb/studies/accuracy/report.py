"""A finished study: its table as text, Markdown, HTML and CSV, its sentences, its plots.

The sentences give references, the cheapest settings that meet the target, and costs.
"""

from __future__ import annotations

import csv
import html
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import OutputError, ViewError
from flexmb.folders import whole_file, write_text_file
from flexmb.studies.accuracy.rows import Error, Row, StudyRows
from flexmb.studies.channel_errors import error_text
from flexmb.studies.study_settings import (
    is_numerical,
    label,
    markdown_table,
    run_command,
    value_text,
)
from flexmb.workflow.installation import machine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.view.work_precision import Curve


_MIN_GAIN = 1.5  # factor by which the error of a slower setting must be smaller to count as better
_MIN_SPAN = 10.0  # factor of errors that a series must cover before its trend is reported


def seconds_text(value: float) -> str:
    """Seconds with three digits."""
    return f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def summarise(study: StudyRows) -> list[str]:
    """All sentences below the table of a study."""
    lines = []
    for group, sentence in study.references.items():
        name = _group_label(study, group)
        lines.append(f"{name}: {sentence}" if name else sentence)
    for group in study.groups():
        lines += _cheapest(study, group)
    lines += [
        f"ten times less error in {name} costs {factor:.2g} times the time"
        for name in study.compared
        if (factor := cost_of_a_digit(study, name)) is not None
    ]
    return [*lines, *_costs(study), *_failures(study)]


def _group_label(study: StudyRows, group: str) -> str:
    """The values that distinguish a machine from the others of the study."""
    groups = study.groups()
    values = groups[group][0].values if group in groups else {}
    every = [row.values for rows in groups.values() for row in rows]
    own = [row.values for row in groups.get(group, ())]
    telling = {
        knob: value
        for knob, value in values.items()
        if all(one.get(knob) == value for one in own)
        and any(one.get(knob) != value for one in every)
    }
    return label(telling) if len(groups) > 1 else ""


def _cheapest(study: StudyRows, group: str) -> Iterator[str]:
    """A sentence for each different cheapest setting, over the quantities."""
    target = _percent(study.target)
    name = _group_label(study, group)
    at = f" at {name}" if name else ""
    answers: dict[int, tuple[Row, list[str]]] = {}
    missed = []
    for quantity in study.compared:
        row = study.cheapest(quantity, group=group)
        if row is None:
            missed.append(quantity)
        else:
            answers.setdefault(id(row), (row, []))[1].append(quantity)
    for row, quantities in answers.values():
        command = f": {run_command(study.source, row.values)}" if study.source else ""
        errors = ", ".join(f"{q} to {_percent(row.errors[q].bound)}" for q in quantities)
        yield (
            f"cheapest setting that meets {target}{at} in {_listed(quantities)}: "
            f"{label(row.values)}, {seconds_text(row.time)} s ({errors}){command}"
        )
    if missed:
        yield f"no setting{at} is known to meet {target} in {_listed(missed)}"


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def series_knob(study: StudyRows) -> str:
    """The knob along which lines are drawn: the integration option with the most values."""

    def weight(knob: str) -> tuple[bool, int]:
        own = [row.values[knob] for row in study.rows if knob in row.values]
        values = {str(value) for value in own}
        numbers = all(isinstance(value, int | float) for value in own)
        return is_numerical(knob) and numbers and len(values) > 1, len(values)

    return max(study.knobs, key=weight)


def series(study: StudyRows) -> dict[str, list[Row]]:
    """The settings that differ only in the knob of the series, by label of the other values."""
    along = {series_knob(study)}
    if along <= {"dynamics.step", "dynamics.accuracy"}:  # either is the length of the steps
        along = {"dynamics.step", "dynamics.accuracy"}
    members: dict[str, list[Row]] = {}
    for row in study.rows:
        others = {knob: value for knob, value in row.values.items() if knob not in along}
        others |= {"steps": "fixed"} if "dynamics.step" in row.values and _both(study) else {}
        members.setdefault(label(others), []).append(row)
    return members


def _both(study: StudyRows) -> bool:
    return {"dynamics.step", "dynamics.accuracy"} <= set(study.knobs)


def cost_of_a_digit(study: StudyRows, quantity: str) -> float | None:
    """Factor of time for a tenfold smaller error: the median over the series.

    Only the finest model counts, since a coarser one stops improving at the error of its omissions.
    Of its settings only those count that take longer than another one and are better by at least
    half.
    """
    if quantity not in study.quantities:
        return None
    factors = []
    for rows in series(study).values():
        points = _improving([row for row in rows if row.finest], quantity)
        if len(points) < 3 or points[0][1] < _MIN_SPAN * points[-1][1]:
            continue
        times, errors = np.log10(np.array(points)).T
        factors.append(10.0 ** -float(np.polyfit(errors, times, 1)[0]))
    return float(np.median(factors)) if factors else None


def _improving(rows: Sequence[Row], quantity: str) -> list[tuple[float, float]]:
    """Time and error of the settings that are better than all faster ones."""
    pairs = [
        (row.time, row.errors[quantity].value)
        for row in rows
        if quantity in row.errors and row.errors[quantity].value >= row.errors[quantity].floor
    ]
    points: list[tuple[float, float]] = []
    for time, error in sorted(pairs):
        if error > 0 and (not points or error * _MIN_GAIN <= points[-1][1]):
            points.append((time, error))
    return points


def _costs(study: StudyRows) -> Iterator[str]:
    for name, seconds in study.reductions:
        of = f" of {name}" if name else ""
        yield f"one-off: flexible bodies{of} reduced from their meshes in {seconds_text(seconds)} s"
    compiled = [float(row.statistics.get("seconds_compile", 0.0)) for row in study.rows]
    if max(compiled) >= 1.0:
        yield f"one-off: units compiled in up to {seconds_text(max(compiled))} s"
    times = "" if study.repeats == 1 else f", median of {study.repeats} runs"
    at = "one run at a time" if study.workers == 1 else f"{study.workers} runs at the same time"
    yield f"time: processor time of the integration{times}, {at} (study.csv has wall times too)"


def _failures(study: StudyRows) -> Iterator[str]:
    for row in study.rows:
        if row.status != "finished":
            what = row.reason.replace("\n", "; ")
            yield f"✗ {label(row.values)}: {what}"
    lost = sum(not math.isfinite(time) for time in study.seconds)
    if lost == len(study.rows):
        yield "no run ended: there is nothing to compare"


_FAILED = "✗"
_COUNTS = ("steps", "rejected_steps", "failed_steps", "residual_evaluations", "newton_iterations",
           "factorisations")  # fmt: skip
_PHASES = ("seconds_compile", "seconds_load", "seconds_assemble")


class Study(StudyRows):
    """A finished study.

    Its data are the attributes of `StudyRows`: `rows`, `quantities`, `errors(quantity)`, `seconds`,
    `cheapest(quantity, target)`; the methods here write tables and draw.
    """

    def __repr__(self) -> str:
        failed = sum(row.status != "finished" for row in self.rows)
        return f'<Study "{self.title}": {len(self.rows)} settings, {failed} failed>'

    def summary(self) -> list[str]:
        """References, cheapest settings and costs in sentences."""
        return summarise(self)

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Headings and rows of the table as text, failed settings included."""
        columns = (*self.knobs.values(), *self.quantities, "CPU [s]", "per sim. s")
        return columns, [self._cells(row) for row in self.rows]

    def _cells(self, row: Row) -> tuple[str, ...]:
        values = [value_text(row.values[k]) if k in row.values else "-" for k in self.knobs]
        if row.status != "finished":
            return (*values, *[_FAILED] * (len(self.quantities) + 2))
        errors = [_error_cell(row.errors.get(name)) for name in self.quantities]
        return (*values, *errors, seconds_text(row.time), seconds_text(row.time / row.duration))

    def markdown(self) -> str:
        """Table and sentences in Markdown."""
        columns, rows = self.table()
        lines = [
            f"### {self.title}: what accuracy costs",
            "",
            *markdown_table(columns, rows, range(len(self.knobs), len(columns))),
            "",
            "Errors: the largest over the outputs, over the peak-to-peak; "
            "drift: of the constraints.",
            "",
            *(f"- {sentence}" for sentence in (*self.summary(), machine())),
        ]
        return "\n".join(lines) + "\n"

    def _repr_html_(self) -> str:
        columns, rows = self.table()
        head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
        body = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows
        )
        items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in self.summary())
        title = html.escape(self.title)
        return f"<table><caption>{title}</caption><tr>{head}</tr>{body}</table><ul>{items}</ul>"

    def to_csv(self, path: str | Path) -> Path:
        """Write errors, times, counts and files of each setting to a CSV file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        path = Path(path)
        records = [self._record(row) for row in self.rows]
        columns = list(dict.fromkeys(name for record in records for name in record))
        try:
            with (
                whole_file(path) as partial,
                partial.open("w", encoding="utf-8", newline="") as file,
            ):
                writer = csv.DictWriter(file, columns, restval="")
                writer.writeheader()
                writer.writerows(records)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None
        return path

    def _record(self, row: Row) -> dict[str, Any]:
        record: dict[str, Any] = {knob: row.values.get(knob, "") for knob in self.knobs}
        record |= {"status": row.status, "reason": row.reason}
        for name in self.quantities:
            error = row.errors.get(name)
            shown = error if error is not None and error.shown else None
            record[f"error_{name}"] = shown.value if shown else ""
            if name in self.compared:
                record[f"smallest_error_{name}"] = error.floor if error is not None else ""
                record[f"worst_{name}"] = shown.where if shown else ""
        if not row.seconds:
            return record
        record |= {
            "seconds_integrate": row.wall_time,
            "seconds_integrate_least": min(row.seconds),
            "seconds_integrate_greatest": max(row.seconds),
            "seconds_per_simulated_second": row.time / row.duration,
            "repeats": len(row.seconds),
            "workers": self.workers,
            "cpu_seconds_integrate": row.time,
            "seconds_flexible_bodies": row.reduction,
        }
        record |= {
            name: row.statistics[name] for name in (*_PHASES, *_COUNTS) if name in row.statistics
        }
        return record | {"folder": row.folder}

    def plot(self, output: str | Path | None = None) -> Figure:
        """Error against processor time, one panel per quantity, one line per series of settings.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.view.work_precision import work_precision_figure

        lines = series(self)
        along = series_knob(self)
        panels = {name: _curves(lines, name, along) for name in self.quantities}
        words = "accuracy or step" if _both(self) else self.knobs[along]
        note = self._note(f"along each line: {words}")
        figure = work_precision_figure(
            panels,
            self._floors(),
            self._best_points(),
            target=self.target,
            title=self.title,
            note=note,
        )
        return _save(figure, output)

    def plot_pareto(self, output: str | Path | None = None) -> Figure:
        """Error against processor time over models (modes, meshes), with the Pareto front.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.view.work_precision import pareto_figure

        models: dict[str, list[Row]] = {}
        for row in self.rows:
            values = {k: v for k, v in row.values.items() if not is_numerical(k)}
            models.setdefault(label(values), []).append(row)
        panels = {name: _curves(models, name) for name in self.compared}
        note = self._note("the front: no other setting is cheaper and better")
        figure = pareto_figure(
            panels,
            self._floors(),
            self._best_points(),
            target=self.target,
            title=self.title,
            note=note,
        )
        return _save(figure, output)

    def _best_points(self) -> dict[str, tuple[float, float]]:
        """Time and error of the cheapest setting that meets the target, by quantity."""
        rows = {name: self.cheapest(name) for name in self.compared}
        return {
            name: (row.time, row.errors[name].bound)
            for name, row in rows.items()
            if row is not None
        }

    def save(self) -> list[Path]:
        """Write tables and plots into the folder of the study; their paths.

        study.csv and study.md; work_precision.png if a run has ended; pareto.png where models
        differ.

        Raises
        ------
        OutputError
            A file cannot be written.
        """
        text = self.folder / "study.md"
        write_text_file(text, self.markdown())
        files = [self.to_csv(self.folder / "study.csv"), text]
        if any(math.isfinite(row.time) for row in self.rows):
            files.append(self.folder / "work_precision.png")
            self.plot(files[-1])
        models = [{row.physics for row in rows if row.physics} for rows in self.groups().values()]
        if self.compared and any(len(several) > 1 for several in models):
            files.append(self.folder / "pareto.png")
            self.plot_pareto(files[-1])
        return files

    def _floors(self) -> dict[str, float]:
        """Errors below which nothing is shown, for any machine."""
        floors: dict[str, float] = {}
        for row in self.rows:
            for name in self.compared:
                if name in row.errors and row.errors[name].shown:
                    floors[name] = max(floors.get(name, 0.0), row.errors[name].floor)
        return floors

    def _note(self, first: str) -> str:
        failed = sum(row.status != "finished" for row in self.rows)
        failures = f"; {_FAILED} {failed} of {len(self.rows)} settings failed" if failed else ""
        times = f"median of {self.repeats}, {self.workers} at a time"
        return f"{first}; processor time: {times}{failures}\n{machine()}"


def _error_cell(error: Error | None) -> str:
    if error is None:
        return "-"
    if not error.shown:
        return "?"
    return f"< {error_text(error.floor)}" if error.value < error.floor else error_text(error.value)


def _curves(lines: dict[str, list[Row]], quantity: str, along: str = "") -> list[Curve]:
    from flexmb.view.work_precision import Curve

    curves = []
    for name, rows in lines.items():
        shown = [row for row in rows if quantity in row.errors and row.errors[quantity].shown]
        times = [row.time for row in shown]
        errors = [row.errors[quantity].bound for row in shown]
        texts = [_point_text(row, along) for row in shown]
        curves.append(Curve(name, times, errors, texts))
    return curves


def _point_text(row: Row, along: str) -> str:
    """The value of the series' knob, or of all integration options."""
    for knob in (along, "dynamics.step", "dynamics.accuracy") if along else ():
        if knob in row.values:
            return value_text(row.values[knob])
    return label({k: v for k, v in row.values.items() if is_numerical(k)})


def _save(figure: Figure, output: str | Path | None) -> Figure:
    from flexmb.view.plot import save_figure

    if not figure.axes:
        raise ViewError("no run has an error to draw")
    if output is not None:
        save_figure(figure, output)
    return figure
