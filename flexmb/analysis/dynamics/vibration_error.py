"""Errors of vibrations that the steps of an implicit method damp, by runs that follow them.

What two runs differ by tells nothing of these: both damp them. Here they are taken where they are
measured (`damped_vibrations`), beside that difference.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import RowComparison
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

_FOLLOWED = 3.0  # times what a run has of a vibration, from which on it has lost it
_DECAYS, _LEAST_TIME = 0.98, 1e-300  # of an amplitude, from half to half of what is seen; s
_TURNS = 0.01  # product of two bends that a vibration turns between, over the square of the largest


class VibrationError:
    """The largest error of all that is compared by a vibration that steps damp.

    Parameters
    ----------
    comparison : RowComparison
        What is compared.

    Attributes
    ----------
    table : (3, k) array
        The errors, their times, and when the vibrations begin [s].
    """

    def __init__(self, comparison: RowComparison) -> None:
        self._comparison = comparison
        self.table = np.zeros((3, len(comparison.compared)))

    def add(
        self, coarse: OutputBlock, fine: OutputBlock, begin: float,
        quantities: Collection[str] = (), output: float = 0.0,
    ) -> float:  # fmt: skip
        """Take rows of the run, and of one that follows vibrations which begin at a time [s]; of
        all that is compared, or of these quantities. Returns the largest share of a reaction.

        Where they end before the first output, what vibrates goes on as it decays in them.
        """
        if not len(fine.t):
            return 0.0
        gaps = self._differences(coarse, fine)
        largest, times = gaps.max(axis=0), fine.t[gaps.argmax(axis=0)]
        if fine.t[-1] < output:
            largest = np.minimum(gaps[len(gaps) // 2 :].max(axis=0), self._swings(fine, output))
            times = np.full(len(largest), output)
        self._widen(largest, times, begin, quantities)
        return self._reaction_share(largest)

    def add_lost(
        self, rows: OutputBlock, fine: OutputBlock, begin: float, quantities: Collection[str],
        longest: float,
    ) -> None:  # fmt: skip
        """Take late rows of the run, and earlier, even ones of a run that follows vibrations: of
        those of a period up to `longest` [s] that are left by their own damping, and lost."""
        at = float(rows.t[0])
        left, own = self._swings(fine, at, longest), self._swings(rows)
        lost = np.where(left > _FOLLOWED * own, left - own, 0.0)
        self._widen(lost, np.full(len(lost), at), begin, quantities)

    def of_reactions(self, joints: Collection[str] | None = None) -> tuple[str, float, float]:
        """The joint whose reactions lack most, what they lack over their scale, and when the
        vibration begins [s]; of all joints, or of those given."""
        shares = self._comparison.shares(self.table[0])
        names = [one.name for one in self._comparison.compared]
        own = [k for k in self._comparison.reactions if joints is None or names[k] in joints]
        if not own:
            return "", 0.0, 0.0
        k = own[int(shares[own].argmax())]
        return names[k], float(shares[k]), float(self.table[2, k])

    def reaction_share(self, row: OutputBlock) -> float:
        """The largest reaction of a row, over the scale of its joint."""
        return self.reaction_difference(without_reactions(row), row)

    def reaction_difference(self, coarse: OutputBlock, fine: OutputBlock) -> float:
        """The largest difference of a reaction in rows, over the scale of its joint."""
        return self._reaction_share(self._differences(coarse, fine).max(axis=0, initial=0.0))

    def reaction_swing(self, rows: OutputBlock) -> float:
        """The largest amplitude of a reaction in a second half of rows, over its scale."""
        return self._reaction_share(self._swings(rows))

    def _reaction_share(self, values: Array) -> float:
        shares = self._comparison.shares(values)[self._comparison.reactions]
        return float(shares.max(initial=0.0))

    def _differences(self, coarse: OutputBlock, fine: OutputBlock) -> Array:
        values = (self._comparison.values(rows) for rows in (coarse, fine))
        return self._comparison.differences(*values)

    def _widen(
        self, largest: Array, times: Array, begin: float, quantities: Collection[str]
    ) -> None:
        """Take errors (k,) by a vibration, of these quantities or all, where they are larger."""
        counts = [not quantities or one.quantity in quantities for one in self._comparison.compared]
        more = (largest > self.table[0]) & counts
        self.table[0, more], self.table[1, more] = largest[more], times[more]
        self.table[2, more] = begin

    def _swings(self, rows: OutputBlock, at: float = -math.inf, longest: float = math.inf) -> Array:
        """Amplitudes (k,) of vibrations in the second half of rows; see `vibration_amplitudes`."""
        values, starts = self._comparison.values(rows), self._comparison.starts
        return vibration_amplitudes(rows.t, values, starts, at, longest)


def without_reactions(rows: OutputBlock) -> OutputBlock:
    """The same rows with no reactions."""
    return replace(rows, reactions=np.zeros_like(rows.reactions))


def vibration_amplitudes(
    t: Array, values: Array, starts: np.ndarray, at: float = -math.inf, longest: float = math.inf
) -> Array:
    """Amplitudes of vibrations in the second half of rows, or as they decay until a later time.

    What changes beside a straight line counts; it decays by the bends between rows of both halves.

    Parameters
    ----------
    t : (n,) array
        Times of the rows, even ones if they are to decay [s].
    values : (n, components) array
        Values.
    starts : (k,) array
        Columns at which the components of each of k vectors begin.
    at : float
        Until when they decay [s].
    longest : float
        Longest period that counts [s]: bends of slower ones, or of single pulses, turn less often.

    Returns
    -------
    (k,) array
        Of the component that moves most.
    """
    if len(t) < 2:
        return np.zeros(len(starts))
    n = len(t) // 2
    halves = (at - t[n]) / max(t[-1] - t[n], _LEAST_TIME)
    bends = np.diff(values, 2, axis=0)
    late = values[n:] - values[n]
    late -= np.linspace(0.0, 1.0, len(late))[:, None] * late[-1]
    early_bend, late_bend, high, low = (
        np.maximum.reduceat(part.max(axis=0, initial=0.0), starts)
        for part in (np.abs(bends[:n]), np.abs(bends[n:]), late, -late)
    )
    amplitudes, widths = 0.5 * (high + low), np.diff(starts, append=values.shape[1])
    turns = bends[n + 1 :] * bends[n:-1] < -_TURNS * np.repeat(late_bend, widths) ** 2
    periods = 2.0 * (t[-1] - t[n]) / np.maximum(turns.sum(axis=0), 1)
    amplitudes[np.minimum.reduceat(periods, starts) > longest] = 0.0
    decays = late_bend < _DECAYS * early_bend
    left = np.divide(late_bend, early_bend, out=np.ones(len(starts)), where=decays)
    return np.asarray(amplitudes * left ** max(halves, 0.0))
