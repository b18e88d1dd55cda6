"""Modes over a parameter: which mode of one value is which of the next.

In: linearisations for a series of values. Out: eigenvalues by value and mode. Modes are matched by
shape (modal assurance criterion, Allemang, Sound and Vibration 37 (2003) no. 8) and by how near
their eigenvalues are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from flexmb.analysis.linear.eigenmodes import Complex
from flexmb.analysis.linear.linearization import Linearization
from flexmb.analysis.linear.state_equations import Array

Numbers = NDArray[np.int64]
_MATCHED = 40  # modes that are followed


@dataclass(frozen=True)
class ModeSweep:
    """Modes for a series of values of a parameter.

    Attributes
    ----------
    parameter : str
        Its name.
    values : (n,) array
        Its values, in the scene's units.
    eigenvalues : (n, k) array
        λ [1/s] of the modes, each in its own column; NaN where a value has fewer modes.
    speeds : (n,) array
        Fastest rotation of a body [rad/s], for the lines of its multiples in a Campbell diagram.
    linearizations : tuple of Linearization
        One for each value.
    """

    parameter: str
    values: Array
    eigenvalues: Complex
    speeds: Array
    linearizations: tuple[Linearization, ...]

    @classmethod
    def of(
        cls, parameter: str, values: Sequence[float], made: Sequence[Linearization]
    ) -> ModeSweep:
        """Match the modes from value to value."""
        k = min(_MATCHED, max(len(one.eigenvalues) for one in made))
        eigenvalues = np.full((len(made), k), complex(np.nan, np.nan))
        order: Numbers = np.arange(min(k, len(made[0].eigenvalues)))
        eigenvalues[0, : len(order)] = made[0].eigenvalues[order]
        columns = order.copy()
        for i, (before, one) in enumerate(zip(made, made[1:], strict=False), start=1):
            found = _match(before, order, one, k)
            eigenvalues[i, columns[: len(found)]] = one.eigenvalues[found]
            order, columns = found, columns[: len(found)]
        speeds = np.array([_fastest_turn(one) for one in made])
        return cls(parameter, np.array(values, float), eigenvalues, speeds, tuple(made))

    @property
    def frequencies(self) -> Array:
        """(n, k) damped frequencies [Hz]."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """(n, k) −Re λ/|λ|."""
        size = np.abs(self.eigenvalues)
        return np.where(size > 0.0, -self.eigenvalues.real / np.where(size > 0.0, size, 1.0), 0.0)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know, each sentence once, with the value it is first said of."""
        seen: dict[str, str] = {}
        for value, one in zip(self.values, self.linearizations, strict=True):
            for note in one.notes:
                seen.setdefault(note.partition(":")[0], f"{self.parameter} = {value:g}: {note}")
        return tuple(seen.values())


def _match(before: Linearization, order: Numbers, after: Linearization, most: int) -> Numbers:
    """Which modes of `after` continue those numbered `order` of `before`."""
    n = min(most, len(after.eigenvalues))
    old, new = before.eigenvalues[order], after.eigenvalues[:n]
    gap = np.abs(old[:, None] - new[None, :])
    gap /= (
        np.maximum(np.abs(old)[:, None], np.abs(new)[None, :]) + 1e-12 * np.abs(new).max() + 1e-300
    )
    if before.shapes.shape[0] == after.shapes.shape[0]:
        weights = np.sqrt(np.abs(np.diag(after.M)))[:, None]
        a, b = weights * before.shapes[:, order], weights * after.shapes[:, :n]
        norms = np.outer((np.abs(a) ** 2).sum(axis=0), (np.abs(b) ** 2).sum(axis=0))
        gap = gap + 1.0 - np.abs(a.conj().T @ b) ** 2 / np.where(norms > 0.0, norms, 1.0)
    rows, columns = scipy.optimize.linear_sum_assignment(gap)
    found: Numbers = np.zeros(len(rows), np.int64)
    found[np.argsort(rows)] = columns
    return found


def _fastest_turn(of: Linearization) -> float:
    v = of.state.v
    turns = [np.linalg.norm(v[b.iv + 3 : b.iv + 6]) for b in of.compiled.layout.bodies]
    return float(max(turns))
