"""The table of a study as text, Markdown, HTML and CSV."""

from __future__ import annotations

import csv
import html as escaping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexmb.errors import OutputError
from flexmb.studies.machine import machine
from flexmb.studies.words import error_text, seconds_text, value_text

if TYPE_CHECKING:
    from flexmb.studies.report import Error, Row, Study

__all__ = ["html", "markdown", "save_tables", "table", "write_csv"]

_FAILED = "✗"
_COUNTS = ("steps", "rejected_steps", "failed_steps", "newton_iterations", "factorisations")
_PHASES = ("seconds_compile", "seconds_load", "seconds_assemble")


def table(study: Study) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows, failed settings included."""
    columns = (*study.knobs.values(), *study.quantities, "time [s]", "per sim. s")
    return columns, [_cells(study, row) for row in study.rows]


def _cells(study: Study, row: Row) -> tuple[str, ...]:
    values = [value_text(value) for value in row.values.values()]
    if row.status != "finished":
        return (*values, *[_FAILED] * (len(study.quantities) + 2))
    errors = [_error(row.errors.get(name)) for name in study.quantities]
    return (*values, *errors, seconds_text(row.time), seconds_text(row.time / row.duration))


def _error(error: Error | None) -> str:
    if error is None:
        return "-"
    if not error.shown:
        return "?"
    return f"< {error_text(error.floor)}" if error.value < error.floor else error_text(error.value)


def markdown(study: Study) -> str:
    """Title, table and sentences."""
    columns, rows = table(study)
    n = len(study.knobs)
    lines = [
        f"### {study.title}: what accuracy costs",
        "",
        f"| {' | '.join(columns)} |",
        f"|{'|'.join('---:' if i >= n else '---' for i in range(len(columns)))}|",
        *(f"| {' | '.join(cell.replace('|', ' ') for cell in row)} |" for row in rows),
        "",
        "Errors: the largest over the outputs, over the peak-to-peak; drift: of the constraints.",
        "",
        *(f"- {sentence}" for sentence in (*study.summary(), machine())),
    ]
    return "\n".join(lines) + "\n"


def html(study: Study) -> str:
    """The table with its sentences, for notebooks."""
    columns, rows = table(study)
    head = "".join(f"<th>{escaping.escape(name)}</th>" for name in columns)
    body = "".join(
        f"<tr>{''.join(f'<td>{escaping.escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    told = "".join(f"<li>{escaping.escape(sentence)}</li>" for sentence in study.summary())
    title = escaping.escape(study.title)
    return f"<table><caption>{title}</caption><tr>{head}</tr>{body}</table><ul>{told}</ul>"


def save_tables(study: Study) -> list[Path]:
    """Write study.csv and study.md into the folder of the study."""
    text = study.folder / "study.md"
    try:
        text.write_text(markdown(study), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{text}: cannot be written ({error.strerror or error})") from None
    return [write_csv(study, study.folder / "study.csv"), text]


def write_csv(study: Study, path: Path) -> Path:
    """Write all that is known of each setting: errors, times, counts, files."""
    records = [_record(study, row) for row in study.rows]
    columns = list(dict.fromkeys(name for record in records for name in record))
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, columns, restval="")
            writer.writeheader()
            writer.writerows(records)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def _record(study: Study, row: Row) -> dict[str, Any]:
    record: dict[str, Any] = {**row.values, "status": row.status, "reason": row.reason}
    for name in study.quantities:
        error = row.errors.get(name)
        known = error is not None and error.shown
        record[f"error_{name}"] = error.value if error is not None and known else ""
        if name in study.compared:
            record[f"smallest_error_{name}"] = error.floor if error is not None else ""
            record[f"worst_{name}"] = error.where if error is not None and known else ""
    if not row.seconds:
        return record
    record |= {
        "seconds_integrate": row.time,
        "seconds_integrate_least": min(row.seconds),
        "seconds_integrate_greatest": max(row.seconds),
        "seconds_per_simulated_second": row.time / row.duration,
        "repeats": len(row.seconds),
        "workers": study.workers,
        "cpu_seconds_integrate": row.cpu_time,
        "seconds_flexible_bodies": row.reduction,
    }
    record |= {name: row.statistics[name] for name in _PHASES if name in row.statistics}
    record |= {name: row.statistics[name] for name in _COUNTS if name in row.statistics}
    return record | {"folder": row.folder}
