"""Equations of small motions in modal coordinates, integrated from row to row.

The coefficients of M ÿ + D ẏ + K y = load change along a motion. They are averaged over each
interval between rows, and the solution there is exact (exponential integrator, loads linear in
time), so that modes much faster than the rows vibrate and resonate correctly. Such a mode vibrates
about its equilibrium with the loads and the accelerations of slow modes. This equilibrium moves
with the coefficients; averaged ones would make it jump and excite the mode. So the deviation from
it is carried over from row to row (adiabatic motion).

Source: Hochbruck & Ostermann, Acta Numerica 19 (2010) 209, on exponential integrators.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.effects.independent_coordinates import IndependentMotions
from flexmb.analysis.effects.smooth_pieces import SmoothPieces
from flexmb.analysis.effects.stored_motion import blocks
from flexmb.analysis.effects.variational_equations import times
from flexmb.flexbody.arrays import Array

UNRESOLVED = 1.0
"""Phase of a vibration between two rows above which they do not resolve it [rad]."""
_ROUNDS = 2  # iterations for the slow motion of unresolved vibrations
_UNBOUNDED = 1e12  # small motion over the size of the model at which the integration ends


class ModalEquations:
    """Equations of y = T η with modal frequencies ω; rows do not resolve the `quick` modes.

    Parameters
    ----------
    pieces : SmoothPieces
        Times of the rows, and jumps between them.
    made : IndependentMotions
        Equations of d independent coordinates y.
    omega, T : (d,) and (d, d) arrays
        Frequencies [rad/s] and mode shapes of these.
    """

    def __init__(
        self, pieces: SmoothPieces, made: IndependentMotions, omega: Array, T: Array
    ) -> None:
        self._pieces, self.omega, self.T = pieces, omega, T
        self.M, self.D, self.K = (T.T @ A @ T for A in (made.M, made.D, made.K))
        self.load = made.load @ T
        self.quick = omega * np.median(np.diff(pieces.t)) > UNRESOLVED

    def integrate(self, y: Array, yd: Array) -> tuple[Array, int]:
        """η, η̇ and η̈ (3, n, d) with given first values; number of bounded rows."""
        M, D, K, w, quick, pieces = self.M, self.D, self.K, self.omega, self.quick, self._pieces
        slow, load = self._slow_motion()
        n, u = load.shape
        x = np.zeros((n, 2 * u))
        x[0] = np.concatenate([y - slow[0, 0], (yd - slow[1, 0]) / w])
        Mm, Dm, Km = (0.5 * (C[1:] + C[:-1]) for C in (M, D, K))  # symmetric means create no energy
        A, inverse = _first_order(Mm, Dm, Km, w)
        is_slow = ~np.tile(quick, 2)
        if is_slow.any():
            resolved = np.ix_(np.arange(n - 1), is_slow, is_slow)
            A[resolved] += pieces.series(_first_order(M, D, K, w, ~quick)[0])
        jumps = pieces.jumps(slow[0], slow[1]), pieces.jumps(slow[1], slow[2]) / w
        rows = _equilibria(M, D, K, load[:, :, None], w, quick)
        moved = _equilibria(Mm, Dm, Km, np.stack([load[:-1], load[1:]], axis=2), w, quick)
        carried = moved[:, :, :-1] - rows[:-1], rows[1:] - np.delete(moved, -2, axis=2)
        bounded = self._propagate(x, load, A, inverse, carried, np.concatenate(jumps, axis=1))
        y, yd = x[:, :u], x[:, u:] * w
        load = load - times(K, y) - times(D, yd)
        return slow + [y, yd, np.linalg.solve(M, load[..., None])[..., 0]], bounded

    def _slow_motion(self) -> tuple[Array, Array]:
        """Slow motion of the quick modes (3, n, d), and the loads without those of it (n, d)."""
        n, u = self.load.shape
        load, slow, quick = self.load, np.zeros((3, n, u)), self.quick
        inner = np.ix_(np.arange(n), quick, quick)
        for _ in range(_ROUNDS):
            y = np.zeros((n, u))
            y[:, quick] = least_squares_solution(self.K[inner], load[:, quick, None])[..., 0]
            motion = np.array([y, self._pieces.rate(y), self._pieces.rate(y, 2)])
            load = load - sum(map(times, (self.K, self.D, self.M), motion))
            slow += motion
        return slow, load

    def _propagate(
        self, x: Array, load: Array, A: Array, inverse: Array, carried: tuple[Array, Array],
        jumps: Array,
    ) -> int:  # fmt: skip
        """Integrate x = (η, η̇/ω) from its first row on, in place; number of bounded rows."""
        from scipy.linalg import expm

        (n, u), t, (leave, arrive), quick = load.shape, self._pieces.t, carried, self.quick
        lead = np.append(~np.tile(quick, 2), True)
        for k in range(n - 1):
            h = t[k + 1] - t[k]
            step = np.zeros((2 * u + 2, 2 * u + 2))
            step[: 2 * u, : 2 * u] = h * A[k]
            step[u : 2 * u, 2 * u] = h * (inverse[k] @ load[k]) / self.omega
            step[u : 2 * u, 2 * u + 1] = h * (inverse[k] @ (load[k + 1] - load[k])) / self.omega
            step[2 * u + 1, 2 * u] = 1.0
            now = np.append(x[k], (1.0, 0.0))
            now[:u][quick] += leave[k] @ now[:-1][lead]
            now = expm(step) @ now
            now[:u][quick] += arrive[k] @ now[:-1][lead]
            x[k + 1] = now[: 2 * u] - jumps[k + 1]
            if not np.abs(self.T @ x[k + 1, :u]).max(initial=0.0) < _UNBOUNDED:
                x[k + 1 :] = 0.0
                return k + 1
        return len(x)


def _equilibria(
    M: Array, D: Array, K: Array, load: Array, omega: Array, quick: NDArray[np.bool_]
) -> Array:
    """Equilibria (n, q, 2 s + r) of q quick modes, per (y, ẏ/ω) of the s others and r loads.

    They are in equilibrium with the loads and the accelerations of the other modes.
    """
    slow = ~quick
    both = np.where(quick, K, M)  # for positions of quick modes, accelerations of the others
    others = np.concatenate([K[:, :, slow], D[:, :, slow] * omega[slow], -load], axis=2)
    return -least_squares_solution(both, others)[:, quick]


def least_squares_solution(A: Array, b: Array) -> Array:
    """x of A x = b; of least norm if A is singular, as with an open contact."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(A) @ b)


def _first_order(
    M: Array, D: Array, K: Array, omega: Array, of: NDArray[np.bool_] | slice = slice(None)
) -> tuple[Array, Array]:
    """A (n, 2 d, 2 d) of ẋ = A x + (0, M⁻¹ f/ω), x = (y, ẏ/ω), and M⁻¹, for some of the y."""
    n, w = len(M), omega[of]
    d = len(w)
    inverse, A = np.zeros_like(M), np.zeros((n, 2 * d, 2 * d))
    A[:, :d, d:] = np.diag(w)
    for part in blocks(n):
        inverse[part] = np.linalg.inv(M[part])
        own = -inverse[part][:, of] / w[:, None]
        A[part, d:, :d] = own @ K[part][:, :, of]
        A[part, d:, d:] = own @ D[part][:, :, of] * w
    return A, inverse
