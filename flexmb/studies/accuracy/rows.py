"""The rows of a study: errors and times of all settings, and the choice among them."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.studies.channel_errors import COMPARED
from flexmb.studies.study_settings import headings

ALL = "all"
"""Name for all quantities that are compared with the reference, taken together."""


@dataclass(frozen=True)
class Error:
    """An error over the peak-to-peak; below `floor` it may be the error of the reference itself."""

    value: float
    floor: float
    where: str
    shown: bool

    @property
    def bound(self) -> float:
        """Upper bound of the error; NaN if nothing is known."""
        return max(self.value, self.floor) if self.shown else float("nan")


@dataclass(frozen=True)
class Row:
    """One setting of a study.

    Attributes
    ----------
    values : dict
        Knob to value.
    status, reason : str
        ``"finished"``, ``"failed"`` or ``"refused"`` (by the model), and the reason.
    group, physics : str
        Equal for settings of the same machine, and of the same model.
    finest : bool
        Whether its model is the finest of the group, which is the model of the reference.
    errors : dict of str to Error
        Positions, velocities, reactions, energy (its balance), drift (of the constraints).
    seconds : tuple of float
        Wall times of the integration, one per repeat.
    cpu_seconds : tuple of float
        Processor times of the same: shorter if the run had to wait for a core or for the disk.
    duration : float
        Simulated time [s].
    reduction : float
        One-off wall time of the reduction of the flexible bodies [s].
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
        """Median processor time of the integration [s]; NaN for a run that failed."""
        times = self.cpu_seconds or self.seconds
        return statistics.median(times) if times else float("nan")

    @property
    def wall_time(self) -> float:
        """Median wall time of the integration [s]; NaN for a run that failed."""
        return statistics.median(self.seconds) if self.seconds else float("nan")


@dataclass(frozen=True, repr=False)
class StudyRows:
    """The data of a study.

    Attributes
    ----------
    title, source : str
        Of the scene; the scene file is empty for a model from Python.
    folder : Path
        Folder of all its files.
    rows : list of Row
        All settings, also those that failed.
    target : float
        The error that the cheapest setting must meet.
    repeats, workers, reused : int
        Repeats of each run, runs at the same time, runs that were there already.
    references : dict
        What errors are measured against, one sentence per group of settings.
    reductions : list
        Label and one-off wall time [s] of the reduction of the flexible bodies.
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
        return headings(tuple(dict.fromkeys(knob for row in self.rows for knob in row.values)))

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities whose errors are known."""
        names = {name for row in self.rows for name in row.errors}
        return tuple(name for name in (*COMPARED, "energy", "drift") if name in names)

    @property
    def compared(self) -> tuple[str, ...]:
        """The quantities that are compared with the reference."""
        return tuple(name for name in self.quantities if name in COMPARED)

    @property
    def seconds(self) -> Array:
        """Median processor time of each row (n,) [s]; NaN where a run failed."""
        return np.array([row.time for row in self.rows])

    def errors(self, quantity: str) -> Array:
        """Upper bound of the error of each row (n,) over the peak-to-peak; NaN if nothing is known.

        Parameters
        ----------
        quantity : str
            One of `quantities`, or ``"all"``: the largest of those that are compared.

        Raises
        ------
        FlexmbError
            The study has no such quantity.
        """
        if quantity == ALL:
            worst: Array = np.max([self.errors(name) for name in self.compared], axis=0)
            return worst
        if quantity not in self.quantities:
            raise FlexmbError.unknown_name("quantity", quantity, (*self.quantities, ALL))
        missing = float("nan")
        return np.array(
            [row.errors[quantity].bound if quantity in row.errors else missing for row in self.rows]
        )

    def cheapest(
        self, quantity: str = "positions", target: float | None = None, group: str | None = None
    ) -> Row | None:
        """The setting with the shortest integration whose error meets the target; None if none
        does.

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

    def groups(self) -> Mapping[str, Sequence[Row]]:
        """The settings by machine, without those that the model refused."""
        members: dict[str, list[Row]] = {}
        for row in self.rows:
            if row.group:
                members.setdefault(row.group, []).append(row)
        return members
