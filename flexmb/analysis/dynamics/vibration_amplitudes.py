"""Amplitudes of vibrations in rows of values, and what their damping leaves of them later."""

from __future__ import annotations

import math

import numpy as np

from flexmb.flexbody.arrays import Array

_DECAYS, _LEAST_TIME = 0.98, 1e-300  # of an amplitude, from half to half of what is seen; s
_TURNS = 0.01  # product of two bends that a vibration turns between, over the square of the largest


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
