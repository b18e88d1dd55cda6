"""How many modes: by number, by frequency, or by what they tell the interfaces.

In: what the user says, an integer or a table with one word. Out: :class:`ModeSelection`, and the
effective interface mass by which modes are told apart. With Psi the constraint modes and phi_k a
fixed-interface mode of unit modal mass, P_k = phi_k^T M Psi; the sum of P_k^T P_k over all modes is
X^T M_ii^-1 X, X = (M Psi)_i. The share of a mode is the mean over the interfaces' motions of its
part of that diagonal. Source: Kammer, Triller (1996), Journal of Vibration and Acoustics 118(3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.flexbody.arrays import FloatArray

ModesLike = int | Mapping[str, Any]

_WORDS = ("count", "frequency", "effective_mass")


@dataclass(frozen=True)
class ModeSelection:
    """Which modes are kept: one of three.

    Parameters
    ----------
    count : int, optional
        So many of the lowest.
    frequency : float, optional
        All below that frequency [Hz].
    effective_mass : float, optional
        As few as hold that share, 0 to below 1, of the effective interface mass.
    """

    count: int | None = None
    frequency: float | None = None
    effective_mass: float | None = None


def mode_selection(given: ModesLike | ModeSelection) -> ModeSelection:
    """The choice that was meant.

    Raises
    ------
    ReductionError
        No whole number, an unknown word, none or several words, or a value that cannot be.
    """
    if isinstance(given, ModeSelection):
        return given
    if not isinstance(given, Mapping):
        if not _whole(given):
            _raise_problem("modes", f"must be a whole number >= 0, given {given!r}")
        return ModeSelection(count=int(given))
    for key in given:
        if key not in _WORDS:
            _raise_problem(f"modes.{key}", "unknown key", _WORDS, nearest(str(key), _WORDS))
    if len(given) != 1:
        _raise_problem("modes", f"takes one of {', '.join(_WORDS)}, given {len(given)}")
    (word, value), *_ = given.items()
    if word == "count" and not _whole(value):
        _raise_problem("modes.count", f"must be a whole number >= 0, given {value!r}")
    if word == "frequency" and not (_real(value) and value > 0):
        _raise_problem("modes.frequency", f"must be a positive number [Hz], given {value!r}")
    if word == "effective_mass" and not (_real(value) and 0 < value < 1):
        _raise_problem("modes.effective_mass", f"must be a share between 0 and 1, given {value!r}")
    return ModeSelection(**{word: value})


def interface_shares(held: FixedInterfaceModel, V: FloatArray) -> FloatArray:
    """(k,) share of each fixed-interface mode in the effective interface mass; all sum to one.

    Parameters
    ----------
    held : Held
        The model with its interfaces held.
    V : (i, k) float
        Modes of unit modal mass over the held body's own degrees of freedom.
    """
    X = (held.fe.M @ held.modes)[held.dofs]
    total = np.sum(X * held.mass_solve(X), axis=0)
    counted = total > 1e-12 * np.diag(held.modes.T @ (held.fe.M @ held.modes))
    return np.asarray(((V.T @ X)[:, counted] ** 2 / total[counted]).sum(axis=1) / counted.sum())


def smallest_set(shares: FloatArray, wanted: float) -> FloatArray:
    """Rows, ascending, of the fewest modes that together hold the wanted share; all if too few."""
    order = np.argsort(-shares, kind="stable")
    count = int(np.searchsorted(np.cumsum(shares[order]), wanted)) + 1
    return np.sort(order[:count])


def _whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= 0


def _real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)


def _raise_problem(
    where: str, what: str, allowed: tuple[str, ...] = (), near: tuple[str, ...] = ()
) -> None:
    raise ReductionError.from_problems([Problem(where, what, allowed, near)])
