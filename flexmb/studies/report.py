"""A finished study: its table as text, Markdown, HTML and CSV, its sentences, its plots."""

from __future__ import annotations

import csv
import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import OutputError, ViewError
from flexmb.folders import whole_file
from flexmb.studies.channel_errors import error_text
from flexmb.studies.rows import Error, Row, StudyRows
from flexmb.studies.study_settings import is_numerical, label, value_text
from flexmb.studies.summary import seconds_text, series, series_knob, summarise
from flexmb.workflow import machine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.view.plot import Curve

_FAILED = "✗"
_COUNTS = ("steps", "rejected_steps", "failed_steps", "newton_iterations", "factorisations")
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
        columns = (*self.knobs.values(), *self.quantities, "time [s]", "per sim. s")
        return columns, [self._cells(row) for row in self.rows]

    def _cells(self, row: Row) -> tuple[str, ...]:
        values = [value_text(value) for value in row.values.values()]
        if row.status != "finished":
            return (*values, *[_FAILED] * (len(self.quantities) + 2))
        errors = [_error_cell(row.errors.get(name)) for name in self.quantities]
        return (*values, *errors, seconds_text(row.time), seconds_text(row.time / row.duration))

    def markdown(self) -> str:
        """Table and sentences in Markdown."""
        columns, rows = self.table()
        n = len(self.knobs)
        lines = [
            f"### {self.title}: what accuracy costs",
            "",
            f"| {' | '.join(columns)} |",
            f"|{'|'.join('---:' if i >= n else '---' for i in range(len(columns)))}|",
            *(f"| {' | '.join(cell.replace('|', ' ') for cell in row)} |" for row in rows),
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
        record: dict[str, Any] = {**row.values, "status": row.status, "reason": row.reason}
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
            "seconds_integrate": row.time,
            "seconds_integrate_least": min(row.seconds),
            "seconds_integrate_greatest": max(row.seconds),
            "seconds_per_simulated_second": row.time / row.duration,
            "repeats": len(row.seconds),
            "workers": self.workers,
            "cpu_seconds_integrate": row.cpu_time,
            "seconds_flexible_bodies": row.reduction,
        }
        record |= {
            name: row.statistics[name] for name in (*_PHASES, *_COUNTS) if name in row.statistics
        }
        return record | {"folder": row.folder}

    def plot(self, output: str | Path | None = None) -> Figure:
        """Error against wall time, one panel per quantity and one line per series of settings.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.view.plot import work_precision_figure

        lines = series(self)
        panels = {name: _curves(lines, name) for name in self.quantities}
        note = self._note(f"along each line: {self.knobs[series_knob(self)]}")
        figure = work_precision_figure(
            panels, self._floors(), target=self.target, title=self.title, note=note
        )
        return _save(figure, output)

    def plot_pareto(self, output: str | Path | None = None) -> Figure:
        """Error against wall time over models (modes, meshes), with the Pareto front.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.view.plot import pareto_figure

        models: dict[str, list[Row]] = {}
        for row in self.rows:
            values = {k: v for k, v in row.values.items() if not is_numerical(k)}
            models.setdefault(label(values), []).append(row)
        panels = {name: _curves(models, name) for name in self.compared}
        note = self._note("the front: no other setting is cheaper and better")
        figure = pareto_figure(
            panels, self._floors(), target=self.target, title=self.title, note=note
        )
        return _save(figure, output)

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
        try:
            text.write_text(self.markdown(), encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{text}: cannot be written ({error.strerror or error})") from None
        files = [self.to_csv(self.folder / "study.csv"), text]
        if any(math.isfinite(row.time) for row in self.rows):
            files.append(self.folder / "work_precision.png")
            self.plot(files[-1])
        if self.compared and any(_has_several_models(rows) for rows in self.groups().values()):
            files.append(self.folder / "pareto.png")
            self.plot_pareto(files[-1])
        return files

    def _floors(self) -> dict[str, float]:
        """Errors below these are not shown, whatever the machine."""
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
        return f"{first}; wall time: {times}{failures}\n{machine()}"


def _error_cell(error: Error | None) -> str:
    if error is None:
        return "-"
    if not error.shown:
        return "?"
    return f"< {error_text(error.floor)}" if error.value < error.floor else error_text(error.value)


def _has_several_models(rows: Sequence[Row]) -> bool:
    return len({row.physics for row in rows if row.physics}) > 1


def _curves(lines: dict[str, list[Row]], quantity: str) -> list[Curve]:
    from flexmb.view.plot import Curve

    curves = []
    for name, rows in lines.items():
        shown = [row for row in rows if quantity in row.errors and row.errors[quantity].shown]
        times = [row.time for row in shown]
        errors = [row.errors[quantity].bound for row in shown]
        texts = [label({k: v for k, v in row.values.items() if is_numerical(k)}) for row in shown]
        curves.append(Curve(name, times, errors, texts))
    return curves


def _save(figure: Figure, output: str | Path | None) -> Figure:
    from flexmb.view import save_figure

    if not figure.axes:
        raise ViewError("no run has an error to draw")
    if output is not None:
        save_figure(figure, output)
    return figure
