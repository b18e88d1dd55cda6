"""Errors by vibrations that the steps of an implicit method damp, from runs that resolve them.

The difference of a run and its scout does not show these errors, since both damp the vibrations.
They are measured by `damped_vibrations` and stored here, in addition to that difference.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexmb.analysis.dynamics.compared_quantities import RowComparison
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.model.sensor import ReactionSensorSpec
from flexmb.results.output_block import OutputBlock

DAMPED_RATIO = 2.6
"""Ratio of errors of two runs if vibrations are damped, at most: the displacement of a sensor by a
vibration of a given load is proportional to the square of its period."""
RATES = "velocities", "reactions"
# A run has lost a vibration if its amplitude should be more than this many times that of the run.
_LOST_RATIO = 3.0
# Ratio of second differences of two halves of rows below which a vibration decays; least time [s].
_MAX_DECAY_RATIO, _LEAST_TIME = 0.98, 1e-300
# Product of successive second differences, over the square of the largest one, below minus which
# the vibration turns between them.
_MIN_TURN = 0.01


class LoadedBody(NamedTuple):
    """A body on which the force of a sensor acts."""

    quantity: int  # number of the sensor among the compared quantities
    first: int  # column of its velocity, or angular velocity
    inertia: float  # kg, or kg m²


def loaded_bodies(
    comparison: RowComparison, compiled: Compiled, model: Model
) -> list[list[LoadedBody]]:
    """The rigid bodies, one or two, on which the force element of each reaction sensor acts."""
    masses, loaded = compiled.system.parts.bodies, []
    bodies = {one.name: k for k, one in enumerate(compiled.layout.bodies) if not one.m}
    for k in comparison.reactions:
        spec = model.sensors.get(comparison.compared[k].name)
        if not isinstance(spec, ReactionSensorSpec) or spec.force is None:
            continue
        force, turns = model.forces[spec.force], spec.quantity == "moment"
        joint = model.joints.get(getattr(force, "joint", None) or "")
        names = getattr(joint or force, "between", None) or (getattr(force, "at", None),)
        own = [bodies[body] for name in names if (body := (name or "").partition(".")[0]) in bodies]
        rows = ((int(masses[n]["iv"]), masses[n]) for n in own)
        loaded.append(
            [
                LoadedBody(
                    int(k), iv + 3 * turns, float(np.trace(row["S0"]) if turns else row["mass"])
                )
                for iv, row in rows
            ]
        )
    return [sides for sides in loaded if sides]


class VibrationError:
    """The largest error of each compared quantity by a vibration that steps damp.

    Parameters
    ----------
    comparison : RowComparison
        The compared quantities.
    loaded : sequence of list of LoadedBody
        The bodies on which forces with sensors act.

    Attributes
    ----------
    table : (3, k) array
        The errors, their times, and the start times of the vibrations [s].
    is_damped : bool
        Whether a vibration is excited that the longest steps of the run damp.
    """

    def __init__(self, comparison: RowComparison, loaded: Sequence[list[LoadedBody]] = ()) -> None:
        self._comparison, self._loaded = comparison, loaded
        self.table = np.zeros((3, len(comparison.compared)))
        self.is_damped = False

    def add(
        self, coarse: OutputBlock, fine: OutputBlock, begin: float,
        quantities: Collection[str] = (), output: float = 0.0,
    ) -> float:  # fmt: skip
        """Add the differences of rows of the run and of one that resolves a vibration.

        The vibration begins at `begin` [s]. `quantities` restricts them; by default all count. If
        the rows end before the first output (`output` [s]), the vibration is extrapolated to it
        with its decay. Returns the largest difference of a reaction, over its scale.
        """
        if not len(fine.t):
            return 0.0
        gaps = self._differences(coarse, fine)
        largest, times = gaps.max(axis=0), fine.t[gaps.argmax(axis=0)]
        if fine.t[-1] < output:
            largest = np.minimum(gaps[len(gaps) // 2 :].max(axis=0), self._swings(fine, output))
            times = np.full(len(largest), output)
        self._raise_errors(largest, times, begin, quantities)
        return self._reaction_share(largest)

    def add_lost(
        self, rows: OutputBlock, fine: OutputBlock, begin: float, quantities: Collection[str],
        longest: float,
    ) -> None:  # fmt: skip
        """Add vibrations that the run has lost by the time of its last rows.

        `rows` are late rows of the run, `fine` earlier rows, at equal intervals, of a run that
        resolves the vibration. Its amplitude there is extrapolated to the late rows with its decay.
        Only vibrations with periods up to `longest` [s] count.
        """
        at = float(rows.t[0])
        left, own = self._swings(fine, at, longest), self._swings(rows)
        lost = np.where(left > _LOST_RATIO * own, left - own, 0.0)
        self._raise_errors(lost, np.full(len(lost), at), begin, quantities)

    def of_reactions(self, joints: Collection[str] | None = None) -> tuple[str, float, float]:
        """The joint with the largest error of reactions, that error over its scale, and the start
        of the vibration [s]; of all joints, or of the given ones."""
        shares = self._comparison.shares(self.table[0])
        names = [one.name for one in self._comparison.compared]
        own = [k for k in self._comparison.reactions if joints is None or names[k] in joints]
        if not own:
            return "", 0.0, 0.0
        k = own[int(shares[own].argmax())]
        return names[k], float(shares[k]), float(self.table[2, k])

    def reaction_share(self, row: OutputBlock) -> float:
        """Largest reaction in a row, over the scale of its joint.

        Of force elements with sensors, which follow positions and so do not show it yet, the
        inertia force of the vibration: of the body on which it is less.
        """
        values, scales = np.zeros(len(self._comparison.compared)), self._comparison.shares
        for sides in self._loaded:
            forces = [np.linalg.norm(row.vd[0, n : n + 3]) * inertia for _, n, inertia in sides]
            values[sides[0].quantity] = min(forces)
        share = float(scales(values).max(initial=0.0))
        return max(self.reaction_difference(without_reactions(row), row), share)

    def reaction_difference(self, coarse: OutputBlock, fine: OutputBlock) -> float:
        """Largest difference of a reaction in two blocks of rows, over the scale of its joint."""
        return self._reaction_share(self._differences(coarse, fine).max(axis=0, initial=0.0))

    def reaction_swing(self, rows: OutputBlock) -> float:
        """Largest amplitude of a reaction in the second half of rows, over its scale."""
        return self._reaction_share(self._swings(rows))

    def _reaction_share(self, values: Array) -> float:
        shares = self._comparison.shares(values)[self._comparison.reactions]
        return float(shares.max(initial=0.0))

    def _differences(self, coarse: OutputBlock, fine: OutputBlock) -> Array:
        values = (self._comparison.values(rows) for rows in (coarse, fine))
        return self._comparison.differences(*values)

    def _raise_errors(
        self, largest: Array, times: Array, begin: float, quantities: Collection[str]
    ) -> None:
        """Raise the errors (k,) to those by a vibration, of these quantities or of all."""
        counts = [not quantities or one.quantity in quantities for one in self._comparison.compared]
        more = (largest > self.table[0]) & counts
        self.table[0, more], self.table[1, more] = largest[more], times[more]
        self.table[2, more] = begin

    def _swings(self, rows: OutputBlock, at: float = -math.inf, longest: float = math.inf) -> Array:
        """Amplitudes (k,) of vibrations in the second half of rows; see `vibration_amplitudes`."""
        values, starts = self._comparison.values(rows), self._comparison.starts
        return vibration_amplitudes(rows.t, values, starts, at, longest)


def without_reactions(rows: OutputBlock) -> OutputBlock:
    """The same rows with zero reactions."""
    return replace(rows, reactions=np.zeros_like(rows.reactions))


def vibration_amplitudes(
    t: Array, values: Array, starts: np.ndarray, at: float = -math.inf, longest: float = math.inf
) -> Array:
    """Amplitudes of vibrations in the second half of rows, or extrapolated to a later time.

    The amplitude is half the range of the deviation from a straight line. The decay is the ratio of
    the largest second differences of rows in both halves.

    Parameters
    ----------
    t : (n,) array
        Times of the rows [s], at equal intervals if they are extrapolated.
    values : (n, components) array
        Values.
    starts : (k,) array
        Columns at which the components of each of k vectors begin.
    at : float
        Time to which they are extrapolated [s].
    longest : float
        Longest period that counts [s], by the number of sign changes of second differences.

    Returns
    -------
    (k,) array
        Amplitude of the component of each vector with the largest one.
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
    turns = bends[n + 1 :] * bends[n:-1] < -_MIN_TURN * np.repeat(late_bend, widths) ** 2
    periods = 2.0 * (t[-1] - t[n]) / np.maximum(turns.sum(axis=0), 1)
    amplitudes[np.minimum.reduceat(periods, starts) > longest] = 0.0
    decays = late_bend < _MAX_DECAY_RATIO * early_bend
    left = np.divide(late_bend, early_bend, out=np.ones(len(starts)), where=decays)
    return np.asarray(amplitudes * left ** max(halves, 0.0))
