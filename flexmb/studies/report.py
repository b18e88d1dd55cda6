"""What a study has found: errors and times of all settings, and what to conclude from them.

In: one row per setting. Out: tables, files, plots, and the cheapest setting that is good enough.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.studies.measure import COMPARED
from flexmb.studies.words import headings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ALL", "Error", "Row", "Study"]

Array = NDArray[np.float64]
ALL = "all"
"""All quantities that are compared with the reference, taken together."""


@dataclass(frozen=True)
class Error:
    """An error over the peak-to-peak; one below `floor` cannot be told from the reference's own."""

    value: float
    floor: float
    where: str
    shown: bool

    @property
    def bound(self) -> float:
        """What the error is at most; NaN where nothing is known."""
        return max(self.value, self.floor) if self.shown else float("nan")


@dataclass(frozen=True)
class Row:
    """One setting of a study.

    Attributes
    ----------
    values : dict
        Knob to value.
    status, reason : str
        ``"finished"``, ``"failed"`` or ``"refused"`` (by the model), and why.
    group, physics : str
        Equal for settings of the same machine, and of the same model.
    finest : bool
        Whether its model is the finest of the group, the one that the reference has.
    errors : dict of str to Error
        Positions, velocities, reactions, energy (its balance), drift (of the constraints).
    seconds : tuple of float
        Wall times of the integration, one per repeat.
    cpu_seconds : tuple of float
        Processor times of the same: less where the run had to wait for a core or for the disk.
    duration : float
        Simulated time [s].
    reduction : float
        One-off wall time of making the flexible bodies from their meshes [s].
    statistics : dict
        Steps, iterations and so on.
    folder : str
        Where the run's result is.
    """

    values: dict[str, Any]
    status: str
    reason: str = ""
    group: str = ""
    physics: str = ""
    finest: bool = True
    errors: dict[str, Error] = field(default_factory=dict)
    seconds: tuple[float, ...] = ()
    cpu_seconds: tuple[float, ...] = ()
    duration: float = 0.0
    reduction: float = 0.0
    statistics: dict[str, Any] = field(default_factory=dict)
    folder: str = ""

    @property
    def time(self) -> float:
        """Median wall time of the integration [s]; NaN for a run that failed."""
        return statistics.median(self.seconds) if self.seconds else float("nan")

    @property
    def cpu_time(self) -> float:
        """Median processor time of the integration [s]; NaN for a run that failed."""
        return statistics.median(self.cpu_seconds) if self.cpu_seconds else float("nan")


@dataclass(frozen=True)
class Study:
    """A finished study.

    Attributes
    ----------
    title, source : str
        Of the scene; the scene file is empty for a model from Python.
    folder : Path
        Where everything is kept.
    rows : list of Row
        All settings, also those that failed.
    target : float
        The error that the cheapest setting must meet.
    repeats, workers, reused : int
        Repeats of each run, runs at the same time, runs that were there already.
    references : dict
        What errors are measured against, one sentence per group of settings.
    reductions : list
        Label and wall time [s] of making the flexible bodies, one-off.
    """

    title: str
    source: str
    folder: Path
    rows: list[Row]
    target: float
    repeats: int
    workers: int
    reused: int
    references: dict[str, str]
    reductions: list[tuple[str, float]]

    @property
    def knobs(self) -> dict[str, str]:
        """The knobs that were varied, with the headings of their columns."""
        return headings(tuple(self.rows[0].values))

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities that errors are known of."""
        found = {name for row in self.rows for name in row.errors}
        return tuple(name for name in (*COMPARED, "energy", "drift") if name in found)

    @property
    def compared(self) -> tuple[str, ...]:
        """The quantities that are compared with the reference."""
        return tuple(name for name in self.quantities if name in COMPARED)

    @property
    def seconds(self) -> Array:
        """Median wall time of each row (n,) [s]; NaN where a run failed."""
        return np.array([row.time for row in self.rows])

    def errors(self, quantity: str) -> Array:
        """Error of each row (n,) over the peak-to-peak, at most; NaN where nothing is known.

        Parameters
        ----------
        quantity : str
            One of `quantities`, or ``"all"``: the largest of those that are compared.

        Raises
        ------
        FlexmbError
            The study knows no such quantity.
        """
        if quantity == ALL:
            worst: Array = np.max([self.errors(name) for name in self.compared], axis=0)
            return worst
        if quantity not in self.quantities:
            names = (*self.quantities, ALL)
            what = f'the study has no errors of "{quantity}"'
            raise FlexmbError.from_problems([Problem("", what, names, nearest(quantity, names))])
        missing = float("nan")
        return np.array(
            [row.errors[quantity].bound if quantity in row.errors else missing for row in self.rows]
        )

    def cheapest(
        self, quantity: str = "positions", target: float | None = None, group: str | None = None
    ) -> Row | None:
        """The setting with the shortest integration whose error meets the target, if any does.

        Parameters
        ----------
        quantity : str
            One of `quantities`, or ``"all"``.
        target : float, optional
            Error over the peak-to-peak; the study's own by default.
        group : str, optional
            Only settings of this machine.
        """
        limit = self.target if target is None else target
        errors = self.errors(quantity)
        good = [
            row
            for row, error in zip(self.rows, errors, strict=True)
            if error <= limit and group in (None, row.group)
        ]
        return min(good, key=lambda row: row.time, default=None)

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Headings and rows of the table, as text."""
        from flexmb.studies.tables import table

        return table(self)

    def summary(self) -> list[str]:
        """What the study says in sentences."""
        from flexmb.studies.conclusions import sentences

        return sentences(self)

    def markdown(self) -> str:
        """Table and sentences in Markdown, ready to paste."""
        from flexmb.studies.tables import markdown

        return markdown(self)

    def to_csv(self, path: str | Path) -> Path:
        """Write everything that is known of each setting to a CSV file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        from flexmb.studies.tables import write_csv

        return write_csv(self, Path(path))

    def plot(self, output: str | Path | None = None) -> Figure:
        """Error against wall time, one panel per quantity and one line per series of settings.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.studies.drawing import work_precision

        return work_precision(self, output)

    def plot_pareto(self, output: str | Path | None = None) -> Figure:
        """Error against wall time over models: modes, meshes; the front that no other beats.

        Raises
        ------
        ViewError
            No run has an error to draw, or the file cannot be written.
        """
        from flexmb.studies.drawing import pareto

        return pareto(self, output)

    def save(self) -> list[Path]:
        """Write table (CSV, Markdown) and plots into the folder of the study; their paths."""
        from flexmb.studies.drawing import save_plots
        from flexmb.studies.tables import save_tables

        return [*save_tables(self), *save_plots(self)]

    def __repr__(self) -> str:
        failed = sum(row.status != "finished" for row in self.rows)
        return f'<Study "{self.title}": {len(self.rows)} settings, {failed} failed>'

    def _repr_html_(self) -> str:
        from flexmb.studies.tables import html

        return html(self)

    def groups(self) -> Mapping[str, Sequence[Row]]:
        """The settings by machine, those that the model refuses left out."""
        found: dict[str, list[Row]] = {}
        for row in self.rows:
            if row.group:
                found.setdefault(row.group, []).append(row)
        return found
