"""Equations of small motions in modal coordinates, integrated from row to row.

The coefficients of M ÿ + D ẏ + K y = load change along a motion. They are averaged over each
interval between rows, and the solution there is exact (exponential integrator, loads linear in
time), so that modes much faster than the rows vibrate and resonate correctly. Such a mode vibrates
about its equilibrium with the loads and the accelerations of slow modes. This equilibrium moves
with the coefficients; averaged ones would make it jump and excite the mode. So the deviation from
it is carried over from row to row (adiabatic motion).

The exponential of a matrix times a vector is a Chebyshev series in the matrix, for frequencies
within a radius: about as many products as there are radians in the step, and some thirty more. A
series with terms that grow would lose digits: the radius is too small, or damping is strong. Then
the radius is increased, and in the end the exponential of the whole matrix is computed.

Sources: Hochbruck & Ostermann, Acta Numerica 19 (2010) 209, on exponential integrators; Tal-Ezer &
Kosloff, J. Chem. Phys. 81 (1984) 3967, on the series.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.effects.independent_coordinates import CondensedMotions, IndependentMotions
from flexmb.analysis.effects.smooth_pieces import SmoothPieces
from flexmb.analysis.effects.stored_motion import blocks
from flexmb.analysis.effects.variational_equations import times
from flexmb.engine.algebra.exponential import put_exponential
from flexmb.engine.compiled_units import bind, interpreted
from flexmb.flexbody.arrays import Array

UNRESOLVED = 1.0
"""Phase of a vibration between two rows above which they do not resolve it [rad]."""
_ROUNDS = 2  # iterations for the slow motion of unresolved vibrations
_UNBOUNDED = 1e12  # small motion over the size of the model at which the integration ends
_GROWTH = 1e4  # largest term of a series over the vector: so many times round-off is lost
_WIDER = 1.25  # factor between radii
_MOST_WIDENINGS = 4
_MOST_RADIANS = 1000.0  # phase of a step above which the whole matrix costs less
_FAILURES = 10  # successive steps without a series after which none is tried


class ModalEquations:
    """Equations of y = T η with modal frequencies ω; rows do not resolve the `quick` modes.

    Parameters
    ----------
    pieces : SmoothPieces
        Times of the rows, and jumps between them.
    made : IndependentMotions or CondensedMotions
        Equations of d independent coordinates y.
    omega, T : (d,) and (d, d) arrays
        Frequencies [rad/s] and mode shapes of these.
    """

    def __init__(
        self, pieces: SmoothPieces, made: IndependentMotions | CondensedMotions, omega: Array,
        T: Array,
    ) -> None:  # fmt: skip
        self._pieces, self.omega, self.T = pieces, omega, T
        self.M, self.D, self.K = (_transformed(A, T) for A in (made.M, made.D, made.K))
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
        (n, u), t, (leave, arrive), quick = load.shape, self._pieces.t, carried, self.quick
        lead = np.append(~np.tile(quick, 2), True)
        steps = ExponentialSteps(t, A, _loads(inverse, load, self.omega), self.omega, quick)
        for k in range(n - 1):
            now = np.append(x[k], (1.0, 0.0))
            now[:u][quick] += leave[k] @ now[:-1][lead]
            now = steps.take(k, now)
            now[:u][quick] += arrive[k] @ now[:-1][lead]
            x[k + 1] = now[: 2 * u] - jumps[k + 1]
            if not np.abs(self.T @ x[k + 1, :u]).max(initial=0.0) < _UNBOUNDED:
                x[k + 1 :] = 0.0
                return k + 1
        return len(x)


def _transformed(A: Array, T: Array) -> Array:
    """Tᵀ A T of each row."""
    made = np.zeros((len(A), *2 * T.shape[1:]))
    for part in blocks(len(A)):
        made[part] = T.T @ (A[part] @ T)
    return made


def _loads(inverse: Array, load: Array, omega: Array) -> Array:
    """M⁻¹ f/ω (n - 1, 2, d) at the beginning of each interval, and its change until the end."""
    both = np.stack([load[:-1], np.diff(load, axis=0)], axis=1)
    return np.asarray(both @ inverse.transpose(0, 2, 1) / omega)


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


class ExponentialSteps:
    """Steps of ẋ = A x + (0, f), x = (η, η̇/ω), from one row to the next.

    Parameters
    ----------
    t : (n,) array
        Times of the rows.
    A : (n - 1, 2 d, 2 d) array
        Coefficients of each step.
    loads : (n - 1, 2, d) array
        f at the beginning of each step, and its change until the end.
    omega : (d,) array
        Frequencies ω.
    plain : (d,) array of bool
        The η whose rate is ω times their η̇/ω and nothing else.
    """

    def __init__(
        self, t: Array, A: Array, loads: Array, omega: Array, plain: NDArray[np.bool_]
    ) -> None:
        self._h, self._A, self._loads, d = np.diff(t), A, loads, len(omega)
        h = float(self._h.max())
        push = float(np.abs(loads * omega).max(initial=0.0)) * h**2
        phases = np.append(np.maximum(omega * h, 1.0), omega * h)
        weights = np.append(phases, np.maximum([push, push], np.finfo(float).tiny))
        radii = np.max(omega * h, initial=1.0) * _WIDER ** np.arange(1, _MOST_WIDENINGS + 1)
        self._radii = radii[(radii < _MOST_RADIANS) & (not interpreted())]
        coefficients = _coefficients(self._radii)
        self._terms = [int(np.flatnonzero(row)[-1]) + 1 for row in coefficients]
        self._wide, self._failed = 0, 0
        self._x, work = np.zeros(2 * d + 2), np.zeros((4, 2 * d + 2))
        self._step = bind(
            put_exponential, np.ascontiguousarray(A), np.ascontiguousarray(loads), omega,
            plain.astype(np.int64), weights, coefficients, self._x, work,
        )  # fmt: skip

    def take(self, k: int, x: Array) -> Array:
        """(η, η̇/ω, 1, 1) at the end of step k from (η, η̇/ω, 1, 0) at its beginning."""
        h = float(self._h[k])
        self._x[:] = x
        while self._wide < len(self._radii) and self._failed < _FAILURES:
            series = self._terms[self._wide], h, float(self._radii[self._wide])
            if self._step(_GROWTH, k, self._wide, *series) < _GROWTH:
                self._failed = 0
                return self._x.copy()
            self._wide += 1
        if self._wide == len(self._radii):  # the coefficients of the next step may be others
            self._wide, self._failed = 0, self._failed + 1
        return self._whole(k, x)

    def _whole(self, k: int, x: Array) -> Array:
        """The same by the exponential of the matrix."""
        from scipy.linalg import expm

        n, h = len(x) - 2, self._h[k]
        step = np.zeros((n + 2, n + 2))
        step[:n, :n] = h * self._A[k]
        step[n // 2 : n, n:] = h * self._loads[k].T
        step[n + 1, n] = 1.0
        return np.asarray(expm(step) @ x)


def _coefficients(radii: Array) -> Array:
    """Of the Chebyshev series of exp(i r z) for each radius r, without those below round-off."""
    from scipy.special import jv

    most = int(1.5 * radii.max(initial=1.0) + 60.0)
    made = 2.0 * jv(np.arange(most), radii[:, None])
    made[:, 0] *= 0.5
    tail = np.abs(made[:, ::-1]).cumsum(axis=1)[:, ::-1]
    return np.ascontiguousarray(np.where(tail > 0.01 * np.finfo(float).eps / _GROWTH, made, 0.0))
