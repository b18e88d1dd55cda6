"""A sweep that has run: its tables, sentences, pictures and files.

In: its runs. Out: what a user reads; failed runs are counted, listed with their reasons and drawn
in red.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.folders import write_text_file
from flexmb.studies.design_search import setting_text
from flexmb.studies.study_settings import headings
from flexmb.studies.sweep_rows import SweepRows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUMMARY = "sweep.json"
"""The file of all tables and sentences in the folder of a sweep."""

RUNS = "runs.parquet"
"""The file of all runs."""

_DIGIT = re.compile(r"[\d.]*\d(?:e[+-]?\d+)?")
_LISTED = 20  # failures in a table
_EXACT = ("grid", "derivatives")  # methods without random numbers


class Table(NamedTuple):
    """A table of a sweep: title, columns, rows, and which columns are numbers."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    right: tuple[int, ...] = ()


class Sweep(SweepRows):
    """A finished sweep; see `SweepRows` for its figures."""

    def __repr__(self) -> str:
        return f'<Sweep "{self.title}" {self.design.method}: {len(self)} runs in {self.folder}>'

    def tables(self) -> Iterator[Table]:
        """All tables: statistics, sensitivities, extremes, failures."""
        short = headings(tuple(self.design.knobs))
        if self.answer is None:
            yield self._statistics_table()
        rows: list[tuple[str, ...]]
        columns: tuple[str, ...]
        if self.design.method == "saltelli":
            rows = [
                (name, short[i.knob], _cell(i.first, 3) + _range(i.first_interval, 2),
                 _cell(i.total, 3) + _range(i.total_interval, 2))
                for name in self.scalars for i in self.sobol_indices(name)
            ]  # fmt: skip
            columns = ("of", "knob", "first order", "total")
            title = "Shares of the variance: indices of Sobol [95 % confidence]"
            yield Table(title, columns, rows, (2, 3))
        if self.design.method == "derivatives":
            rows = [
                (name, short[d.knob], _cell(d.value, 6), _cell(d.error, 2), _cell(d.deviation),
                 f"{100 * d.share:.3g} %")
                for name in self.scalars for d in self.derivatives(name)
            ]  # fmt: skip
            columns = ("of", "by", "derivative", "error", "deviation", "share of variance")
            yield Table("Derivatives at the medians", columns, rows, (2, 3, 4, 5))
        elif self.answer is None and len(self) > 2:
            rows = [
                (name, *(_cell(value, 2) for value in self.correlations(name).values()))
                for name in self.scalars
            ]
            columns = ("of", *(short[knob] for knob in self.design.knobs))
            yield Table("Correlations", columns, rows, tuple(range(1, len(columns))))
        yield self._extremes_table(short)
        if self.failures:
            rows = [
                (f"run {i}", setting_text(self.settings[i]), reason.partition("\n")[0])
                for i, reason in self.failures[:_LISTED]
            ]
            more = len(self.failures) - _LISTED
            if more > 0:
                rows.append(("", f"and {more} more in runs.parquet", ""))
            yield Table("Failed runs", ("run", "values", "why"), rows)

    def _statistics_table(self) -> Table:
        shares = [f"{100 * share:g} %" for share in self.shares]
        columns = ("of", "unit", "runs", "mean", "deviation", "least", *shares, "largest")
        rows: list[tuple[str, ...]] = []
        for scalar in self.scalars:
            one = self.statistics(scalar)
            digits = _digits(one.greatest, one.deviation)
            quantiles = (_cell(q.value, digits) + _range(q.interval, digits) for q in one.quantiles)
            rows.append((
                scalar, self.units[scalar], str(one.runs),
                _cell(one.mean, digits) + _range(one.mean_interval, digits),
                _cell(one.deviation, 3) + _range(one.deviation_interval, 3),
                _cell(one.least, digits), *quantiles, _cell(one.greatest, digits),
            ))  # fmt: skip
        return Table("Statistics [95 % confidence]", columns, rows, tuple(range(2, len(columns))))

    def _extremes_table(self, short: Mapping[str, str]) -> Table:
        rows: list[tuple[str, ...]] = []
        for scalar in self.scalars:
            for word, runs in zip(("largest", "least"), self.extremes(scalar, 1), strict=True):
                rows += [
                    (scalar, word, _cell(self[scalar][i], 6), f"run {i}",
                     setting_text(self.settings[i]))
                    for i in runs
                ]  # fmt: skip
        return Table("Extremes", ("of", "", "value", "run", "values"), rows, (2,))

    def summary(self) -> list[str]:
        """Sentences: the answer, how many runs, what failed, what they do not say."""
        lines = list(self.answer.sentences) if self.answer is not None else []
        lines += self.design.notes
        seconds = float(np.nansum(np.asarray(self["seconds"], float)))
        lines.append(
            f"{len(self)} runs ({self.design.method}"
            + (f", seed {self.seed}" if self.design.method not in _EXACT else "")
            + f"), {seconds:.3g} s of computing"
            + (f"; {self.reused} were there already" if self.reused else "")
        )
        if self.failures:
            what = f"{len(self.failures)} of {len(self)} runs failed: all figures are those of the "
            lines.append(f"{what}others, and differ if runs fail for their values")
        lines += self._notes()
        if self.answer is not None:
            settings = enumerate(self.answer.settings, 1)
            return [*lines, *(self.command_of(one, f"answer_{i}") for i, one in settings)]
        for scalar in self.scalars[:1]:
            largest, least = self.extremes(scalar, 1)
            lines += [f"largest {scalar}: {self.command(i)}" for i in largest]
            lines += [f"least {scalar}: {self.command(i)}" for i in least if i not in largest]
        return lines

    def _notes(self) -> Iterator[str]:
        """Notes of runs, each with how many have it; numbers in them differ from run to run."""
        lines: dict[str, list[str]] = {}
        for text in self.columns.get("notes", ()):
            for line in str(text or "").splitlines():
                lines.setdefault(_DIGIT.sub("#", line), []).append(line)
        for members in lines.values():
            yield f"{len(members)} of {len(self)} runs: {members[0]}"

    def markdown(self) -> str:
        """All sentences and tables."""
        parts = [f"# {self.title}: sweep", "", *(f"- {line}" for line in self.summary())]
        for table in self.tables():
            parts += ["", f"## {table.title}", "", _markdown_row(table.columns)]
            marks = ["--:" if i in table.right else "---" for i in range(len(table.columns))]
            parts += [_markdown_row(marks), *map(_markdown_row, table.rows)]
        return "\n".join(parts) + "\n"

    def plot(self, kind: str, output: str | Path | None = None) -> Figure:
        """A picture: ``"histograms"``, ``"scatter"``, ``"surfaces"``, ``"sensitivities"``,
        ``"parallel"``; also written to `output` if given.

        Raises
        ------
        FlexmbError
            The sweep has nothing of that kind.
        """
        from flexmb.studies.sweep_pictures import PICTURES
        from flexmb.view import save_figure

        if kind not in PICTURES:
            raise FlexmbError.unknown_name("picture", kind, PICTURES)
        figure = PICTURES[kind](self)
        if figure is None:
            raise FlexmbError(f"the sweep has nothing for a picture of {kind}")
        if output is not None:
            save_figure(figure, output)
        return figure

    def save(self) -> list[Path]:
        """Write tables, sentences and pictures into the folder of the sweep; their paths.

        Raises
        ------
        OutputError
            A file cannot be written.
        """
        from flexmb.studies.sweep_pictures import PICTURES
        from flexmb.view import save_figure

        tables = [table._asdict() for table in self.tables()]
        pictures: list[str] = []
        data = {"title": self.title, "sentences": self.summary(), "tables": tables}
        files = [self.folder / RUNS, self.folder / "sweep.md"]
        for kind, draw in PICTURES.items():
            figure = draw(self)
            path = self.folder / f"{kind}.png"
            path.unlink(missing_ok=True)  # that of an earlier sweep
            if figure is not None:
                files.append(save_figure(figure, path))
                pictures.append(path.name)
        about = json.dumps({**data, "pictures": pictures}, indent=1)
        texts = {files[1]: self.markdown(), self.folder / SUMMARY: about}
        for path, text in texts.items():
            write_text_file(path, text)
        return files


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _cell(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"


def _range(interval: tuple[float, float], digits: int = 3) -> str:
    """An interval in brackets; nothing where the runs are too few for one."""
    low, high = interval
    shown = bool(np.isfinite([low, high]).all())
    return f" [{low:.{digits}g}, {high:.{digits}g}]" if shown else ""


def _digits(value: float, deviation: float) -> int:
    """Digits of a value that show its deviation to three."""
    if not (np.isfinite(deviation) and deviation > 0.0 and abs(value) > deviation):
        return 4
    return int(np.clip(np.ceil(np.log10(abs(value) / deviation)) + 3, 4, 12))
