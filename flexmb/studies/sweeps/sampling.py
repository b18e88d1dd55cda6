"""The settings of a sweep: points of the unit cube by a method, mapped to values of the knobs.

In: distributions of knobs, a method, a number of samples, a seed. Out: a :class:`Design`: points
(n, k) and values. The methods: all combinations of given values; independent samples; Latin
hypercubes (McKay, Beckman, Conover 1979); scrambled Sobol sequences (Sobol 1967, Owen 1998); the
radial scheme of Saltelli et al. (2010) for sensitivities; central differences with two steps.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import Problem, SceneError
from flexmb.flexbody.arrays import Array
from flexmb.model.scenes.sweep import Distribution
from flexmb.results.crash_safe_file import uninterrupted

MAX_RUNS = 1_000_000
DIFFERENCES = (-2.0, -1.0, 1.0, 2.0)
"""Steps at which derivatives by each knob are sampled, in multiples of the step."""

_STEP = 0.05  # step of derivatives: probability on each side of the median
_SHARES = 20_000  # quantiles of a distribution from which its standard deviation is computed
_DIGITS = 12  # significant digits of values, so that a command repeats a run to the last bit
_TAIL = 1e-12  # probability kept away from the ends of a normal distribution, which are infinite
_MAX_SOBOL = 21201  # number of dimensions in SciPy's table of direction numbers


@dataclass(frozen=True)
class Design:
    """The settings of a sweep.

    Attributes
    ----------
    knobs : dict of str to Distribution
        Distributions by the full names of the knobs.
    method : str
        How the settings are selected.
    points : (n, k) array
        Points in the unit cube. Saltelli scheme: row by row A, B, then A with one column replaced
        by that of B, for each knob. Derivatives: steps from the medians, first none, then
        `DIFFERENCES` of each knob.
    notes : tuple of str
        Differences from the request.
    """

    knobs: dict[str, Distribution]
    method: str
    points: Array
    notes: tuple[str, ...] = ()

    @property
    def block(self) -> int:
        """Number of runs that belong together: k + 2 in a Saltelli scheme."""
        return len(self.knobs) + 2 if self.method == "saltelli" else 1

    def values(self) -> list[dict[str, Any]]:
        """Value of each knob, run by run."""
        at = _stepped if self.method == "derivatives" else values_at
        columns = [at(one, self.points[:, i]) for i, one in enumerate(self.knobs.values())]
        return [dict(zip(self.knobs, row, strict=True)) for row in zip(*columns, strict=True)]


def values_at(distribution: Distribution, u: Array) -> list[Any]:
    """Values of a knob at probabilities u (n,): the inverse distribution function."""
    if distribution.kind == "choice":
        choices = distribution.choices
        places = np.minimum((u * len(choices)).astype(int), len(choices) - 1)
        return [choices[place] for place in places]
    return _rounded(_quantiles(distribution, u))


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def deviation_of(distribution: Distribution) -> float:
    """Standard deviation of a numerical distribution."""
    shares = (np.arange(_SHARES) + 0.5) / _SHARES
    return float(_quantiles(distribution, shares).std())


def _stepped(distribution: Distribution, steps: Array) -> list[float]:
    """Values of a knob at steps from the median."""
    low, median, high = _quantiles(distribution, np.array([0.5 - _STEP, 0.5, 0.5 + _STEP]))
    return _rounded(median + 0.5 * (high - low) * steps)


def _quantiles(distribution: Distribution, u: Array) -> Array:
    from scipy.special import ndtr, ndtri

    numbers = distribution.numbers
    if distribution.kind == "uniform":
        low, high = numbers
        return np.asarray(low + (high - low) * u)
    if distribution.kind == "log-uniform":
        low, high = numbers
        return np.asarray(low * (high / low) ** u)
    if distribution.kind == "triangular":
        low, mode, high = numbers
        rise, fall = (high - low) * (mode - low), (high - low) * (high - mode)
        turn = (mode - low) / (high - low)
        left, right = low + np.sqrt(u * rise), high - np.sqrt((1.0 - u) * fall)
        return np.where(u < turn, left, right)
    mean, deviation, *limits = numbers
    shares = ndtr((np.array(limits) - mean) / deviation) if limits else (0.0, 1.0)
    u = shares[0] + (shares[1] - shares[0]) * u
    return np.asarray(mean + deviation * ndtri(np.clip(u, _TAIL, 1.0 - _TAIL)))


def make_design(knobs: Mapping[str, Distribution], method: str, samples: int, seed: int) -> Design:
    """The settings of a sweep.

    Parameters
    ----------
    knobs : mapping of str to Distribution
        By full name.
    method : str
        One of those of `SweepSpec`; ``"auto"``: a grid where all knobs have values, else Sobol
        samples.
    samples : int
        Number of settings (Saltelli scheme: of base samples); not used for a grid.
    seed : int
        Seed of the random numbers.

    Raises
    ------
    SceneError
        Knobs that the method does not allow; too many runs.
    """
    knobs = dict(knobs)
    if method == "auto":
        valued = all(one.kind == "choice" or one.levels for one in knobs.values())
        method = "grid" if valued else "sobol"
    problems = [p for name, one in knobs.items() for p in _problems(name, one, method)]
    if problems:
        raise SceneError.from_problems(problems)
    notes: tuple[str, ...] = ()
    if method in ("sobol", "saltelli"):
        power = 1 << (samples - 1).bit_length()
        if power != samples:
            notes = (f"samples: {samples} is no power of two, {power} are taken",)
        samples = power
    count = _count(knobs, method, samples)
    if count > MAX_RUNS:
        raise SceneError(f"the sweep has {count} runs; {MAX_RUNS} are the most")
    return Design(knobs, method, _points(knobs, method, samples, seed), notes)


def _problems(name: str, one: Distribution, method: str) -> list[Problem]:
    where = f"vary {name}"
    if method == "grid" and one.kind != "choice" and not one.levels:
        return [Problem(where, f'a grid needs a number of values: "{one.text}:5"')]
    if method != "grid" and one.levels:
        text = one.text.rpartition(":")[0]
        return [Problem(where, f':{one.levels} is for a grid; {method} samples take "{text}"')]
    if method == "derivatives" and one.kind == "choice":
        return [Problem(where, "has no derivative: it is a choice; give a range of numbers")]
    return []


def _count(knobs: Mapping[str, Distribution], method: str, samples: int) -> int:
    k = len(knobs)
    if method == "grid":
        return int(np.prod([one.levels or len(one.choices) for one in knobs.values()], dtype=float))
    return {"saltelli": samples * (k + 2), "derivatives": 4 * k + 1}.get(method, samples)


def _points(knobs: Mapping[str, Distribution], method: str, n: int, seed: int) -> Array:
    from scipy.stats import qmc

    k = len(knobs)
    if method == "grid":
        return np.array(list(itertools.product(*map(_levels, knobs.values()))))
    if method == "derivatives":
        return _differences(k)
    if method == "random":
        return np.random.default_rng(seed).random((n, k))
    generator = np.random.default_rng(seed)
    if method == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(k, seed=generator).random(n))
    dimensions = 2 * k if method == "saltelli" else k
    if dimensions > _MAX_SOBOL:
        raise SceneError(f"{k} knobs are more than a Sobol sequence has dimensions for")
    # SciPy ignores exceptions while it reads its direction numbers: samples would differ
    with uninterrupted():
        sample = np.asarray(qmc.Sobol(dimensions, seed=generator).random(n))
    if method == "sobol":
        return sample
    A, B = sample[:, :k], sample[:, k:]
    blocks = np.stack([A, B, *(_exchanged(A, B, i) for i in range(k))], axis=1)
    return blocks.reshape(-1, k)


def _exchanged(A: Array, B: Array, i: int) -> Array:
    mixed = A.copy()
    mixed[:, i] = B[:, i]
    return mixed


def _levels(one: Distribution) -> Array:
    n = one.levels or len(one.choices)
    if one.kind in ("choice", "normal"):
        return (np.arange(n) + 0.5) / n
    return np.linspace(0.0, 1.0, n)


def _differences(k: int) -> Array:
    """Steps of central differences (4 k + 1, k), in multiples of the step."""
    steps = (step * row for row in np.eye(k) for step in DIFFERENCES)
    return np.array([np.zeros(k), *steps])
