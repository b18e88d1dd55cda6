"""The runs of a sweep and what is computed from them: statistics, sensitivities, extremes.

In: the settings and the records of their runs. Out: figures of a scalar or of a run. A failed run
has NaN for its scalars.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError
from flexmb.studies.design_search import Answer, setting_text
from flexmb.studies.sampling import Design, deviation_of
from flexmb.studies.study_settings import toml_text
from flexmb.studies.sweep_statistics import (
    Derivative,
    Index,
    ResponseSurface,
    Statistics,
    correlation,
    derivatives_of,
    response_surface,
    sobol_indices,
    statistics_of,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class SweepRows:
    """The runs of a sweep, and what is computed from them.

    Attributes
    ----------
    title, source : str
        Of the scene; the scene file is empty for a model from Python.
    folder : Path
        Folder of its files; ``runs.parquet`` holds one row a run.
    design : Design
        Knobs, method, notes.
    settings : list of dict
        Value of each knob, run by run.
    units : dict of str to str
        Unit of each scalar.
    columns : dict of str to array
        Status, reason, notes, seconds and the scalars, run by run.
    shares : tuple of float
        Of the quantiles.
    seed : int
        Of the random numbers.
    overrides : dict
        Values changed for all runs.
    answer : Answer or None
        To its questions.
    reused : int
        Runs that were there already.
    """

    title: str
    source: str
    folder: Path
    design: Design
    settings: list[dict[str, Any]]
    units: dict[str, str]
    columns: dict[str, NDArray[Any]]
    shares: tuple[float, ...]
    seed: int = 0
    overrides: dict[str, Any] = field(default_factory=dict)
    answer: Answer | None = None
    reused: int = 0

    def __len__(self) -> int:
        return len(self.settings)

    @property
    def scalars(self) -> tuple[str, ...]:
        """Names of the scalars."""
        return tuple(self.units)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A scalar, a knob or a column such as ``"status"`` of all runs (n,); NaN where one failed.

        Raises
        ------
        FlexmbError
            There is no such column.
        """
        if name in self.design.knobs:
            return np.array([setting[name] for setting in self.settings])
        if name not in self.columns:
            raise FlexmbError.unknown_name("column", name, (*self.design.knobs, *self.columns))
        return self.columns[name]

    def statistics(self, scalar: str) -> Statistics:
        """Mean, deviation and quantiles of a scalar over the runs that ended well."""
        is_sample = self.design.method in ("random", "latin-hypercube", "sobol", "saltelli")
        return statistics_of(self.sample(scalar), self.shares, is_sample)

    def sample(self, scalar: str) -> Array:
        """Values that are a sample of the distributions: of a Saltelli scheme those of A and B."""
        values = np.asarray(self[scalar], float)
        block = self.design.block
        return values if block == 1 else values.reshape(-1, block)[:, :2].ravel()

    def sobol_indices(self, scalar: str) -> list[Index]:
        """Sensitivities of first order and total.

        Raises
        ------
        FlexmbError
            The sweep has no Saltelli scheme.
        """
        if self.design.method != "saltelli":
            raise FlexmbError('indices of Sobol need a sweep with method = "saltelli"')
        values = np.asarray(self[scalar], float).reshape(-1, self.design.block)
        return sobol_indices(tuple(self.design.knobs), values, self.seed)

    def derivatives(self, scalar: str) -> list[Derivative]:
        """Local derivatives at the medians of the knobs.

        Raises
        ------
        FlexmbError
            The sweep has no steps for them.
        """
        if self.design.method != "derivatives":
            raise FlexmbError('derivatives need a sweep with method = "derivatives"')
        knobs = tuple(self.design.knobs)
        steps = [self[k][4 * i + 3] - self[k][0] for i, k in enumerate(knobs)]
        deviations = [deviation_of(one) for one in self.design.knobs.values()]
        values = np.asarray(self[scalar], float)
        return derivatives_of(knobs, np.array(steps), np.array(deviations), values)

    def correlations(self, scalar: str) -> dict[str, float]:
        """How much of a scalar follows each knob, from -1 to 1; of choices from 0."""
        values = np.asarray(self[scalar], float)
        return {
            knob: correlation([setting[knob] for setting in self.settings], values)
            for knob in self.design.knobs
        }

    def surface(self, scalar: str) -> tuple[list[str], ResponseSurface | None]:
        """Polynomial of second degree of a scalar over the knobs that are numbers."""
        names = [k for k in self.design.knobs if np.issubdtype(self[k].dtype, np.number)]
        if not names:
            return [], None
        points = np.stack([self[name].astype(float) for name in names], axis=1)
        return names, response_surface(points, np.asarray(self[scalar], float))

    def extremes(self, scalar: str, count: int = 3) -> tuple[list[int], list[int]]:
        """Numbers of the runs with the largest and with the least values of a scalar."""
        values = np.asarray(self[scalar], float)
        order = [int(i) for i in np.argsort(values) if np.isfinite(values[i])]
        return order[::-1][:count], order[:count]

    @cached_property
    def failures(self) -> list[tuple[int, str]]:
        """Number and reason of each run that failed."""
        status = self.columns["status"]
        return [(int(i), str(self["reason"][i])) for i in np.flatnonzero(status != "finished")]

    def command(self, run: int) -> str:
        """The command that does a run again, by itself and with its history."""
        return self.command_of(self.settings[run], f"run_{run}")

    def command_of(self, setting: Mapping[str, Any], name: str) -> str:
        """The command that runs a setting, into a folder of this name in that of the sweep."""
        changes = {**self.overrides, **setting}
        words = [f"--set {shlex.quote(f'{k}={toml_text(v)}')}" for k, v in changes.items()]
        if not self.source:
            return setting_text(setting)
        output = shlex.quote(str(self.folder / name))
        return f"flexmb run {shlex.quote(self.source)} {' '.join(words)} --output {output}"
