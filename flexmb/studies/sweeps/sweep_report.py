"""A sweep that has run: its tables, sentences, pictures and files.

In: the runs. Out: texts and pictures for a user; failed runs are counted, listed with their reasons
and drawn in red.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.folders import write_text_file
from flexmb.studies.study_settings import headings, markdown_table
from flexmb.studies.sweeps.design_search import setting_text
from flexmb.studies.sweeps.sweep_statistics import ResponseSurface, SweepRows
from flexmb.view.sweep_plots import (
    Axis,
    Bar,
    SurfacePicture,
    histogram_figure,
    parallel_figure,
    scatter_figure,
    sensitivity_figure,
    surface_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SUMMARY = "sweep.json"
"""The file of all tables and sentences in the folder of a sweep."""

RUNS = "runs.parquet"
"""The file of all runs."""

_DIGIT = re.compile(r"[\d.]*\d(?:e[+-]?\d+)?")
_LISTED = 20  # failures listed in a table
_EXACT = ("grid", "derivatives")  # methods without random numbers


_PANELS = 9
_GRID = 4  # largest number of knobs, and of scalars, in a scatter picture
_SURFACES = 3
_AXES = 10  # largest number of axes of parallel coordinates
_EXPLAINED = 0.5  # explained share of the variance below which no picture of a surface is drawn


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
                (name, label, _cell(d.value / factor, 6), _cell(d.error / factor, 2),
                 _cell(d.deviation * factor), f"{100 * d.share:.3g} %")
                for name in self.scalars for d in self.derivatives(name)
                for label, factor in [_stated_label(self, d.knob, short[d.knob])]
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
                (
                    f"run {i}",
                    setting_text(self.settings[i], self.knob_units),
                    reason.partition("\n")[0],
                )
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
                     setting_text(self.settings[i], self.knob_units))
                    for i in runs
                ]  # fmt: skip
        return Table("Extremes", ("of", "", "value", "run", "values"), rows, (2,))

    def summary(self) -> list[str]:
        """Sentences: the answer, the number of runs, failures, and limits of the conclusions."""
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
            others = "all figures are those of the others, and differ if runs fail for their values"
            what = others if len(self.failures) < len(self) else "there are no figures"
            lines.append(f"{len(self.failures)} of {len(self)} runs failed: {what}")
        lines += self._notes()
        if self.answer is not None:
            settings = enumerate(self.answer.settings, 1)
            return [*lines, *(self.command_of(one, f"answer_{i}") for i, one in settings)]
        names = varying(self)
        if not names and len(self) - len(self.failures) > 1:
            lines.append("no result differs by more than round-off: the knobs have no effect on it")
        for scalar in names[:1]:
            largest, least = self.extremes(scalar, 1)
            lines += [f"largest {scalar}: {self.command(i)}" for i in largest]
            lines += [f"least {scalar}: {self.command(i)}" for i in least if i not in largest]
        return lines

    def _notes(self) -> Iterator[str]:
        """Notes of runs, each with the number of runs that have it; numbers in them may differ."""
        lines: dict[str, list[str]] = {}
        for text in self.columns.get("notes", ()):
            for line in str(text or "").splitlines():
                lines.setdefault(_DIGIT.sub("#", line), []).append(line)
        for members in lines.values():
            yield f"{len(members)} of {len(self)} runs: {members[0]}"

    def markdown(self) -> str:
        """All sentences and tables in Markdown."""
        parts = [f"# {self.title}: sweep", "", *(f"- {line}" for line in self.summary())]
        for table in self.tables():
            parts += ["", f"## {table.title}", ""]
            parts += markdown_table(table.columns, table.rows, table.right)
        return "\n".join(parts) + "\n"

    def plot(self, kind: str, output: str | Path | None = None) -> Figure:
        """A picture: ``"histograms"``, ``"scatter"``, ``"surfaces"``, ``"sensitivities"``,
        ``"parallel"``; also written to `output` if given.

        Raises
        ------
        FlexmbError
            The sweep has nothing of that kind.
        """
        from flexmb.view.plot import save_figure

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
        from flexmb.view.plot import save_figure

        tables = [table._asdict() for table in self.tables()]
        pictures: list[str] = []
        data = {"title": self.title, "sentences": self.summary(), "tables": tables}
        files = [self.folder / RUNS, self.folder / "sweep.md"]
        for kind, draw in PICTURES.items():
            figure = draw(self)
            path = self.folder / f"{kind}.png"
            path.unlink(missing_ok=True)  # the picture of an earlier sweep
            if figure is not None:
                files.append(save_figure(figure, path))
                pictures.append(path.name)
        about = json.dumps({**data, "pictures": pictures}, indent=1)
        texts = {files[1]: self.markdown(), self.folder / SUMMARY: about}
        for path, text in texts.items():
            write_text_file(path, text)
        return files


def _cell(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"


def _range(interval: tuple[float, float], digits: int = 3) -> str:
    """An interval in brackets; empty if there are too few runs for one."""
    low, high = interval
    shown = bool(np.isfinite([low, high]).all())
    return f" [{low:.{digits}g}, {high:.{digits}g}]" if shown else ""


def _digits(value: float, deviation: float) -> int:
    """Digits with which a value shows its standard deviation to three digits."""
    if not (np.isfinite(deviation) and deviation > 0.0 and abs(value) > deviation):
        return 4
    return int(np.clip(np.ceil(np.log10(abs(value) / deviation)) + 3, 4, 12))


def _knobs(sweep: SweepRows) -> list[Axis]:
    """All knobs as axes; choices as numbers with labels."""
    axes = []
    for knob, label in headings(tuple(sweep.design.knobs)).items():
        values = sweep[knob]
        if np.issubdtype(values.dtype, np.number):
            axes.append(_number_axis(sweep, knob, label))
            continue
        words = tuple(map(str, sweep.design.knobs[knob].choices))
        places = np.array([float(words.index(str(value))) for value in values])
        axes.append(Axis(label, places, words))
    return axes


def _number_axis(sweep: SweepRows, knob: str, label: str) -> Axis:
    """The axis of a numerical knob, in the unit in which the scene states it."""
    label, factor = _stated_label(sweep, knob, label)
    return Axis(label, sweep[knob].astype(float) * factor)


def _stated_label(sweep: SweepRows, knob: str, label: str) -> tuple[str, float]:
    """The label of a knob with the unit in which the scene states it, and the factor to that
    unit."""
    unit, factor = _stated_unit(sweep, knob)
    return f"{label} [{unit}]" if unit else label, factor


def _stated_unit(sweep: SweepRows, knob: str) -> tuple[str, float]:
    return sweep.knob_units.get(knob, ("", 1.0))


def _scalars(sweep: SweepRows, count: int) -> list[Axis]:
    """Axes of the first scalars that vary."""
    return [
        Axis(f"{name} [{unit}]" if (unit := sweep.units[name]) else name, sweep[name].astype(float))
        for name in varying(sweep)[:count]
    ]


def varying(sweep: SweepRows) -> list[str]:
    """The scalars that differ between runs by more than round-off."""
    names = []
    for name in sweep.scalars:
        values = np.asarray(sweep[name], float)
        finite = values[np.isfinite(values)]
        if len(finite) > 1 and np.ptp(finite) > 1e-12 * np.abs(finite).max():
            names.append(name)
    return names


def _histograms(sweep: SweepRows) -> Figure | None:
    names = varying(sweep)[:_PANELS]
    if sweep.answer is not None or not names or sweep.design.method in ("grid", "derivatives"):
        return None
    axes = [
        Axis(f"{n} [{sweep.units[n]}]" if sweep.units[n] else n, sweep.sample(n)) for n in names
    ]
    marks = [[q.value for q in sweep.statistics(n).quantiles] for n in names]
    note = "dashed: " + ", ".join(f"{100 * share:g} %" for share in sweep.shares)
    return histogram_figure(axes, marks, f"{sweep.title}: histograms", note)


def _scatter(sweep: SweepRows) -> Figure | None:
    knobs, scalars = _knobs(sweep)[:_GRID], _scalars(sweep, _GRID)
    if not scalars or sweep.design.method == "derivatives":
        return None
    joined = len(sweep.design.knobs) == 1 and not knobs[0].words and len(sweep) < 200
    return scatter_figure(knobs, scalars, f"{sweep.title}: runs", joined)


def _fit_of_two(
    u: Array, v: Array, *, surface: ResponseSurface, at: tuple[int, int],
    by: tuple[float, ...], base: Array,
) -> Array:  # fmt: skip
    """A response surface over two knobs in their stated units, with the other knobs at `base`."""
    points = np.tile(base, (len(u), 1))
    points[:, at[0]], points[:, at[1]] = u / by[0], v / by[1]
    return np.asarray(surface(points))


def _surfaces(sweep: SweepRows) -> Figure | None:
    pictures = []
    for axis in _scalars(sweep, _SURFACES):
        scalar = axis.label.partition(" [")[0]
        names, surface = sweep.surface(scalar)
        if surface is None or len(names) < 2 or surface.explained < _EXPLAINED:
            continue
        influence = sweep.correlations(scalar)
        i, j = sorted(range(len(names)), key=lambda k: -abs(influence[names[k]]))[:2]
        labels = headings(tuple(sweep.design.knobs))
        x, y = (_number_axis(sweep, names[k], labels[names[k]]) for k in (i, j))
        factors = tuple(_stated_unit(sweep, names[k])[1] for k in (i, j))
        fixed = np.array([np.median(sweep[name].astype(float)) for name in names])

        others = ", others at their medians" if len(names) > 2 else ""
        note = f"fit of degree 2 explains {100 * surface.explained:.3g} % of the variance{others}"
        fit = partial(_fit_of_two, surface=surface, at=(i, j), by=factors, base=fixed)
        pictures.append(SurfacePicture(x, y, axis, fit, note))
    return surface_figure(pictures, f"{sweep.title}: response surfaces") if pictures else None


def _sensitivities(sweep: SweepRows) -> Figure | None:
    short = headings(tuple(sweep.design.knobs))
    panels = []
    if sweep.design.method == "saltelli":
        for name in sweep.scalars:
            indices = sweep.sobol_indices(name)
            if indices:
                first = [Bar(short[i.knob], i.first, *i.first_interval) for i in indices]
                total = [Bar(short[i.knob], i.total, *i.total_interval) for i in indices]
                panels.append((name, [("first order", first), ("total", total)]))
        ordinate = "share of the variance"
    elif sweep.design.method == "derivatives":
        for name in sweep.scalars:
            bars = []
            for one in sweep.derivatives(name):
                effect, off = one.value * one.deviation, one.error * one.deviation
                bars.append(Bar(short[one.knob], effect, effect - off, effect + off))
            if any(np.isfinite(bar.value) and bar.value for bar in bars):
                panels.append((name, [("", bars)]))
        ordinate = "derivative times deviation of the knob"
    if not panels:
        return None
    return sensitivity_figure(panels[:_PANELS], f"{sweep.title}: sensitivities", ordinate)


def _parallel(sweep: SweepRows) -> Figure | None:
    scalars = _scalars(sweep, _AXES)
    if len(sweep.design.knobs) + len(scalars) < 3 or not scalars:
        return None
    axes = [*_knobs(sweep), *scalars[: max(1, _AXES - len(sweep.design.knobs))]]
    return parallel_figure(axes, scalars[0], f"{sweep.title}: parallel coordinates")


PICTURES: dict[str, Callable[[SweepRows], Figure | None]] = {
    "histograms": _histograms,
    "scatter": _scatter,
    "surfaces": _surfaces,
    "sensitivities": _sensitivities,
    "parallel": _parallel,
}
"""The pictures by kind; None if a sweep has no data for one."""
