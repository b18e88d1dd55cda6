"""Statistics of a scalar over the runs of a sweep: mean, deviation, quantiles, sensitivities.

In: values of runs (n,), NaN for failed ones, and values of the knobs. Out: records with confidence
intervals, which contain the true value in 95 of 100 sweeps of independent samples. Latin-hypercube
and Sobol samples are more accurate, so that their intervals are wider than necessary.
Sensitivities: Sobol indices by the estimators of Saltelli et al. (2010) for the first order and
Jansen (1999) for the total, with bootstrap over the rows of the scheme; derivatives by central
differences with two steps.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.studies.study_settings import run_command
from flexmb.studies.sweeps.design_search import Answer, in_stated_units, setting_text
from flexmb.studies.sweeps.sampling import Design, deviation_of

Interval = tuple[float, float]

CONFIDENCE = 0.95
_NONE = (float("nan"), float("nan"))
_RESAMPLES = 500
_DECIMALS = 9  # decimals of a share; smaller differences are round-off
_BATCH = 4e6  # weights of the bootstrap per batch
_ROUND_OFF = 1e-12  # relative variation below which a scalar does not vary


class Quantile(NamedTuple):
    """A value below which a share of the runs lies; the interval is NaN if there are too few
    runs."""

    share: float
    value: float
    interval: Interval


class Statistics(NamedTuple):
    """Statistics of a scalar; without intervals for a grid, which is not a sample."""

    runs: int
    least: float
    greatest: float
    mean: float
    mean_interval: Interval
    deviation: float
    deviation_interval: Interval
    quantiles: tuple[Quantile, ...]


def statistics_of(values: Array, shares: Sequence[float], is_sample: bool = True) -> Statistics:
    """Statistics of values (n,); NaN are left out.

    The interval of the mean is Student's; that of the deviation is from its asymptotic variance
    with the kurtosis of the sample; that of a quantile is between two order statistics, which is
    valid for every distribution (David and Nagaraja, Order Statistics, 2003, section 7.1).
    """
    x = np.sort(values[np.isfinite(values)])
    n = len(x)
    if not n:
        nan = float("nan")
        none = tuple(Quantile(share, nan, _NONE) for share in shares)
        return Statistics(0, nan, nan, nan, _NONE, nan, _NONE, none)
    mean = float(x.mean())
    deviation = float(x.std(ddof=1)) if n > 1 else float("nan")
    mean_interval = deviation_interval = _NONE
    if is_sample and n > 2:
        from scipy.special import ndtri, stdtrit

        half = float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * deviation / np.sqrt(n)
        mean_interval = (mean - half, mean + half)
        scale = deviation or 1.0
        kurtosis = float(np.mean(((x - mean) / scale) ** 4))
        spread = np.sqrt(max(kurtosis - 1.0, 0.0) / (4.0 * n)) * ndtri(0.5 + 0.5 * CONFIDENCE)
        deviation_interval = (deviation * float(np.exp(-spread)), deviation * float(np.exp(spread)))
    quantiles = tuple(
        Quantile(share, float(np.quantile(x, share)), _between(x, share) if is_sample else _NONE)
        for share in shares
    )
    return Statistics(
        n, float(x[0]), float(x[-1]), mean, mean_interval, deviation, deviation_interval, quantiles
    )


def _between(x: Array, share: float) -> Interval:
    """The two order statistics that enclose a quantile with the confidence."""
    from scipy.stats import binom

    n, tail = len(x), 0.5 * (1.0 - CONFIDENCE)
    low, high = int(binom.ppf(tail, n, share)), int(binom.ppf(1.0 - tail, n, share)) + 1
    return (float(x[low - 1]), float(x[high - 1])) if low >= 1 and high <= n else _NONE


class Index(NamedTuple):
    """Share of a knob in the variance of a scalar: alone, and with all interactions."""

    knob: str
    first: float
    first_interval: Interval
    total: float
    total_interval: Interval


def sobol_indices(knobs: Sequence[str], values: Array, seed: int = 0) -> list[Index]:
    """Sobol indices from the values (n, k + 2) of a Saltelli scheme: A, B, A with column i of B.

    Rows with NaN are left out. The list is empty for a scalar that does not vary. The variance is
    computed from the differences of A and B, whose errors correlate with those of the numerators.
    """
    values = values[np.isfinite(values).all(axis=1)]
    n, k = len(values), len(knobs)
    if n < 2 or np.ptp(values) <= _ROUND_OFF * np.abs(values).max():
        return []
    centred = values - values[:, :2].mean()
    a, b, mixed = centred[:, :1], centred[:, 1:2], centred[:, 2:]
    terms = np.hstack([b * (mixed - a), 0.5 * (a - mixed) ** 2, 0.5 * (a - b) ** 2])

    def indices(means: Array) -> Array:
        """Indices (..., 2 k) from the means (..., 2 k + 1) of the terms."""
        return np.round(means[..., :-1] / means[..., -1:], _DECIMALS) + 0.0

    best = indices(terms.mean(axis=0))
    generator, batch = np.random.default_rng(seed), max(1, int(_BATCH / n))
    resamples = []
    for start in range(0, _RESAMPLES, batch):
        count = min(batch, _RESAMPLES - start)
        places = generator.integers(0, n, (count, n))
        weights = np.stack([np.bincount(row, minlength=n) for row in places]) / n
        resamples.append(indices(weights @ terms))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(np.vstack(resamples), (tail, 1.0 - tail), axis=0)
    return [
        Index(knob, float(best[i]), (float(low[i]), float(high[i])),
              float(best[k + i]), (float(low[k + i]), float(high[k + i])))
        for i, knob in enumerate(knobs)
    ]  # fmt: skip


class Derivative(NamedTuple):
    """Derivative of a scalar with respect to a knob at the medians of all knobs.

    `error` is its difference from the derivative with the smaller step; `deviation` is the standard
    deviation of the knob, `share` its share of the variance if the scalar were linear.
    """

    knob: str
    value: float
    error: float
    deviation: float
    share: float


def derivatives_of(
    knobs: Sequence[str], steps: Array, deviations: Array, values: Array
) -> list[Derivative]:
    """Derivatives from values (4 k + 1,) at the centre and at -2, -1, 1, 2 steps (k,) of each knob.

    Both steps are extrapolated, so that the error is of fourth order.
    """
    outer = values[1:].reshape(-1, 4)
    near = (outer[:, 2] - outer[:, 1]) / (2.0 * steps)
    far = (outer[:, 3] - outer[:, 0]) / (4.0 * steps)
    best = (4.0 * near - far) / 3.0
    parts = (best * deviations) ** 2
    shares = parts / np.nansum(parts) if np.nansum(parts) > 0.0 else np.zeros(len(parts))
    return [
        Derivative(*row) for row in zip(
            knobs, best.tolist(), np.abs(best - near).tolist(), deviations.tolist(),
            shares.tolist(), strict=True,
        )
    ]  # fmt: skip


def correlation(knob: Sequence[object], values: Array) -> float:
    """Correlation of a scalar (n,) with a knob; for a choice the correlation ratio."""
    finite = np.isfinite(values)
    y = values[finite]
    if len(y) < 3 or np.ptp(y) <= _ROUND_OFF * np.abs(y).max():
        return float("nan")
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in knob):
        x = np.asarray(knob, float)[finite]
        return float(np.corrcoef(x, y)[0, 1]) if np.ptp(x) > 0.0 else float("nan")
    words = np.array([str(value) for value in knob])[finite]
    means = {word: y[words == word].mean() for word in set(words.tolist())}
    between = np.array([means[word] for word in words])
    return float(np.sqrt(between.var() / y.var()))


class ResponseSurface(NamedTuple):
    """A polynomial of second degree fitted to a sample.

    `centre` and `scale` (k,) normalise the knobs; `explained` is the share of the variance that is
    predicted for values not used in the fit (leave-one-out).
    """

    centre: Array
    scale: Array
    coefficients: Array
    explained: float

    def __call__(self, points: Array) -> Array:
        """Values (n,) at points (n, k)."""
        return np.asarray(_terms((points - self.centre) / self.scale) @ self.coefficients)


def _terms(z: Array) -> Array:
    i, j = np.triu_indices(z.shape[1])
    return np.hstack([np.ones((len(z), 1)), z, z[:, i] * z[:, j]])


def response_surface(points: Array, values: Array) -> ResponseSurface | None:
    """The least-squares polynomial of second degree; None for too few runs or knobs that do not
    vary."""
    finite = np.isfinite(values)
    x, y = points[finite], values[finite]
    if len(y) < 4 or np.ptp(y) <= _ROUND_OFF * np.abs(y).max():
        return None
    centre, scale = x.mean(axis=0), x.std(axis=0)
    scale[scale == 0.0] = 1.0
    terms = _terms((x - centre) / scale)
    if len(y) < 1.5 * terms.shape[1]:
        return None
    U, singular, Vt = np.linalg.svd(terms, full_matrices=False)
    full = singular > _ROUND_OFF * singular[0]  # a knob with two values defines no parabola
    U, coefficients = U[:, full], Vt[full].T @ ((U[:, full].T @ y) / singular[full])
    leverage = np.minimum((U**2).sum(axis=1), 1.0 - 1e-9)
    residual = (y - terms @ coefficients) / (1.0 - leverage)
    explained = 1.0 - float((residual**2).sum() / ((y - y.mean()) ** 2).sum())
    return ResponseSurface(centre, scale, np.asarray(coefficients), explained)


@dataclass(frozen=True, repr=False)
class SweepRows:
    """The runs of a sweep, and what is computed from them.

    Attributes
    ----------
    title, source : str
        Of the scene; the scene file is empty for a model from Python.
    folder : Path
        Folder of its files; ``runs.parquet`` has one row per run.
    design : Design
        Knobs, method, notes.
    settings : list of dict
        Value of each knob, run by run.
    units : dict of str to str
        Unit of each scalar.
    columns : dict of str to array
        Status, reason, notes, seconds and the scalars, run by run.
    shares : tuple of float
        Probabilities of the quantiles.
    seed : int
        Seed of the random numbers.
    overrides : dict
        Values changed for all runs.
    answer : Answer or None
        Answer to its questions.
    reused : int
        Number of runs that existed already.
    knob_units : dict of str to (str, float)
        Unit in which the scene states a knob, and its factor from the scene's units.
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
    knob_units: dict[str, tuple[str, float]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.settings)

    @property
    def scalars(self) -> tuple[str, ...]:
        """Names of the scalars."""
        return tuple(self.units)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A scalar, a knob or a column such as ``"status"`` of all runs (n,); NaN for failed ones.

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
        """Mean, deviation and quantiles of a scalar over the successful runs."""
        is_sample = self.design.method in ("random", "latin-hypercube", "sobol", "saltelli")
        return statistics_of(self.sample(scalar), self.shares, is_sample)

    def sample(self, scalar: str) -> Array:
        """Values that are a sample of the distributions: in a Saltelli scheme those of A and B."""
        values = np.asarray(self[scalar], float)
        block = self.design.block
        return values if block == 1 else values.reshape(-1, block)[:, :2].ravel()

    def sobol_indices(self, scalar: str) -> list[Index]:
        """Sobol indices of first order and total.

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
        """Correlation of a scalar with each knob, from -1 to 1; for choices from 0 to 1."""
        values = np.asarray(self[scalar], float)
        return {
            knob: correlation([setting[knob] for setting in self.settings], values)
            for knob in self.design.knobs
        }

    def surface(self, scalar: str) -> tuple[list[str], ResponseSurface | None]:
        """The response surface of a scalar over the numerical knobs, and their names."""
        names = [k for k in self.design.knobs if np.issubdtype(self[k].dtype, np.number)]
        if not names:
            return [], None
        points = np.stack([self[name].astype(float) for name in names], axis=1)
        return names, response_surface(points, np.asarray(self[scalar], float))

    def extremes(self, scalar: str, count: int = 3) -> tuple[list[int], list[int]]:
        """Numbers of the runs with the largest and with the smallest values of a scalar."""
        values = np.asarray(self[scalar], float)
        order = [int(i) for i in np.argsort(values) if np.isfinite(values[i])]
        return order[::-1][:count], order[:count]

    @cached_property
    def failures(self) -> list[tuple[int, str]]:
        """Number and reason of each run that failed."""
        status = self.columns["status"]
        return [(int(i), str(self["reason"][i])) for i in np.flatnonzero(status != "finished")]

    def command(self, run: int) -> str:
        """The command that repeats a run alone and with its history."""
        return self.command_of(self.settings[run], f"run_{run}")

    def command_of(self, setting: Mapping[str, Any], name: str) -> str:
        """The command that runs a setting, into a folder of this name in that of the sweep."""
        if not self.source:
            return setting_text(setting, self.knob_units)
        values = in_stated_units(setting, self.knob_units)
        command = run_command(self.source, {**self.overrides, **values})
        return f"{command} --output {shlex.quote(str(self.folder / name))}"
